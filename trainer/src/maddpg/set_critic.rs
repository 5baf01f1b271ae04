//! A global critic that adds up what is known of the cell's vehicles and judges the sum, so that neither their order nor their number
//! is built into it (deep sets, Zaheer et al. 2017).

use super::critic::{Critic, CriticPass, Question};
use super::view::View;
use crate::network::perceptron::Perceptron;
use host_sim::stream::Stream;

/// Sums are divided by this, which brings those of twenty vehicles near one (chosen).
const SUM_SCALE: f32 = 12.0;

/// Vehicles are told to the second part in twenties.
const COUNT_SCALE: f32 = 20.0;

/// Columns of alternatives that run together: their activations stay in cache.
const BLOCK: usize = 960;

/// `Q = judge(sum over vehicles of describe(what is known, 1, action) / 12, vehicles / 20)`, where actions are choices. The one is a bias
/// that weighs like an input.
#[derive(Clone, Debug)]
pub struct SetCritic {
    describe: Perceptron,
    judge: Perceptron,
    actions: usize,
    known: usize,
}

impl SetCritic {
    /// For so many actions and `known` values of each vehicle.
    pub fn new(actions: usize, known: usize, describe: usize, sum: usize, judge: &[usize]) -> Self {
        Self {
            describe: Perceptron::new(known + 1 + actions, &[describe], sum),
            judge: Perceptron::new(sum + 1, judge, 1),
            actions,
            known,
        }
    }

    /// Writes what is known; gives the room for the action, which is zeros.
    fn write_known<'l>(&self, view: &View<'_>, row: usize, line: &'l mut [f32]) -> &'l mut [f32] {
        let (known, rest) = line.split_at_mut(self.known);
        known.copy_from_slice(&view.observations[row * view.width..][..self.known]);
        rest[0] = 1.0;
        &mut rest[1..]
    }
}

/// Parameters are those of the description, then those of the judgement.
impl Critic for SetCritic {
    fn initial(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.describe.initial(stream);
        parameters.extend(self.judge.initial(stream));
        parameters
    }

    fn forward(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let (view, actions) = (&asked.view, asked.actions);
        let (describe, judge) = asked.parameters.split_at(self.describe.parameters());
        let (samples, rows) = (view.samples(), view.samples() * view.vehicles);
        pass.describe.fill(&self.describe, rows, |row, line| {
            let action = &actions[row * self.actions..][..self.actions];
            self.write_known(view, row, line).copy_from_slice(action);
        });
        self.describe.forward(describe, &mut pass.describe);
        let described = pass.describe.output();
        let input = pass.judge.input(&self.judge, samples);
        let (sums, counts) = input.split_at_mut(self.describe.outputs() * samples);
        for (sums, values) in sums.chunks_exact_mut(samples).zip(described.chunks_exact(rows)) {
            let vehicles = values.chunks_exact(view.vehicles);
            for ((sum, values), &present) in sums.iter_mut().zip(vehicles).zip(view.present) {
                *sum = 0.0;
                for value in &values[..present.into()] {
                    *sum += value / SUM_SCALE;
                }
            }
        }
        for (count, &present) in counts.iter_mut().zip(view.present) {
            *count = f32::from(present) / COUNT_SCALE;
        }
        self.judge.forward(judge, &mut pass.judge);
        pass.judge.output().to_vec()
    }

    fn backward(&self, asked: &Question<'_>, slopes: &[f32], pass: &mut CriticPass, gradient: &mut [f32]) {
        let view = &asked.view;
        let (describe, judge) = asked.parameters.split_at(self.describe.parameters());
        let (describe_gradient, judge_gradient) = gradient.split_at_mut(self.describe.parameters());
        pass.judge.output_slopes().copy_from_slice(slopes);
        self.judge
            .backward(judge, &mut pass.judge, Some(judge_gradient), true);
        let (samples, rows) = (view.samples(), view.samples() * view.vehicles);
        let along_sums = pass.judge.input_slopes().chunks_exact(samples);
        let along_values = pass.describe.output_slopes().chunks_exact_mut(rows);
        for (values, sums) in along_values.zip(along_sums) {
            for (row, value) in values.iter_mut().enumerate() {
                let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
                *value = if view.takes_part(sample, vehicle) {
                    sums[sample] / SUM_SCALE
                } else {
                    0.0
                };
            }
        }
        self.describe
            .backward(describe, &mut pass.describe, Some(describe_gradient), false);
    }

    fn gains(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let _values = self.forward(asked, pass);
        let (view, actions) = (&asked.view, self.actions);
        let (describe, judge) = asked.parameters.split_at(self.describe.parameters());
        let (samples, rows) = (view.samples(), view.samples() * view.vehicles);
        let width = self.describe.outputs();
        // The value with each action of each vehicle. An absent vehicle's are worth nothing; nobody asks for them.
        let total = rows * actions;
        let mut values = Vec::with_capacity(total);
        for first in (0..total).step_by(BLOCK) {
            let columns = BLOCK.min(total - first);
            pass.alternatives.fill(&self.describe, columns, |column, line| {
                let (row, action) = ((first + column) / actions, (first + column) % actions);
                self.write_known(view, row, line)[action] = 1.0;
            });
            self.describe.forward(describe, &mut pass.alternatives);
            let (own, sums) = (pass.alternatives.output(), pass.judge.input_values());
            let actual_values = pass.describe.output();
            let input = pass.alternative_judge.input(&self.judge, columns);
            let (input, counts) = input.split_at_mut(width * columns);
            let (sums, all) = sums.split_at(width * samples);
            let row = |column: usize| (first + column) / actions;
            let each = input.chunks_exact_mut(columns).zip(own.chunks_exact(columns));
            let known = sums.chunks_exact(samples).zip(actual_values.chunks_exact(rows));
            for ((input, own), (sums, actual_values)) in each.zip(known) {
                for (column, (input, own)) in input.iter_mut().zip(own).enumerate() {
                    let row = row(column);
                    *input = sums[row / view.vehicles] + (own - actual_values[row]) / SUM_SCALE;
                }
            }
            for (column, count) in counts.iter_mut().enumerate() {
                *count = all[row(column) / view.vehicles];
            }
            self.judge.forward(judge, &mut pass.alternative_judge);
            values.extend_from_slice(pass.alternative_judge.output());
        }
        values
    }
}
