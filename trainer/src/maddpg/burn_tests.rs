//! Updates of both backends against burn's gradients and Adam by definition, both in f64.
//!
//! A learner gives its first parameters, its options, its batches and its draws of noise, but none of its arithmetic. What differs from
//! f64 is its own rounding.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use super::burn::{Layers, Printed, slopes, tensor};
use super::in_cell::MaddpgInCell;
use super::learner::MaddpgLearner;
use super::options::{Backend, Maddpg};
use super::replay::Batch;
use crate::configuration::Preset;
use crate::laboratory::learner::Learner as _;
use crate::laboratory::random;
use crate::network::optimiser::Learned;
use crate::network::perceptron::Perceptron;
use burn_tensor::{DType, Tensor};

const SAMPLES: usize = 16;
/// Every second one is a delayed one.
const UPDATES: u32 = 8;

/// The bar of relative error, over all parameters of a network together.
const MOST: f64 = 4e-4;

/// A perceptron and Adam, by definition.
struct Network {
    name: String,
    first: Tensor<1>,
    parameters: Tensor<1>,
    target: Tensor<1>,
    mean: Tensor<1>,
    square: Tensor<1>,
    steps: u32,
}

impl Network {
    fn new(name: String, learned: &Learned) -> Self {
        let parameters = flat(&learned.parameters);
        Self {
            name,
            first: parameters.clone(),
            target: parameters.clone(),
            mean: parameters.zeros_like(),
            square: parameters.zeros_like(),
            parameters,
            steps: 0,
        }
    }

    /// Adam (Kingma and Ba 2015, Algorithm 1) with its usual numbers, then the target after the parameters.
    fn step(&mut self, slopes: Tensor<1>, learning_rate: f32, target_rate: f32) {
        let (beta_1, beta_2, epsilon) = (0.9, 0.999, 1e-8);
        self.steps += 1;
        let unbiased = |beta: f64| 1.0 - libm::pow(beta, f64::from(self.steps));
        self.mean = self.mean.clone() * beta_1 + slopes.clone() * (1.0 - beta_1);
        self.square = self.square.clone() * beta_2 + slopes.square() * (1.0 - beta_2);
        let mean = self.mean.clone() / unbiased(beta_1);
        let root = (self.square.clone() / unbiased(beta_2)).sqrt();
        self.parameters = self.parameters.clone() - mean * learning_rate / (root + epsilon);
        self.target = self.target.clone() * (1.0 - target_rate) + self.parameters.clone() * target_rate;
    }

    /// Asserts that ours are near these, measured by how far these came.
    fn compare(&self, ours: &Learned, update: u32) {
        for (role, ours, theirs) in [
            ("parameters", &ours.parameters, &self.parameters),
            ("target", &ours.target, &self.target),
        ] {
            let from = |other: Tensor<1>| -> f64 {
                let square = (theirs.clone() - other).square().sum();
                libm::sqrt(square.try_into_scalar().unwrap())
            };
            let (error, change) = (from(flat(ours)), from(self.first.clone()));
            let place = format!("{}, {role}, update {update}", self.name);
            assert_eq!(change > 0.0, self.steps > 0, "{place}: learned");
            assert!(
                error <= MOST * change,
                "{place}: error {error:.2e} after a change of {change:.2e}"
            );
        }
    }
}

fn flat(values: &[f32]) -> Tensor<1> {
    tensor(values, [values.len()], DType::F64)
}

/// Steps down the gradient of a loss of these networks' parameters.
fn improve(
    network: &Perceptron,
    networks: &mut [Network],
    learning_rate: f32,
    target_rate: f32,
    loss: impl FnOnce(&[Layers]) -> Tensor<1>,
) {
    let (_loss, slopes) = slopes(parameters(network, networks), loss);
    for (network, slopes) in networks.iter_mut().zip(slopes) {
        network.step(slopes, learning_rate, target_rate);
    }
}

fn parameters(network: &Perceptron, networks: &[Network]) -> Vec<Layers> {
    networks
        .iter()
        .map(|each| Layers::new(network, &each.parameters))
        .collect()
}

fn targets(network: &Perceptron, networks: &[Network]) -> Vec<Layers> {
    networks
        .iter()
        .map(|each| Layers::new(network, &each.target))
        .collect()
}

struct Oracle {
    actors: Vec<Network>,
    local_critics: Vec<Network>,
    twins: Vec<Network>,
    updates: u32,
}

impl Oracle {
    fn new(learner: &MaddpgLearner) -> Self {
        let [actors, local_critics, twins] = learned(learner);
        let networks = |name: &str, learned: &[&Learned]| {
            let each = learned.iter().enumerate();
            each.map(|(index, learned)| Network::new(format!("{name} {index}"), learned))
                .collect()
        };
        Self {
            actors: networks("actor", &actors),
            local_critics: networks("local critic", &local_critics),
            twins: networks("global critic", &twins),
            updates: 0,
        }
    }

