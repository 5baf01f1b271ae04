//! What a slot of the cell costs the vehicles of a group, and what the critic knows of the group.

use super::central::{GROUP_COUNTS, GroupCounts};
use crate::game::cell::{Outcome, Rules, Sensed};
use firmware::observation::Observation;
use firmware::units::SUB_CHANNELS;

/// What a vehicle's reward is made of.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    /// Weight of each other group member's cost next to the own.
    pub team: f32,
    /// Cost of a slot: the age in periods, at most this.
    pub most_periods: f32,
    /// Cost of a transmission. Where everybody sends and nobody is heard, only this tells anybody to stop.
    pub transmission: f32,
    /// Rewards are multiplied by this; 1 less the discount makes a value a mean cost.
    pub scale: f32,
}

impl Costs {
    /// Of how many members' costs the reward of one of so many is a mean.
    fn weight(&self, members: f32) -> f32 {
        1.0 + self.team * (members - 1.0)
    }
}

impl Rules for Costs {
    fn extra(&self) -> usize {
        GROUP_COUNTS
    }

    fn know<'r>(&self, world: &[Option<Sensed>], extras: impl Iterator<Item = &'r mut [f32]>) {
        let observations = || {
            world
                .iter()
                .map(|sensed| sensed.as_ref().map(|sensed| &sensed.observation))
        };
        let counts = GroupCounts::new(observations().flatten());
        for (observation, extra) in observations().zip(extras) {
            if let Some(observation) = observation {
                counts.write(observation, extra);
            }
        }
    }

    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        let cost = |outcome: &Outcome| {
            let periods = f32::from(outcome.age.slots()) / f32::from(outcome.observation.period().slots());
            periods.min(self.most_periods)
        };
        let mut groups = [(0.0_f32, 0.0_f32); SUB_CHANNELS];
        for outcome in world.iter().flatten() {
            let (members, sum) = &mut groups[outcome.observation.home().index()];
            *members += 1.0;
            *sum += cost(outcome);
        }
        for (outcome, reward) in world.iter().zip(rewards) {
            let Some(outcome) = outcome else { continue };
            let sent = if outcome.sent { self.transmission } else { 0.0 };
            let (members, sum) = groups[outcome.observation.home().index()];
            let own = cost(outcome);
            *reward = -(own + sent + self.team * (sum - own)) / self.weight(members) * self.scale;
        }
    }

    fn parts(&self, world: &[Option<Sensed>], parts: &mut [f32]) {
        let home = |observation: &Observation| observation.home().index();
        let mut members = [0.0_f32; SUB_CHANNELS];
        for sensed in world.iter().flatten() {
            members[home(&sensed.observation)] += 1.0;
        }
        for (sensed, part) in world.iter().zip(parts) {
            *part = sensed.map_or(1.0, |sensed| self.weight(members[home(&sensed.observation)]));
        }
    }
}
