//! The printed algorithm in burn's tensors, whose automatic differentiation finds the gradients: backend `burn`.
//!
//! Here a loss can be changed without deriving its gradient by hand; and the own kernels are held against it in the tests. It
//! knows the paper's form alone (see [`super::options::Maddpg::check`]). Adam, targets and checkpoints are those of [`Learned`].

use super::learner::MaddpgLearner;
use super::options::{GlobalWeight, Maddpg};
use super::replay::{Batch, Extent};
use crate::network::optimiser::{Learned, Step, clip};
use crate::network::perceptron::Perceptron;
use burn_tensor::activation::relu;
use burn_tensor::{DType, Device, Gradients, Tensor, TensorData};
use host_sim::stream::Stream;
use rayon::prelude::*;

/// One update of the global critics and, if it is a delayed one, of local critics and actors.
pub fn update(learner: &mut MaddpgLearner, batch: &Batch, delayed: bool, stream: &mut Stream) {
    let normals: Vec<f32> = batch.actions.iter().map(|_| stream.normal() as f32).collect();
    let printed = Printed::new(learner, batch, DType::F32);
    let next = printed.next(&targets(&printed.actor, &learner.actors.learned), &normals);
    let (critic_step, actor_step) = (learner.critic_step(), learner.actor_step());
    let longest = learner.options.gradient_clip;

    let critic = &printed.global_critic;
    let later = targets(critic, &learner.twins);
    let loss = improve(critic, &mut learner.twins, critic_step, longest, |twins| {
        printed.global_loss(twins, &later, &next)
    });
    learner.losses.global += loss / 2.0;
    learner.losses.global_count += 1;
    if !delayed {
        return;
    }

    let twins = learners(critic, &learner.twins);
    let mut local_critics = Vec::new();
    if let Some(critics) = &mut learner.local_critics {
        let critic = &printed.local_critic;
        let later = targets(critic, &critics.learned);
        let loss = improve(critic, &mut critics.learned, critic_step, longest, |critics| {
            printed.local_loss(critics, &later, &next)
        });
        learner.losses.local += loss / critics.learned.len() as f64;
        local_critics = learners(critic, &critics.learned);
    }
    let actors = &mut learner.actors.learned;
    improve(&printed.actor, actors, actor_step, longest, |actors| {
        printed.actor_loss(actors, &twins[0], &local_critics)
    });
    learner.losses.delayed_count += 1;
}

/// A batch, the shapes of the networks that it runs through, and the losses.
pub struct Printed {
    /// From an observation to an action before its tanh.
    pub actor: Perceptron,
    /// From an observation and an action to a value.
    pub local_critic: Perceptron,
    /// The same of all vehicles side by side.
    pub global_critic: Perceptron,
    options: Maddpg,
    vehicles: usize,
    real: DType,
    /// `[sample][vehicle][observation]`.
    seen: Tensor<3>,
    /// The same after the steps of a return.
    seen_later: Tensor<3>,
    /// `[sample][vehicle][action]`.
    actions: Tensor<3>,
    /// `[sample][vehicle]`: parts of the cell's reward.
    rewards: Tensor<2>,
    /// `[sample][vehicle]`: what each agent is paid, up to its end.
    own_rewards: Tensor<2>,
    /// `[sample][1]`: weight of the cell's value after the steps of a return.
    later_weight: Tensor<2>,
    /// `[sample][vehicle]`: weight of each agent's, 0 after its end.
    own_later_weight: Tensor<2>,
}

