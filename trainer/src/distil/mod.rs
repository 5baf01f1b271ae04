//! Distillation: a small network imitates the ring clock by dataset aggregation (DAgger, Ross et al. 2011). The learner
//! drives the cells, the clock says what it should have done there.

pub mod table;

use crate::forms::{as_float, best_action};
use crate::game::start_ages;
use crate::laboratory::random;
use crate::mixture::Mixture;
use crate::network::Network;
use crate::network::optimiser::{Adam, Step};
use crate::network::perceptron::{Pass, Rows};
use crate::network::product::Rounding;
use firmware::clock;
use firmware::decision::{ACTIONS, Action, PowerPlan};
use firmware::observation::{INPUTS, Observation};
use firmware::units::Level;
use host_sim::decisions::Decisions;
use host_sim::policy::power_plan;
use host_sim::stream::{Purpose, Role, WorldKey};
use rayon::prelude::*;

/// How to distil. The defaults made the shipped table.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Seed of everything random.
    pub seed: u64,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Rounds of collecting and learning.
    pub iterations: u32,
    /// Optimiser steps in a round.
    pub steps: u32,
    /// Samples in a step.
    pub batch: usize,
    /// Cells in a round.
    pub worlds: u32,
    /// Slots a cell is watched.
    pub slots: u32,
    /// Rounds whose samples are kept.
    pub kept: usize,
    /// Rounds over which the clock hands over to the learner.
    pub hand_over: u32,
    /// First learning rate; it falls to 0 by a half cosine.
    pub learning_rate: f32,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            seed: 1,
            hidden: vec![32, 32],
            iterations: 20,
            steps: 300,
            batch: 4096,
            worlds: 32,
            slots: 50,
            kept: 10,
            hand_over: 5,
            learning_rate: 4e-3,
        }
    }
}

/// Fewest and most vehicles of the cells that are watched, where the mixture does not say (chosen).
pub const VEHICLES: [u32; 2] = [1, 300];

/// Most vehicles that a distilled table serves. What the network sees has no scale but the frame, so that more than it was trained with
/// are no news to it; `tests/results.rs` tries as many.
pub const SERVED_VEHICLES: u32 = 2000;

/// What distilling gives.
pub struct Distilled {
    /// The learned network.
    pub network: Network,
    /// Encoded observations of the last rounds, for calibration.
    pub inputs: Vec<[i8; INPUTS]>,
    /// Mean cross entropy of the last round.
    pub loss: f32,
}

/// Progress after a round.
#[derive(Clone, Copy, Debug)]
pub struct Round {
    /// Its number, from 1.
    pub number: u32,
    /// Mean cross entropy over its steps.
    pub loss: f32,
    /// Samples learned from.
    pub samples: usize,
}

/// Encoded observations and what the clock does.
#[derive(Clone, Debug, Default)]
struct Samples {
    inputs: Vec<[i8; INPUTS]>,
    classes: Vec<u8>,
}

/// Distils the clock in the cells of a mixture. The same recipe and mixture give the same network to the last bit, on any machine
/// and any number of threads.
pub fn distil(mixture: &Mixture, recipe: &Recipe, mut progress: impl FnMut(Round)) -> Distilled {
    let key = |world: u64| WorldKey {
        seed: recipe.seed,
        purpose: Purpose::Training,
        world,
    };
    let mut stream = key(u64::MAX).stream(Role::Policy, 0);
    let widths = [&[INPUTS], &recipe.hidden[..], &[ACTIONS]].concat();
    let mut network = Network::random(&widths, &mut stream);
    let mut adam = Adam::new(network.parameters.len(), Rounding::Each);
    let mut rounds: Vec<Samples> = Vec::new();
    let total_steps = f64::from(recipe.iterations * recipe.steps);
    let mut loss = f32::NAN;
    for iteration in 0..recipe.iterations {
        let expert_share = 1.0 - f64::from(iteration) / f64::from(recipe.hand_over.max(1));
        let worlds = u64::from(iteration) * u64::from(recipe.worlds)
            ..u64::from(iteration + 1) * u64::from(recipe.worlds);
        let collected: Vec<Samples> = worlds
            .into_par_iter()
            .map(|world| watch(mixture, recipe, &key(world), &network, expert_share))
            .collect();
        rounds.push(Samples {
            inputs: collected
                .iter()
                .flat_map(|samples| samples.inputs.iter().copied())
                .collect(),
            classes: collected
                .iter()
                .flat_map(|samples| samples.classes.iter().copied())
                .collect(),
        });
        if rounds.len() > recipe.kept {
            drop(rounds.remove(0));
        }
        let inputs: Vec<[f32; INPUTS]> = rounds
            .iter()
            .flat_map(|round| round.inputs.iter().map(as_float))
            .collect();
        let classes: Vec<u8> = rounds
            .iter()
            .flat_map(|round| round.classes.iter().copied())
            .collect();
        loss = 0.0;
        for step in 0..recipe.steps {
            let done = f64::from(iteration * recipe.steps + step) / total_steps;
            let learning_rate =
                recipe.learning_rate * (0.5 + 0.5 * libm::cos(std::f64::consts::PI * done) as f32);
            let drawn: Vec<usize> = (0..recipe.batch)
                .map(|_| stream.below(classes.len() as u32) as usize)
                .collect();
            let batch: Vec<&[f32]> = drawn.iter().map(|&index| inputs[index].as_slice()).collect();
            let targets: Vec<u8> = drawn.iter().map(|&index| classes[index]).collect();
            let (now, gradient) = network.cross_entropy_gradient(&batch, &targets);
            adam.step(
                &mut network.parameters,
                &mut [],
                &gradient,
                Step::plain(learning_rate),
            );
            loss += now / recipe.steps as f32;
        }
        progress(Round {
            number: iteration + 1,
            loss,
            samples: classes.len(),
        });
    }
    Distilled {
        network,
        inputs: rounds.into_iter().flat_map(|round| round.inputs).collect(),
        loss,
    }
}

