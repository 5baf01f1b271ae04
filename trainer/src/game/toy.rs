//! A game small enough that its best play is known exactly: two vehicles take turns on one sub-channel.
//!
//! A learner that cannot find the best play here has a fault; one that finds it has proved little more than that.

use super::actions::ActionSpace;
use super::{Game, Shape, Tally};
use crate::network::categorical::largest;

/// The largest age.
const AGES: usize = 4;

/// Vehicles.
const AGENTS: usize = 2;

/// Values that a vehicle observes.
const OBSERVED: usize = 2 * AGES + 1;

/// Age of each vehicle in one world, in slots from 1.
type Ages = [usize; AGENTS];

/// Two vehicles, one sub-channel without fading. In every slot each stays silent (action 0) or sends (1). Who sends alone is
/// received, and its age becomes 1; every other age grows by one slot, up to 4. A vehicle's reward is minus its age
/// after the slot, unless [`Turns::paying`] says otherwise. World `w` starts from the `w mod 16`-th pair of ages, so 16 worlds see every start.
///
/// Both see both ages, and the second knows that it is the second: only so can equals agree who goes first.
#[derive(Clone, Debug)]
pub struct Turns {
    ages: Vec<Ages>,
    /// Whether both get the reward of their mean age.
    together: bool,
    /// What rewards are multiplied by.
    scale: f32,
}

impl Turns {
    /// That many worlds.
    pub fn new(worlds: usize) -> Self {
        Self {
            ages: (0..worlds).map(start).collect(),
            together: false,
            scale: 1.0,
        }
    }

    /// The same with rewards for minus the own age or, `together`, the mean of both, times `scale`.
    pub fn paying(self, together: bool, scale: f32) -> Self {
        Self {
            together,
            scale,
            ..self
        }
    }

    /// Mean age over the slots of an episode, from every start, of agents that choose the larger of two scores; `scores` gets what
    /// an agent observes, and its index.
    pub fn mean_age(slots: u32, scores: impl Fn(&[f32], usize) -> Vec<f32>) -> f64 {
        let mut turns = Self::new(AGES * AGES);
        let rows = turns.shape().rows();
        let (mut known, mut rewards) = (vec![0.0; rows * OBSERVED], vec![0.0; rows]);
        let mut tally = Tally::default();
        for _ in 0..slots {
            turns.know(&mut known);
            let agents = known.chunks_exact(OBSERVED).enumerate();
            let chosen = agents.map(|(row, observed)| largest(&scores(observed, row % AGENTS)) as f32);
            let actions: Vec<f32> = chosen.collect();
            turns.step(&actions, &mut rewards, &mut tally);
        }
        tally.age / tally.agent_slots
    }

    /// Least mean age over an episode of this many slots, from every start: by backward induction over the 16
    /// pairs of ages and 4 pairs of actions.
    pub fn best_age(slots: u32) -> f64 {
        let mut best = [0.0; AGES * AGES];
        for _ in 0..slots {
            let later = best;
            best = std::array::from_fn(|index| {
                let outcomes = (0..4_u8).map(|pair| {
                    let next = after(start(index), [pair & 1 == 1, pair & 2 == 2]);
                    (next[0] as f64 + next[1] as f64) / AGENTS as f64 + later[index_of(next)]
                });
                outcomes.fold(f64::INFINITY, f64::min)
            });
        }
        best.iter().sum::<f64>() / best.len() as f64 / f64::from(slots)
    }
}

/// The pair of ages with this index.
const fn start(index: usize) -> Ages {
    [index % AGES + 1, index / AGES % AGES + 1]
}

const fn index_of(ages: Ages) -> usize {
    ages[0] - 1 + AGES * (ages[1] - 1)
}

/// Ages after a slot in which these vehicles send.
fn after(ages: Ages, sends: [bool; AGENTS]) -> Ages {
    let alone = sends[0] != sends[1];
    std::array::from_fn(|agent| {
        if alone && sends[agent] {
            1
        } else {
            (ages[agent] + 1).min(AGES)
        }
    })
}

fn one_hot(age: usize, values: &mut [f32]) {
    values.fill(0.0);
    values[age - 1] = 1.0;
}

impl Game for Turns {
    fn shape(&self) -> Shape {
        Shape {
            worlds: self.ages.len(),
            agents: AGENTS,
            known: OBSERVED,
            observed: OBSERVED,
            actions: ActionSpace::Choices(2),
        }
    }

    fn know(&self, known: &mut [f32]) {
        let mut rows = known.chunks_exact_mut(OBSERVED);
        for ages in &self.ages {
            for (agent, row) in (0..AGENTS).zip(&mut rows) {
                one_hot(ages[agent], &mut row[..AGES]);
                one_hot(ages[1 - agent], &mut row[AGES..2 * AGES]);
                row[2 * AGES] = agent as f32;
            }
        }
    }

    fn step(&mut self, actions: &[f32], rewards: &mut [f32], tally: &mut Tally) {
        let worlds = actions.chunks_exact(AGENTS).zip(rewards.chunks_exact_mut(AGENTS));
        for (ages, (actions, rewards)) in self.ages.iter_mut().zip(worlds) {
            *ages = after(*ages, [actions[0] == 1.0, actions[1] == 1.0]);
            let mean = (ages[0] + ages[1]) as f32 / AGENTS as f32;
            for (reward, &age) in rewards.iter_mut().zip(ages.iter()) {
                let cost = if self.together { mean } else { age as f32 };
                *reward = -cost * self.scale;
                tally.reward += f64::from(*reward);
                tally.age += age as f64;
            }
            tally.world_slots += 1.0;
            tally.agent_slots += AGENTS as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean age when the older sends, the first of equals.
    fn play_by_age(slots: u32) -> f64 {
        let age = |one_hot: &[f32]| largest(one_hot);
        Turns::mean_age(slots, |observed, agent| {
            let (own, other) = (age(&observed[..AGES]), age(&observed[AGES..2 * AGES]));
            vec![
                0.5,
                f32::from(u8::from(own > other || own == other && agent == 0)),
            ]
        })
    }

    #[test]
    fn taking_turns_is_the_best_play() {
        // One slot: from ages (i, j), the best sends the older: 1 and the younger's age + 1.
        let one: f64 = (1..=4)
            .flat_map(|i: u32| (1..=4).map(move |j: u32| f64::from(1 + (i.min(j) + 1).min(4)) / 2.0))
            .sum();
        assert!((Turns::best_age(1) - one / 16.0).abs() < 1e-12);
        assert!((Turns::best_age(20) - play_by_age(20)).abs() < 1e-12);
        // In the long run the ages alternate between (1, 2) and (2, 1).
        assert!((Turns::best_age(10_000) - 1.5).abs() < 1e-3);
    }
}
