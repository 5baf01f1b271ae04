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

    /// Steps down the gradient along the slopes that a pass holds.
    fn descend(
        &self,
        network: &Perceptron,
        learned: &mut Learned,
        pass: &mut Pass,
        step: Step,
        longest_gradient: f32,
    ) {
        self.lend(network.parameters(), |gradient| {
            network.backward(&learned.parameters, pass, Some(gradient), false);
            let scale = clip(gradient, longest_gradient);
            learned.step(gradient, Step { scale, ..step });
        });
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
        let (network, copies) = (&self.network, self.learned.len());
        let each = self.passes.par_iter_mut().zip(&self.learned).enumerate();
        each.for_each(|(copy, (pass, learned))| {
            fill(pass, network, rows, copy, copies);
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
            self.gradients
                .descend(network, learned, pass, step, longest_gradient);
        });
    }

    /// Steps down the gradient of a loss of what the target networks say of `later` and the learners of `now`. `judge` takes a row
    /// (sample times vehicles, and the vehicle) with both outputs, writes the slopes along the learner's and returns the row's loss.
    ///
    /// One network after the other, so that its parameters are read while they are near. Returns the losses, `[sample][vehicle]`.
    pub fn learn_from(
        &mut self,
        later: &[Rows<'_>],
        now: &[Rows<'_>],
        step: Step,
        longest_gradient: f32,
        judge: impl Fn(usize, &[f32], &[f32], &mut [f32]) -> f32 + Sync,
    ) -> Vec<f32> {
        let (network, copies) = (&self.network, self.learned.len());
        let width = network.outputs();
        let each = self.passes.par_iter_mut().zip(&mut self.learned).enumerate();
        let losses = each.map(|(copy, (pass, learned))| {
            fill(pass, network, later, copy, copies);
            network.forward(&learned.target, pass);
            let targets = output_lines(pass, width);
            fill(pass, network, now, copy, copies);
            network.forward(&learned.parameters, pass);
            let values = output_lines(pass, width);
            let mut slopes = vec![0.0; values.len()];
            let lines = targets.chunks_exact(width).zip(values.chunks_exact(width));
            let losses = lines
                .zip(slopes.chunks_exact_mut(width))
                .enumerate()
                .map(|(column, ((target, value), slopes))| {
                    judge(column * copies + copy, target, value, slopes)
                })
                .collect();
            set_slopes(pass, &slopes, width, 0, 1);
            self.gradients
                .descend(network, learned, pass, step, longest_gradient);
            losses
        });
        let losses: Vec<Vec<f32>> = losses.collect();
        let rows = losses.iter().map(Vec::len).sum();
        (0..rows).map(|row| losses[row % copies][row / copies]).collect()
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

    /// Slopes of the outputs' sum along the last of these rows, `[sample][vehicle][width]`.
    pub fn slopes_along_last(&mut self, rows: &[Rows<'_>]) -> Vec<f32> {
        let Some((last, before)) = rows.split_last() else {
            return Vec::new();
        };
        let (network, copies) = (&self.network, self.learned.len());
        let each = self.passes.par_iter_mut().zip(&self.learned).enumerate();
        each.for_each(|(copy, (pass, learned))| {
            fill(pass, network, rows, copy, copies);
            network.forward(&learned.parameters, pass);
            pass.output_slopes().fill(1.0);
            network.backward(&learned.parameters, pass, None, true);
        });
        let (first, width): (usize, _) = (before.iter().map(|rows| rows.width).sum(), last.width);
        let rows = last.values.len() / last.stride;
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

/// Fills the input of one of so many networks with the rows of its vehicles.
fn fill(pass: &mut Pass, network: &Perceptron, rows: &[Rows<'_>], copy: usize, copies: usize) {
    let columns = rows
        .first()
        .map_or(0, |rows| rows.values.len() / rows.stride / copies);
    pass.fill(network, columns, |column, line| {
        let row = column * copies + copy;
        let mut first = 0;
        for rows in rows {
            let values = &rows.values[row * rows.stride..][..rows.width];
            line[first..first + rows.width].copy_from_slice(values);
            first += rows.width;
        }
    });
}

/// A pass's outputs, `[column][output]`.
fn output_lines(pass: &Pass, width: usize) -> Vec<f32> {
    let columns = pass.output().len() / width;
    (0..columns)
        .flat_map(|column| pass.output().iter().skip(column).step_by(columns).copied())
        .collect()
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
