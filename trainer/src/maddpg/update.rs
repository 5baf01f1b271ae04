//! One update: critics towards their targets, actors up the critics' slopes (paper, Algorithm 1).
//!
//! A batch moves the twin global critics towards `y_g = r_g + gamma min(Q'_1, Q'_2)`, and every `delay`-th time the local critics
//! towards `y_l = r_l + gamma Q'_l` (`y_l = r_l` where the vehicle is replaced: its agent ends) and the actors up the slopes of Q_1 and Q_l together; targets follow all of them.

use super::critic::{CriticPass, Question};
use super::group::Role;
use super::learner::MaddpgLearner;
use super::options::GlobalWeight;
use super::replay::Batch;
use super::view::View;
use crate::network::categorical::{
    draw, entropy, entropy_slope, expectation, expectation_slopes, one_hot, probabilities,
};
use crate::network::optimiser::{Learned, Step};
use crate::network::perceptron::Rows;
use host_sim::stream::Stream;

impl MaddpgLearner {
    pub(super) fn learn(&mut self, stream: &mut Stream) {
        let sought = self.options.sought();
        if self.replay.transitions(sought.steps) < self.options.warm_up_slots.max(self.options.batch) {
            return;
        }
        let mut batch = std::mem::take(&mut self.batch);
        self.replay.sample(self.options.batch, sought, stream, &mut batch);
        self.counters.updates += 1;
        let delayed = self
            .counters
            .updates
            .is_multiple_of(u64::from(self.options.delay));
        match self.options.backend {
            #[cfg(feature = "burn")]
            super::options::Backend::Burn => super::burn::update(self, &batch, delayed, stream),
            _ => self.improve(&batch, delayed, stream),
        }
        self.batch = batch;
    }

    fn improve(&mut self, batch: &Batch, delayed: bool, stream: &mut Stream) {
        let rows = Rows {
            values: &batch.later,
            stride: self.extent.known,
            width: self.extent.observed,
        };
        let outputs = self.actors.outputs(Role::Target, &[rows]);
        let later = self.target_actions(&outputs, stream);
        self.improve_global(batch, &later);
        if delayed {
            self.improve_local(batch, &outputs, &later);
            self.improve_actors(batch, stream);
        }
    }

    /// What the target actors would do, smoothed: with noise, or now and then drawn from a flatter softmax.
    fn target_actions(&self, outputs: &[f32], stream: &mut Stream) -> Vec<f32> {
        let options = &self.options;
        let length = self.space.length();
        let mut actions = Vec::with_capacity(outputs.len());
        for outputs in outputs.chunks_exact(length) {
            if self.space.is_choice() {
                let flat = stream.uniform() < options.smoothing_noise;
                let scale = if flat { 0.5 } else { 1.0 };
                let scores: Vec<f32> = outputs.iter().map(|output| output * scale).collect();
                one_hot(draw(&scores, stream), length, &mut actions);
            } else {
                actions.extend(outputs.iter().map(|&output| {
                    let noise = options.smoothing_noise * stream.normal() as f32;
                    let noise = noise.clamp(-options.smoothing_clip, options.smoothing_clip);
                    (libm::tanhf(output) + noise).clamp(-1.0, 1.0)
                }));
            }
        }
        actions
    }

    /// Actions of the batch as vectors.
    fn action_vectors(&self, batch: &Batch) -> Vec<f32> {
        if !self.space.is_choice() {
            return batch.actions.clone();
        }
        let mut vectors = Vec::with_capacity(batch.actions.len() * self.space.length());
        for &action in &batch.actions {
            one_hot(action as usize, self.space.length(), &mut vectors);
        }
        vectors
    }

    fn step(&self, first: f32, last: f32) -> Step {
        Step {
            learning_rate: first + (last - first) * self.progress(),
            target_rate: self.options.target_rate,
            scale: 1.0,
        }
    }

    pub(super) fn critic_step(&self) -> Step {
        self.step(
            self.options.critic_learning_rate,
            self.options.last_critic_learning_rate,
        )
    }

    pub(super) fn actor_step(&self) -> Step {
        self.step(
            self.options.actor_learning_rate,
            self.options.last_actor_learning_rate,
        )
    }

