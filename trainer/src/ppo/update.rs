//! Learning from experience: some epochs of minibatches over what was just played.

use super::Recipe;
use super::loss::{ActorTerms, Taken, clipped_surrogate, huber};
use super::rollout::Experience;
use crate::laboratory::random::shuffle;
use crate::network::Network;
use crate::network::optimiser::{Adam, Step, clip};
use crate::network::product::Rounding;
use host_sim::stream::Stream;

/// A network with its optimiser.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The network.
    pub network: Network,
    /// Moments of its gradient.
    pub adam: Adam,
}

impl Part {
    /// That has not learned yet.
    pub fn new(network: Network) -> Self {
        Self {
            adam: Adam::new(network.parameters.len(), Rounding::Each),
            network,
        }
    }

    fn step(&mut self, gradient: &[f32], step: Step) {
        self.adam
            .step(&mut self.network.parameters, &mut [], gradient, step);
    }
}

/// What learns.
#[derive(Clone, Debug, PartialEq)]
pub struct ActorCritic {
    /// From an observation to the actions' scores.
    pub actor: Part,
    /// From what is known of a vehicle to a value.
    pub critic: Part,
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

impl ActorCritic {
    /// Learns from `experience`, whose rows are shuffled by `stream` anew in each epoch.
    pub fn update(
        &mut self,
        experience: &Experience,
        recipe: &Recipe,
        rates: Rates,
        stream: &mut Stream,
    ) -> Losses {
        let advantages = normalised_by_cell(experience);
        let (observed, width) = (self.actor.network.widths()[0], self.critic.network.widths()[0]);
        let mut order: Vec<usize> = (0..experience.actions.len()).collect();
        let mut losses = Losses::default();
        for _ in 0..recipe.epochs {
            shuffle(&mut order, stream);
            for rows in order.chunks(recipe.minibatch) {
                let known = rows.iter().map(|&row| &experience.known[row * width..][..width]);
                let known: Vec<&[f32]> = known.collect();
                if rates.actor > 0.0 {
                    let inputs: Vec<&[f32]> = known.iter().map(|known| &known[..observed]).collect();
                    let ([loss, entropy, clipped], gradient) =
                        self.actor.network.gradient(&inputs, |index, outputs, slope| {
                            let row = rows[index];
                            let taken = Taken {
                                action: experience.actions[row] as usize,
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
                    let step = Step {
                        scale: clip(&gradient, recipe.gradient_limit),
                        ..Step::plain(rates.actor)
                    };
                    self.actor.step(&gradient, step);
                    losses.actor += f64::from(loss);
                    losses.entropy += f64::from(entropy);
                    losses.clipped += f64::from(clipped);
                }
                let ([loss], gradient) = self.critic.network.gradient(&known, |index, outputs, slope| {
                    let (loss, against_value) = huber(outputs[0], experience.targets[rows[index]]);
                    slope[0] = against_value;
                    [loss]
                });
                self.critic.step(&gradient, Step::plain(rates.critic));
                losses.critic += f64::from(loss);
                losses.steps += 1.0;
            }
        }
        losses
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

/// Advantages with mean 0 and deviation 1 in each cell: where links are weak ages are larger and vary more, and that cell alone
/// would be heard.
pub(super) fn normalised_by_cell(experience: &Experience) -> Vec<f32> {
    let mut rest = experience.advantages.as_slice();
    let mut all = Vec::with_capacity(rest.len());
    for &decisions in &experience.cells {
        let (cell, others) = rest.split_at(decisions);
        all.extend(normalised(cell));
        rest = others;
    }
    all
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
