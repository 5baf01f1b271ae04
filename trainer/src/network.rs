//! A small multilayer perceptron in f32 with its gradient and Adam.
//!
//! Written out here, although libraries do this faster, because a shipped table must be reproducible to the byte from its
//! seed on any machine: every sum below has one fixed order, nothing is fused, and transcendental functions are libm's.
//! Inner loops run over a layer's outputs, so that they vectorise, at whatever width the machine has, without changing a sum.

use crate::product::{Factor, Product, Rounding, Scratch, Start, rectified, transpose};
use host_sim::lanes::Vectors;
use host_sim::stream::Stream;
use rayon::prelude::*;

/// Samples whose gradients are summed one after the other; such sums are then added in order, whichever thread made them.
const CHUNK: usize = 256;

/// A dense layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Row length.
    pub inputs: usize,
    /// Number of rows.
    pub outputs: usize,
    /// `[inputs][outputs]`: transposed, as the inner loops run.
    pub weights: Vec<f32>,
    /// `[outputs]`.
    pub biases: Vec<f32>,
}

/// Dense layers with ReLU between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// From the input on.
    pub layers: Vec<Layer>,
}

impl Layer {
    fn zeros(inputs: usize, outputs: usize) -> Self {
        Self {
            inputs,
            outputs,
            weights: vec![0.0; inputs * outputs],
            biases: vec![0.0; outputs],
        }
    }

    /// Weights as `[outputs][inputs]`, PyTorch's and the firmware's order.
    pub fn rows(&self) -> impl Iterator<Item = f32> {
        let column = |output| self.weights.iter().skip(output).step_by(self.outputs).copied();
        (0..self.outputs).flat_map(column)
    }

    #[inline(always)]
    fn forward(&self, input: &[f32], output: &mut [f32]) {
        output.copy_from_slice(&self.biases);
        for (&value, row) in input.iter().zip(self.weights.chunks_exact(self.outputs)) {
            add_scaled(output, value, row);
        }
    }

    fn parameters(&self) -> impl Iterator<Item = &f32> {
        self.weights.iter().chain(&self.biases)
    }

    fn parameters_mut(&mut self) -> impl Iterator<Item = &mut f32> {
        self.weights.iter_mut().chain(&mut self.biases)
    }
}

/// `target += factor * values`. Flags and silent units make many factors 0, which change nothing.
#[inline(always)]
fn add_scaled(target: &mut [f32], factor: f32, values: &[f32]) {
    if factor == 0.0 {
        return;
    }
    for (target, value) in target.iter_mut().zip(values) {
        *target += factor * value;
    }
}

/// Activations of one sample, `[layer][unit]`; index 0 is the input.
#[derive(Clone, Debug)]
pub struct Activations(Vec<Vec<f32>>);

/// Activations of many samples, `[unit][sample]`.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    values: Vec<f32>,
    next: Vec<f32>,
    scratch: Scratch,
}

impl Network {
    /// A network of these widths (inputs first) with uniform weights and biases in +-1/sqrt(inputs).
    pub fn random(widths: &[usize], stream: &mut Stream) -> Self {
        let layers = widths.windows(2).map(|window| {
            let mut layer = Layer::zeros(window[0], window[1]);
            let limit = 1.0 / libm::sqrt(window[0] as f64);
            layer
                .parameters_mut()
                .for_each(|parameter| *parameter = stream.uniform_between(-limit, limit) as f32);
            layer
        });
        Self {
            layers: layers.collect(),
        }
    }

    /// Inputs and each layer's outputs.
    pub fn widths(&self) -> Vec<usize> {
        let inputs = self.layers.first().map(|layer| layer.inputs);
        inputs
            .into_iter()
            .chain(self.layers.iter().map(|layer| layer.outputs))
            .collect()
    }

    /// The last layer's outputs.
    pub fn forward(&self, input: &[f32]) -> Vec<f32> {
        let mut activations = self.activations();
        let _ = self.forward_into(input, &mut activations);
        activations.0.pop().unwrap_or_default()
    }

