//! The paper's global critic: all observations and actions side by side.

use super::critic::{Critic, CriticPass, Question};
use crate::game::actions::ActionSpace;
use crate::network::perceptron::Perceptron;
use host_sim::stream::Stream;

/// Samples of alternatives that run through the critic together: their activations stay in cache.
const BLOCK: usize = 512;

/// One perceptron on `[vehicle][observation, action]`; absent vehicles are zeros.
#[derive(Clone, Debug)]
pub struct FlatCritic {
    /// Its shape, with one output.
    pub network: Perceptron,
    space: ActionSpace,
}

impl FlatCritic {
    /// For cells of so many vehicles, each with so many observations.
    pub fn new(vehicles: usize, observed: usize, space: ActionSpace, hidden: &[usize]) -> Self {
        Self {
            network: Perceptron::new(vehicles * (observed + space.length()), hidden, 1),
            space,
        }
    }

    fn write(&self, Question { view, actions, .. }: &Question<'_>, sample: usize, line: &mut [f32]) {
        let length = self.space.length();
        for (vehicle, line) in line.chunks_exact_mut(view.observed + length).enumerate() {
            if view.takes_part(sample, vehicle) {
                let (observed, action) = line.split_at_mut(view.observed);
                observed.copy_from_slice(&view.row(sample, vehicle)[..view.observed]);
                let first = (sample * view.vehicles + vehicle) * length;
                action.copy_from_slice(&actions[first..first + length]);
            }
        }
    }

    /// Slopes along the actions.
    fn slopes(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let _values = self.forward(asked, pass);
        pass.judge.output_slopes().fill(1.0);
        self.network
            .backward(asked.parameters, &mut pass.judge, None, true);
        let (view, length) = (&asked.view, self.space.length());
        let (samples, each) = (view.samples(), view.observed + length);
        let slopes = pass.judge.input_slopes();
        let mut result = Vec::with_capacity(samples * view.vehicles * length);
        for sample in 0..samples {
            for vehicle in 0..view.vehicles {
                let first = vehicle * each + view.observed;
                // An absent vehicle's action is not looked at.
                let looked_at = view.takes_part(sample, vehicle);
                result.extend((first..first + length).map(|index| {
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

    /// Values with each action of a choice.
    fn alternatives(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let (view, count) = (&asked.view, self.space.length());
        let each = view.observed + count;
        let total = view.samples() * view.vehicles * count;
        let mut result = Vec::with_capacity(total);
        for first in (0..total).step_by(BLOCK) {
            let columns = BLOCK.min(total - first);
            pass.judge.fill(&self.network, columns, |column, line| {
                let (row, action) = ((first + column) / count, (first + column) % count);
                let (sample, vehicle) = (row / view.vehicles, row % view.vehicles);
                self.write(asked, sample, line);
                let own = &mut line[vehicle * each + view.observed..][..count];
                own.fill(0.0);
                own[action] = 1.0;
            });
            self.network.forward(asked.parameters, &mut pass.judge);
            result.extend_from_slice(pass.judge.output());
        }
        result
    }
}

impl Critic for FlatCritic {
    fn initial(&self, stream: &mut Stream) -> Vec<f32> {
        self.network.initial(stream)
    }

    fn forward(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        let samples = asked.view.samples();
        pass.judge.fill(&self.network, samples, |sample, line| {
            self.write(asked, sample, line)
        });
        self.network.forward(asked.parameters, &mut pass.judge);
        pass.judge.output().to_vec()
    }

    fn backward(&self, asked: &Question<'_>, slopes: &[f32], pass: &mut CriticPass, gradient: &mut [f32]) {
        pass.judge.output_slopes().copy_from_slice(slopes);
        self.network
            .backward(asked.parameters, &mut pass.judge, Some(gradient), false);
    }

    fn gains(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32> {
        if self.space.is_choice() {
            self.alternatives(asked, pass)
        } else {
            self.slopes(asked, pass)
        }
    }
}
