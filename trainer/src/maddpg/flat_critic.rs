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
    pub fn forward(&self, parameters: &[f32], view: &View<'_>, actions: &[f32], pass: &mut FlatPass) -> Vec<f32> {
        let samples = view.samples();
        let input = pass.pass.input(&self.network, samples);
        input.fill(0.0);
        for sample in 0..samples {
            self.write(view, actions, sample, |index, value| input[index * samples + sample] = value);
        }
        self.network.forward(parameters, &mut pass.pass);
        pass.pass.output().to_vec()
    }

    /// Runs slopes back, to the gradient or else to the inputs.
    pub fn backward(&self, parameters: &[f32], slopes: &[f32], pass: &mut FlatPass, gradient: Option<&mut [f32]>) {
        pass.pass.output_slopes().copy_from_slice(slopes);
        let along_inputs = gradient.is_none();
        self.network.backward(parameters, &mut pass.pass, gradient, along_inputs);
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
                result.extend(actions.map(|index| slopes[index * samples + sample]));
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
            let input = pass.pass.input(&self.network, columns);
            input.fill(0.0);
            for column in 0..columns {
                let (row, action) = ((first + column) / count, (first + column) % count);
                let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
                self.write(view, actions, sample, |index, value| input[index * columns + column] = value);
                let place = vehicle * each + view.observed;
                for other in 0..count {
                    input[(place + other) * columns + column] = f32::from(u8::from(other == action));
                }
            }
            self.network.forward(parameters, &mut pass.pass);
            result.extend_from_slice(pass.pass.output());
        }
        result
    }

    fn write(&self, view: &View<'_>, actions: &[f32], sample: usize, mut put: impl FnMut(usize, f32)) {
        let each = view.observed + self.action_length;
        for vehicle in (0..view.vehicles).filter(|&vehicle| view.takes_part(sample, vehicle)) {
            let row = &view.row(sample, vehicle)[..view.observed];
            let action = (sample * view.vehicles + vehicle) * self.action_length;
            let values = row.iter().chain(&actions[action..action + self.action_length]);
            for (index, &value) in values.enumerate() {
                put(vehicle * each + index, value);
            }
        }
    }
}