    /// `y_g = r_g + gamma min(Q'_1, Q'_2)`.
    fn improve_global(&mut self, batch: &Batch, later: &[f32]) {
        let (actions, step) = (self.action_vectors(batch), self.critic_step());
        let (critic, options) = (self.critic.as_ref(), &self.options);
        let gradients = &self.gradients;
        let now = batch.view(&self.extent, &batch.known);
        let next = batch.view(&self.extent, &batch.later);
        let [first, second] = &mut self.passes;
        let later = self
            .twins
            .each_ref()
            .map(|twin| Question::new(&twin.target, next, later));
        let (first_value, second_value) = rayon::join(
            || critic.forward(&later[0], first),
            || critic.forward(&later[1], second),
        );
        let mut targets = global_rewards(&now, &batch.rewards);
        let least = first_value.iter().zip(&second_value).map(|(a, b)| a.min(*b));
        for ((target, least), weight) in targets.iter_mut().zip(least).zip(&batch.later_weight) {
            *target += weight * least;
        }
        let improve = |learned: &mut Learned, pass: &mut CriticPass| {
            let values = critic.forward(&Question::new(&learned.parameters, now, &actions), pass);
            let scale = 1.0 / values.len() as f32;
            let mut loss = 0.0;
            let slopes: Vec<f32> = values
                .iter()
                .zip(&targets)
                .map(|(value, target)| {
                    let (part, slope) = options.loss.of(value - target);
                    loss += part * scale;
                    slope * scale
                })
                .collect();
            learned.descend(gradients, step, options.gradient_clip, |parameters, gradient| {
                let asked = Question::new(parameters, now, &actions);
                critic.backward(&asked, &slopes, pass, gradient);
            });
            loss
        };
        let [first_twin, second_twin] = &mut self.twins;
        let (a, b) = rayon::join(|| improve(first_twin, first), || improve(second_twin, second));
        self.losses.global += f64::from(a + b) / 2.0;
        self.losses.global_count += 1;
    }

    /// `y_l = r_l + gamma Q'_l`, for a choice with the target actor's expectation of Q'_l.
    fn improve_local(&mut self, batch: &Batch, outputs: &[f32], later: &[f32]) {
        let step = self.critic_step();
        let (length, vehicles) = (self.space.length(), self.extent.vehicles);
        let (choice, loss) = (self.space.is_choice(), self.options.loss);
        let actions = self.action_vectors(batch);
        let Some(critics) = &mut self.local_critics else {
            return;
        };
        let known = |values| Rows {
            values,
            stride: self.extent.known,
            width: self.extent.observed,
        };
        let (later, now) = (
            [known(&batch.later), Rows::all(later, length)],
            [known(&batch.known), Rows::all(&actions, length)],
        );
        // Where actions are choices a critic has an output for each, otherwise the action is an input.
        let inputs = if choice { 1 } else { 2 };
        let scale = critics.learned.len() as f32 / taking_part(&batch.present);
        let losses = critics.learn_from(
            &later[..inputs],
            &now[..inputs],
            step,
            self.options.gradient_clip,
            |row, later, values, slopes| {
                if row % vehicles >= usize::from(batch.present[row / vehicles]) {
                    return 0.0;
                }
                let (index, later) = if choice {
                    let scores = &outputs[row * length..][..length];
                    (
                        batch.actions[row] as usize,
                        expectation(&probabilities(scores), later),
                    )
                } else {
                    (0, later[0])
                };
                let target = batch.own_rewards[row] + batch.own_later_weight[row] * later;
                let (part, slope) = loss.of(values[index] - target);
                slopes[index] = slope * scale;
                part * scale
            },
        );
        self.losses.local += f64::from(losses.iter().sum::<f32>()) / critics.learned.len() as f64;
    }