impl Printed {
    /// What a learner makes of a batch, counted in this type.
    pub fn new(learner: &MaddpgLearner, batch: &Batch, real: DType) -> Self {
        let Extent {
            vehicles,
            known,
            observed,
            action,
            ..
        } = learner.extent;
        let options = learner.options.clone();
        let seen_and_done = observed + action;
        let samples = batch.present.len();
        // A vehicle's row ends with what only other forms of critics may know.
        let seen = |values| tensor(values, [samples, vehicles, known], real).slice_dim(2, 0..observed);
        Self {
            actor: Perceptron::new(observed, &options.actor_hidden, action),
            local_critic: Perceptron::new(seen_and_done, &options.local_critic_hidden, 1),
            global_critic: Perceptron::new(vehicles * seen_and_done, &options.global_critic_hidden, 1),
            vehicles,
            options,
            real,
            seen: seen(&batch.known),
            seen_later: seen(&batch.later),
            actions: tensor(&batch.actions, [samples, vehicles, action], real),
            rewards: tensor(&batch.rewards, [samples, vehicles], real),
            own_rewards: tensor(&batch.own_rewards, [samples, vehicles], real),
            later_weight: tensor(&batch.later_weight, [samples, 1], real),
            own_later_weight: tensor(&batch.own_later_weight, [samples, vehicles], real),
        }
    }

    /// What comes next, and what target actors would do there, smoothed by these standard normal draws.
    pub fn next(&self, target_actors: &[Layers], normals: &[f32]) -> Tensor<3> {
        let clip = self.options.smoothing_clip;
        let noise = tensor(normals, self.actions.dims(), self.real) * self.options.smoothing_noise;
        let actions = self.act(target_actors, &self.seen_later) + noise.clamp(-clip, clip);
        beside(&self.seen_later, actions.clamp(-1.0, 1.0))
    }

    /// Squared distance of each twin from `y_g = r_g + gamma min(Q'_1, Q'_2)`, summed over the twins.
    pub fn global_loss(&self, twins: &[Layers], later: &[Layers], next: &Tensor<3>) -> Tensor<1> {
        let least = later
            .iter()
            .map(|twin| twin.run(all(next)))
            .reduce(Tensor::min_pair);
        let reward = self.rewards.clone().mean_dim(1);
        let wanted = match least {
            Some(least) => reward + least * self.later_weight.clone(),
            None => reward,
        };
        let now = beside(&self.seen, self.actions.clone());
        self.sum(
            twins
                .iter()
                .map(|twin| (twin.run(all(&now)) - wanted.clone()).square().mean()),
        )
    }

    /// Squared distance of each local critic from `y_l = r_l + gamma Q'_l`, without the latter where the agent has ended, summed over
    /// the vehicles.
    pub fn local_loss(&self, critics: &[Layers], later: &[Layers], next: &Tensor<3>) -> Tensor<1> {
        let now = beside(&self.seen, self.actions.clone());
        let each = critics.iter().zip(later).enumerate();
        self.sum(each.map(|(vehicle, (critic, later))| {
            let [reward, weight] =
                [&self.own_rewards, &self.own_later_weight].map(|all| all.clone().slice_dim(1, vehicle));
            let wanted = reward + later.run(own(next, vehicle)) * weight;
            (critic.run(own(&now, vehicle)) - wanted).square().mean()
        }))
    }

    /// What the actors step down: minus what the first twin and the local critics, if there are any, think of their actions (paper
    /// eq. "td3").
    pub fn actor_loss(&self, actors: &[Layers], twin: &Layers, critics: &[Layers]) -> Tensor<1> {
        let samples = 0..self.options.actor_batch.min(self.options.batch);
        let seen = self.seen.clone().slice_dim(0, samples);
        let acting = beside(&seen, self.act(actors, &seen));
        let weight = match self.options.global_weight {
            GlobalWeight::Printed => 1.0,
            GlobalWeight::Vehicles => self.vehicles as f32,
            GlobalWeight::None => 0.0,
        };
        let global = twin.run(all(&acting)).mean();
        let local = self.sum(
            critics
                .iter()
                .enumerate()
                .map(|(vehicle, critic)| critic.run(own(&acting, vehicle)).mean()),
        );
        -(global * weight + local * self.options.local_weight)
    }

    /// Actions of all vehicles, `[sample][vehicle][action]`.
    fn act(&self, actors: &[Layers], seen: &Tensor<3>) -> Tensor<3> {
        let each = actors.iter().enumerate();
        let actions = each.map(|(vehicle, actor)| actor.run(own(seen, vehicle)).tanh());
        Tensor::stack(actions.collect(), 1)
    }

