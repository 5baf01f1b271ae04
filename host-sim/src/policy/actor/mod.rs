//! The firmware's actor: it decides for a row of worlds at a time, with the bits of the firmware's library.
//!
//! The library is the specification: `observation`, `network` and the power below only do the same for many worlds side by
//! side, and `tests/environment.rs` compares. A unit that has a measurement in every slot decides by the actor alone, so
//! no state is kept. For tables of other forms than the shipped one's, and for vehicles with tables of their own, `forms` puts
//! the library's own encoders and decoders around the network. Where a group can be too large for a broadcast, `units` decide; so
//! they do for a single world, which is less work than a row of which one lane counts.

mod forms;
mod network;
mod observation;
mod units;

use super::{Decider, Kind, Needs, Policy, Setup};
use crate::decisions::{SILENT, VehicleDecisions};
use crate::lanes::{LANES, Row};
use crate::senses::{Broadcasts, Senses};
use firmware::decision::{ACTIONS, Action, JOINER_LEVELS, PowerPlan};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::INPUTS;
use firmware::table::Table;
use firmware::units::{Level, Period};
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
    let measured = setup.most_vehicles <= usize::from(Period::MAX);
    if setup.worlds() == 1 || !measured {
        return Box::new(units::Units::new(tables, setup));
    }
    match tables {
        [table]
            if table.observation_form() == ObservationForm::HomeFirst
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

/// Decides for a row of worlds at a time. Every group must be small enough for a broadcast.
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
                let actions = self.network.largest::<ACTIONS>(vectors, &self.inputs);
                *decisions.sub_channel = sub_channels(&view, &actions);
                *decisions.power = powers(&self.power_plan, &view, &actions);
            },
        );
    }
}

/// Home, or silence.
#[inline(always)]
fn sub_channels(view: &View, actions: &Row<i32>) -> Row<u8> {
    let mut chosen = [0; LANES];
    for lane in 0..LANES {
        let silent = i32::from(actions[lane] == Action::Silent as i32).wrapping_neg();
        // All bits set.
        const _: () = assert!(SILENT == u8::MAX);
        chosen[lane] = (view.home[lane] | silent) as u8;
    }
    chosen
}

/// Powers in 1/256 dBm as [`PowerPlan::decision`] gives them.
#[inline(always)]
fn powers(plan: &PowerPlan, view: &View, actions: &Row<i32>) -> Row<i16> {
    // No level is above the largest, so aiming there takes full power.
    let mut aims = [i32::from(Level::MAX.to_bits()); LANES];
    for joiner in 0..JOINER_LEVELS {
        let level = i32::from(plan.joiner_levels[joiner].to_bits());
        let action = Action::JOINERS[joiner] as i32;
        for lane in 0..LANES {
            let here = i32::from(actions[lane] == action).wrapping_neg();
            aims[lane] = (here & level) | (!here & aims[lane]);
        }
    }
    let max_power = i32::from(plan.max_power.to_bits());
    let mut powers = [0; LANES];
    for lane in 0..LANES {
        let reduction = (view.gain[0][lane] - aims[lane]).clamp(0, i32::from(i16::MAX));
        powers[lane] = (max_power - reduction).max(i32::from(i16::MIN)) as i16;
    }
    powers
}
