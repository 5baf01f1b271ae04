//! The printed algorithm a second time, in burn's tensors and automatic differentiation, against ours.
//!
//! A learner gives its first parameters, its options, its batches and its draws of noise, but none of its arithmetic. Burn counts in
//! f64, so that what differs is our own rounding.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use super::learner::MaddpgLearner;
use super::optimiser::Learned;
use super::options::Maddpg;
use super::replay::Batch;
use crate::laboratory::configuration::Preset;
use crate::laboratory::learner::Learner as _;
use crate::laboratory::random;
use burn_tensor::activation::relu;
use burn_tensor::{DType, Device, Tensor, TensorData};

const VEHICLES: usize = 3;
const SAMPLES: usize = 16;
/// Sub-channel and power.
const ACTION: usize = 2;
/// Every second one is a delayed one.
const UPDATES: u32 = 8;

/// The bar of relative error, over all parameters of a network together.
const MOST: f64 = 4e-4;

fn tensor<const D: usize>(values: &[f32], shape: [usize; D]) -> Tensor<D> {
    let data = TensorData::new(values.to_vec(), shape);
    Tensor::from_data(data, (&Device::default(), DType::F64))
}

/// A perceptron and Adam, by definition.
struct Network {
    name: String,
    widths: Vec<usize>,
    first: Tensor<1>,
    parameters: Tensor<1>,
    target: Tensor<1>,
    mean: Tensor<1>,
    square: Tensor<1>,
    steps: u32,
}

impl Network {
    fn new(name: String, widths: &[usize], learned: &Learned) -> Self {
        let parameters = tensor(&learned.parameters, [learned.parameters.len()]);
        Self {
            name,
            widths: widths.to_vec(),
            first: parameters.clone(),
            target: parameters.clone(),
            mean: parameters.zeros_like(),
            square: parameters.zeros_like(),
            parameters,
            steps: 0,
        }
    }

    /// Layers lie one after the other: weights `[outputs][inputs]`, then biases.
    fn run(&self, parameters: &Tensor<1>, mut values: Tensor<2>) -> Tensor<2> {
        let (mut first, last) = (0, self.widths.len() - 2);
        for (layer, width) in self.widths.windows(2).enumerate() {
            let (inputs, outputs) = (width[0], width[1]);
            let mut part = |rows: usize, columns: usize| -> Tensor<2> {
                let place = first..first + rows * columns;
                first = place.end;
                parameters.clone().slice([place]).reshape([rows, columns])
            };
            let weights = part(outputs, inputs);
            values = values.matmul(weights.transpose()) + part(1, outputs);
            if layer < last {
                values = relu(values);
            }
        }
        values
    }

    fn run_target(&self, values: Tensor<2>) -> Tensor<2> {
        self.run(&self.target, values)
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
            let (error, change) = (from(tensor(ours, [ours.len()])), from(self.first.clone()));
            let place = format!("{}, {role}, update {update}", self.name);
            assert_eq!(change > 0.0, self.steps > 0, "{place}: learned");
            assert!(
                error <= MOST * change,
                "{place}: error {error:.2e} after a change of {change:.2e}"
            );
        }
    }
}

/// Steps down the gradient of a loss of these networks' parameters.
fn improve(
    networks: &mut [Network],
    learning_rate: f32,
    target_rate: f32,
    loss: impl Fn(&[Network], &[Tensor<1>]) -> Tensor<1>,
) {
    let leaf = |network: &Network| network.parameters.clone().autodiff().require_grad();
    let parameters: Vec<Tensor<1>> = networks.iter().map(leaf).collect();
    let gradients = loss(networks, &parameters).backward();
    for (network, parameters) in networks.iter_mut().zip(&parameters) {
        let slopes = parameters.grad(&gradients).unwrap();
        network.step(slopes, learning_rate, target_rate);
    }
}

/// Actions of all vehicles, `[sample][vehicle][action]`.
fn actions(actors: &[Network], parameters: &[Tensor<1>], seen: &Tensor<3>) -> Tensor<3> {
    let each = actors.iter().zip(parameters).enumerate();
    let actions = each.map(|(vehicle, (actor, parameters))| actor.run(parameters, own(seen, vehicle)).tanh());
    Tensor::stack(actions.collect(), 1)
}

/// One vehicle's part of `[sample][vehicle][value]`.
fn own(values: &Tensor<3>, vehicle: usize) -> Tensor<2> {
    values.clone().select_dim(1, vehicle)
}

/// All vehicles' parts side by side.
fn all(values: &Tensor<3>) -> Tensor<2> {
    values.clone().flatten(1, 2)
}

fn beside(seen: &Tensor<3>, actions: Tensor<3>) -> Tensor<3> {
    Tensor::cat(vec![seen.clone(), actions], 2)
}

fn sum(terms: impl Iterator<Item = Tensor<1>>) -> Tensor<1> {
    terms.reduce(|sum, term| sum + term).unwrap()
}

struct Oracle {
    options: Maddpg,
    actors: Vec<Network>,
    local_critics: Vec<Network>,
    twins: Vec<Network>,
    updates: u32,
}

impl Oracle {
    fn new(learner: &MaddpgLearner) -> Self {
        let (options, seen) = (learner.options.clone(), learner.extent.observed);
        let [actors, local_critics, twins] = learned(learner);
        let networks = |name: &str, learned: &[&Learned], inputs: usize, hidden: &[usize], outputs: usize| {
            let widths = [&[inputs], hidden, &[outputs]].concat();
            let each = learned.iter().enumerate();
            each.map(|(index, learned)| Network::new(format!("{name} {index}"), &widths, learned))
                .collect()
        };
        let (local, global) = (seen + ACTION, VEHICLES * (seen + ACTION));
        Self {
            actors: networks("actor", &actors, seen, &options.actor_hidden, ACTION),
            local_critics: networks(
                "local critic",
                &local_critics,
                local,
                &options.local_critic_hidden,
                1,
            ),
            twins: networks("global critic", &twins, global, &options.global_critic_hidden, 1),
            options,
            updates: 0,
        }
    }

