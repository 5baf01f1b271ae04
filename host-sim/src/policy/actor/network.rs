//! A table's network for a row of worlds at a time: the integers of [`firmware::network::DenseLayer`], one lane a world.

use crate::lanes::{Activations, Dense, DenseRow, LANES, Row, Vectors};
use firmware::decision::{ACTIONS, better};
use firmware::network::{MAX_OUTPUTS, QUAD_ROWS, Quad};
use firmware::table::Table;

/// The network and the activations in work.
#[derive(Clone, Debug)]
pub struct LaneNetwork {
    layers: Vec<Dense>,
    activations: Activations,
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
        Self {
            layers: layers.collect(),
            activations: Activations::new(widest),
        }
    }

    /// The outputs for encoded observations, `[input][world]`, each in the range of i8; those that the network does not have are 0.
    #[inline(always)]
    pub fn infer(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> [Row<i32>; MAX_OUTPUTS] {
        let mut outputs = [[0; LANES]; MAX_OUTPUTS];
        vectors.infer(&self.layers, inputs, &mut self.activations, &mut outputs);
        outputs
    }

    /// Indices of the largest of the actions' outputs; of equal ones the first.
    #[inline(always)]
    pub fn choose(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> Row<i32> {
        let mut outputs = [[0; LANES]; ACTIONS.next_multiple_of(4)];
        vectors.infer(&self.layers, inputs, &mut self.activations, &mut outputs);
        let (mut best, mut most) = ([0; LANES], [i32::MIN; LANES]);
        for (output, row) in outputs.iter().take(ACTIONS).enumerate() {
            for lane in 0..LANES {
                (best[lane], most[lane]) = better((best[lane], most[lane]), (output as i32, row[lane]));
            }
        }
        best
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
