//! Dense layers with ReLU between them, forwards and backwards over a batch.
//!
//! Activations are `[unit][column]`, one column a sample: every product then runs over the batch, and weights are read once, as
//! PyTorch keeps them (`[outputs][inputs]`).

use crate::product::{Factor, Product, Rounding, Scratch, Start, transpose};
use host_sim::stream::Stream;
use std::ops::Range;

/// Widths of a perceptron; its parameters are one slice: each layer's weights `[outputs][inputs]`, then its biases.
#[derive(Clone, Debug, PartialEq)]
pub struct Perceptron {
    widths: Vec<usize>,
}

/// One batch on its way through a perceptron. Buffers are kept between batches.
#[derive(Clone, Debug, Default)]
pub struct Pass {
    columns: usize,
    /// `[layer][unit][column]`; layer 0 is the input.
    values: Vec<Vec<f32>>,
    /// Slopes of the loss along the values, in the same layout.
    slopes: Vec<Vec<f32>>,
    lines: Vec<f32>,
    scratch: Scratch,
}

impl Perceptron {
    /// From the inputs to the outputs.
    pub fn new(inputs: usize, hidden: &[usize], outputs: usize) -> Self {
        let widths = [inputs]
            .into_iter()
            .chain(hidden.iter().copied())
            .chain([outputs]);
        Self {
            widths: widths.collect(),
        }
    }

    /// Inputs, then each layer's outputs.
    pub fn widths(&self) -> &[usize] {
        &self.widths
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.widths[self.layers()]
    }

    /// Number of layers.
    pub fn layers(&self) -> usize {
        self.widths.len() - 1
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.biases(self.layers() - 1).end
    }

    /// Where a layer's weights are.
    pub fn weights(&self, layer: usize) -> Range<usize> {
        let before: usize = self
            .widths
            .windows(2)
            .take(layer)
            .map(|w| (w[0] + 1) * w[1])
            .sum();
        before..before + self.widths[layer] * self.widths[layer + 1]
    }

    /// Where a layer's biases are.
    pub fn biases(&self, layer: usize) -> Range<usize> {
        let start = self.weights(layer).end;
        start..start + self.widths[layer + 1]
    }

    /// Uniform weights and biases in +-1/sqrt(inputs), PyTorch's default.
    pub fn initial(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = Vec::with_capacity(self.parameters());
        for layer in self.widths.windows(2) {
            let limit = 1.0 / libm::sqrt(layer[0] as f64);
            let count = (layer[0] + 1) * layer[1];
            parameters.extend((0..count).map(|_| stream.uniform_between(-limit, limit) as f32));
        }
        parameters
    }

    /// Runs the pass's input through all layers.
    pub fn forward(&self, parameters: &[f32], pass: &mut Pass) {
        let columns = pass.columns;
        pass.values.resize_with(self.widths.len(), Vec::new);
        for layer in 0..self.layers() {
            let (before, after) = pass.values.split_at_mut(layer + 1);
            let result = &mut after[0];
            result.resize(self.widths[layer + 1] * columns, 0.0);
            Product {
                left: Factor::Plain(&parameters[self.weights(layer)]),
                right: Factor::Plain(&before[layer]),
                depth: self.widths[layer],
                columns,
                start: Start::Rows(&parameters[self.biases(layer)]),
                rectify: layer + 1 < self.layers(),
                rounding: Rounding::Fused,
                result,
                scratch: &mut pass.scratch,
            }
            .compute();
        }
    }

