//! The AoI clock: a decentralised protocol in which a vehicle's own age is its clock.
//!
//! A vehicle sends on its home sub-channel whenever its age is a multiple of its group's period, so the group's members take
//! turns without any message between them. After a fade it waits a whole period, which keeps its turn. A vehicle that has
//! lost its turn joins anew: with the broadcast probability, drawn from its own fading, at one of four received levels,
//! chosen low so that a vehicle in its turn captures the receiver.

use super::{Decider, Kind, Needs, Policy, power_plan};
use crate::decisions::VehicleDecisions;
use crate::senses::Senses;
use firmware::decision::{Action, JOINER_LEVELS, PowerPlan};
use firmware::observation::Observation;
use firmware::units::Level;

/// The clock for all vehicles.
pub static KIND: Kind = Kind {
    name: "clock",
    meaning: "The AoI clock, the rules that the network imitates: a vehicle sends when its age is a multiple of its period.",
    stream: 2,
    needs: Needs::Groups,
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
                let observation = Observation::new(&measurement);
                let action = act(&observation, self.required);
                decisions.set(lane, self.power_plan.decision(action, &observation));
            }
        }
    }
}

/// What the clock does: the expert that networks imitate.
pub fn act(observation: &Observation, required: Level) -> Action {
    if observation.home_gain() < required {
        return Action::Silent;
    }
    // Two strong vehicles on one turn would collide for ever: they part. Weak ones are more likely faded, and keep it.
    if observation.turn_lost() || (observation.overdue() && observation.strong()) {
        // Below the joiner probability the thinned draw is uniform again, so it also chooses the level.
        let draw = observation.thinned_uniform();
        return match (draw as usize * JOINER_LEVELS) >> 16 {
            index if index < JOINER_LEVELS => Action::JOINERS[index],
            _ => Action::Silent,
        };
    }
    if observation.own_turn() {
        Action::FullPower
    } else {
        Action::Silent
    }
}
