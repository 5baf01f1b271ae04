//! Distillation: a small network imitates the AoI clock by dataset aggregation (DAgger, Ross et al. 2011). The learner
//! drives the cells, the clock says what it should have done there.

use crate::network::{Adam, Network};
use firmware::clock;
use firmware::decision::{ACTIONS, Action, PowerPlan};
use firmware::observation::{INPUTS, ONE, Observation};
use firmware::units::{Age, Level, SUB_CHANNELS};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::policy::power_plan;
use host_sim::scenario::Scenario;
use host_sim::stream::{Purpose, Role, Stream, WorldKey};
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
    /// Fewest vehicles in a cell.
    pub min_vehicles: u32,
    /// Most vehicles in a cell: what the table will serve.
    pub max_vehicles: u32,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            seed: 1,
            hidden: vec![32, 32],
            iterations: 20,
            steps: 200,
            batch: 4096,
            worlds: 32,
            slots: 50,
            kept: 10,
            hand_over: 5,
            learning_rate: 4e-3,
            min_vehicles: 3,
            max_vehicles: 72,
        }
    }
}

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

/// The encoded observation as the float network sees it.
pub fn as_float<const LENGTH: usize>(input: &[i8; LENGTH]) -> [f32; LENGTH] {
    input.map(|value| f32::from(value) / f32::from(ONE))
}

/// The action with the largest output; the first of equals, as in the firmware.
pub fn best_action(outputs: &[f32]) -> Action {
    let mut best = (Action::Silent, f32::NEG_INFINITY);
    for (action, &output) in Action::ALL.into_iter().zip(outputs) {
        if output > best.1 {
            best = (action, output);
        }
    }
    best.0
}

/// Distils the clock of `scenario`. The same recipe and scenario give the same network to the last bit, on any machine and any
/// number of threads.
pub fn distil(scenario: &Scenario, recipe: &Recipe, mut progress: impl FnMut(Round)) -> Distilled {
    let key = |world: u64| WorldKey {
        seed: recipe.seed,
        purpose: Purpose::Training,
        world,
    };
    let mut stream = key(u64::MAX).stream(Role::Policy, 0);
    let widths: Vec<usize> = [INPUTS]
        .into_iter()
        .chain(recipe.hidden.iter().copied())
        .chain([ACTIONS])
        .collect();
    let mut network = Network::random(&widths, &mut stream);
    let mut adam = Adam::new(&network);
    let mut rounds: Vec<Samples> = Vec::new();
    let total_steps = f64::from(recipe.iterations * recipe.steps);
    let mut loss = f32::NAN;
    for iteration in 0..recipe.iterations {
        let expert_share = 1.0 - f64::from(iteration) / f64::from(recipe.hand_over.max(1));
        let worlds = u64::from(iteration) * u64::from(recipe.worlds)
            ..u64::from(iteration + 1) * u64::from(recipe.worlds);
        let collected: Vec<Samples> = worlds
            .into_par_iter()
            .map(|world| watch(scenario, recipe, &key(world), &network, expert_share))
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
            adam.step(&mut network, &gradient, learning_rate);
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

/// Watches one cell of random size from random ages. In a share of slots the clock drives, in the others the learner.
fn watch(
    scenario: &Scenario,
    recipe: &Recipe,
    key: &WorldKey,
    network: &Network,
    expert_share: f64,
) -> Samples {
    let mut stream = key.stream(Role::Policy, 1);
    let mut scenario = scenario.clone();
    scenario.cell.vehicles =
        recipe.min_vehicles + stream.below(recipe.max_vehicles - recipe.min_vehicles + 1);
    let (required, plan): (Level, PowerPlan) = (scenario.radio.required_level(), power_plan(&scenario));
    let mut cell = Environment::new(&scenario, &Grid, key.seed, key.purpose, key.world..key.world + 1);
    let homes: Vec<Option<usize>> = (0..cell.vehicles())
        .map(|vehicle| cell.broadcast(0, vehicle))
        .map(|broadcast| broadcast.map(|broadcast| broadcast.home.index()))
        .collect();
    start_ages(&homes, &mut stream, |vehicle, age| cell.set_age(0, vehicle, age));
    let mut samples = Samples::default();
    let mut decisions = Decisions::new(1, cell.vehicles());
    for _ in 0..recipe.slots {
        let expert_drives = stream.chance(expert_share);
        for &vehicle in cell.present() {
            let Some(measurement) = cell.measurement(0, vehicle) else {
                continue;
            };
            let observation = Observation::new(&measurement);
            let input = observation.encode(required);
            let expert = clock::act(&observation, required);
            let action = if expert_drives {
                expert
            } else {
                best_action(&network.forward(&as_float(&input)))
            };
            decisions.set(0, vehicle, plan.decision(action, &observation));
            samples.inputs.push(input);
            samples.classes.push(expert as u8);
        }
        cell.step(&decisions);
    }
    samples
}

/// Start ages of one cell: all at the largest age, or everybody in turn (some of them lost), or uniform. `homes` says which group
/// each vehicle is in.
pub fn start_ages(homes: &[Option<usize>], stream: &mut Stream, mut set_age: impl FnMut(usize, Age)) {
    let kind = stream.uniform();
    if kind < 0.35 {
        return;
    }
    let uniform = |stream: &mut Stream| Age::after(1 + stream.below(u32::from(Age::MAX.slots())));
    let mut members: [Vec<usize>; SUB_CHANNELS] = Default::default();
    for (vehicle, home) in homes.iter().enumerate() {
        if let Some(home) = home {
            members[*home].push(vehicle);
        }
    }
    for group in &mut members {
        shuffle(group, stream);
        for (age, &vehicle) in (1..).zip(group.iter()) {
            let lost = kind < 0.55 && stream.chance(0.1);
            let age = if kind >= 0.65 || lost {
                uniform(stream)
            } else {
                Age::after(age)
            };
            set_age(vehicle, age);
        }
    }
}

/// Fisher and Yates.
pub fn shuffle(values: &mut [usize], stream: &mut Stream) {
    for last in (1..values.len()).rev() {
        values.swap(last, stream.below(last as u32 + 1) as usize);
    }
}
