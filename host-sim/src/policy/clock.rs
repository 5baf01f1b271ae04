//! The ring clock, as [`firmware::clock`] defines it, in every vehicle.

use super::{Decider, Kind, Needs, Policy, power_plan};
use crate::decisions::VehicleDecisions;
use crate::senses::Senses;
use firmware::clock;
use firmware::decision::PowerPlan;
use firmware::lots::Identity;
use firmware::observation::Observation;
use firmware::units::Level;

/// The clock for all vehicles.
pub static KIND: Kind = Kind {
    name: "clock",
    meaning: "The ring clock, the rules that the network imitates: a vehicle sends when its place comes round.",
    stream: 2,
    needs: Needs::Ring,
    build: |setup, _| {
        Decider::Policy(Box::new(Clock {
            power_plan: power_plan(setup.scenario),
            required: setup.scenario.radio.required_level(),
        }))
    },
};

struct Clock {
    power_plan: PowerPlan,
    required: Level,
}

impl Policy for Clock {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        for lane in 0..senses.worlds() {
            if let Some(measurement) = senses.measurement(lane) {
                let observation = Observation::new(&measurement, Identity(senses.identities()[lane]));
                let action = clock::act(&observation, self.required);
                decisions.set(lane, self.power_plan.decision(action, &observation));
            }
        }
    }
}
