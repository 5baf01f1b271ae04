//! Multilayer perceptrons in f32, their gradients and Adam: one kind of network for every learner.
//!
//! A [`Perceptron`] is a shape, through which batches run with any parameters; a [`Network`] has its own. [`optimiser`] moves
//! parameters, [`product`] is the matrix product behind them all.
//!
//! Written out here, although libraries do this, because a seed must give the same bytes on every machine and with any number of
//! threads: every sum has one fixed order, and transcendental functions are libm's. With [`Rounding::Each`], which the shipped table
//! was distilled with, nothing is fused either; [`Rounding::Fused`] is what larger networks learn with.

pub mod categorical;
pub mod optimiser;
pub mod perceptron;
pub mod pool;
pub mod product;

use categorical::softmax;
use host_sim::stream::Stream;
use perceptron::{Pass, Perceptron, Rows};
use product::{Rounding, transpose};
use rayon::prelude::*;

/// Samples whose gradients are summed one after the other; such sums are then added in order, whichever thread made them.
const CHUNK: usize = 256;

/// A perceptron with its parameters, whose every operation is rounded by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    shape: Perceptron,
    /// Each layer's weights, `[outputs][inputs]`, then its biases.
    pub parameters: Vec<f32>,
}

/// A layer's place in a network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<'a> {
    /// Length of a row of weights.
    pub inputs: usize,
    /// Number of rows.
    pub outputs: usize,
    /// `[outputs][inputs]`, PyTorch's order.
    pub weights: &'a [f32],
    /// `[outputs]`.
    pub biases: &'a [f32],
}

impl Network {
    /// A network of these widths, inputs first, with these parameters.
    pub fn new(widths: &[usize], parameters: Vec<f32>) -> Self {
        let shape = Perceptron::of_widths(widths).with_rounding(Rounding::Each);
        Self { shape, parameters }
    }

    /// A network with uniform weights and biases in +-1/sqrt(inputs), drawn as [`Network::by_inputs`] says.
    pub fn random(widths: &[usize], stream: &mut Stream) -> Self {
        Self::by_inputs(widths, &Perceptron::of_widths(widths).initial(stream))
    }

    /// A network whose weights are given input by input, `[inputs][outputs]`: the order of first draws, and of the files of
    /// learners that draw so.
    pub fn by_inputs(widths: &[usize], parameters: &[f32]) -> Self {
        let mut network = Self::new(widths, parameters.to_vec());
        for layer in 0..network.shape.layers() {
            let place = network.shape.weights(layer);
            let (inputs, outputs) = (widths[layer], widths[layer + 1]);
            transpose(
                &parameters[place.clone()],
                outputs,
                &mut network.parameters[place],
                inputs,
            );
        }
        network
    }

    /// A layer's weights as [`Network::by_inputs`] takes them.
    pub fn weights_by_inputs(&self, layer: usize) -> Vec<f32> {
        let place = self.shape.weights(layer);
        let mut weights = vec![0.0; place.len()];
        let widths = self.widths();
        transpose(
            &self.parameters[place],
            widths[layer],
            &mut weights,
            widths[layer + 1],
        );
        weights
    }

    /// Inputs and each layer's outputs.
    pub fn widths(&self) -> &[usize] {
        self.shape.widths()
    }

