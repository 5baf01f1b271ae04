//! A table's network for a row of worlds at a time: the integers of [`firmware::network::DenseLayer`], one lane a world.

use crate::lanes::{Dense, DenseRow, LANES, Row, Vectors};
use firmware::decision::better;
use firmware::network::{MAX_OUTPUTS, QUAD_ROWS, Quad};
use firmware::table::Table;

/// The network and the activations in work.
#[derive(Clone, Debug)]
pub struct LaneNetwork {
    layers: Vec<Dense>,
    /// Activations as the vector unit takes them.
    now: Vec<Row<i32>>,
    next: Vec<Row<i32>>,
}

impl LaneNetwork {
    /// A checked table's network.
    pub fn new(table: &Table<'_>) -> Self {
        let mut widest = 0;
        let layers = table.network().layers().enumerate().map(|(index, layer)| {
            let geometry = layer.geometry();
            widest = widest.max(geometry.rows()).max(geometry.columns());
            let rows: Vec<DenseRow> = layer.quads().flat_map(|quad| rows(&quad, geometry.inputs)).collect();
            Dense::new(&rows[..geometry.outputs], index == 0)
        });
        let layers = layers.collect();
        let words = vec![[0; LANES]; widest.div_ceil(2)];
        Self {
            layers,
            now: words.clone(),
            next: words,
        }
    }

    /// The outputs for encoded observations, `[input][world]`, each in the range of i8; those that the network does not have are 0.
    #[inline(always)]
    pub fn infer(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> [Row<i32>; MAX_OUTPUTS] {
        self.run_hidden(vectors, inputs);
        let mut outputs = [[0; LANES]; MAX_OUTPUTS];
        if let Some(layer) = self.layers.last() {
            vectors.outputs(layer, &self.now, &mut outputs);
        }
        outputs
    }

    /// Indices of the largest of the first `COUNT` outputs; of equal ones the first.
    #[inline(always)]
    pub fn largest<const COUNT: usize>(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> Row<i32> {
        let outputs = self.infer(vectors, inputs);
        let (mut best, mut most) = ([0; LANES], [i32::MIN; LANES]);
        for (output, row) in outputs.iter().take(COUNT).enumerate() {
            for lane in 0..LANES {
                (best[lane], most[lane]) = better((best[lane], most[lane]), (output as i32, row[lane]));
            }
        }
        best
    }

    /// The activations behind the last hidden layer.
    #[inline(always)]
    fn run_hidden(&mut self, vectors: Vectors, inputs: &[Row<i32>]) {
        vectors.take_inputs(inputs, &mut self.now);
        for layer in self.layers.split_last().into_iter().flat_map(|(_, hidden)| hidden) {
            vectors.hidden(layer, &self.now, &mut self.next);
            std::mem::swap(&mut self.now, &mut self.next);
        }
    }
}

/// Four rows of a table, without the columns that only fill blocks.
fn rows(quad: &Quad<'_>, columns: usize) -> [DenseRow; QUAD_ROWS] {
    let (biases, multipliers) = (quad.biases(), quad.multipliers());
    std::array::from_fn(|row| {
        let weights = quad.weights().flat_map(|block| block[row].map(i32::from));
        DenseRow {
            bias: biases[row],
            multiplier: multipliers[row],
            weights: weights.take(columns).collect(),
        }
    })
}
