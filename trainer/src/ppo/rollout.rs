//! Playing with the present actor, and what is remembered of it.

use super::Recipe;
use super::advantage::advantages;
use crate::game::{Game, Tally};
use crate::network::Network;
use crate::network::categorical::{largest, log_probability, softmax};
use crate::network::perceptron::{Pass, Rows};
use host_sim::stream::Stream;

/// Decisions that were taken, in a fixed order; one row each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Experience {
    /// What the critic knew, which begins with what the actor observed: rows of equal width.
    pub known: Vec<f32>,
    /// What was done: indices.
    pub actions: Vec<f32>,
    /// Log probabilities of that.
    pub log_probabilities: Vec<f32>,
    /// How much better than the critic expected it went, in parts.
    pub advantages: Vec<f32>,
    /// What the critic should have expected.
    pub targets: Vec<f32>,
    /// How many decisions are of each cell of a mixture, one after the other. Advantages are compared within a cell.
    pub cells: Vec<usize>,
}

impl Experience {
    /// Joins batches in their order; those of one cell, whose index comes with each, are neighbours.
    pub fn join(batches: impl IntoIterator<Item = (usize, Self)>) -> Self {
        let mut all = Self::default();
        let mut last = None;
        for (cell, batch) in batches {
            match all.cells.last_mut() {
                Some(decisions) if last == Some(cell) => *decisions += batch.actions.len(),
                _ => all.cells.push(batch.actions.len()),
            }
            last = Some(cell);
            all.known.extend(batch.known);
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
    game: &mut impl Game,
    actor: &Network,
    critic: &Network,
    recipe: &Recipe,
    stream: &mut Stream,
    tally: &mut Tally,
) -> Experience {
    let shape = game.shape();
    let (agents, width) = (shape.rows(), shape.known);
    let decided = recipe.slots as usize * agents;
    let mut experience = Experience {
        known: vec![0.0; (decided + agents) * width],
        ..Experience::default()
    };
    let (mut rewards, mut parts, mut ended) = (vec![0.0; decided], vec![0.0; decided], vec![false; decided]);
    let mut pass = Pass::default();
    let (mut scores, mut probabilities) = (Vec::new(), Vec::new());
    for first in (0..decided).step_by(agents) {
        let slot = first..first + agents;
        let known = &mut experience.known[first * width..][..agents * width];
        game.know(known);
        let observed = Rows {
            values: known,
            stride: width,
            width: shape.observed,
        };
        let columns = actor.forward_batch(observed, &mut pass);
        for agent in 0..agents {
            scores.clear();
            scores.extend(columns.iter().skip(agent).step_by(agents));
            probabilities.resize(scores.len(), 0.0);
            softmax(&scores, &mut probabilities);
            let action = draw(&probabilities, stream.uniform());
            experience.actions.push(action as f32);
            experience
                .log_probabilities
                .push(log_probability(probabilities[action]));
        }
        game.parts(&mut parts[slot.clone()]);
        game.step(
            &experience.actions[slot.clone()],
            &mut rewards[slot.clone()],
            tally,
        );
        game.ended(&mut ended[slot]);
    }
    // The state after the last reward is valued, and then forgotten.
    game.know(&mut experience.known[decided * width..]);
    let values = critic.forward_batch(Rows::all(&experience.known, width), &mut pass);
    experience.known.truncate(decided * width);
    let advantages = advantages(&rewards, values, &ended, agents, recipe.discount, recipe.trace);
    experience.targets = values
        .iter()
        .zip(&advantages)
        .map(|(value, advantage)| value + advantage)
        .collect();
    experience.cells = vec![decided];
    experience.advantages = advantages
        .iter()
        .zip(&parts)
        .map(|(advantage, parts)| advantage * parts)
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
    largest(probabilities)
}
