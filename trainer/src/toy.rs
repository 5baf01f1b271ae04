//! A game small enough that its best play is known exactly: two vehicles take turns on one sub-channel.
//!
//! A learner that cannot find the best play here has a fault; one that finds it has proved little more than that.

use crate::laboratory::game::Game;

/// The largest age.
const AGES: usize = 4;

/// Vehicles.
const AGENTS: usize = 2;

/// Age of each vehicle in one world, in slots from 1.
type Ages = [usize; AGENTS];

/// Two vehicles, one sub-channel without fading. In every slot each stays silent (action 0) or sends (1). Who sends alone is
/// received, and its age becomes 1; every other age grows by one slot, up to 4. A vehicle's reward is minus its age
/// after the slot. World `w` starts from the `w mod 16`-th pair of ages, so 16 worlds see every start.
///
/// Both see both ages, and the second knows that it is the second: only so can equals agree who goes first.
#[derive(Clone, Debug)]
pub struct Turns {
    ages: Vec<Ages>,
}

impl Turns {
    /// That many worlds.
    pub fn new(worlds: usize) -> Self {
        let mut turns = Self {
            ages: vec![[1; AGENTS]; worlds],
        };
        turns.reset(0);
        turns
    }

    /// Best mean global reward of a slot in an episode of this many slots, over all starts: by backward induction over the 16
    /// pairs of ages and 4 pairs of actions.
    pub fn best_reward(slots: u32) -> f64 {
        let mut best = [0.0; AGES * AGES];
        for _ in 0..slots {
            let later = best;
            best = std::array::from_fn(|index| {
                let outcomes = (0..4_u8).map(|pair| {
                    let next = after(start(index), [pair & 1 == 1, pair & 2 == 2]);
                    let reward = -(next[0] as f64 + next[1] as f64) / AGENTS as f64;
                    reward + later[index_of(next)]
                });
                outcomes.fold(f64::NEG_INFINITY, f64::max)
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
    fn worlds(&self) -> usize {
        self.ages.len()
    }

    fn agents(&self) -> usize {
        AGENTS
    }

    fn observation_length(&self) -> usize {
        2 * AGES + 1
    }

    fn state_length(&self) -> usize {
        2 * AGES
    }

    fn actions(&self) -> usize {
        2
    }

    fn reset(&mut self, _episode: u64) {
        for (world, ages) in self.ages.iter_mut().enumerate() {
            *ages = start(world);
        }
    }

    fn observe(&self, observations: &mut [f32]) {
        let mut rows = observations.chunks_exact_mut(2 * AGES + 1);
        for ages in &self.ages {
            for (agent, row) in (0..AGENTS).zip(&mut rows) {
                one_hot(ages[agent], &mut row[..AGES]);
                one_hot(ages[1 - agent], &mut row[AGES..2 * AGES]);
                row[2 * AGES] = agent as f32;
            }
        }
    }

    fn states(&self, states: &mut [f32]) {
        for (ages, row) in self.ages.iter().zip(states.chunks_exact_mut(2 * AGES)) {
            one_hot(ages[0], &mut row[..AGES]);
            one_hot(ages[1], &mut row[AGES..]);
        }
    }

    fn step(&mut self, actions: &[u8], rewards: &mut [f32]) {
        let actions = actions.chunks_exact(AGENTS);
        for ((ages, actions), rewards) in self
            .ages
            .iter_mut()
            .zip(actions)
            .zip(rewards.chunks_exact_mut(AGENTS))
        {
            *ages = after(*ages, [actions[0] == 1, actions[1] == 1]);
            for (reward, &age) in rewards.iter_mut().zip(ages.iter()) {
                *reward = -(age as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean global reward when the older sends, the first of equals.
    fn play_by_age(slots: u32) -> f64 {
        let mut game = Turns::new(AGES * AGES);
        let mut rewards = vec![0.0; game.worlds() * AGENTS];
        let mut sum = 0.0;
        for _ in 0..slots {
            let actions: Vec<u8> = game
                .ages
                .iter()
                .flat_map(|ages| {
                    let first = ages[0] >= ages[1];
                    [u8::from(first), u8::from(!first)]
                })
                .collect();
            game.step(&actions, &mut rewards);
            sum += rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
        }
        sum / rewards.len() as f64 / f64::from(slots)
    }

    #[test]
    fn taking_turns_is_the_best_play() {
        // One slot: from ages (i, j), the best sends the older: 1 and the younger's age + 1.
        let one: f64 = (1..=4)
            .flat_map(|i: u32| (1..=4).map(move |j: u32| -f64::from(1 + (i.min(j) + 1).min(4)) / 2.0))
            .sum();
        assert!((Turns::best_reward(1) - one / 16.0).abs() < 1e-12);
        assert!((Turns::best_reward(20) - play_by_age(20)).abs() < 1e-12);
        // In the long run the ages alternate between (1, 2) and (2, 1).
        assert!((Turns::best_reward(10_000) + 1.5).abs() < 1e-3);
    }
}
