//! The firmware's actor: it decides for a row of worlds at a time, with the bits of the firmware's library.
//!
//! The library is the specification: `observation` and `network` only do the same for many worlds side by side, and
//! `tests/actor_parity.rs` compares. A unit that has a measurement in every slot decides by the actor alone, so no state
//! is kept; where a group can be too large for a broadcast, `units` decide.

mod network;
mod observation;
mod units;

use super::Policy;
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::lanes::{LANES, Row};
use firmware::decision::{Action, Decision, PowerPlan};
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::units::Period;
use network::LaneNetwork;
pub use observation::Encoder;

/// The actor in the way that fits the environment.
pub fn build<'t>(environment: &Environment<'_>, table: &'t Table<'t>) -> Box<dyn Policy + 't> {
    if environment.most_vehicles() <= usize::from(Period::MAX) {
        Box::new(LaneActor::new(table))
    } else {
        Box::new(units::Units::new(table, environment))
    }
}

/// Decides for a row of worlds at a time. Every group must be small enough for a broadcast.
pub struct LaneActor {
    encoder: Encoder,
    network: LaneNetwork,
    power_plan: PowerPlan,
}

impl LaneActor {
    /// An actor that runs this table.
    pub fn new(table: &Table<'_>) -> Self {
        Self {
            encoder: Encoder::new(table.required_sinr()),
            network: LaneNetwork::new(table),
            power_plan: *table.power_plan(),
        }
    }

    /// What a vehicle does in every world of a block, as indices of [`Action::ALL`].
    #[inline(always)]
    fn act(&mut self, environment: &Environment<'_>, block: usize, vehicle: usize) -> Row<u8> {
        self.encoder
            .encode(environment, block, vehicle, self.network.inputs());
        self.network.infer(environment.vectors())
    }
}

impl Policy for LaneActor {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        for block in 0..environment.ages().blocks() {
            let worlds = (environment.worlds() - block * LANES).min(LANES);
            for &vehicle in environment.present() {
                let actions = environment.vectors().run(
                    #[inline(always)]
                    || self.act(environment, block, vehicle),
                );
                for (lane, action) in actions.into_iter().enumerate().take(worlds) {
                    if action == Action::Silent as u8 {
                        continue;
                    }
                    let world = block * LANES + lane;
                    let decision = environment.measurement(world, vehicle).map(|measurement| {
                        let action = Action::ALL[usize::from(action)];
                        self.power_plan.decision(action, &Observation::new(&measurement))
                    });
                    decisions.set(world, vehicle, decision.unwrap_or(Decision::Silent));
                }
            }
        }
    }
}