/// Watches one cell of the mixture from random ages. In a share of slots the clock drives, in the others the learner.
fn watch(
    mixture: &Mixture,
    recipe: &Recipe,
    key: &WorldKey,
    network: &Network,
    expert_share: f64,
) -> Samples {
    let mut stream = key.stream(Role::Policy, 1);
    let scenario = mixture.draw(&mut stream);
    let (required, plan): (Level, PowerPlan) = (scenario.radio.required_level(), power_plan(&scenario));
    let mut cell = random::worlds(&scenario, key.seed, key.world..key.world + 1);
    start_ages::for_every_load(&mut cell, &mut stream);
    let mut samples = Samples::default();
    let mut decisions = Decisions::new(1, cell.vehicles());
    let mut pass = Pass::default();
    for _ in 0..recipe.slots {
        let expert_drives = stream.chance(expert_share);
        let first = samples.inputs.len();
        let mut observed = Vec::new();
        for &vehicle in cell.present() {
            let Some(measurement) = cell.measurement(0, vehicle) else {
                continue;
            };
            let observation = Observation::new(&measurement, cell.identity(0, vehicle));
            samples.inputs.push(observation.encode(required));
            samples.classes.push(clock::act(&observation, required) as u8);
            observed.push((vehicle, observation));
        }
        let inputs: Vec<f32> = samples.inputs[first..].iter().flat_map(as_float).collect();
        let _columns = network.forward_batch(Rows::all(&inputs, INPUTS), &mut pass);
        let (scores, classes) = (pass.output_lines(), &samples.classes[first..]);
        let each = observed.iter().zip(scores.chunks_exact(ACTIONS)).zip(classes);
        for (((vehicle, observation), scores), &expert) in each {
            let action = if expert_drives {
                Action::ALL[usize::from(expert)]
            } else {
                best_action(scores)
            };
            decisions.set(0, *vehicle, plan.decision(action, observation));
        }
        cell.step(&decisions);
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distil::table::distil_table;
    use crate::mixture::MixtureSource;
    use firmware::table::Provenance;

    /// Seconds are enough to see that the cells are watched, and that the table serves what they ask for.
    #[test]
    fn the_clock_is_distilled_in_the_cells_of_a_mixture() {
        let source: MixtureSource = toml::from_str(
            "mixture = [{ preset = 'paper', weight = 1, vehicles = [2, 9] },
             { preset = 'edge', weight = 1, vehicles = [20, 30], set = ['radio.sub_channels=4'] }]",
        )
        .unwrap();
        let mixture = Mixture::read(&source.mixture, VEHICLES, |preset| Ok(preset.values())).unwrap();
        let recipe = Recipe {
            iterations: 1,
            steps: 2,
            batch: 8,
            worlds: 16,
            slots: 5,
            ..Recipe::default()
        };
        let distilled = distil(&mixture, &recipe, |_| ());
        let samples = distilled.inputs.len();
        // Not of one cell alone: at most 9 and at least 20 vehicles in five slots of sixteen worlds.
        assert!(samples > 9 * 5 * 16 && samples < 20 * 5 * 16, "{samples}");
        let provenance = Provenance {
            seed: 1,
            revision: [0; 20],
            modified: false,
        };
        let made = distil_table(&mixture, &recipe, provenance, |_| ()).unwrap();
        assert_eq!(made.actors.networks[0], distilled.network);
        assert_eq!(made.actors.form.min_vehicles, 2);
        assert_eq!(made.table.parse().unwrap().max_sub_channels().count(), 4);
    }
}
