//! A table's network for a row of worlds at a time: the integers of [`firmware::actor::DenseLayer`], one lane a world.

use crate::lanes::{LANES, Row};
use firmware::actor::QUAD_ROWS;
use firmware::observation::INPUTS;
use firmware::table::{HEADER_LEN, Table};

/// Two columns' activations, a world's side by side: what a vector unit multiplies and adds in one instruction.
type PairRow = [i16; 2 * LANES];

/// One row of a layer.
#[derive(Clone, Debug)]
struct Neuron {
    bias: i32,
    multiplier: i32,
    /// `[column pair]`.
    weights: Vec<[i16; 2]>,
}

/// The network and the activations in work.
#[derive(Clone, Debug)]
pub struct LaneNetwork {
    inputs: [Row<i8>; INPUTS],
    /// `[layer][row]`.
    layers: Vec<Vec<Neuron>>,
    /// `[column pair]`.
    now: Vec<PairRow>,
    next: Vec<PairRow>,
}

impl LaneNetwork {
    /// A checked table's network.
    pub fn new(table: &Table<'_>) -> Self {
        let mut rest = &table.bytes()[HEADER_LEN..];
        let layers: Vec<Vec<Neuron>> = table
            .network()
            .layers()
            .map(|layer| {
                let geometry = layer.geometry();
                let biases;
                (biases, rest) = rest.split_at(4 * geometry.rows());
                let stream;
                (stream, rest) = rest.split_at(geometry.stream_len());
                let biases = words(biases);
                let quads = stream.chunks_exact(stream.len() * QUAD_ROWS / geometry.rows());
                let mut neurons: Vec<Neuron> = quads
                    .zip(biases.chunks_exact(QUAD_ROWS))
                    .flat_map(|(quad, biases)| unpacked(quad, biases))
                    .collect();
                neurons.truncate(geometry.outputs);
                neurons
            })
            .collect();
        let widest = layers.iter().map(Vec::len).max().unwrap_or(0).max(INPUTS);
        // Columns behind the last are weighted 0; rows may be padded to eight.
        let pairs = widest.next_multiple_of(8) / 2;
        Self {
            inputs: [[0; LANES]; INPUTS],
            layers,
            now: vec![[0; 2 * LANES]; pairs],
            next: vec![[0; 2 * LANES]; pairs],
        }
    }

    /// The encoded observations, to be written. `[input][world]`.
    #[inline(always)]
    pub fn inputs(&mut self) -> &mut [Row<i8>; INPUTS] {
        &mut self.inputs
    }

    /// The actions with the largest outputs; of equal ones the first.
    #[inline(always)]
    pub fn infer(&mut self) -> Row<u8> {
        for (pair, inputs) in self.now.iter_mut().zip(self.inputs.as_chunks::<2>().0) {
            for lane in 0..LANES {
                pair[2 * lane] = i16::from(inputs[0][lane]);
                pair[2 * lane + 1] = i16::from(inputs[1][lane]);
            }
        }
        let Some((output, hidden)) = self.layers.split_last() else {
            return [0; LANES];
        };
        for layer in hidden {
            for (row, neuron) in layer.iter().enumerate() {
                let scaled = scaled(neuron, &self.now);
                let next = &mut self.next[row / 2];
                for lane in 0..LANES {
                    next[2 * lane + row % 2] = scaled[lane].max(0).min(255) as i16;
                }
            }
            std::mem::swap(&mut self.now, &mut self.next);
        }
        let (mut best, mut most) = ([0_u32; LANES], [i32::MIN; LANES]);
        for (action, neuron) in output.iter().enumerate() {
            let scaled = scaled(neuron, &self.now);
            for lane in 0..LANES {
                let better = u32::from(scaled[lane] > most[lane]).wrapping_neg();
                best[lane] = better & action as u32 | !better & best[lane];
                most[lane] = most[lane].max(scaled[lane]);
            }
        }
        best.map(|best| best as u8)
    }
}

/// A row's results by the specification, before any clamp.
#[inline(always)]
fn scaled(neuron: &Neuron, activations: &[PairRow]) -> Row<i32> {
    let mut sums = [neuron.bias; LANES];
    for (&[even, odd], activations) in neuron.weights.iter().zip(activations) {
        let (even, odd) = (i32::from(even), i32::from(odd));
        for lane in 0..LANES {
            let products =
                i32::from(activations[2 * lane]) * even + i32::from(activations[2 * lane + 1]) * odd;
            sums[lane] = sums[lane].wrapping_add(products);
        }
    }
    let mut scaled = [0; LANES];
    for lane in 0..LANES {
        let product = i64::from(sums[lane]) * i64::from(neuron.multiplier);
        scaled[lane] = ((product + (1 << 31)) >> 32) as i32;
    }
    scaled
}

/// Four rows from their quad in the stream, which [`firmware::table`] describes.
fn unpacked(quad: &[u8], biases: &[i32]) -> [Neuron; QUAD_ROWS] {
    let (halfwords, multipliers) = quad[16..].split_at(quad.len() - 32);
    let multipliers = words(multipliers);
    let halfwords: Vec<i16> = halfwords
        .as_chunks::<2>()
        .0
        .iter()
        .map(|bytes| i16::from_le_bytes(*bytes))
        .collect();
    std::array::from_fn(|row| {
        // Blocks of four columns, first of the upper two rows, then of the lower two.
        let blocks = halfwords
            .chunks_exact(8)
            .flat_map(|block| &block[row / 2 * 4..][..4]);
        let weights: Vec<i16> = blocks
            .map(|&halfword| {
                if row % 2 == 0 {
                    (halfword + 128) >> 8
                } else {
                    i16::from(halfword as i8)
                }
            })
            .collect();
        Neuron {
            bias: biases[row],
            multiplier: multipliers[row],
            weights: weights.as_chunks::<2>().0.to_vec(),
        }
    })
}

fn words(bytes: &[u8]) -> Vec<i32> {
    let words = bytes.as_chunks::<4>().0;
    words.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect()
}
