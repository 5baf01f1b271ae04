//! The shape of a multilayer perceptron, and how a batch runs through it, forwards and backwards.
//!
//! Activations are `[unit][column]`, one column a sample: every product then runs over the batch, and weights are read once, as
//! PyTorch keeps them (`[outputs][inputs]`).

use super::product::{Factor, Product, Rounding, Scratch, Start, transpose};
use host_sim::stream::Stream;
use std::ops::Range;

/// Widths of dense layers with ReLU between them, and how their sums round. Parameters are one slice: each layer's weights
/// `[outputs][inputs]`, then its biases.
#[derive(Clone, Debug, PartialEq)]
pub struct Perceptron {
    widths: Vec<usize>,
    rounding: Rounding,
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
    ones: Vec<f32>,
    scratch: Scratch,
}

/// Rows of values of which not all count.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Row after row.
    pub values: &'a [f32],
    /// Distance from one row to the next.
    pub stride: usize,
    /// How many of a row's values count, from the first on.
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
    /// How many.
    pub fn len(&self) -> usize {
        self.values.len() / self.stride
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// What counts of a row.
    pub fn row(&self, index: usize) -> &'a [f32] {
        &self.values[index * self.stride..][..self.width]
    }
}

impl Perceptron {
    /// From the inputs to the outputs; products and sums are rounded together.
    pub fn new(inputs: usize, hidden: &[usize], outputs: usize) -> Self {
        Self::of_widths(&[&[inputs], hidden, &[outputs]].concat())
    }

    /// From inputs, hidden widths and outputs in one list.
    pub fn of_widths(widths: &[usize]) -> Self {
        Self {
            widths: widths.to_vec(),
            rounding: Rounding::Fused,
        }
    }

    /// The same with another rounding.
    pub fn with_rounding(self, rounding: Rounding) -> Self {
        Self { rounding, ..self }
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
            let weights = Factor::Plain(&parameters[self.weights(layer)]);
            let (inputs, shape) = (Factor::Plain(&before[layer]), [self.widths[layer], columns]);
            Product {
                start: Start::Rows(&parameters[self.biases(layer)]),
                rectify: layer + 1 < self.layers(),
                ..Product::new(weights, inputs, shape, self.rounding, result, &mut pass.scratch)
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
                let (left, right) = (Factor::Plain(slopes), Factor::Transposed(&pass.values[layer]));
                let (shape, result) = ([columns, inputs], &mut gradient[self.weights(layer)]);
                Product::new(left, right, shape, self.rounding, result, &mut pass.scratch).compute();
                let biases = &mut gradient[self.biases(layer)];
                self.sum_columns(slopes, biases, &mut pass.ones, &mut pass.scratch);
            }
            if layer > 0 || along_inputs {
                let result = &mut before[layer];
                result.resize(inputs * columns, 0.0);
                let weights = Factor::Transposed(&parameters[self.weights(layer)]);
                let (slopes, shape) = (Factor::Plain(slopes), [outputs, columns]);
                Product::new(weights, slopes, shape, self.rounding, result, &mut pass.scratch).compute();
                if layer > 0 {
                    for (slope, &value) in result.iter_mut().zip(&pass.values[layer]) {
                        *slope = if value > 0.0 { *slope } else { 0.0 };
                    }
                }
            }
        }
    }

    /// Sums of `[unit][column]` over the columns: from the first to the last where every sum is rounded by itself, otherwise in
    /// parts side by side.
    fn sum_columns(&self, values: &[f32], sums: &mut [f32], ones: &mut Vec<f32>, scratch: &mut Scratch) {
        let columns = values.len() / sums.len();
        match self.rounding {
            Rounding::Fused => {
                for (sum, values) in sums.iter_mut().zip(values.chunks_exact(columns)) {
                    *sum = sum_in_parts(values);
                }
            }
            Rounding::Each => {
                ones.resize(columns, 1.0);
                let (values, ones) = (Factor::Plain(values), Factor::Plain(ones));
                Product::new(values, ones, [columns, 1], self.rounding, sums, scratch).compute();
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

    /// The largest of each layer's outputs over the batch, or 0.
    pub fn largest(&self) -> impl Iterator<Item = f32> {
        let layers = self.values.iter().skip(1);
        layers.map(|values| values.iter().fold(0.0, |largest: f32, &value| largest.max(value)))
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

    /// The outputs as `[column][output]`.
    pub fn output_lines(&self) -> Vec<f32> {
        lines(self.output(), self.columns)
    }

    /// Sets the slopes along the outputs, given column after column.
    pub fn set_output_slopes<'a>(&mut self, lines: impl Iterator<Item = &'a [f32]>) {
        let columns = self.columns;
        let slopes = self.output_slopes();
        for (column, line) in lines.enumerate() {
            for (index, &slope) in line.iter().enumerate() {
                slopes[index * columns + column] = slope;
            }
        }
    }

    /// Slopes along the inputs, `[input][column]`, after a backward run that asked for them.
    pub fn input_slopes(&self) -> &[f32] {
        self.slopes.first().map_or(&[], Vec::as_slice)
    }
}

/// `[unit][column]` as `[column][unit]`.
pub fn lines(values: &[f32], columns: usize) -> Vec<f32> {
    let column = |column| values.iter().skip(column).step_by(columns).copied();
    (0..columns).flat_map(column).collect()
}

/// A sum in sixteen parts, so that it vectorises; the order is fixed.
fn sum_in_parts(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut parts = [0.0_f32; 16];
    for chunk in chunks {
        for (part, value) in parts.iter_mut().zip(chunk) {
            *part += value;
        }
    }
    parts.iter().sum::<f32>() + rest.iter().sum::<f32>()
}