    /// Up the slopes of the first twin and the local critic together (paper eq. "td3").
    fn improve_actors(&mut self, batch: &Batch, stream: &mut Stream) {
        let samples = self.options.actor_batch.min(batch.present.len());
        let rows = samples * self.extent.vehicles;
        let known = Rows {
            values: &batch.known[..rows * self.extent.known],
            stride: self.extent.known,
            width: self.extent.observed,
        };
        let view = View {
            present: &batch.present[..samples],
            ..batch.view(&self.extent, known.values)
        };
        let outputs = self.actors.forward(&[known]);
        let scale = self.actors.learned.len() as f32 / taking_part(view.present);
        let slopes = if self.space.is_choice() {
            self.choice_slopes(&view, known, &outputs, scale, stream)
        } else {
            let actions: Vec<f32> = outputs.iter().map(|&output| libm::tanhf(output)).collect();
            let mut slopes = self.gains(&view, known, &actions);
            for (index, (slope, action)) in slopes.iter_mut().zip(&actions).enumerate() {
                let row = index / self.space.length();
                // An absent vehicle's action teaches nothing.
                let looked_at = view.takes_part(row / view.vehicles, row % view.vehicles);
                *slope = if looked_at {
                    -scale * *slope * (1.0 - action * action)
                } else {
                    0.0
                };
            }
            slopes
        };
        let step = self.actor_step();
        self.actors.learn(&slopes, step, self.options.gradient_clip);
        self.losses.delayed_count += 1;
    }

    /// Slopes of the actors' loss along the scores of their choices: up the gains, and up the entropy.
    fn choice_slopes(
        &mut self,
        view: &View<'_>,
        known: Rows<'_>,
        outputs: &[f32],
        scale: f32,
        stream: &mut Stream,
    ) -> Vec<f32> {
        let length = self.space.length();
        let scores = outputs.chunks_exact(length);
        let softmax: Vec<f32> = scores.clone().flat_map(probabilities).collect();
        let mut chosen = Vec::with_capacity(outputs.len());
        scores.for_each(|scores| one_hot(draw(scores, stream), length, &mut chosen));
        let gains = self.gains(view, known, &chosen);
        let entropy_weight = interpolate(self.options.entropy, self.options.last_entropy, self.progress());
        let (mut slopes, mut total_entropy) = (vec![0.0; outputs.len()], 0.0);
        let vehicles = view.vehicles;
        let rows = (0..slopes.len() / length).filter(|row| view.takes_part(row / vehicles, row % vehicles));
        for row in rows {
            let place = row * length..(row + 1) * length;
            let softmax = &softmax[place.clone()];
            let gain_slopes = expectation_slopes(softmax, &gains[place.clone()]);
            let spread = entropy(softmax);
            total_entropy += spread;
            let each = slopes[place].iter_mut().zip(gain_slopes).zip(softmax);
            for ((slope, gain_slope), &probability) in each {
                let spread_slope = entropy_slope(probability, spread);
                *slope = -scale * (gain_slope + entropy_weight * spread_slope);
            }
        }
        self.losses.entropy += f64::from(total_entropy / taking_part(view.present));
        slopes
    }

    /// What the critics say of actions, both weighted: what every other choice would be worth, or how values rise along each.
    fn gains(&mut self, view: &View<'_>, known: Rows<'_>, actions: &[f32]) -> Vec<f32> {
        let (critic, pass) = (&self.critic, &mut self.passes[0]);
        let (space, critics) = (self.space, &self.local_critics);
        let asked = Question::new(&self.twins[0].parameters, *view, actions);
        let heard = self.options.global_weight != GlobalWeight::None;
        let global = || heard.then(|| critic.gains(&asked, pass));
        let local = || {
            critics.as_ref().map(|critics| {
                if space.is_choice() {
                    return critics.outputs(Role::Learner, &[known]);
                }
                critics.slopes_along_last(&[known, Rows::all(actions, space.length())])
            })
        };
        let (global, local) = rayon::join(global, local);
        let mut gains = global.unwrap_or_else(|| vec![0.0; actions.len()]);
        let global_weight = match self.options.global_weight {
            GlobalWeight::Printed => 1.0,
            GlobalWeight::Vehicles => taking_part(view.present) / view.samples() as f32,
            GlobalWeight::None => 0.0,
        };
        gains.iter_mut().for_each(|gain| *gain *= global_weight);
        for (gain, local) in gains.iter_mut().zip(local.iter().flatten()) {
            *gain += self.options.local_weight * local;
        }
        gains
    }
}

/// Mean own reward of the vehicles of the cell, `[sample]`.
fn global_rewards(view: &View<'_>, rewards: &[f32]) -> Vec<f32> {
    let mut sums = vec![0.0; view.samples()];
    for (row, &reward) in rewards.iter().enumerate() {
        let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
        if view.takes_part(sample, vehicle) {
            sums[sample] += reward / f32::from(view.present[sample]);
        }
    }
    sums
}

