//! Dense layers of small integers for rows of worlds: the integers of [`firmware::network::DenseLayer`], one lane a world.
//!
//! Activations lie as [`Products`] multiplies them, two or four columns in a lane. All are 0 to 255: a layer's inputs, which
//! have a sign, are taken 128 larger, and what its sums start from makes up for it.

use super::units::{Kernel, Products, Unit};
use super::{LANES, Row, Vectors};

/// How much larger than they are a network's inputs are taken.
const OFFSET: i32 = 128;

/// One row of a layer.
#[derive(Clone, Debug, Default)]
pub struct DenseRow {
    /// What its sum starts from.
    pub bias: i32,
    /// By what it is multiplied, in 1/2^32.
    pub multiplier: i32,
    /// By column, each in the range of i8.
    pub weights: Vec<i32>,
}

/// A dense layer.
#[derive(Clone, Debug)]
pub struct Dense {
    rows: usize,
    /// For products of two columns.
    pub(super) pairs: Vec<Block<2>>,
    /// For products of four.
    #[allow(dead_code, reason = "some architectures have none")]
    pub(super) bytes: Vec<Block<4>>,
}

/// Some rows of it.
#[derive(Clone, Debug)]
pub struct Block<const COLUMNS: usize> {
    /// What the sums start from.
    starts: [i32; COLUMNS],
    multipliers: [i32; COLUMNS],
    /// `[columns of a lane][row]`.
    weights: Vec<[i32; COLUMNS]>,
}

impl Dense {
    /// The first layer of a network takes its inputs.
    pub fn new(rows: &[DenseRow], is_first: bool) -> Self {
        let offset = if is_first { OFFSET } else { 0 };
        Self {
            rows: rows.len(),
            pairs: rows.chunks(2).map(|rows| Block::new(rows, offset)).collect(),
            bytes: rows
                .chunks(4)
                .map(|rows| Block::new(rows, offset - BYTES_BELOW))
                .collect(),
        }
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.rows
    }
}

/// How much smaller than they are activations lie in bytes: some instructions take bytes with a sign.
pub const BYTES_BELOW: i32 = if cfg!(target_arch = "aarch64") { 128 } else { 0 };

impl<const COLUMNS: usize> Block<COLUMNS> {
    /// At most so many rows, for activations that are `offset` larger than they mean.
    fn new(rows: &[DenseRow], offset: i32) -> Self {
        let nothing = DenseRow::default();
        let rows: [&DenseRow; COLUMNS] = std::array::from_fn(|row| rows.get(row).unwrap_or(&nothing));
        let bits = 32 / COLUMNS;
        let words = rows[0].weights.len().div_ceil(COLUMNS);
        let word = |row: &DenseRow, first: usize| {
            let weights = row.weights.iter().skip(first).take(COLUMNS).enumerate();
            weights.fold(0, |word, (column, weight)| {
                word | (weight & ((1 << bits) - 1)) << (column * bits)
            })
        };
        Self {
            starts: rows.map(|row| {
                let sum: i32 = row.weights.iter().sum();
                row.bias.wrapping_sub(sum * offset)
            }),
            multipliers: rows.map(|row| row.multiplier),
            weights: (0..words)
                .map(|index| rows.map(|row| word(row, index * COLUMNS)))
                .collect(),
        }
    }
}

impl Vectors {
    /// A network's inputs, each in the range of i8, as its first layer takes them; `words` has room for half as many.
    pub fn take_inputs(self, inputs: &[Row<i32>], words: &mut [Row<i32>]) {
        self.compute(Inputs { inputs, words });
    }

    /// A hidden layer's activations; `next` has room for half as many as it has rows.
    pub fn hidden(self, layer: &Dense, now: &[Row<i32>], next: &mut [Row<i32>]) {
        self.compute(Hidden { layer, now, next });
    }

    /// The last layer's rows before any clamp, as many as there is room for, whole blocks of up to four.
    pub fn outputs(self, layer: &Dense, now: &[Row<i32>], outputs: &mut [Row<i32>]) {
        self.compute(Outputs { layer, now, outputs });
    }
}

struct Inputs<'a> {
    inputs: &'a [Row<i32>],
    words: &'a mut [Row<i32>],
}

impl Kernel for Inputs<'_> {
    #[inline(always)]
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(self, products: P) {
        let unit = products.unit();
        let offset = unit.splat(OFFSET);
        let (whole, rest) = self.inputs.as_chunks::<COLUMNS>();
        let mut last = [[0; LANES]; COLUMNS];
        last[..rest.len()].copy_from_slice(rest);
        for (inputs, word) in whole.iter().chain([&last]).zip(self.words) {
            for part in 0..LANES / P::Unit::WIDTH {
                let mut columns = [offset; COLUMNS];
                for column in 0..COLUMNS {
                    columns[column] = unit.add(unit.load(&inputs[column], part), offset);
                }
                unit.store(word, part, products.pack(columns));
            }
        }
    }
}

struct Hidden<'a> {
    layer: &'a Dense,
    now: &'a [Row<i32>],
    next: &'a mut [Row<i32>],
}

impl Kernel for Hidden<'_> {
    #[inline(always)]
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(self, products: P) {
        for (block, next) in P::blocks(self.layer).iter().zip(self.next) {
            for first in (0..LANES / P::Unit::WIDTH).step_by(PARTS) {
                let rows = scaled::<P, COLUMNS, PARTS>(products, block, self.now, first);
                for part in 0..PARTS {
                    let mut columns = [rows[0][part]; COLUMNS];
                    for column in 0..COLUMNS {
                        columns[column] = rows[column][part];
                    }
                    products.unit().store(next, first + part, products.pack(columns));
                }
            }
        }
    }
}

struct Outputs<'a> {
    layer: &'a Dense,
    now: &'a [Row<i32>],
    outputs: &'a mut [Row<i32>],
}

impl Kernel for Outputs<'_> {
    #[inline(always)]
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(self, products: P) {
        let outputs = self.outputs.as_chunks_mut::<COLUMNS>().0;
        for (block, outputs) in P::blocks(self.layer).iter().zip(outputs) {
            for first in (0..LANES / P::Unit::WIDTH).step_by(PARTS) {
                let rows = scaled::<P, COLUMNS, PARTS>(products, block, self.now, first);
                for (output, row) in outputs.iter_mut().zip(rows) {
                    for part in 0..PARTS {
                        products.unit().store(output, first + part, row[part]);
                    }
                }
            }
        }
    }
}

/// A block's rows by the specification, before any clamp, in the vectors from `first` on.
#[inline(always)]
fn scaled<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    block: &Block<COLUMNS>,
    now: &[Row<i32>],
    first: usize,
) -> [[<P::Unit as Unit>::Vector; PARTS]; COLUMNS] {
    let unit = products.unit();
    let mut sums = [[unit.splat(0); PARTS]; COLUMNS];
    for row in 0..COLUMNS {
        sums[row] = [unit.splat(block.starts[row]); PARTS];
    }
    for (weights, now) in block.weights.iter().zip(now) {
        for row in 0..COLUMNS {
            let weights = unit.splat(weights[row]);
            for part in 0..PARTS {
                let activations = unit.load(now, first + part);
                sums[row][part] = products.add_products(sums[row][part], activations, weights);
            }
        }
    }
    for row in 0..COLUMNS {
        let multipliers = unit.splat(block.multipliers[row]);
        for part in 0..PARTS {
            sums[row][part] = unit.scale(sums[row][part], multipliers);
        }
    }
    sums
}

#[cfg(test)]
#[path = "dense_tests.rs"]
mod tests;
