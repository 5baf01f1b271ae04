//! The firmware's actor: it decides for a row of worlds at a time, with the bits of the firmware's library.
//!
//! Encoding, choice and power are the library's own lines, called lane by lane. The network's products alone are written anew for
//! rows of worlds (`network`), and `tests/environment.rs` compares them with the library's. A unit that has a measurement in every
//! slot decides by the actor alone, so no state is kept. For tables of other forms than the shipped one's, and for vehicles with tables of their own, `forms` puts
//! the library's own encoders and decoders around the network. In a single world the lanes are vehicles (`single`). Where modems may
//! measure nothing, and in a single world whose vehicles have tables of their own, `units` decide.

mod forms;
mod network;
mod observation;
mod single;
mod units;

use super::{Decider, Kind, Needs, Policy, Setup};
use crate::decisions::{SILENT, VehicleDecisions};
use crate::lanes::{LANES, Row};
use crate::senses::{Broadcasts, Senses};
use firmware::decision::{Action, PowerPlan, power};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::{INPUTS, NOWHERE};
use firmware::table::Table;
use firmware::units::Dbm;
use network::LaneNetwork;
pub use observation::Encoder;
use observation::View;

/// The frozen int8 network in every vehicle.
pub static KIND: Kind = Kind {
    name: "actor",
    meaning: "The frozen int8 network, one in each vehicle, on the firmware's own code.",
    stream: 0,
    needs: Needs::Table,
    build: |setup, table| Decider::Policy(build(setup, std::slice::from_ref(table))),
};

/// The actors in the way that fits the worlds: with one table for all vehicles, or one for each.
pub fn build<'t>(setup: &Setup<'_>, tables: &'t [Table<'t>]) -> Box<dyn Policy + 't> {
    let misses = setup.scenario.feedback.measurement_loss > 0.0;
    if misses {
        return Box::new(units::Units::new(tables, setup));
    }
    match tables {
        [table] if setup.worlds() == 1 => Box::new(single::SingleWorld::new(table, setup.vehicles)),
        _ if setup.worlds() == 1 => Box::new(units::Units::new(tables, setup)),
        [table]
            if table.observation_form() == ObservationForm::Ring
                && table.output_form() == OutputForm::Actions =>
        {
            Box::new(LaneActor::new(table))
        }
        _ => Box::new(forms::FormActors::new(tables)),
    }
}

/// Which table is a vehicle's own; with one table, everybody's.
fn table_index(tables: &[Table<'_>], vehicle: usize) -> usize {
    vehicle.min(tables.len().saturating_sub(1))
}

/// Decides for a row of worlds at a time.
pub struct LaneActor {
    encoder: Encoder,
    inputs: [Row<i32>; INPUTS],
    network: LaneNetwork,
    power_plan: PowerPlan,
}

impl LaneActor {
    /// An actor that runs this table, of the shipped one's form.
    pub fn new(table: &Table<'_>) -> Self {
        Self {
            encoder: Encoder::new(table.required_sinr()),
            inputs: [[0; LANES]; INPUTS],
            network: LaneNetwork::new(table),
            power_plan: *table.power_plan(),
        }
    }
}

impl Policy for LaneActor {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        self.encoder.hear(broadcasts);
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let vectors = senses.vectors();
        vectors.run(
            #[inline(always)]
            || {
                let view = self.encoder.view(senses);
                self.encoder.encode(&view, &mut self.inputs);
                let actions = self.network.choose(vectors, &self.inputs);
                set(&self.encoder, &self.power_plan, &view, &actions, decisions);
            },
        );
    }
}

/// Carries out actions that somebody else chose for a vehicle in the row of worlds that the encoder heard last.
pub fn carry_out(
    encoder: &Encoder,
    plan: &PowerPlan,
    senses: &Senses<'_>,
    actions: &Row<i32>,
    decisions: &mut VehicleDecisions<'_>,
) {
    senses.vectors().run(
        #[inline(always)]
        || set(encoder, plan, &encoder.view(senses), actions, decisions),
    );
}

#[inline(always)]
fn set(
    encoder: &Encoder,
    plan: &PowerPlan,
    view: &View,
    actions: &Row<i32>,
    decisions: &mut VehicleDecisions<'_>,
) {
    *decisions.sub_channel = sub_channels(view, actions);
    *decisions.power = powers(plan, encoder.max_power(), view, actions);
}

/// All bits set where this action is the chosen one. Of a choice between two rows the compiler makes one between their addresses, lane
/// after lane.
#[inline(always)]
fn mask(chosen: i32, action: Action) -> i32 {
    i32::from(chosen == action as i32).wrapping_neg()
}

/// Where an action sends: its own place's sub-channel, the best one to contend on, the best one of others, or nowhere.
#[inline(always)]
fn sub_channels(view: &View, actions: &Row<i32>) -> Row<u8> {
    let mut chosen = [0; LANES];
    for lane in 0..LANES {
        let silent = mask(actions[lane], Action::Silent);
        // All bits set, as in no sub-channel.
        const _: () = assert!(SILENT == u8::MAX && NOWHERE as u8 == SILENT);
        let own = mask(actions[lane], Action::FullPower);
        let guest = mask(actions[lane], Action::Guest);
        let best = view.best[lane] & !(own | guest);
        let sub_channel = best | view.own[lane] & own | view.guest[lane] & guest;
        chosen[lane] = (sub_channel | silent) as u8;
    }
    chosen
}

/// Powers in 1/256 dBm as [`PowerPlan::decision`] gives them; without meaning for silence.
#[inline(always)]
fn powers(plan: &PowerPlan, max_power: Dbm, view: &View, actions: &Row<i32>) -> Row<i16> {
    let aims = Action::ALL.map(|action| i32::from(plan.aim(action).to_bits()));
    let mut powers = [0; LANES];
    for lane in 0..LANES {
        let mut chosen = 0;
        for (action, &aim) in Action::ALL.into_iter().zip(&aims) {
            chosen = if actions[lane] == action as i32 {
                aim
            } else {
                chosen
            };
        }
        let guest = mask(actions[lane], Action::Guest);
        let gain = view.guest_gain[lane] & guest | view.best_gain[lane] & !guest;
        // At full power no gain is reduced.
        powers[lane] = power(max_power, gain, chosen) as i16;
    }
    powers
}
