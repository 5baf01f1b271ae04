//! Learning from experience: some epochs of minibatches over what was just played.

use super::Recipe;
use super::loss::{ActorTerms, Taken, clipped_surrogate, huber};
use super::rollout::Experience;
use crate::distil::shuffle;
use crate::network::{Adam, Network};
use host_sim::stream::Stream;

/// The networks and their optimisers.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimiser {
    /// From an observation to the actions' scores.
    pub actor: Network,
    /// From a central view to a value.
    pub critic: Network,
    /// Moments of the actor's gradient.
    pub actor_adam: Adam,
    /// Moments of the critic's gradient.
    pub critic_adam: Adam,
}

/// How far to step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Learning rate of the actor; at 0 it stays as it is.
    pub actor: f32,
    /// Learning rate of the critic.
    pub critic: f32,
    /// Weight of the entropy.
    pub entropy: f32,
}

/// Sums over optimiser steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// The actor's loss.
    pub actor: f64,
    /// The critic's loss.
    pub critic: f64,
    /// Entropy in nats.
    pub entropy: f64,
    /// Share of samples that were clipped.
    pub clipped: f64,
    /// Optimiser steps.
    pub steps: f64,
}

impl Optimiser {
    /// Learns from `experience`, whose rows are shuffled by `stream` anew in each epoch.
    pub fn update(
        &mut self,
        experience: &Experience,
        recipe: &Recipe,
        rates: Rates,
        stream: &mut Stream,
    ) -> Losses {
        let advantages = normalised(&experience.advantages);
        let (width, view_width) = (self.actor.layers[0].inputs, self.critic.layers[0].inputs);
        let mut order: Vec<usize> = (0..experience.actions.len()).collect();
        let mut losses = Losses::default();
        for _ in 0..recipe.epochs {
            shuffle(&mut order, stream);
            for rows in order.chunks(recipe.minibatch) {
                if rates.actor > 0.0 {
                    let inputs: Vec<&[f32]> = rows
                        .iter()
                        .map(|&row| &experience.inputs[row * width..][..width])
                        .collect();
                    let ([loss, entropy, clipped], mut gradient) =
                        self.actor.gradient(&inputs, |index, outputs, slope| {
                            let row = rows[index];
                            let taken = Taken {
                                action: usize::from(experience.actions[row]),
                                log_probability: experience.log_probabilities[row],
                                advantage: advantages[row],
                            };
                            let ActorTerms {
                                loss,
                                entropy,
                                clipped,
                            } = clipped_surrogate(outputs, taken, recipe.clip, rates.entropy, slope);
                            [loss, entropy, clipped]
                        });
                    let norm = gradient.norm() as f32;
                    if norm > recipe.gradient_limit {
                        gradient.scale(recipe.gradient_limit / norm);
                    }
                    self.actor_adam.step(&mut self.actor, &gradient, rates.actor);
                    losses.actor += f64::from(loss);
                    losses.entropy += f64::from(entropy);
                    losses.clipped += f64::from(clipped);
                }
                let views: Vec<&[f32]> = rows
                    .iter()
                    .map(|&row| &experience.views[row * view_width..][..view_width])
                    .collect();
                let ([loss], gradient) = self.critic.gradient(&views, |index, outputs, slope| {
                    let (loss, against_value) = huber(outputs[0], experience.targets[rows[index]]);
                    slope[0] = against_value;
                    [loss]
                });
                self.critic_adam.step(&mut self.critic, &gradient, rates.critic);
                losses.critic += f64::from(loss);
                losses.steps += 1.0;
            }
        }
        losses
    }

    /// Everything in the shape of a network, by name: weights and moments.
    pub fn networks(&self) -> [(&'static str, &Network); 6] {
        [
            ("actor", &self.actor),
            ("actor.mean", &self.actor_adam.mean),
            ("actor.square", &self.actor_adam.square),
            ("critic", &self.critic),
            ("critic.mean", &self.critic_adam.mean),
            ("critic.square", &self.critic_adam.square),
        ]
    }

    /// The same, to be changed.
    pub fn networks_mut(&mut self) -> [(&'static str, &mut Network); 6] {
        [
            ("actor", &mut self.actor),
            ("actor.mean", &mut self.actor_adam.mean),
            ("actor.square", &mut self.actor_adam.square),
            ("critic", &mut self.critic),
            ("critic.mean", &mut self.critic_adam.mean),
            ("critic.square", &mut self.critic_adam.square),
        ]
    }

    /// The optimisers by name.
    pub const fn adams(&self) -> [(&'static str, &Adam); 2] {
        [("actor", &self.actor_adam), ("critic", &self.critic_adam)]
    }

    /// The same, to be changed.
    pub const fn adams_mut(&mut self) -> [(&'static str, &mut Adam); 2] {
        [("actor", &mut self.actor_adam), ("critic", &mut self.critic_adam)]
    }
}

impl Losses {
    /// Adds another.
    pub fn add(&mut self, other: &Self) {
        self.actor += other.actor;
        self.critic += other.critic;
        self.entropy += other.entropy;
        self.clipped += other.clipped;
        self.steps += other.steps;
    }
}

/// Advantages with mean 0 and deviation 1.
fn normalised(advantages: &[f32]) -> Vec<f32> {
    let count = advantages.len().max(1) as f64;
    let mean = advantages.iter().fold(0.0, |sum, &value| sum + f64::from(value)) / count;
    let square = advantages.iter().fold(0.0, |sum, &value| {
        let distance = f64::from(value) - mean;
        sum + distance * distance
    });
    let deviation = libm::sqrt(square / count) + 1e-8;
    advantages
        .iter()
        .map(|&value| ((f64::from(value) - mean) / deviation) as f32)
        .collect()
}
