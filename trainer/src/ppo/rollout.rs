//! Playing with the present actor, and what is remembered of it.

use super::Recipe;
use super::advantage::advantages;
use super::loss::{log_probability, softmax};
use crate::network::{Batch, Network};
use host_sim::stream::Stream;

/// Agents that act together, slot after slot. Rows are in the order of agents, the same in every slot.
pub trait Arena {
    /// How many agents, over all worlds.
    fn agents(&self) -> usize;

    /// Appends what each agent's actor sees and what the critic sees for each agent.
    fn observe(&mut self, inputs: &mut Vec<f32>, views: &mut Vec<f32>);

    /// Carries out one action of each agent as observed last, and appends each agent's reward. A reward is a mean; how many
    /// parts it is a mean of is appended to `weights`.
    fn step(&mut self, actions: &[u8], rewards: &mut Vec<f32>, weights: &mut Vec<f32>);
}

/// Decisions that were taken, in a fixed order; one row each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Experience {
    /// What the actor saw: rows of equal width.
    pub inputs: Vec<f32>,
    /// What the critic saw: rows of equal width.
    pub views: Vec<f32>,
    /// What was done.
    pub actions: Vec<u8>,
    /// Log probabilities of that.
    pub log_probabilities: Vec<f32>,
    /// How much better than the critic expected it went, in parts.
    pub advantages: Vec<f32>,
    /// What the critic should have expected.
    pub targets: Vec<f32>,
}

impl Experience {
    /// Joins batches in their order.
    pub fn join(batches: Vec<Self>) -> Self {
        let mut all = Self::default();
        for batch in batches {
            all.inputs.extend(batch.inputs);
            all.views.extend(batch.views);
            all.actions.extend(batch.actions);
            all.log_probabilities.extend(batch.log_probabilities);
            all.advantages.extend(batch.advantages);
            all.targets.extend(batch.targets);
        }
        all
    }
}

/// Plays on for the recipe's slots and judges every decision; `stream` draws the actions.
pub fn play(
    arena: &mut impl Arena,
    actor: &Network,
    critic: &Network,
    recipe: &Recipe,
    stream: &mut Stream,
) -> Experience {
    let agents = arena.agents();
    let decided = recipe.slots as usize * agents;
    let mut experience = Experience::default();
    let (mut rewards, mut weights) = (Vec::with_capacity(decided), Vec::with_capacity(decided));
    let mut batch = Batch::default();
    let width = actor.layers[0].inputs;
    let (mut scores, mut probabilities) = (Vec::new(), Vec::new());
    for _ in 0..recipe.slots {
        let first = experience.actions.len();
        arena.observe(&mut experience.inputs, &mut experience.views);
        let columns = actor.forward_batch(&experience.inputs[first * width..], &mut batch);
        for agent in 0..agents {
            scores.clear();
            scores.extend(columns.iter().skip(agent).step_by(agents));
            probabilities.resize(scores.len(), 0.0);
            softmax(&scores, &mut probabilities);
            let action = draw(&probabilities, stream.uniform());
            experience.actions.push(action as u8);
            experience
                .log_probabilities
                .push(log_probability(probabilities[action]));
        }
        arena.step(&experience.actions[first..], &mut rewards, &mut weights);
    }
    // The state after the last reward is valued, and then forgotten.
    arena.observe(&mut experience.inputs, &mut experience.views);
    let view_width = critic.layers[0].inputs;
    let values = critic.forward_batch(&experience.views, &mut batch);
    experience.inputs.truncate(decided * width);
    experience.views.truncate(decided * view_width);
    let advantages = advantages(&rewards, values, agents, recipe.discount, recipe.trace);
    experience.targets = values
        .iter()
        .zip(&advantages)
        .map(|(value, advantage)| value + advantage)
        .collect();
    experience.advantages = advantages
        .iter()
        .zip(&weights)
        .map(|(advantage, weight)| advantage * weight)
        .collect();
    experience
}

/// The action whose interval of the cumulated probabilities holds `uniform`.
fn draw(probabilities: &[f32], uniform: f32) -> usize {
    let mut left = uniform;
    for (action, &probability) in probabilities.iter().enumerate() {
        left -= probability;
        if left < 0.0 {
            return action;
        }
    }
    // Rounding left a little: the likeliest action has room for it.
    (1..probabilities.len()).fold(0, |best, action| {
        if probabilities[action] > probabilities[best] {
            action
        } else {
            best
        }
    })
}