    /// Algorithm 1 on one batch, with standard normal draws `[sample][vehicle][action]`.
    fn learn(&mut self, options: &Maddpg, batch: &Printed, normals: &[f32]) {
        let (actor_rate, critic_rate) = (options.actor_learning_rate, options.critic_learning_rate);
        let follow = options.target_rate;
        let next = batch.next(&targets(&batch.actor, &self.actors), normals);
        let critic = &batch.global_critic;
        let later = targets(critic, &self.twins);
        improve(critic, &mut self.twins, critic_rate, follow, |twins| {
            batch.global_loss(twins, &later, &next)
        });
        self.updates += 1;
        if !self.updates.is_multiple_of(options.delay) {
            return;
        }
        let twins = parameters(critic, &self.twins);
        let critic = &batch.local_critic;
        let later = targets(critic, &self.local_critics);
        improve(critic, &mut self.local_critics, critic_rate, follow, |critics| {
            batch.local_loss(critics, &later, &next)
        });
        let critics = parameters(critic, &self.local_critics);
        improve(&batch.actor, &mut self.actors, actor_rate, follow, |actors| {
            batch.actor_loss(actors, &twins[0], &critics)
        });
    }
}

/// Actors, local critics, twins.
fn learned(learner: &MaddpgLearner) -> [Vec<&Learned>; 3] {
    [
        learner.actors.learned.iter().collect(),
        learner
            .local_critics
            .iter()
            .flat_map(|critics| &critics.learned)
            .collect(),
        learner.twins.iter().collect(),
    ]
}

fn learner(backend: Backend) -> MaddpgInCell {
    let settings = [
        "scenario.cell.vehicles=3",
        // So that agents end in most batches.
        "scenario.cell.replacement_probability=0.1",
        "maddpg.slots=50",
        "maddpg.replay=1000",
        // Never reached by playing.
        "maddpg.warm_up_slots=1000",
        "maddpg.batch=16",
        "maddpg.actor_hidden=[24, 16]",
        "maddpg.local_critic_hidden=[20, 12, 8]",
        "maddpg.global_critic_hidden=[20, 12, 8]",
        // Faster than the preset's: where little changes, what is seen is how parameters are rounded.
        "maddpg.actor_learning_rate=2e-3",
        "maddpg.last_actor_learning_rate=2e-3",
        "maddpg.target_rate=0.1",
        // Small rewards: a part of the targets beside the critics' values, and much noise that is cut.
        "maddpg.age_cap=10",
        "maddpg.smoothing_clip=0.2",
    ];
    let mut cell = MaddpgInCell::of_preset(Preset::Companion, &settings);
    let learner = &mut cell.learner;
    learner.options.backend = backend;
    // Twice as large as usual, so that they count beside the rewards.
    let local = learner
        .local_critics
        .iter_mut()
        .flat_map(|critics| &mut critics.learned);
    for critic in local.chain(&mut learner.twins) {
        *critic = Learned::new(
            critic
                .parameters
                .iter()
                .map(|parameter| 2.0 * parameter)
                .collect(),
        );
    }
    cell
}

#[test]
fn both_backends_update_as_burn_and_adam_do_in_f64() {
    for backend in [Backend::Own, Backend::Burn] {
        compare(learner(backend));
        // One twin may be the lesser for all samples: then the other way round the least is the other one.
        let mut swapped = learner(backend);
        swapped.learner.twins.swap(0, 1);
        compare(swapped);
    }
}

fn compare(mut cell: MaddpgInCell) {
    let mut oracle = Oracle::new(&cell.learner);
    (0..2).for_each(|_| {
        let _metrics = cell.advance();
    });
    let learner = &mut cell.learner;
    assert_eq!(learner.updates(), 0);
    learner.options.warm_up_slots = 0;
    let mut stream = random::initial(1, 1);
    for update in 1..=UPDATES {
        // What `learn` draws: the batch, then noise.
        let (mut draws, mut batch) = (stream.clone(), Batch::default());
        learner
            .replay
            .sample(SAMPLES, learner.options.sought(), &mut draws, &mut batch);
        let normals: Vec<f32> = batch.actions.iter().map(|_| draws.normal() as f32).collect();
        let printed = Printed::new(learner, &batch, DType::F64);
        learner.learn(&mut stream);
        oracle.learn(&learner.options, &printed, &normals);
        let groups = [&oracle.actors, &oracle.local_critics, &oracle.twins];
        for (ours, theirs) in learned(learner).iter().zip(groups) {
            for (ours, theirs) in ours.iter().zip(theirs) {
                theirs.compare(ours, update);
            }
        }
    }
}
