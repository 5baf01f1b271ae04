//! One network for all vehicles, or one for each: the same calls serve both.

use super::optimiser::{Learned, Step, clip};
use super::perceptron::{Pass, Perceptron};
use host_sim::stream::Stream;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Networks of one kind, their batches on the way, and what they learn with.
pub struct Group {
    /// The shape that all share.
    pub network: Perceptron,
    /// One network, or one for each vehicle.
    pub learned: Vec<Learned>,
    passes: Vec<Pass>,
    gradients: Gradients,
    vehicles: usize,
}

/// Room for gradients, kept between updates: as many as threads ask for at once.
#[derive(Default)]
pub struct Gradients(Mutex<Vec<Vec<f32>>>);

impl Gradients {
    /// Lends room of this length; nothing is said about what stands in it.
    pub fn lend<T>(&self, length: usize, work: impl FnOnce(&mut [f32]) -> T) -> T {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut gradient = kept().pop().unwrap_or_default();
        gradient.resize(length, 0.0);
        let result = work(&mut gradient);
        kept().push(gradient);
        result
    }
}

/// Which parameters run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Those that learn.
    Learner,
    /// Those that follow.
    Target,
}

/// An array over samples and vehicles, `[sample][vehicle][width]`.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// The values.
    pub values: &'a [f32],
    /// Distance from one vehicle to the next.
    pub stride: usize,
    /// How many of a vehicle's values count.
    pub width: usize,
}

impl<'a> Rows<'a> {
    /// All values of rows of this width.
    pub fn all(values: &'a [f32], width: usize) -> Self {
        Self {
            values,
            stride: width,
            width,
        }
    }
}

impl Group {
    /// Random networks.
    pub fn new(network: Perceptron, shared: bool, vehicles: usize, stream: &mut Stream) -> Self {
        let copies = if shared { 1 } else { vehicles };
        let learned: Vec<Learned> = (0..copies)
            .map(|_| Learned::new(network.initial(stream)))
            .collect();
        Self {
            passes: vec![Pass::default(); copies],
            gradients: Gradients::default(),
            network,
            learned,
            vehicles,
        }
    }

    /// Runs the rows of all vehicles, side by side, through their networks.
    pub fn forward(&mut self, role: Role, rows: &[Rows<'_>]) {
        let (network, vehicles, copies) = (&self.network, self.vehicles, self.learned.len());
        let samples = rows
            .first()
            .map_or(0, |rows| rows.values.len() / rows.stride / vehicles);
        let each = self.passes.par_iter_mut().zip(&self.learned).enumerate();
        each.for_each(|(copy, (pass, learned))| {
            let columns = samples * vehicles / copies;
            pass.fill(network, columns, |column, line| {
                let row = column * copies + copy;
                let mut first = 0;
                for rows in rows {
                    let values = &rows.values[row * rows.stride..][..rows.width];
                    line[first..first + rows.width].copy_from_slice(values);
                    first += rows.width;
                }
            });
            network.forward(parameters(learned, role), pass);
        });
    }

    /// Output `index` of a vehicle in a sample.
    pub fn output(&self, sample: usize, vehicle: usize, index: usize) -> f32 {
        let (copy, column, columns) = self.place(sample, vehicle);
        self.passes[copy].output()[index * columns + column]
    }

    /// All outputs, `[sample][vehicle][output]`.
    pub fn outputs(&self) -> Vec<f32> {
        let width = self.network.outputs();
        let total: usize = self.passes.iter().map(|pass| pass.output().len()).sum();
        let samples = total / width / self.vehicles;
        let mut outputs = Vec::with_capacity(total);
        for sample in 0..samples {
            for vehicle in 0..self.vehicles {
                outputs.extend((0..width).map(|index| self.output(sample, vehicle, index)));
            }
        }
        outputs
    }

    /// Steps down the gradient of a loss with these slopes along the outputs, `[sample][vehicle][output]`.
    pub fn learn(&mut self, slopes: &[f32], step: Step, longest_gradient: f32) {
        let (network, copies) = (&self.network, self.learned.len());
        let each = self.passes.par_iter_mut().zip(&mut self.learned).enumerate();
        each.for_each(|(copy, (pass, learned))| {
            set_slopes(pass, slopes, network.outputs(), copy, copies);
            self.gradients.lend(network.parameters(), |gradient| {
                network.backward(&learned.parameters, pass, Some(gradient), false);
                let scale = clip(gradient, longest_gradient);
                learned.step(gradient, Step { scale, ..step });
            });
        });
    }

    /// Each network's gradient of a loss with these slopes along the outputs.
    #[cfg(test)]
    pub fn gradients(&mut self, slopes: &[f32]) -> Vec<Vec<f32>> {
        let copies = self.learned.len();
        let each = self.passes.iter_mut().zip(&self.learned).enumerate();
        each.map(|(copy, (pass, learned))| {
            let mut gradient = vec![0.0; self.network.parameters()];
            set_slopes(pass, slopes, self.network.outputs(), copy, copies);
            self.network
                .backward(&learned.parameters, pass, Some(&mut gradient), false);
            gradient
        })
        .collect()
    }

    /// Slopes along the inputs from `first` on, `[sample][vehicle][width]`, of a loss with these slopes along the outputs.
    pub fn input_slopes(&mut self, slopes: &[f32], first: usize, width: usize) -> Vec<f32> {
        let (network, copies) = (&self.network, self.learned.len());
        let each = self.passes.par_iter_mut().zip(&self.learned).enumerate();
        each.for_each(|(copy, (pass, learned))| {
            set_slopes(pass, slopes, network.outputs(), copy, copies);
            network.backward(&learned.parameters, pass, None, true);
        });
        let rows = slopes.len() / network.outputs();
        let mut result = Vec::with_capacity(rows * width);
        for row in 0..rows {
            let (copy, column, columns) = self.place(row / self.vehicles, row % self.vehicles);
            let slopes = self.passes[copy].input_slopes();
            result.extend((first..first + width).map(|index| slopes[index * columns + column]));
        }
        result
    }

    /// The network, the column and the number of columns of a vehicle in a sample.
    fn place(&self, sample: usize, vehicle: usize) -> (usize, usize, usize) {
        let copies = self.learned.len();
        let row = sample * self.vehicles + vehicle;
        let columns = self.passes[row % copies].output().len() / self.network.outputs();
        (row % copies, row / copies, columns)
    }
}

fn parameters(learned: &Learned, role: Role) -> &[f32] {
    match role {
        Role::Learner => &learned.parameters,
        Role::Target => &learned.target,
    }
}

fn set_slopes(pass: &mut Pass, slopes: &[f32], width: usize, copy: usize, copies: usize) {
    let output = pass.output_slopes();
    let columns = output.len() / width;
    let lines = slopes.chunks_exact(width).skip(copy).step_by(copies);
    for (column, line) in lines.enumerate() {
        for (index, &slope) in line.iter().enumerate() {
            output[index * columns + column] = slope;
        }
    }
}
