//! A global critic per sub-channel: it adds up what is known of the vehicles on a sub-channel and judges the sum, so that
//! neither their order nor their number is built into it (deep sets, Zaheer et al. 2017).

use super::critic::{Critic, CriticPass};
use super::view::View;
use crate::game::actions::ActionSpace;
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

/// `Q_n = judge(sum over vehicles of describe(what is known, action on n) / 4, vehicles / 20)`.
#[derive(Clone, Debug)]
pub struct SetCritic {
    describe: Perceptron,
    judge: Perceptron,
    space: ActionSpace,
    known: usize,
}

/// The sum of nobody.
const NOWHERE: u32 = u32::MAX;

impl SetCritic {
    /// For `known` values of each vehicle.
    pub fn new(space: ActionSpace, known: usize, describe: usize, sum: usize, judge: &[usize]) -> Self {
        Self {
            describe: Perceptron::new(known + space.places() + space.kinds(), &[describe], sum),
            judge: Perceptron::new(sum + 1, judge, 1),
            space,
            known,
        }
    }

    /// The sum that each column belongs to: that of the home sub-channel of its vehicle or of one `place` further;
    /// [`NOWHERE`] for an absent vehicle.
    fn find_heads(&self, view: &View<'_>, heads: &mut Vec<u32>) {
        heads.clear();
        for (row, &home) in view.homes.iter().enumerate() {
            let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
            heads.extend((0..self.space.places()).map(|place| {
                let sub_channel = (usize::from(home) + place) % HEADS;
                if view.takes_part(sample, vehicle) {
                    (sample * HEADS + sub_channel) as u32
                } else {
                    NOWHERE
                }
            }));
        }
    }

    /// Writes what is known, and which place is meant; gives the room for the kinds of action, which are zeros.
    fn write_known<'l>(
        &self,
        view: &View<'_>,
        row: usize,
        place: usize,
        line: &'l mut [f32],
    ) -> &'l mut [f32] {
        let (known, rest) = line.split_at_mut(self.known);
        known.copy_from_slice(&view.observations[row * view.width..][..self.known]);
        let (places, kinds) = rest.split_at_mut(self.space.places());
        places[place] = 1.0;
        kinds
    }
}

/// Parameters are those of the description, then those of the judgement. Alternatives leave out the sub-channels that an action cannot
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

    fn forward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        let (describe, judge) = parameters.split_at(self.describe.parameters());
        let (places, length) = (self.space.places(), self.space.length());
        let rows = view.samples() * view.vehicles;
        let columns = rows * places;
        pass.describe.fill(&self.describe, columns, |column, line| {
            let (row, place) = (column / places, column % places);
            let kinds = self.write_known(view, row, place, line);
            for (index, &weight) in actions[row * length..][..length].iter().enumerate() {
                kinds[self.space.kind(index, place)] += weight;
            }
        });
        self.describe.forward(describe, &mut pass.describe);
        let sums = pass.describe.output();
        let heads = view.samples() * HEADS;
        self.find_heads(view, &mut pass.heads);
        let input = pass.judge.input(&self.judge, heads);
        input.fill(0.0);
        for (input, sums) in input.chunks_exact_mut(heads).zip(sums.chunks_exact(columns)) {
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

    fn backward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        slopes: &[f32],
        pass: &mut CriticPass,
        gradient: Option<&mut [f32]>,
    ) {
        let (describe, judge) = parameters.split_at(self.describe.parameters());
        let (describe_gradient, judge_gradient) = match gradient {
            Some(gradient) => {
                let (first, second) = gradient.split_at_mut(self.describe.parameters());
                (Some(first), Some(second))
            }
            None => (None, None),
        };
        let along_inputs = describe_gradient.is_none();
        pass.judge.output_slopes().copy_from_slice(slopes);
        self.judge.backward(judge, &mut pass.judge, judge_gradient, true);
        let heads = view.samples() * HEADS;
        let columns = view.samples() * view.vehicles * self.space.places();
        let along_sums = pass.judge.input_slopes().chunks_exact(heads);
        let along_values = pass.describe.output_slopes().chunks_exact_mut(columns);
        for (values, sums) in along_values.zip(along_sums) {
            for (&head, value) in pass.heads.iter().zip(values) {
                *value = sums.get(head as usize).map_or(0.0, |sum| sum / SUM_SCALE);
            }
        }
        self.describe
            .backward(describe, &mut pass.describe, describe_gradient, along_inputs);
    }

    fn along_actions(&self, view: &View<'_>, pass: &CriticPass) -> Vec<f32> {
        let (places, length) = (self.space.places(), self.space.length());
        let rows = view.samples() * view.vehicles;
        let columns = rows * places;
        let slopes = pass.describe.input_slopes();
        let mut result = Vec::with_capacity(rows * length);
        for row in 0..rows {
            result.extend((0..length).map(|action| {
                let along = (0..places).map(|place| {
                    let index = self.known + places + self.space.kind(action, place);
                    slopes[index * columns + row * places + place]
                });
                along.sum::<f32>()
            }));
        }
        result
    }

    fn alternatives(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        let _values = self.forward(parameters, view, actions, pass);
        let (describe, judge) = parameters.split_at(self.describe.parameters());
        let (places, kinds) = (self.space.places(), self.space.kinds());
        let actual_columns = view.samples() * view.vehicles * places;
        let heads = view.samples() * HEADS;
        let width = self.describe.outputs();
        // The value of each kind in each place of each vehicle.
        let total = actual_columns * kinds;
        let mut values = Vec::with_capacity(total);
        for first in (0..total).step_by(BLOCK) {
            let columns = BLOCK.min(total - first);
            pass.alternatives.fill(&self.describe, columns, |column, line| {
                let (actual, kind) = ((first + column) / kinds, (first + column) % kinds);
                let (row, place) = (actual / places, actual % places);
                self.write_known(view, row, place, line)[kind] = 1.0;
            });
            self.describe.forward(describe, &mut pass.alternatives);
            let (own, sums) = (pass.alternatives.output(), pass.judge.input_values());
            let actual_values = pass.describe.output();
            let input = pass.alternative_judge.input(&self.judge, columns);
            let (input, counts) = input.split_at_mut(width * columns);
            let (sums, all) = sums.split_at(width * heads);
            // An absent vehicle's alternatives are worth nothing; nobody asks for them.
            let place = |column: usize| {
                (
                    (first + column) / kinds,
                    pass.heads[(first + column) / kinds] as usize % heads,
                )
            };
            let each = input.chunks_exact_mut(columns).zip(own.chunks_exact(columns));
            let known = sums
                .chunks_exact(heads)
                .zip(actual_values.chunks_exact(actual_columns));
            for ((input, own), (sums, actual_values)) in each.zip(known) {
                for (column, (input, own)) in input.iter_mut().zip(own).enumerate() {
                    let (actual, head) = place(column);
                    *input = sums[head] + (own - actual_values[actual]) / SUM_SCALE;
                }
            }
            for (column, count) in counts.iter_mut().enumerate() {
                *count = all[place(column).1];
            }
            self.judge.forward(judge, &mut pass.alternative_judge);
            values.extend_from_slice(pass.alternative_judge.output());
        }
        let rows = view.samples() * view.vehicles;
        let mut result = Vec::with_capacity(rows * self.space.length());
        for row in 0..rows {
            result.extend((0..self.space.length()).map(|action| {
                let reached = (0..places)
                    .map(|place| values[(row * places + place) * kinds + self.space.kind(action, place)]);
                reached.sum::<f32>() / HEADS as f32
            }));
        }
        result
    }
}