/// Vehicles over all samples.
fn taking_part(present: &[u8]) -> f32 {
    present.iter().map(|&present| f32::from(present)).sum()
}

fn interpolate(first: f32, last: f32, progress: f32) -> f32 {
    if first > 0.0 && last > 0.0 {
        first * libm::powf(last / first, progress)
    } else {
        first + (last - first) * progress
    }
}

#[cfg(test)]
mod tests {
    use super::super::in_cell::MaddpgInCell;
    use super::super::learner::LEARNING;
    use super::*;
    use crate::configuration::Preset;
    use crate::laboratory::learner::Learner as _;
    use crate::laboratory::random;

    /// The backends that this trainer is built with.
    const BACKENDS: &[&str] = if cfg!(feature = "burn") {
        &["own", "burn"]
    } else {
        &["own"]
    };

    /// A learner of two vehicles in the paper's form whose critics are constants: their last biases.
    fn constant_critics(backend: &str, biases: [f32; 2], local: f32) -> MaddpgInCell {
        let backend = format!("maddpg.backend={backend}");
        let settings = [
            "scenario.cell.vehicles=2",
            "scenario.cell.replacement_probability=0.3",
            "maddpg.slots=10",
            "maddpg.n_step=2",
            "maddpg.replay=10",
            "maddpg.warm_up_slots=1",
            "maddpg.batch=9",
            "maddpg.actor_hidden=[4]",
            "maddpg.local_critic_hidden=[4]",
            "maddpg.global_critic_hidden=[4]",
            "maddpg.critic_learning_rate=0",
            "maddpg.last_critic_learning_rate=0",
            "maddpg.discount=0.5",
            "maddpg.delay=1",
            &backend,
        ];
        let mut cell = MaddpgInCell::of_preset(Preset::Paper, &settings);
        let learner = &mut cell.learner;
        let constant = |learned: &mut Learned, value: f32| {
            let mut parameters = vec![0.0; learned.parameters.len()];
            *parameters.last_mut().unwrap() = value;
            *learned = Learned::new(parameters);
        };
        for (learned, value) in learner.twins.iter_mut().zip(biases) {
            constant(learned, value);
        }
        for learned in &mut learner.local_critics.as_mut().unwrap().learned {
            constant(learned, local);
        }
        cell
    }

    /// With constant critics the losses say what the targets were: `r_g + gamma min(Q'_1, Q'_2)`, and `r_l + gamma Q'_l` up to the end
    /// of who is replaced.
    #[test]
    fn targets_are_rewards_and_the_least_twin() {
        for backend in BACKENDS {
            let mut learner = constant_critics(backend, [3.0, -1.0], 2.0);
            let metrics = learner.advance();
            let mut batch = Batch::default();
            // The one update's batch again: its draws follow the episode's exploration in the same stream.
            let mut stream = random::episode(1, 0, LEARNING);
            let draws_before = 10 * 2 * 2;
            (0..draws_before).for_each(|_| {
                let _noise = stream.normal();
            });
            let sought = learner.learner.options.sought();
            learner.learner.replay.sample(9, sought, &mut stream, &mut batch);
            let ends = batch.own_later_weight.iter().filter(|&&weight| weight == 0.0);
            assert!((1..18).contains(&ends.count()), "some end");
            let square = |value: f64| value * value;
            let global_reward =
                |sample: usize| f64::from(batch.rewards[2 * sample] + batch.rewards[2 * sample + 1]) / 2.0;
            let global: f64 = (0..9)
                .map(|sample| {
                    let target = global_reward(sample) - 0.25;
                    (square(3.0 - target) + square(-1.0 - target)) / 2.0 / 9.0
                })
                .sum();
            let paid = batch.own_rewards.iter().zip(&batch.own_later_weight);
            let local: f64 = paid
                .map(|(&reward, &weight)| square(2.0 - f64::from(reward + 2.0 * weight)) / 18.0)
                .sum();
            assert!(
                (metrics.get("global_loss").unwrap() - global).abs() < 1e-4 * global,
                "{backend}"
            );
            assert!(
                (metrics.get("local_loss").unwrap() - local).abs() < 1e-4 * local,
                "{backend}"
            );
        }
    }
}