    /// Algorithm 1 on one batch, with standard normal draws `[sample][vehicle][action]`.
    fn learn(&mut self, batch: &Batch, normals: &[f32]) {
        let options = &self.options;
        let (actor_rate, critic_rate) = (options.actor_learning_rate, options.critic_learning_rate);
        let (follow, discount) = (options.target_rate, options.discount);
        // A vehicle's row ends with what only other forms of critics may know.
        let known = batch.known.len() / (SAMPLES * VEHICLES);
        let seen = |values| {
            let seen = 0..self.actors[0].widths[0];
            tensor(values, [SAMPLES, VEHICLES, known]).slice_dim(2, seen)
        };
        let (now, later) = (seen(&batch.known), seen(&batch.later));
        let shape = [SAMPLES, VEHICLES, ACTION];
        let done = beside(&now, tensor(&batch.actions, shape));
        let rewards: Tensor<2> = tensor(&batch.rewards, [SAMPLES, VEHICLES]);

        let clip = options.smoothing_clip;
        let noise = (tensor(normals, shape) * options.smoothing_noise).clamp(-clip, clip);
        let targets: Vec<Tensor<1>> = self.actors.iter().map(|actor| actor.target.clone()).collect();
        let smoothed = (actions(&self.actors, &targets, &later) + noise).clamp(-1.0, 1.0);
        let next = beside(&later, smoothed);

        let [first, second] = [0, 1].map(|twin: usize| self.twins[twin].run_target(all(&next)));
        let wanted = rewards.clone().mean_dim(1) + first.min_pair(second) * discount;
        improve(&mut self.twins, critic_rate, follow, |twins, parameters| {
            let each = twins.iter().zip(parameters);
            sum(each.map(|(twin, at)| (twin.run(at, all(&done)) - wanted.clone()).square().mean()))
        });
        self.updates += 1;
        if !self.updates.is_multiple_of(self.options.delay) {
            return;
        }

        let each = self.local_critics.iter().enumerate();
        let wanted: Vec<Tensor<2>> = each
            .map(|(vehicle, critic)| {
                rewards.clone().slice_dim(1, vehicle) + critic.run_target(own(&next, vehicle)) * discount
            })
            .collect();
        improve(
            &mut self.local_critics,
            critic_rate,
            follow,
            |critics, parameters| {
                let each = critics.iter().zip(parameters).zip(&wanted).enumerate();
                sum(each.map(|(vehicle, ((critic, at), wanted))| {
                    (critic.run(at, own(&done, vehicle)) - wanted.clone())
                        .square()
                        .mean()
                }))
            },
        );

        let (twin, critics) = (&self.twins[0], &self.local_critics);
        improve(&mut self.actors, actor_rate, follow, |actors, parameters| {
            let acting = beside(&now, actions(actors, parameters, &now));
            let each = critics.iter().enumerate();
            let local =
                sum(each
                    .map(|(vehicle, critic)| critic.run(&critic.parameters, own(&acting, vehicle)).mean()));
            -(twin.run(&twin.parameters, all(&acting)).mean() + local)
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

fn learner() -> MaddpgLearner {
    let settings = [
        "scenario.cell.vehicles=3",
        "maddpg.slots=50",
        "maddpg.replay=1000",
        // Never reached by playing.
        "maddpg.warm_up_slots=1000",
        "maddpg.batch=16",
        "maddpg.actor_hidden=[24, 16]",
        "maddpg.local_critic_hidden=[20, 12, 8]",
        "maddpg.global_critic_hidden=[20, 12, 8]",
        // Faster than the preset's: where little changes, what is seen is how parameters are rounded.
        "maddpg.actor_learning_rate=1e-3",
        "maddpg.last_actor_learning_rate=1e-3",
        "maddpg.target_rate=0.1",
        // Small rewards: a part of the targets beside the critics' values, and much noise that is cut.
        "maddpg.age_cap=10",
        "maddpg.smoothing_clip=0.2",
    ];
    let mut learner = MaddpgLearner::of_preset(Preset::Companion, &settings);
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
    learner
}

#[test]
fn burn_repeats_the_updates() {
    compare(learner());
    // One twin may be the lesser for all samples: then the other way round the least is the other one.
    let mut swapped = learner();
    swapped.twins.swap(0, 1);
    compare(swapped);
}

fn compare(mut learner: MaddpgLearner) {
    let mut oracle = Oracle::new(&learner);
    (0..2).for_each(|_| {
        let _metrics = learner.advance();
    });
    assert_eq!(learner.updates(), 0);
    learner.options.warm_up_slots = 0;
    let mut stream = random::initial(1, 1);
    for update in 1..=UPDATES {
        // What `learn` draws: the batch, then noise.
        let (mut draws, mut batch) = (stream.clone(), Batch::default());
        learner
            .replay
            .sample(SAMPLES, 1, learner.options.discount, &mut draws, &mut batch);
        let normals: Vec<f32> = batch.actions.iter().map(|_| draws.normal() as f32).collect();
        learner.learn(&mut stream);
        oracle.learn(&batch, &normals);
        let groups = [&oracle.actors, &oracle.local_critics, &oracle.twins];
        for (ours, theirs) in learned(&learner).iter().zip(groups) {
            for (ours, theirs) in ours.iter().zip(theirs) {
                theirs.compare(ours, update);
            }
        }
    }
}
