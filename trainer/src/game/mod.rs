//! Games of several agents, as learners play them: the simulator's [`cell`], and a [`toy`] whose best play is known.

pub mod actions;
pub mod cell;
pub mod reward;
pub mod start_ages;
pub mod toy;

use crate::laboratory::learner::{Metrics, name};
use actions::ActionSpace;

/// A batch of equal worlds that advance together, begun and not ended: who ends an episode is the learner.
///
/// ```
/// use trainer::game::toy::Turns;
/// use trainer::game::{Game, Tally};
///
/// let mut game = Turns::new(16);
/// let shape = game.shape();
/// let mut known = vec![0.0; shape.rows() * shape.known];
/// game.know(&mut known);
/// // In every world the first agent sends and the second is silent.
/// let actions: Vec<f32> = (0..shape.rows()).map(|row| f32::from(row % 2 == 0)).collect();
/// let (mut rewards, mut tally) = (vec![0.0; shape.rows()], Tally::default());
/// game.step(&actions, &mut rewards, &mut tally);
/// assert_eq!(rewards[0], -1.0);
/// assert_eq!(tally.agent_slots, 32.0);
/// ```
///
/// Rows are `[world][agent]`. One trait serves both families of learners: what an actor observes is the first part of what a critic
/// knows, and a choice is its index, so that one call gives all of the former and one takes all of the latter.
pub trait Game {
    /// Sizes that stay.
    fn shape(&self) -> Shape;

    /// Writes what is known of every agent, `[world][agent][known]`; zeros for an absent one.
    fn know(&self, known: &mut [f32]);

    /// Carries out every agent's action, `[world][agent][value]`, writes its reward, `[world][agent]`, zero for an absent one, and
    /// adds to the tally.
    fn step(&mut self, actions: &[f32], rewards: &mut [f32], tally: &mut Tally);

    /// Writes whose agent the last step ended, `[world][agent]`: what comes after in its row is another's. In many games nobody's.
    fn ended(&self, ended: &mut [bool]) {
        ended.fill(false);
    }

    /// Writes of how many agents' costs every agent's next reward is a mean, `[world][agent]`; in many games of its own alone.
    fn parts(&self, parts: &mut [f32]) {
        parts.fill(1.0);
    }
}

/// Sizes of a game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Worlds.
    pub worlds: usize,
    /// Agents that a world has room for.
    pub agents: usize,
    /// Values known of an agent.
    pub known: usize,
    /// How many of them, from the first on, the agent itself observes.
    pub observed: usize,
    /// What an agent may do.
    pub actions: ActionSpace,
}

impl Shape {
    /// Agents over all worlds.
    pub const fn rows(&self) -> usize {
        self.worlds * self.agents
    }
}

/// Sums over agents and slots, for people.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// World-slots.
    pub world_slots: f64,
    /// Agent-slots, without absent agents.
    pub agent_slots: f64,
    /// Ages after the slot, in slots.
    pub age: f64,
    /// Rewards.
    pub reward: f64,
    /// Agents that were received.
    pub received: f64,
    /// Transmit powers in mW.
    pub power_mw: f64,
}

impl Tally {
    /// The metrics of an episode that every learner has: with a mean reward, all world-slots so far and all updates.
    pub fn metrics(&self, reward: f64, slots: f64, updates: u64) -> Metrics {
        Metrics::default()
            .with(name::REWARD, reward)
            .with(name::AGE, self.age / self.agent_slots)
            .with(name::SUCCESSES, self.received / self.world_slots)
            .with(name::POWER, self.power_mw / self.agent_slots)
            .with(name::SLOTS, slots)
            .with(name::UPDATES, updates as f64)
    }

    /// Adds another.
    pub fn merge(&mut self, other: &Self) {
        self.world_slots += other.world_slots;
        self.agent_slots += other.agent_slots;
        self.age += other.age;
        self.reward += other.reward;
        self.received += other.received;
        self.power_mw += other.power_mw;
    }
}