    /// From the input on.
    pub fn layers(&self) -> impl ExactSizeIterator<Item = Layer<'_>> {
        let widths = self.widths();
        (0..self.shape.layers()).map(|layer| Layer {
            inputs: widths[layer],
            outputs: widths[layer + 1],
            weights: &self.parameters[self.shape.weights(layer)],
            biases: &self.parameters[self.shape.biases(layer)],
        })
    }

    /// A layer's weights and biases, to be changed.
    pub fn layer_mut(&mut self, layer: usize) -> (&mut [f32], &mut [f32]) {
        let (weights, biases) = (self.shape.weights(layer), self.shape.biases(layer));
        self.parameters[weights.start..biases.end].split_at_mut(weights.len())
    }

    /// The last layer's weights and biases, to be changed.
    pub fn last_mut(&mut self) -> (&mut [f32], &mut [f32]) {
        self.layer_mut(self.shape.layers() - 1)
    }

    /// The last layer's outputs.
    pub fn forward(&self, input: &[f32]) -> Vec<f32> {
        let input = Rows::all(input, input.len());
        self.forward_batch(input, &mut Pass::default()).to_vec()
    }

    /// The last layer's outputs, `[output][sample]`, for inputs `[sample][input]`: what [`Network::forward`] gives for each.
    pub fn forward_batch<'a>(&self, inputs: Rows<'_>, pass: &'a mut Pass) -> &'a [f32] {
        pass.fill(&self.shape, inputs.len(), |sample, line| {
            line.copy_from_slice(inputs.row(sample))
        });
        self.shape.forward(&self.parameters, pass);
        pass.output()
    }

    /// Each layer's largest outputs over samples, `[sample][input]`, or 0.
    pub fn largest_activations(&self, inputs: &[f32]) -> Vec<f32> {
        let mut largest = vec![0.0_f32; self.shape.layers()];
        let mut pass = Pass::default();
        let width = self.widths()[0];
        for inputs in inputs.chunks(CHUNK * width) {
            let _outputs = self.forward_batch(Rows::all(inputs, width), &mut pass);
            for (largest, found) in largest.iter_mut().zip(pass.largest()) {
                *largest = largest.max(found);
            }
        }
        largest
    }

    /// Mean cross entropy of samples against their classes, and its gradient.
    pub fn cross_entropy_gradient(&self, inputs: &[&[f32]], classes: &[u8]) -> (f32, Vec<f32>) {
        let ([loss], gradient) = self.gradient(inputs, |sample, outputs, error| {
            [softmax_error(outputs, usize::from(classes[sample]), error)]
        });
        (loss, gradient)
    }

    /// Means over samples, and the gradient of a mean loss along the parameters.
    ///
    /// `loss` gets a sample's index and the outputs, writes the slope of its loss along each output, and returns values of
    /// which the means are wanted, such as the loss itself.
    pub fn gradient<const MEANS: usize>(
        &self,
        inputs: &[&[f32]],
        loss: impl Fn(usize, &[f32], &mut [f32]) -> [f32; MEANS] + Sync,
    ) -> ([f32; MEANS], Vec<f32>) {
        let chunks = inputs.par_chunks(CHUNK).enumerate();
        let parts: Vec<([f32; MEANS], Vec<f32>)> = chunks
            .map_init(Pass::default, |pass, (chunk, inputs)| {
                let sample = |sample: usize| chunk * CHUNK + sample;
                self.chunk_gradient(pass, inputs, |index, outputs, slopes| {
                    loss(sample(index), outputs, slopes)
                })
            })
            .collect();
        let scale = 1.0 / inputs.len() as f32;
        let (mut means, mut total) = ([0.0; MEANS], vec![0.0; self.parameters.len()]);
        for (sums, gradient) in &parts {
            add_scaled(&mut means, scale, sums);
            add_scaled(&mut total, scale, gradient);
        }
        (means, total)
    }

    /// Sums and summed gradient of one chunk.
    fn chunk_gradient<const MEANS: usize>(
        &self,
        pass: &mut Pass,
        inputs: &[&[f32]],
        loss: impl Fn(usize, &[f32], &mut [f32]) -> [f32; MEANS],
    ) -> ([f32; MEANS], Vec<f32>) {
        pass.fill(&self.shape, inputs.len(), |sample, line| {
            line.copy_from_slice(inputs[sample])
        });
        self.shape.forward(&self.parameters, pass);
        let (outputs, width) = (pass.output_lines(), self.shape.outputs());
        let mut slopes = vec![0.0; outputs.len()];
        let mut sums = [0.0; MEANS];
        let samples = outputs.chunks_exact(width).zip(slopes.chunks_exact_mut(width));
        for (sample, (outputs, slopes)) in samples.enumerate() {
            add_scaled(&mut sums, 1.0, &loss(sample, outputs, slopes));
        }
        pass.set_output_slopes(slopes.chunks_exact(width));
        let mut gradient = vec![0.0; self.parameters.len()];
        self.shape
            .backward(&self.parameters, pass, Some(&mut gradient), false);
        (sums, gradient)
    }
}

