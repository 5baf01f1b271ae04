//! A table's network for a row of worlds at a time: the integers of [`firmware::network::DenseLayer`], one lane a world.

use crate::lanes::{LANES, QUAD, Row, Vectors, pair};
use firmware::decision::better;
use firmware::network::{MAX_OUTPUTS, QUAD_ROWS, scaled_product};
use firmware::table::Table;

const _: () = assert!(QUAD == QUAD_ROWS);

/// Four rows of a layer.
#[derive(Clone, Debug)]
struct Quad {
    biases: [i32; QUAD],
    multipliers: [i32; QUAD],
    /// `[column pair][row]`, both columns' weights in one word.
    weights: Vec<[i32; QUAD]>,
}

/// The network and the activations in work.
#[derive(Clone, Debug)]
pub struct LaneNetwork {
    /// `[layer][quad of rows]`.
    layers: Vec<Vec<Quad>>,
    /// `[column pair][world]`, both columns' activations in one word.
    now: Vec<Row<i32>>,
    next: Vec<Row<i32>>,
}

impl LaneNetwork {
    /// A checked table's network.
    pub fn new(table: &Table<'_>) -> Self {
        let mut widest = 0;
        let layers = table.network().layers().map(|layer| {
            let geometry = layer.geometry();
            widest = widest.max(geometry.rows()).max(geometry.columns());
            let pairs = geometry.inputs.div_ceil(2);
            layer.quads().map(|quad| Quad::new(&quad, pairs)).collect()
        });
        let layers = layers.collect();
        // Columns behind the last have no weights.
        let pairs = vec![[0; LANES]; widest / 2 + 1];
        Self {
            layers,
            now: pairs.clone(),
            next: pairs,
        }
    }

    /// The outputs for encoded observations, `[input][world]`, each in the range of i8; those that the network does not have are 0.
    #[inline(always)]
    pub fn infer(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> [Row<i32>; MAX_OUTPUTS] {
        self.run_hidden(vectors, inputs);
        let mut outputs = [[0; LANES]; MAX_OUTPUTS];
        let output = self.layers.last().into_iter().flatten();
        for (outputs, quad) in outputs.as_chunks_mut::<QUAD>().0.iter_mut().zip(output) {
            *outputs = quad.scaled(vectors, &self.now);
        }
        outputs
    }

    /// Indices of the largest of the first `COUNT` outputs; of equal ones the first. Quad by quad, so that no output is stored.
    #[inline(always)]
    pub fn largest<const COUNT: usize>(&mut self, vectors: Vectors, inputs: &[Row<i32>]) -> Row<i32> {
        self.run_hidden(vectors, inputs);
        let (mut best, mut most) = ([0; LANES], [i32::MIN; LANES]);
        for (index, quad) in self.layers.last().into_iter().flatten().enumerate() {
            let rows = quad.scaled(vectors, &self.now);
            for (output, row) in (index * QUAD..COUNT).zip(&rows) {
                for lane in 0..LANES {
                    (best[lane], most[lane]) = better((best[lane], most[lane]), (output as i32, row[lane]));
                }
            }
        }
        best
    }

    /// The activations behind the last hidden layer.
    #[inline(always)]
    fn run_hidden(&mut self, vectors: Vectors, inputs: &[Row<i32>]) {
        let (pairs, last) = inputs.as_chunks::<2>();
        for (now, inputs) in self.now.iter_mut().zip(pairs) {
            for lane in 0..LANES {
                now[lane] = pair(inputs[0][lane], inputs[1][lane]);
            }
        }
        if let [last] = last {
            self.now[pairs.len()] = last.map(|input| pair(input, 0));
        }
        let Some((_, hidden)) = self.layers.split_last() else {
            return;
        };
        for layer in hidden {
            for (quad, next) in layer.iter().zip(self.next.as_chunks_mut::<{ QUAD / 2 }>().0) {
                let rows = quad.scaled(vectors, &self.now);
                for (next, rows) in next.iter_mut().zip(rows.as_chunks::<2>().0) {
                    for lane in 0..LANES {
                        let clamped = |row: &Row<i32>| row[lane].clamp(0, 255);
                        next[lane] = pair(clamped(&rows[0]), clamped(&rows[1]));
                    }
                }
            }
            std::mem::swap(&mut self.now, &mut self.next);
        }
    }
}

impl Quad {
    /// Four rows from a table, without the columns that only fill blocks.
    fn new(quad: &firmware::network::Quad<'_>, pairs: usize) -> Self {
        let columns = |rows: [[i16; 4]; QUAD]| {
            [0, 2].map(|column| rows.map(|row| pair(i32::from(row[column]), i32::from(row[column + 1]))))
        };
        Self {
            biases: quad.biases(),
            multipliers: quad.multipliers(),
            weights: quad.weights().flat_map(columns).take(pairs).collect(),
        }
    }

    /// The rows' results by the specification, before any clamp.
    #[inline(always)]
    fn scaled(&self, vectors: Vectors, activations: &[Row<i32>]) -> [Row<i32>; QUAD] {
        // No closure: it would not always be inlined, and then lose the vector unit.
        let mut rows = [[0; LANES]; QUAD];
        for (row, &bias) in rows.iter_mut().zip(&self.biases) {
            *row = [bias; LANES];
        }
        vectors.add_products(&mut rows, &self.weights, activations);
        for (row, &multiplier) in rows.iter_mut().zip(&self.multipliers) {
            // Two neighbours in 64 bits, each multiplied as its half: no lane has to move.
            let mut pairs: [i64; LANES / 2] = pulp::cast(*row);
            let multiplier = i64::from(multiplier);
            for pair in &mut pairs {
                let lower = scaled_product(i64::from(*pair as i32), multiplier);
                let upper = scaled_product(*pair >> 32, multiplier);
                *pair = ((lower as u64) >> 32) as i64 | (upper & !0xffff_ffff);
            }
            *row = pulp::cast(pairs);
        }
        rows
    }
}
