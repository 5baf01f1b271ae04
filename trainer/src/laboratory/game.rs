//! A game of several agents, as learners see it: the cell, or a toy whose best play is known.

/// A batch of equal worlds that advance together.
pub trait Game {
    /// Worlds.
    fn worlds(&self) -> usize;

    /// Agents in each world.
    fn agents(&self) -> usize;

    /// Length of what one agent sees.
    fn observation_length(&self) -> usize;

    /// Length of what a central critic sees of one world.
    fn state_length(&self) -> usize;

    /// Actions that an agent has.
    fn actions(&self) -> usize;

    /// Begins an episode with fresh worlds.
    fn reset(&mut self, episode: u64);

    /// Writes what every agent sees, `[world][agent][input]`.
    fn observe(&self, observations: &mut [f32]);

    /// Writes what a central critic sees, `[world][value]`.
    fn states(&self, states: &mut [f32]);

    /// Carries out one action of each agent, `[world][agent]`, and writes each agent's own reward of the slot in the same
    /// order. The global reward is their mean over a world's agents.
    fn step(&mut self, actions: &[u8], rewards: &mut [f32]);
}