/// `target += factor * values`.
fn add_scaled(target: &mut [f32], factor: f32, values: &[f32]) {
    for (target, value) in target.iter_mut().zip(values) {
        *target += factor * value;
    }
}

/// Cross entropy of a softmax, and its slopes along the outputs.
fn softmax_error(outputs: &[f32], class: usize, error: &mut [f32]) -> f32 {
    softmax(outputs, error);
    let loss = -categorical::log_probability(error[class]);
    error[class] -= 1.0;
    loss
}

#[cfg(test)]
mod tests {
    use super::optimiser::{Adam, Step};
    use super::product::rectified;
    use super::*;
    use host_sim::stream::{Purpose, Role, WorldKey};

    fn stream() -> Stream {
        WorldKey {
            seed: 1,
            purpose: Purpose::Training,
            world: 0,
        }
        .stream(Role::Policy, 0)
    }

    fn samples(stream: &mut Stream, count: usize) -> (Vec<Vec<f32>>, Vec<u8>) {
        let inputs: Vec<Vec<f32>> = (0..count)
            .map(|_| (0..5).map(|_| stream.uniform() * 2.0 - 1.0).collect())
            .collect();
        let classes = inputs
            .iter()
            .map(|x| u8::from(x[0] > 0.0) + u8::from(x[1] > 0.3))
            .collect();
        (inputs, classes)
    }

    #[test]
    fn samples_of_a_batch_are_as_if_alone() {
        let network = Network::random(&[5, 70, 33, 4], &mut stream());
        // Each output as a sum in the order of its inputs.
        let plain = |input: &[f32]| {
            let mut values = input.to_vec();
            for (index, layer) in network.layers().enumerate() {
                let rows = layer.weights.chunks_exact(layer.inputs).zip(layer.biases);
                let sums =
                    rows.map(|(row, &bias)| row.iter().zip(&values).fold(bias, |sum, (w, x)| sum + w * x));
                let last = index == 2;
                values = sums.map(|sum| if last { sum } else { rectified(sum) }).collect();
            }
            values
        };
        let mut pass = Pass::default();
        for count in [1, 20, 33] {
            let (inputs, _) = samples(&mut stream(), count);
            let outputs = network.forward_batch(Rows::all(&inputs.concat(), 5), &mut pass);
            for (sample, input) in inputs.iter().enumerate() {
                let alone = network.forward(input);
                assert_eq!(alone, plain(input));
                let together: Vec<f32> = outputs.iter().skip(sample).step_by(count).copied().collect();
                assert_eq!(together, alone, "sample {sample} of {count}");
            }
        }
    }

    #[test]
    fn gradient_is_that_of_finite_differences() {
        let mut stream = stream();
        let network = Network::random(&[5, 7, 6, 3], &mut stream);
        let (inputs, classes) = samples(&mut stream, 40);
        let inputs: Vec<&[f32]> = inputs.iter().map(Vec::as_slice).collect();
        let (_, gradient) = network.cross_entropy_gradient(&inputs, &classes);
        for (index, found) in gradient.iter().enumerate() {
            let loss = |change: f32| {
                let mut network = network.clone();
                network.parameters[index] += change;
                network.cross_entropy_gradient(&inputs, &classes).0
            };
            let slope = (loss(1e-3) - loss(-1e-3)) / 2e-3;
            assert!(
                (slope - found).abs() < 2e-3,
                "parameter {index}: {slope} and {found}"
            );
        }
    }

    #[test]
    fn learns_a_separable_task() {
        let mut stream = stream();
        let mut network = Network::random(&[5, 16, 3], &mut stream);
        let (inputs, classes) = samples(&mut stream, 600);
        let inputs: Vec<&[f32]> = inputs.iter().map(Vec::as_slice).collect();
        let mut adam = Adam::new(network.parameters.len(), Rounding::Each);
        let mut loss = f32::INFINITY;
        for _ in 0..400 {
            let (now, gradient) = network.cross_entropy_gradient(&inputs, &classes);
            adam.step(&mut network.parameters, &mut [], &gradient, Step::plain(1e-2));
            loss = now;
        }
        assert!(loss < 0.05, "{loss}");
    }
}
