//! The firmware's actor: it decides for a row of worlds at a time, with the bits of the firmware's library.
//!
//! Encoding, choice and power are the library's own lines, called lane by lane. The network's products alone are written anew for
//! rows of worlds (`network`), and `tests/environment.rs` compares them with the library's. A unit that has a measurement in every
//! slot decides by the actor alone, so no state is kept. For tables of other forms than the shipped one's, and for vehicles with tables of their own, `forms` puts
//! the library's own encoders and decoders around the network. In a single world the lanes are vehicles (`single`). Where modems may
//! measure nothing, and in a single world whose vehicles have tables of their own, `units` decide.

mod forms;
mod network;
mod single;
mod units;

use super::{Decider, Kind, Needs, Observer, Policy, Setup, actions};
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, Row};
use crate::senses::{Broadcasts, Senses};
use firmware::decision::PowerPlan;
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::INPUTS;
use firmware::table::Table;
use network::LaneNetwork;

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
    observer: Observer,
    inputs: [Row<i32>; INPUTS],
    network: LaneNetwork,
    power_plan: PowerPlan,
}

impl LaneActor {
    /// An actor that runs this table, of the shipped one's form.
    pub fn new(table: &Table<'_>) -> Self {
        Self {
            observer: Observer::new(table.required_sinr()),
            inputs: [[0; LANES]; INPUTS],
            network: LaneNetwork::new(table),
            power_plan: *table.power_plan(),
        }
    }
}

impl Policy for LaneActor {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        self.observer.hear(broadcasts);
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let vectors = senses.vectors();
        vectors.run(
            #[inline(always)]
            || {
                let view = self.observer.view(senses);
                self.observer.encode(&view, &mut self.inputs);
                let chosen = self.network.choose(vectors, &self.inputs);
                actions::set(&self.observer, &self.power_plan, &view, &chosen, decisions);
            },
        );
    }
}
