//! One network for all vehicles, or one for each: the same calls serve both.

use crate::network::optimiser::{Learned, Step};
use crate::network::perceptron::{Pass, Perceptron, Rows, lines};
use crate::network::pool::Pool;
use host_sim::stream::Stream;
use rayon::prelude::*;

/// Networks of one kind, their batches on the way, and what they learn with.
pub struct Group {
    /// The shape that all share.
    pub network: Perceptron,
    /// One network, or one for each vehicle.
    pub learned: Vec<Learned>,
    /// Each network's last [`Group::forward`].
    passes: Vec<Pass>,
    /// For batches of which nothing is kept.
    lent: Pool<Pass>,
    gradients: Pool<Vec<f32>>,
}

/// Networks that a thread takes at a time: of cores that are unequally fast the faster one then does more.
const AT_A_TIME: usize = 1;

/// Which parameters run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Those that learn.
    Learner,
    /// Those that follow.
    Target,
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
            lent: Pool::default(),
            gradients: Pool::default(),
            network,
            learned,
        }
    }

    /// The outputs for the rows of all vehicles, `[sample][vehicle][output]`.
    pub fn outputs(&self, role: Role, rows: &[Rows<'_>]) -> Vec<f32> {
        let (network, copies) = (&self.network, self.learned.len());
        from_each(self.learned.par_iter(), network.outputs(), |copy, learned| {
            let parameters = parameters(learned, role);
            self.lent
                .lend(|pass| run(pass, network, parameters, rows, copy, copies))
        })
    }

    /// The learners' outputs, to be learnt from by [`Group::learn`].
    pub fn forward(&mut self, rows: &[Rows<'_>]) -> Vec<f32> {
        let (network, copies) = (&self.network, self.learned.len());
        let each = self.passes.par_iter_mut().zip(&self.learned);
        from_each(each, network.outputs(), |copy, (pass, learned)| {
            run(pass, network, &learned.parameters, rows, copy, copies)
        })
    }

    /// Steps down the gradient of a loss with these slopes along the outputs of the last [`Group::forward`],
    /// `[sample][vehicle][output]`.
    pub fn learn(&mut self, slopes: &[f32], step: Step, longest_gradient: f32) {
        let (network, copies) = (&self.network, self.learned.len());
        let each = self
            .passes
            .par_iter_mut()
            .zip(&mut self.learned)
            .enumerate()
            .with_max_len(AT_A_TIME);
        each.for_each(|(copy, (pass, learned))| {
            set_slopes(pass, slopes, network.outputs(), copy, copies);
            descend(&self.gradients, network, learned, pass, step, longest_gradient);
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
        let (width, lent, gradients) = (network.outputs(), &self.lent, &self.gradients);
        from_each(self.learned.par_iter_mut(), 1, |copy, learned| {
            lent.lend(|pass| {
                let targets = run(pass, network, &learned.target, later, copy, copies);
                let values = run(pass, network, &learned.parameters, now, copy, copies);
                let mut slopes = vec![0.0; values.len()];
                let losses = targets
                    .chunks_exact(width)
                    .zip(values.chunks_exact(width))
                    .zip(slopes.chunks_exact_mut(width))
                    .enumerate()
                    .map(|(column, ((target, value), slopes))| {
                        judge(column * copies + copy, target, value, slopes)
                    })
                    .collect();
                set_slopes(pass, &slopes, width, 0, 1);
                descend(gradients, network, learned, pass, step, longest_gradient);
                losses
            })
        })
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
    pub fn slopes_along_last(&self, rows: &[Rows<'_>]) -> Vec<f32> {
        let Some((last, before)) = rows.split_last() else {
            return Vec::new();
        };
        let (network, copies) = (&self.network, self.learned.len());
        let first: usize = before.iter().map(|rows| rows.width).sum();
        from_each(self.learned.par_iter(), last.width, |copy, learned| {
            self.lent.lend(|pass| {
                let _outputs = run(pass, network, &learned.parameters, rows, copy, copies);
                pass.output_slopes().fill(1.0);
                network.backward(&learned.parameters, pass, None, true);
                let columns = pass.columns();
                lines(
                    &pass.input_slopes()[first * columns..][..last.width * columns],
                    columns,
                )
            })
        })
    }
}

/// Steps down the gradient along the slopes that a pass holds.
fn descend(
    gradients: &Pool<Vec<f32>>,
    network: &Perceptron,
    learned: &mut Learned,
    pass: &mut Pass,
    step: Step,
    longest_gradient: f32,
) {
    learned.descend(gradients, step, longest_gradient, |parameters, gradient| {
        network.backward(parameters, pass, Some(gradient), false);
    });
}

fn parameters(learned: &Learned, role: Role) -> &[f32] {
    match role {
        Role::Learner => &learned.parameters,
        Role::Target => &learned.target,
    }
}

/// Runs the rows of its vehicles through one of so many networks; gives the outputs, `[column][output]`.
fn run(
    pass: &mut Pass,
    network: &Perceptron,
    parameters: &[f32],
    rows: &[Rows<'_>],
    copy: usize,
    copies: usize,
) -> Vec<f32> {
    let columns = rows.first().map_or(0, |rows| rows.len() / copies);
    pass.fill(network, columns, |column, line| {
        let row = column * copies + copy;
        let mut first = 0;
        for rows in rows {
            line[first..first + rows.width].copy_from_slice(rows.row(row));
            first += rows.width;
        }
    });
    network.forward(parameters, pass);
    pass.output_lines()
}

/// What each network makes, `[column][value]`, as `[sample][vehicle][value]`.
fn from_each<T: Send>(
    networks: impl IndexedParallelIterator<Item = T>,
    width: usize,
    make: impl Fn(usize, T) -> Vec<f32> + Sync,
) -> Vec<f32> {
    let each = networks.enumerate().with_max_len(AT_A_TIME);
    let made = each.map(|(copy, network)| make(copy, network));
    side_by_side(&made.collect::<Vec<_>>(), width)
}

/// Each network's `[column][value]` as `[sample][vehicle][value]`.
fn side_by_side(networks: &[Vec<f32>], width: usize) -> Vec<f32> {
    let columns = networks.first().map_or(0, Vec::len) / width;
    let rows = (0..columns).flat_map(|column| {
        networks
            .iter()
            .map(move |lines| &lines[column * width..][..width])
    });
    rows.flatten().copied().collect()
}

fn set_slopes(pass: &mut Pass, slopes: &[f32], width: usize, copy: usize, copies: usize) {
    pass.set_output_slopes(slopes.chunks_exact(width).skip(copy).step_by(copies));
}
