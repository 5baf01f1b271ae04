//! What vehicles are paid for: rewards by name, for every learner and for Python, and what an age is worth.
//!
//! One more is a name here and what it pays.

use super::cell::{Outcome, Rules, Sensed};
use firmware::units::Age;
use kit::choice::Choice as _;
use kit::choices;
use kit::error::Result;

choices! {
    /// What vehicles are paid for, by name.
    pub enum RewardName {
        /// Its own age over 100 slots
        Own = "own",
        /// The mean of this over its world's vehicles
        Team = "team",
        /// The paper's own reward: its age over the number of vehicles, and what a reception adds
        Paper = "paper",
    }
}

/// Stands for what an algorithm's own keys say.
const OF_THE_ALGORITHM: &str = "algorithm";

/// What the key of rewards may say, with meanings.
pub fn keyed() -> Vec<(&'static str, &'static str)> {
    let own = (OF_THE_ALGORITHM, "What the algorithm's own keys say");
    let named = RewardName::ALL.iter().map(|name| (name.name(), name.meaning()));
    std::iter::once(own).chain(named).collect()
}

/// The reward that the key of this name says; `None` for what the algorithm's own keys say.
///
/// # Errors
/// Another name.
pub fn of_key(key: &str, said: &str) -> Result<Option<RewardName>> {
    (said != OF_THE_ALGORITHM)
        .then(|| RewardName::of_name(key, said))
        .transpose()
}

/// What the success of a slot adds to the paper's reward.
const PAPER_SUCCESS: f32 = 0.05;

/// A reward by name, in worlds of so many vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reward {
    /// What a vehicle's own age is worth.
    pub own: AgeReward,
    /// Whether everybody in a world gets the mean.
    pub shared: bool,
}

impl Reward {
    /// Of this name.
    pub fn new(name: RewardName, vehicles: usize) -> Self {
        let most = f32::from(Age::TIME_CONSTRAINT.slots());
        let (scale, success) = match name {
            RewardName::Own | RewardName::Team => (most, 0.0),
            RewardName::Paper => (vehicles as f32, PAPER_SUCCESS),
        };
        Self {
            own: AgeReward {
                scale,
                cap: most,
                success,
            },
            shared: name == RewardName::Team,
        }
    }

    /// Writes the rewards of a world's vehicles; they are zeros beforehand.
    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        let own = |outcome: &Outcome| self.own.of(outcome.age, outcome.received);
        let present = world.iter().flatten();
        let mean = present.clone().map(own).sum::<f32>() / present.count().max(1) as f32;
        for (outcome, reward) in world.iter().zip(rewards) {
            if let Some(outcome) = outcome {
                *reward = if self.shared { mean } else { own(outcome) };
            }
        }
    }
}

/// An algorithm's rules, with a reward by name where one is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Paying<R> {
    /// What the algorithm would do.
    pub rules: R,
    /// The name.
    pub name: Option<RewardName>,
    /// A named reward is multiplied by this.
    pub scale: f32,
}

impl<R: Rules> Rules for Paying<R> {
    fn extra(&self) -> usize {
        self.rules.extra()
    }

    fn know<'r>(&self, world: &[Option<Sensed>], extras: impl Iterator<Item = &'r mut [f32]>) {
        self.rules.know(world, extras);
    }

    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        let Some(name) = self.name else {
            return self.rules.pay(world, rewards);
        };
        Reward::new(name, world.iter().flatten().count()).pay(world, rewards);
        rewards.iter_mut().for_each(|reward| *reward *= self.scale);
    }

    fn parts(&self, world: &[Option<Sensed>], parts: &mut [f32]) {
        match self.name {
            None => self.rules.parts(world, parts),
            Some(_) => parts.fill(1.0),
        }
    }
}

/// Minus the age, cut and scaled, and something for being received: the paper's own reward, and others of its kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgeReward {
    /// An age is divided by this.
    pub scale: f32,
    /// Larger ages, in slots, count as this.
    pub cap: f32,
    /// What being received adds.
    pub success: f32,
}

impl AgeReward {
    /// The reward of a vehicle with this age after the slot.
    pub fn of(&self, age: Age, received: bool) -> f32 {
        let age = f32::from(age.min(Age::TIME_CONSTRAINT).slots()).min(self.cap);
        -age / self.scale + if received { self.success } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rewards_by_hand() {
        let reward = AgeReward {
            scale: 20.0,
            cap: 50.0,
            success: 0.05,
        };
        assert_eq!(reward.of(Age::after(1), true), -1.0 / 20.0 + 0.05);
        assert_eq!(reward.of(Age::after(10), false), -10.0 / 20.0);
        assert_eq!(reward.of(Age::after(300), false), -50.0 / 20.0);
    }
    #[test]
    fn named_rewards_by_hand() {
        let of = |age, received| {
            Some(Outcome {
                observation: crate::game::cell::tests::observation(),
                sent: true,
                received,
                age: Age::after(age),
            })
        };
        let world = [of(1, true), None, of(9, false)];
        let paid = |name, scale| {
            let mut rewards = [0.0; 3];
            let rules = crate::game::cell::Unpaid;
            Paying { rules, name, scale }.pay(&world, &mut rewards);
            rewards
        };
        assert_eq!(paid(None, 1.0), [0.0; 3]);
        assert_eq!(paid(Some(RewardName::Own), 1.0), [-0.01, 0.0, -0.09]);
        assert_eq!(paid(Some(RewardName::Team), 2.0), [-0.1, 0.0, -0.1]);
        assert_eq!(paid(Some(RewardName::Paper), 1.0), [-0.5 + 0.05, 0.0, -4.5]);
        assert_eq!(of_key("reward", "algorithm").unwrap(), None);
        assert!(of_key("reward", "papr").is_err());
    }
}
