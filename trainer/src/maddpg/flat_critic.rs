//! The paper's global critic: all observations and actions side by side.

use super::critic::{Critic, CriticPass};
use super::view::View;
use crate::network::perceptron::Perceptron;
use host_sim::stream::Stream;

/// Samples of alternatives that run through the critic together: their activations stay in cache.
const BLOCK: usize = 512;

/// One perceptron on `[vehicle][observation, action]`; absent vehicles are zeros.
#[derive(Clone, Debug)]
pub struct FlatCritic {
    /// Its shape, with one output.
    pub network: Perceptron,
    action_length: usize,
}

impl FlatCritic {
    /// For cells of so many vehicles, each with so many observations and action values.
    pub fn new(vehicles: usize, observed: usize, action_length: usize, hidden: &[usize]) -> Self {
        Self {
            network: Perceptron::new(vehicles * (observed + action_length), hidden, 1),
            action_length,
        }
    }

    fn write(&self, view: &View<'_>, actions: &[f32], sample: usize, line: &mut [f32]) {
        let each = view.observed + self.action_length;
        for (vehicle, line) in line.chunks_exact_mut(each).enumerate() {
            if view.takes_part(sample, vehicle) {
                let (observed, action) = line.split_at_mut(view.observed);
                observed.copy_from_slice(&view.row(sample, vehicle)[..view.observed]);
                let first = (sample * view.vehicles + vehicle) * self.action_length;
                action.copy_from_slice(&actions[first..first + self.action_length]);
            }
        }
    }
}

impl Critic for FlatCritic {
    fn heads(&self) -> usize {
        1
    }

    fn initial(&self, stream: &mut Stream) -> Vec<f32> {
        self.network.initial(stream)
    }

    fn forward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        let samples = view.samples();
        pass.judge.fill(&self.network, samples, |sample, line| {
            self.write(view, actions, sample, line)
        });
        self.network.forward(parameters, &mut pass.judge);
        pass.judge.output().to_vec()
    }

    fn backward(
        &self,
        parameters: &[f32],
        _view: &View<'_>,
        slopes: &[f32],
        pass: &mut CriticPass,
        gradient: Option<&mut [f32]>,
    ) {
        pass.judge.output_slopes().copy_from_slice(slopes);
        let along_inputs = gradient.is_none();
        self.network
            .backward(parameters, &mut pass.judge, gradient, along_inputs);
    }

    fn along_actions(&self, view: &View<'_>, pass: &CriticPass) -> Vec<f32> {
        let (samples, each) = (view.samples(), view.observed + self.action_length);
        let slopes = pass.judge.input_slopes();
        let mut result = Vec::with_capacity(samples * view.vehicles * self.action_length);
        for sample in 0..samples {
            for vehicle in 0..view.vehicles {
                let first = vehicle * each + view.observed;
                let actions = first..first + self.action_length;
                // An absent vehicle's action is not looked at.
                let looked_at = view.takes_part(sample, vehicle);
                result.extend(actions.map(|index| {
                    if looked_at {
                        slopes[index * samples + sample]
                    } else {
                        0.0
                    }
                }));
            }
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
        let (each, count) = (view.observed + self.action_length, self.action_length);
        let total = view.samples() * view.vehicles * count;
        let mut result = Vec::with_capacity(total);
        for first in (0..total).step_by(BLOCK) {
            let columns = BLOCK.min(total - first);
            pass.judge.fill(&self.network, columns, |column, line| {
                let (row, action) = ((first + column) / count, (first + column) % count);
                let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
                self.write(view, actions, sample, line);
                let own = &mut line[vehicle * each + view.observed..][..count];
                own.fill(0.0);
                own[action] = 1.0;
            });
            self.network.forward(parameters, &mut pass.judge);
            result.extend_from_slice(pass.judge.output());
        }
        result
    }
}