    fn sum(&self, terms: impl Iterator<Item = Tensor<1>>) -> Tensor<1> {
        terms.fold(tensor(&[0.0], [1], self.real), |sum, term| sum + term)
    }
}

/// Steps down the gradient of a loss of these networks' parameters; gives the loss.
fn improve(
    network: &Perceptron,
    learned: &mut [Learned],
    step: Step,
    longest_gradient: f32,
    loss: impl FnOnce(&[Layers]) -> Tensor<1>,
) -> f64 {
    let (loss, slopes) = slopes(learners(network, learned), loss);
    learned.par_iter_mut().zip(slopes).for_each(|(learned, slopes)| {
        let slopes = values(slopes);
        let scale = clip(&slopes, longest_gradient);
        learned.step(&slopes, Step { scale, ..step });
    });
    values(loss).iter().map(|&loss| f64::from(loss)).sum()
}

/// A loss and its slopes along each network's parameters.
pub fn slopes(
    networks: Vec<Layers>,
    loss: impl FnOnce(&[Layers]) -> Tensor<1>,
) -> (Tensor<1>, Vec<Tensor<1>>) {
    let networks: Vec<Layers> = networks.into_iter().map(Layers::wanted).collect();
    let loss = loss(&networks);
    assert_eq!(loss.dims(), [1], "a loss is one number: a mean over the batch");
    let gradients = loss.backward();
    let slopes = networks
        .iter()
        .map(|network| network.slopes(&gradients))
        .collect();
    (loss, slopes)
}

fn learners(network: &Perceptron, learned: &[Learned]) -> Vec<Layers> {
    let layers = |learned: &Learned| Layers::new(network, &flat(&learned.parameters));
    learned.iter().map(layers).collect()
}

fn targets(network: &Perceptron, learned: &[Learned]) -> Vec<Layers> {
    let layers = |learned: &Learned| Layers::new(network, &flat(&learned.target));
    learned.iter().map(layers).collect()
}

fn flat(values: &[f32]) -> Tensor<1> {
    tensor(values, [values.len()], DType::F32)
}

/// Each layer's weights, `[outputs][inputs]`, and biases, `[1][outputs]`.
pub struct Layers(Vec<[Tensor<2>; 2]>);

impl Layers {
    /// A network's parameters, which lie one layer after the other.
    pub fn new(network: &Perceptron, parameters: &Tensor<1>) -> Self {
        let layers = network.widths().windows(2).enumerate();
        let layers = layers.map(|(layer, width)| {
            let [weights, biases] = [network.weights(layer), network.biases(layer)]
                .map(|place| parameters.clone().slice([place]));
            [
                weights.reshape([width[1], width[0]]),
                biases.reshape([1, width[1]]),
            ]
        });
        Self(layers.collect())
    }

    /// The same, followed by automatic differentiation.
    fn wanted(self) -> Self {
        let wanted = |part: Tensor<2>| part.autodiff().require_grad();
        Self(self.0.into_iter().map(|layer| layer.map(wanted)).collect())
    }

    /// Slopes along the parameters, in their order; zeros where the loss does not depend on them.
    fn slopes(&self, gradients: &Gradients) -> Tensor<1> {
        let slopes = |part: &Tensor<2>| {
            let slopes = part.grad(gradients);
            slopes
                .unwrap_or_else(|| part.clone().inner().zeros_like())
                .flatten(0, 1)
        };
        Tensor::cat(self.0.as_flattened().iter().map(slopes).collect(), 0)
    }

    /// ReLU between the layers.
    fn run(&self, mut values: Tensor<2>) -> Tensor<2> {
        for (index, [weights, biases]) in self.0.iter().enumerate() {
            values = values.matmul(weights.clone().transpose()) + biases.clone();
            if index + 1 < self.0.len() {
                values = relu(values);
            }
        }
        values
    }
}

/// Values as a tensor that counts in this type.
pub fn tensor<const D: usize>(values: &[f32], shape: [usize; D], real: DType) -> Tensor<D> {
    let data = TensorData::new(values.to_vec(), shape);
    Tensor::from_data(data, (&Device::default(), real))
}

fn values(tensor: Tensor<1>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
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
