//! A global critic per sub-channel: it adds up what is known of the vehicles on a sub-channel and judges the sum, so that
//! neither their order nor their number is built into it (deep sets, Zaheer et al. 2017).

use super::critic::{Critic, CriticPass, Question};
use super::view::View;
use crate::network::perceptron::Perceptron;
use firmware::units::SUB_CHANNELS;
use host_sim::stream::Stream;

/// One value for each sub-channel.
pub const HEADS: usize = SUB_CHANNELS;

/// Sums are divided by this, which brings those of groups of seven near one (chosen).
const SUM_SCALE: f32 = 4.0;

/// Vehicles are told to the second part in twenties.
const COUNT_SCALE: f32 = 20.0;

/// Columns of alternatives that run together: their activations stay in cache.
const BLOCK: usize = 960;

/// `Q_n = judge(sum over vehicles with home n of describe(what is known, 1, action) / 4, vehicles / 20)`, where actions are choices on
/// the home sub-channel. The one is a bias that weighs like an input.
#[derive(Clone, Debug)]
pub struct SetCritic {
    describe: Perceptron,
    judge: Perceptron,
    actions: usize,
    known: usize,
}

/// The sum of nobody.
const NOWHERE: u32 = u32::MAX;

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

    /// The sum that each vehicle's column belongs to, that of its home sub-channel; [`NOWHERE`] for an absent vehicle.
    fn find_heads(view: &View<'_>, heads: &mut Vec<u32>) {
        heads.clear();
        heads.extend(view.homes.iter().enumerate().map(|(row, &home)| {
            let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
            if view.takes_part(sample, vehicle) {
                (sample * HEADS + usize::from(home) % HEADS) as u32
            } else {
                NOWHERE
            }
        }));
    }

    /// Writes what is known; gives the room for the action, which is zeros.
    fn write_known<'l>(&self, view: &View<'_>, row: usize, line: &'l mut [f32]) -> &'l mut [f32] {
        let (known, rest) = line.split_at_mut(self.known);
        known.copy_from_slice(&view.observations[row * view.width..][..self.known]);
        rest[0] = 1.0;
        &mut rest[1..]
    }
}

/// Parameters are those of the description, then those of the judgement. Gains leave out the sub-channels that an action cannot
/// reach.
impl Critic for SetCritic {
    fn heads(&self) -> usize {
        HEADS
    }

    fn initial(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.describe.initial(stream);
        parameters.extend(self.judge.initial(stream));
        parameters
    }

    fn forward(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let (view, actions) = (&asked.view, asked.actions);
        let (describe, judge) = asked.parameters.split_at(self.describe.parameters());
        let rows = view.samples() * view.vehicles;
        pass.describe.fill(&self.describe, rows, |row, line| {
            let action = &actions[row * self.actions..][..self.actions];
            self.write_known(view, row, line).copy_from_slice(action);
        });
        self.describe.forward(describe, &mut pass.describe);
        let sums = pass.describe.output();
        let heads = view.samples() * HEADS;
        Self::find_heads(view, &mut pass.heads);
        let input = pass.judge.input(&self.judge, heads);
        input.fill(0.0);
        for (input, sums) in input.chunks_exact_mut(heads).zip(sums.chunks_exact(rows)) {
            for (&head, &value) in pass.heads.iter().zip(sums) {
                if let Some(sum) = input.get_mut(head as usize) {
                    *sum += value / SUM_SCALE;
                }
            }
        }
        let counts = input.chunks_exact_mut(heads).next_back().unwrap_or_default();
        for (head, count) in counts.iter_mut().enumerate() {
            *count = f32::from(view.present[head / HEADS]) / COUNT_SCALE;
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
        let heads = view.samples() * HEADS;
        let rows = view.samples() * view.vehicles;
        let along_sums = pass.judge.input_slopes().chunks_exact(heads);
        let along_values = pass.describe.output_slopes().chunks_exact_mut(rows);
        for (values, sums) in along_values.zip(along_sums) {
            for (&head, value) in pass.heads.iter().zip(values) {
                *value = sums.get(head as usize).map_or(0.0, |sum| sum / SUM_SCALE);
            }
        }
        self.describe
            .backward(describe, &mut pass.describe, Some(describe_gradient), false);
    }

    fn gains(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let _values = self.forward(asked, pass);
        let (view, actions) = (&asked.view, self.actions);
        let (describe, judge) = asked.parameters.split_at(self.describe.parameters());
        let rows = view.samples() * view.vehicles;
        let heads = view.samples() * HEADS;
        let width = self.describe.outputs();
        // The value with each action of each vehicle.
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
            let (sums, all) = sums.split_at(width * heads);
            // An absent vehicle's alternatives are worth nothing; nobody asks for them.
            let place = |column: usize| {
                let row = (first + column) / actions;
                (row, pass.heads[row] as usize % heads)
            };
            let each = input.chunks_exact_mut(columns).zip(own.chunks_exact(columns));
            let known = sums.chunks_exact(heads).zip(actual_values.chunks_exact(rows));
            for ((input, own), (sums, actual_values)) in each.zip(known) {
                for (column, (input, own)) in input.iter_mut().zip(own).enumerate() {
                    let (row, head) = place(column);
                    *input = sums[head] + (own - actual_values[row]) / SUM_SCALE;
                }
            }
            for (column, count) in counts.iter_mut().enumerate() {
                *count = all[place(column).1];
            }
            self.judge.forward(judge, &mut pass.alternative_judge);
            let judged = pass.alternative_judge.output();
            values.extend(judged.iter().map(|value| value / HEADS as f32));
        }
        values
    }
}