    /// The last layer's outputs, computed in buffers that [`Network::activations`] made.
    fn forward_into<'a>(&self, input: &[f32], activations: &'a mut Activations) -> &'a [f32] {
        Vectors::widest().run(
            #[inline(always)]
            || self.run(input, activations),
        );
        activations.0.last().map_or(&[], Vec::as_slice)
    }

    /// The last layer's outputs, `[output][sample]`, for inputs `[sample][input]`: what [`Network::forward`] gives for each, but
    /// weights are read once for all.
    pub fn forward_batch<'a>(&self, inputs: &[f32], batch: &'a mut Batch) -> &'a [f32] {
        let Batch {
            values,
            next,
            scratch,
        } = batch;
        let width = self.layers.first().map_or(1, |layer| layer.inputs);
        let samples = inputs.len() / width;
        values.resize(inputs.len(), 0.0);
        transpose(inputs, width, values, samples);
        for (index, layer) in self.layers.iter().enumerate() {
            next.resize(layer.outputs * samples, 0.0);
            Product {
                left: Factor::Transposed(&layer.weights),
                right: Factor::Plain(values),
                depth: layer.inputs,
                columns: samples,
                start: Start::Rows(&layer.biases),
                rectify: index + 1 < self.layers.len(),
                rounding: Rounding::Each,
                result: next,
                scratch,
            }
            .compute();
            std::mem::swap(values, next);
        }
        values
    }

    /// The hidden activations' largest values over samples, by layer; the outputs come last.
    pub fn largest_activations<'a>(&self, inputs: impl Iterator<Item = &'a [f32]>) -> Vec<f32> {
        let mut largest = vec![0.0_f32; self.layers.len()];
        let mut activations = self.activations();
        for input in inputs {
            let _ = self.forward_into(input, &mut activations);
            for (largest, values) in largest.iter_mut().zip(&activations.0[1..]) {
                *largest = values.iter().fold(*largest, |largest, &value| largest.max(value));
            }
        }
        largest
    }

    /// Buffers for one sample.
    fn activations(&self) -> Activations {
        Activations(self.widths().into_iter().map(|width| vec![0.0; width]).collect())
    }

    #[inline(always)]
    fn run(&self, input: &[f32], activations: &mut Activations) {
        activations.0[0].copy_from_slice(input);
        let last = self.layers.len() - 1;
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = activations.0.split_at_mut(index + 1);
            layer.forward(&before[index], &mut after[0]);
            if index < last {
                after[0].iter_mut().for_each(|value| *value = rectified(*value));
            }
        }
    }

    /// Mean cross entropy of samples against their classes, and its gradient.
    pub fn cross_entropy_gradient(&self, inputs: &[&[f32]], classes: &[u8]) -> (f32, Network) {
        let ([loss], gradient) = self.gradient(inputs, |sample, outputs, error| {
            [softmax_error(outputs, usize::from(classes[sample]), error)]
        });
        (loss, gradient)
    }

    /// Means over samples, and the gradient of a mean loss.
    ///
    /// `loss` gets a sample's index and the outputs, writes the slope of its loss against each output, and returns values of
    /// which the means are wanted, such as the loss itself.
    pub fn gradient<const MEANS: usize>(
        &self,
        inputs: &[&[f32]],
        loss: impl Fn(usize, &[f32], &mut [f32]) -> [f32; MEANS] + Sync,
    ) -> ([f32; MEANS], Network) {
        let transposed: Vec<Vec<f32>> = self.layers.iter().map(|layer| layer.rows().collect()).collect();
        let partial: Vec<([f32; MEANS], Network)> = inputs
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, inputs)| {
                let loss =
                    |index, outputs: &[f32], error: &mut [f32]| loss(chunk * CHUNK + index, outputs, error);
                Vectors::widest().run(
                    #[inline(always)]
                    || self.chunk_gradient(&transposed, inputs, loss),
                )
            })
            .collect();
        let scale = 1.0 / inputs.len() as f32;
        let (mut means, mut total) = ([0.0; MEANS], self.zeros_like());
        for (sums, gradient) in &partial {
            add_scaled(&mut means, scale, sums);
            for (total, layer) in total.layers.iter_mut().zip(&gradient.layers) {
                total
                    .parameters_mut()
                    .zip(layer.parameters())
                    .for_each(|(total, value)| *total += value * scale);
            }
        }
        (means, total)
    }

    /// Length of all parameters as one vector.
    pub fn norm(&self) -> f64 {
        let parameters = self.layers.iter().flat_map(Layer::parameters);
        libm::sqrt(parameters.fold(0.0, |sum, &value| sum + f64::from(value) * f64::from(value)))
    }

    /// Multiplies all parameters.
    pub fn scale(&mut self, factor: f32) {
        let parameters = self.layers.iter_mut().flat_map(Layer::parameters_mut);
        parameters.for_each(|value| *value *= factor);
    }

    fn zeros_like(&self) -> Network {
        Network {
            layers: self
                .layers
                .iter()
                .map(|layer| Layer::zeros(layer.inputs, layer.outputs))
                .collect(),
        }
    }

    /// Sums and summed gradient of one chunk.
    #[inline(always)]
    fn chunk_gradient<const MEANS: usize>(
        &self,
        transposed: &[Vec<f32>],
        inputs: &[&[f32]],
        loss: impl Fn(usize, &[f32], &mut [f32]) -> [f32; MEANS],
    ) -> ([f32; MEANS], Network) {
        let mut gradient = self.zeros_like();
        let mut activations = self.activations();
        let mut errors = self.activations();
        let mut sums = [0.0; MEANS];
        let last = self.layers.len();
        for (sample, input) in inputs.iter().enumerate() {
            self.run(input, &mut activations);
            let values = loss(sample, &activations.0[last], &mut errors.0[last]);
            add_scaled(&mut sums, 1.0, &values);
            for index in (0..last).rev() {
                let (before, after) = errors.0.split_at_mut(index + 1);
                let (error, layer) = (&after[0], &mut gradient.layers[index]);
                add_scaled(&mut layer.biases, 1.0, error);
                for (&value, row) in activations.0[index]
                    .iter()
                    .zip(layer.weights.chunks_exact_mut(error.len()))
                {
                    add_scaled(row, value, error);
                }
                if index > 0 {
                    let earlier = &mut before[index];
                    earlier.fill(0.0);
                    for (&value, row) in error.iter().zip(transposed[index].chunks_exact(earlier.len())) {
                        add_scaled(earlier, value, row);
                    }
                    for (earlier, &activation) in earlier.iter_mut().zip(&activations.0[index]) {
                        if activation <= 0.0 {
                            *earlier = 0.0;
                        }
                    }
                }
            }
        }
        (sums, gradient)
    }
}

