//! The ring clock, as [`firmware::clock`] defines it, in every vehicle; a row of worlds at a time.

use super::{Decider, Kind, Needs, Observer, Policy, actions, power_plan};
use crate::decisions::VehicleDecisions;
use crate::lanes::LANES;
use crate::senses::{Broadcasts, Senses};
use firmware::clock;
use firmware::decision::{Action, PowerPlan};

/// The clock for all vehicles.
pub static KIND: Kind = Kind {
    name: "clock",
    meaning: "The ring clock, the rules that the network imitates: a vehicle sends when its place comes round.",
    stream: 2,
    needs: Needs::Ring,
    build: |setup, _| {
        Decider::Policy(Box::new(Clock {
            observer: Observer::new(setup.scenario.radio.required_level()),
            power_plan: power_plan(setup.scenario),
        }))
    },
};

struct Clock {
    observer: Observer,
    power_plan: PowerPlan,
}

impl Policy for Clock {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        self.observer.hear(broadcasts);
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let observer = &self.observer;
        senses.vectors().run(
            #[inline(always)]
            || {
                let view = observer.view(senses);
                let mut chosen = [Action::Silent as i32; LANES];
                for lane in 0..LANES {
                    chosen[lane] = clock::choose(&observer.quantities(&view, lane), observer.required());
                }
                if let Some(measured) = senses.measured() {
                    for lane in 0..LANES {
                        chosen[lane] *= i32::from(measured[lane]);
                    }
                }
                actions::set(observer, &self.power_plan, &view, &chosen, decisions);
            },
        );
    }
}

// Who measures nothing is silent.
const _: () = assert!(Action::Silent as i32 == 0);
