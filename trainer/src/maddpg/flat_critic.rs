//! The paper's global critic: all observations and actions side by side.

use super::actions::ActionSet;
use super::critic::View;
use super::perceptron::{Pass, Perceptron};

/// Samples of alternatives that run through the critic together: their activations stay in cache.
const BLOCK: usize = 512;

/// One perceptron on `[vehicle][observation, action]`; absent vehicles are zeros.
#[derive(Clone, Debug)]
pub struct FlatCritic {
    /// Its shape, with one output.
    pub network: Perceptron,
    action_length: usize,
}

/// A batch on its way.
#[derive(Clone, Debug, Default)]
pub struct FlatPass {
    pass: Pass,
}

impl FlatCritic {
    /// For cells of so many vehicles, each with so many observations and action values.
    pub fn new(vehicles: usize, observed: usize, action_length: usize, hidden: &[usize]) -> Self {
        Self {
            network: Perceptron::new(vehicles * (observed + action_length), hidden, 1),
            action_length,
        }
    }

    /// See [`super::critic::Critic::forward`].
    pub fn forward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut FlatPass,
    ) -> Vec<f32> {
        let samples = view.samples();
        pass.pass.fill(&self.network, samples, |sample, line| {
            self.write(view, actions, sample, line)
        });
        self.network.forward(parameters, &mut pass.pass);
        pass.pass.output().to_vec()
    }

    /// Runs slopes back, to the gradient or else to the inputs.
    pub fn backward(
        &self,
        parameters: &[f32],
        slopes: &[f32],
        pass: &mut FlatPass,
        gradient: Option<&mut [f32]>,
    ) {
        pass.pass.output_slopes().copy_from_slice(slopes);
        let along_inputs = gradient.is_none();
        self.network
            .backward(parameters, &mut pass.pass, gradient, along_inputs);
    }

    /// Slopes along the actions after a backward run to the inputs.
    pub fn action_slopes(&self, view: &View<'_>, pass: &FlatPass) -> Vec<f32> {
        let (samples, each) = (view.samples(), view.observed + self.action_length);
        let slopes = pass.pass.input_slopes();
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

    /// See [`super::critic::Critic::alternatives`].
    pub fn alternatives(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        set: ActionSet,
        pass: &mut FlatPass,
    ) -> Vec<f32> {
        let (each, count) = (view.observed + self.action_length, set.length());
        let total = view.samples() * view.vehicles * count;
        let mut result = Vec::with_capacity(total);
        for first in (0..total).step_by(BLOCK) {
            let columns = BLOCK.min(total - first);
            pass.pass.fill(&self.network, columns, |column, line| {
                let (row, action) = ((first + column) / count, (first + column) % count);
                let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
                self.write(view, actions, sample, line);
                let own = &mut line[vehicle * each + view.observed..][..count];
                own.fill(0.0);
                own[action] = 1.0;
            });
            self.network.forward(parameters, &mut pass.pass);
            result.extend_from_slice(pass.pass.output());
        }
        result
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