/// Cross entropy of a softmax, and its gradient with respect to the outputs.
fn softmax_error(outputs: &[f32], class: usize, error: &mut [f32]) -> f32 {
    let largest = outputs
        .iter()
        .fold(f32::NEG_INFINITY, |largest, &value| largest.max(value));
    let mut sum = 0.0;
    for (error, &output) in error.iter_mut().zip(outputs) {
        *error = libm::expf(output - largest);
        sum += *error;
    }
    error.iter_mut().for_each(|error| *error /= sum);
    let loss = -libm::logf(error[class].max(f32::MIN_POSITIVE));
    error[class] -= 1.0;
    loss
}

/// Adam (Kingma and Ba 2015) with beta 0.9 and 0.999.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Running mean of the gradient.
    pub mean: Network,
    /// Running mean of its square.
    pub square: Network,
    /// Both betas to the power of the steps done.
    pub decay: (f32, f32),
}

impl Adam {
    const BETA: (f32, f32) = (0.9, 0.999);

    /// For this network.
    pub fn new(network: &Network) -> Self {
        Self {
            mean: network.zeros_like(),
            square: network.zeros_like(),
            decay: (1.0, 1.0),
        }
    }

    /// One step down the gradient.
    pub fn step(&mut self, network: &mut Network, gradient: &Network, learning_rate: f32) {
        let (beta_1, beta_2) = Self::BETA;
        self.decay.0 *= beta_1;
        self.decay.1 *= beta_2;
        let (correction_1, correction_2) = (1.0 - self.decay.0, 1.0 - self.decay.1);
        let state = self.mean.layers.iter_mut().zip(&mut self.square.layers);
        for ((layer, gradient), (mean, square)) in network.layers.iter_mut().zip(&gradient.layers).zip(state)
        {
            let moments = mean.parameters_mut().zip(square.parameters_mut());
            for ((parameter, &slope), (mean, square)) in
                layer.parameters_mut().zip(gradient.parameters()).zip(moments)
            {
                *mean = beta_1 * *mean + (1.0 - beta_1) * slope;
                *square = beta_2 * *square + (1.0 - beta_2) * slope * slope;
                let root = libm::sqrtf(*square / correction_2) + 1e-8;
                *parameter -= learning_rate * (*mean / correction_1) / root;
            }
        }
    }
}

#[cfg(test)]
mod tests {
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
        let mut batch = Batch::default();
        for count in [1, 20, 33] {
            let (inputs, _) = samples(&mut stream(), count);
            let outputs = network.forward_batch(&inputs.concat(), &mut batch);
            for (sample, input) in inputs.iter().enumerate() {
                let alone = network.forward(input);
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
        for layer in 0..3 {
            for index in 0..network.layers[layer].weights.len() {
                let loss = |change: f32| {
                    let mut network = network.clone();
                    network.layers[layer].weights[index] += change;
                    network.cross_entropy_gradient(&inputs, &classes).0
                };
                let slope = (loss(5e-3) - loss(-5e-3)) / 1e-2;
                let found = gradient.layers[layer].weights[index];
                assert!(
                    (slope - found).abs() < 2e-3,
                    "layer {layer} weight {index}: {slope} and {found}"
                );
            }
        }
    }

    #[test]
    fn learns_a_separable_task() {
        let mut stream = stream();
        let mut network = Network::random(&[5, 16, 3], &mut stream);
        let (inputs, classes) = samples(&mut stream, 600);
        let inputs: Vec<&[f32]> = inputs.iter().map(Vec::as_slice).collect();
        let mut adam = Adam::new(&network);
        let mut loss = f32::INFINITY;
        for _ in 0..400 {
            let (now, gradient) = network.cross_entropy_gradient(&inputs, &classes);
            adam.step(&mut network, &gradient, 1e-2);
            loss = now;
        }
        assert!(loss < 0.05, "{loss}");
    }
}
