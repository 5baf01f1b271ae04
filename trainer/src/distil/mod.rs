//! Distillation: a small network imitates the ring clock by dataset aggregation (DAgger, Ross et al. 2011). The learner
//! drives the cells, the clock says what it should have done there.

pub mod table;

use crate::forms::{as_float, best_action};
use crate::game::start_ages;
use crate::laboratory::random;
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
    /// Most vehicles in a cell.
    pub max_vehicles: u32,
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
            min_vehicles: 1,
            max_vehicles: 300,
        }
    }
}

/// Most sub-channels of a cell that is watched: what the table will serve (chosen: two and a half times the paper's).
pub const MAX_SUB_CHANNELS: u32 = 8;

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

/// Distils the clock of `scenario`. The same recipe and scenario give the same network to the last bit, on any machine and any
/// number of threads.
pub fn distil(scenario: &Scenario, recipe: &Recipe, mut progress: impl FnMut(Round)) -> Distilled {
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

/// Makes one cell of the mixture: any load, number of sub-channels and link budget, with and without places, and what a street brings
/// (shares are chosen).
fn vary(scenario: &mut Scenario, recipe: &Recipe, stream: &mut Stream) {
    let (least, most) = (f64::from(recipe.min_vehicles), f64::from(recipe.max_vehicles));
    // Loads whose ratios are alike are equally frequent.
    let vehicles = least * libm::pow((most + 1.0) / least, f64::from(stream.uniform()));
    scenario.cell.vehicles = (vehicles as u32).clamp(recipe.min_vehicles, recipe.max_vehicles);
    let mut either = |share: f64, value: f64, other: f64| if stream.chance(share) { value } else { other };
    let radio = &mut scenario.radio;
    radio.max_power_dbm = either(0.5, radio.max_power_dbm, 23.0);
    radio.carrier_ghz = either(0.5, radio.carrier_ghz, 5.9);
    let feedback = &mut scenario.feedback;
    let lost = either(0.5, 0.3, 1.0);
    feedback.place_loss = either(0.4, 0.0, lost);
    feedback.acknowledgement_delay_slots = either(0.5, 0.0, 4.0) as u32;
    feedback.acknowledgement_loss = either(0.5, 0.0, 0.05);
    scenario.knowledge.gain_delay_slots = either(0.5, 0.0, 4.0) as u32;
    scenario.knowledge.gain_error_db = either(0.5, 0.0, 2.0);
    scenario.mobility.standing_share = either(0.5, 0.0, 0.3);
    scenario.fading.follows_speed = either(0.5, 0.0, 1.0) > 0.0;
    if stream.chance(0.5) {
        scenario.radio.sub_channels = 1 + stream.below(MAX_SUB_CHANNELS);
    }
}

/// Watches one cell of the mixture from random ages. In a share of slots the clock drives, in the others the learner.
fn watch(
    scenario: &Scenario,
    recipe: &Recipe,
    key: &WorldKey,
    network: &Network,
    expert_share: f64,
) -> Samples {
    let mut stream = key.stream(Role::Policy, 1);
    let mut scenario = scenario.clone();
    vary(&mut scenario, recipe, &mut stream);
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
    use crate::distil::table::shipped_scenario;

    #[test]
    fn the_mixture_holds_every_kind_of_cell() {
        let recipe = Recipe::default();
        let shipped = shipped_scenario().unwrap();
        let mut stream = random::initial(1, 0);
        let cells: Vec<Scenario> = (0..2000)
            .map(|_| {
                let mut cell = shipped.clone();
                vary(&mut cell, &recipe, &mut stream);
                cell.check().unwrap();
                cell
            })
            .collect();
        let share = |holds: &dyn Fn(&Scenario) -> bool| {
            cells.iter().filter(|cell| holds(cell)).count() as f64 / cells.len() as f64
        };
        for sub_channels in 1..=MAX_SUB_CHANNELS {
            let expected = if sub_channels == 3 {
                0.5 + 1.0 / 16.0
            } else {
                1.0 / 16.0
            };
            let found = share(&|cell| cell.radio.sub_channels == sub_channels);
            assert!((found - expected).abs() < 0.04, "{sub_channels}: {found}");
        }
        // Half of the loads are below the square root of the largest.
        let few = share(&|cell| cell.cell.vehicles < 17);
        assert!((few - 0.5).abs() < 0.04, "{few}");
        let ends = [recipe.min_vehicles, recipe.max_vehicles];
        assert!(
            cells
                .iter()
                .all(|cell| (ends[0]..=ends[1]).contains(&cell.cell.vehicles))
        );
        let places = [0.0, 0.3, 1.0].map(|loss| share(&|cell| cell.feedback.place_loss == loss));
        assert!(
            places.iter().all(|share| (share - 0.35).abs() < 0.1),
            "{places:?}"
        );
        let late = share(&|cell| cell.knowledge.gain_delay_slots > 0 && cell.fading.follows_speed);
        assert!((late - 0.25).abs() < 0.04, "{late}");
    }
}