    /// Runs the slopes that [`Pass::output_slopes`] holds back through all layers of the last [`Perceptron::forward`]. Writes
    /// the parameters' gradient, if wanted, and the slopes along the inputs, if wanted.
    pub fn backward(
        &self,
        parameters: &[f32],
        pass: &mut Pass,
        mut gradient: Option<&mut [f32]>,
        along_inputs: bool,
    ) {
        let columns = pass.columns;
        for layer in (0..self.layers()).rev() {
            let (inputs, outputs) = (self.widths[layer], self.widths[layer + 1]);
            let (before, after) = pass.slopes.split_at_mut(layer + 1);
            let slopes = &after[0];
            if let Some(gradient) = gradient.as_deref_mut() {
                Product {
                    left: Factor::Plain(slopes),
                    right: Factor::Transposed(&pass.values[layer]),
                    depth: columns,
                    columns: inputs,
                    start: Start::Zero,
                    rectify: false,
                    rounding: Rounding::Fused,
                    result: &mut gradient[self.weights(layer)],
                    scratch: &mut pass.scratch,
                }
                .compute();
                for (bias, slopes) in gradient[self.biases(layer)]
                    .iter_mut()
                    .zip(slopes.chunks_exact(columns))
                {
                    *bias = sum(slopes);
                }
            }
            if layer > 0 || along_inputs {
                let result = &mut before[layer];
                result.resize(inputs * columns, 0.0);
                Product {
                    left: Factor::Transposed(&parameters[self.weights(layer)]),
                    right: Factor::Plain(slopes),
                    depth: outputs,
                    columns,
                    start: Start::Zero,
                    rectify: false,
                    rounding: Rounding::Fused,
                    result,
                    scratch: &mut pass.scratch,
                }
                .compute();
                if layer > 0 {
                    for (slope, &value) in result.iter_mut().zip(&pass.values[layer]) {
                        *slope = if value > 0.0 { *slope } else { 0.0 };
                    }
                }
            }
        }
    }
}

impl Pass {
    /// Fills the input of a batch of so many columns, one column after the other. `write` finds zeros.
    pub fn fill(&mut self, network: &Perceptron, columns: usize, mut write: impl FnMut(usize, &mut [f32])) {
        let inputs = network.widths[0];
        // Written one after the other and then transposed in blocks: columns lie far apart in memory.
        let mut lines = std::mem::take(&mut self.lines);
        lines.clear();
        lines.resize(columns * inputs, 0.0);
        for (column, line) in lines.chunks_exact_mut(inputs).enumerate() {
            write(column, line);
        }
        self.columns = columns;
        self.values.resize_with(network.widths.len(), Vec::new);
        self.values[0].resize(columns * inputs, 0.0);
        transpose(&lines, inputs, &mut self.values[0], columns);
        self.lines = lines;
    }

    /// The input of a batch of so many columns, `[input][column]`, to be filled.
    pub fn input(&mut self, network: &Perceptron, columns: usize) -> &mut [f32] {
        self.columns = columns;
        self.values.resize_with(network.widths.len(), Vec::new);
        self.values[0].resize(network.widths[0] * columns, 0.0);
        &mut self.values[0]
    }

    /// Samples of the batch.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The input, `[input][column]`.
    pub fn input_values(&self) -> &[f32] {
        self.values.first().map_or(&[], Vec::as_slice)
    }

    /// The last layer's values, `[output][column]`.
    pub fn output(&self) -> &[f32] {
        self.values.last().map_or(&[], Vec::as_slice)
    }

    /// Slopes along the outputs, `[output][column]`, to be filled.
    pub fn output_slopes(&mut self) -> &mut [f32] {
        self.slopes.resize_with(self.values.len(), Vec::new);
        let length = self.output().len();
        match self.slopes.last_mut() {
            Some(slopes) => {
                slopes.resize(length, 0.0);
                slopes
            }
            None => &mut [],
        }
    }

    /// Slopes along the inputs, `[input][column]`, after a backward run that asked for them.
    pub fn input_slopes(&self) -> &[f32] {
        self.slopes.first().map_or(&[], Vec::as_slice)
    }
}

/// A sum in sixteen parts, so that it vectorises; the order is fixed.
pub fn sum(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut parts = [0.0_f32; 16];
    for chunk in chunks {
        for (part, value) in parts.iter_mut().zip(chunk) {
            *part += value;
        }
    }
    parts.iter().sum::<f32>() + rest.iter().sum::<f32>()
}
