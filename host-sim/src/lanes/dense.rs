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

/// What a network's activations lie in while it is computed.
#[derive(Clone, Debug)]
pub struct Activations {
    now: Vec<Row<i32>>,
    next: Vec<Row<i32>>,
}

impl Activations {
    /// Room for layers of up to so many columns and rows.
    pub fn new(widest: usize) -> Self {
        let words = vec![[0; LANES]; widest.div_ceil(2)];
        Self {
            now: words.clone(),
            next: words,
        }
    }
}

impl Vectors {
    /// The rows of a network's last layer before any clamp, as many as there is room for, whole blocks of up to four. `inputs` are each in
    /// the range of i8.
    pub fn infer(
        self,
        layers: &[Dense],
        inputs: &[Row<i32>],
        activations: &mut Activations,
        outputs: &mut [Row<i32>],
    ) {
        self.compute(Inference {
            layers,
            inputs,
            activations,
            outputs,
        });
    }
}

/// All layers in one kernel: choosing the unit, and waiting for vectors that were just stored, takes as long as a small layer.
struct Inference<'a> {
    layers: &'a [Dense],
    inputs: &'a [Row<i32>],
    activations: &'a mut Activations,
    outputs: &'a mut [Row<i32>],
}

impl Kernel for Inference<'_> {
    #[inline(always)]
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize, const TWO: bool>(
        self,
        products: P,
    ) {
        let Activations { now, next } = self.activations;
        let (mut now, mut next) = (&mut now[..], &mut next[..]);
        take_inputs(products, self.inputs, now);
        if let Some((last, hidden)) = self.layers.split_last() {
            for layer in hidden {
                compute_hidden::<P, COLUMNS, PARTS, TWO>(products, layer, now, next);
                std::mem::swap(&mut now, &mut next);
            }
            compute_outputs::<P, COLUMNS, PARTS>(products, last, now, self.outputs);
        }
    }
}

/// A network's inputs as its first layer takes them.
#[inline(always)]
fn take_inputs<P: Products<COLUMNS>, const COLUMNS: usize>(
    products: P,
    inputs: &[Row<i32>],
    words: &mut [Row<i32>],
) {
    let unit = products.unit();
    let offset = unit.splat(OFFSET);
    let (whole, rest) = inputs.as_chunks::<COLUMNS>();
    let mut last = [[0; LANES]; COLUMNS];
    last[..rest.len()].copy_from_slice(rest);
    for (inputs, word) in whole.iter().chain([&last]).zip(words) {
        for part in 0..LANES / P::Unit::WIDTH {
            let mut columns = [offset; COLUMNS];
            for column in 0..COLUMNS {
                columns[column] = unit.add(unit.load(&inputs[column], part), offset);
            }
            unit.store(word, part, products.pack(columns));
        }
    }
}

/// A hidden layer's activations.
#[inline(always)]
fn compute_hidden<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize, const TWO: bool>(
    products: P,
    layer: &Dense,
    now: &[Row<i32>],
    next: &mut [Row<i32>],
) {
    let blocks = P::blocks(layer);
    let pairs = if TWO { blocks.as_chunks::<2>().0 } else { &[] };
    let singles = &blocks[2 * pairs.len()..];
    let (next_pairs, next_singles) = next.split_at_mut((2 * pairs.len()).min(next.len()));
    for ([one, other], [next_one, next_other]) in pairs.iter().zip(next_pairs.as_chunks_mut().0) {
        for first in (0..LANES / P::Unit::WIDTH).step_by(PARTS) {
            let mut sums = start::<P, COLUMNS, PARTS>(products, one);
            let mut others = start::<P, COLUMNS, PARTS>(products, other);
            for ((weights, other_weights), now) in one.weights.iter().zip(&other.weights).zip(now) {
                add_word::<P, COLUMNS, PARTS>(products, &mut sums, weights, now, first);
                add_word::<P, COLUMNS, PARTS>(products, &mut others, other_weights, now, first);
            }
            activate::<P, COLUMNS, PARTS>(products, one, sums, next_one, first);
            activate::<P, COLUMNS, PARTS>(products, other, others, next_other, first);
        }
    }
    for (block, next) in singles.iter().zip(next_singles) {
        for first in (0..LANES / P::Unit::WIDTH).step_by(PARTS) {
            let sums = sum_up::<P, COLUMNS, PARTS>(products, block, now, first);
            activate::<P, COLUMNS, PARTS>(products, block, sums, next, first);
        }
    }
}

/// The last layer's rows.
#[inline(always)]
fn compute_outputs<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    layer: &Dense,
    now: &[Row<i32>],
    outputs: &mut [Row<i32>],
) {
    let outputs = outputs.as_chunks_mut::<COLUMNS>().0;
    for (block, outputs) in P::blocks(layer).iter().zip(outputs) {
        for first in (0..LANES / P::Unit::WIDTH).step_by(PARTS) {
            let sums = sum_up::<P, COLUMNS, PARTS>(products, block, now, first);
            for (output, row) in outputs
                .iter_mut()
                .zip(scale::<P, COLUMNS, PARTS>(products, block, sums))
            {
                for part in 0..PARTS {
                    products.unit().store(output, first + part, row[part]);
                }
            }
        }
    }
}

/// Of a block's rows, in some vectors of each.
type Sums<P, const COLUMNS: usize, const PARTS: usize> =
    [[<<P as Products<COLUMNS>>::Unit as Unit>::Vector; PARTS]; COLUMNS];

/// What a block's sums start from.
#[inline(always)]
fn start<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    block: &Block<COLUMNS>,
) -> Sums<P, COLUMNS, PARTS> {
    let unit = products.unit();
    let mut sums = [[unit.splat(0); PARTS]; COLUMNS];
    for row in 0..COLUMNS {
        sums[row] = [unit.splat(block.starts[row]); PARTS];
    }
    sums
}

/// Adds the products of a word's columns, in the vectors from `first` on.
#[inline(always)]
fn add_word<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    sums: &mut Sums<P, COLUMNS, PARTS>,
    weights: &[i32; COLUMNS],
    now: &Row<i32>,
    first: usize,
) {
    let unit = products.unit();
    for row in 0..COLUMNS {
        let weights = unit.splat(weights[row]);
        for part in 0..PARTS {
            sums[row][part] = products.add_products(sums[row][part], unit.load(now, first + part), weights);
        }
    }
}

/// A block's sums, in the vectors from `first` on.
#[inline(always)]
fn sum_up<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    block: &Block<COLUMNS>,
    now: &[Row<i32>],
    first: usize,
) -> Sums<P, COLUMNS, PARTS> {
    let mut sums = start::<P, COLUMNS, PARTS>(products, block);
    // Two words at a time: the loop itself costs as much as a row.
    let words = block.weights.len().min(now.len());
    let (weights, last_weights) = block.weights[..words].as_chunks::<2>();
    let (now, last) = now[..words].as_chunks::<2>();
    for (weights, now) in weights.iter().zip(now) {
        add_word::<P, COLUMNS, PARTS>(products, &mut sums, &weights[0], &now[0], first);
        add_word::<P, COLUMNS, PARTS>(products, &mut sums, &weights[1], &now[1], first);
    }
    for (weights, now) in last_weights.iter().zip(last) {
        add_word::<P, COLUMNS, PARTS>(products, &mut sums, weights, now, first);
    }
    sums
}

/// A block's rows by the specification, before any clamp.
#[inline(always)]
fn scale<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    block: &Block<COLUMNS>,
    mut sums: Sums<P, COLUMNS, PARTS>,
) -> Sums<P, COLUMNS, PARTS> {
    let unit = products.unit();
    for row in 0..COLUMNS {
        let multipliers = unit.splat(block.multipliers[row]);
        for part in 0..PARTS {
            sums[row][part] = unit.scale(sums[row][part], multipliers);
        }
    }
    sums
}

/// A block's rows as the next layer takes them.
#[inline(always)]
fn activate<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize>(
    products: P,
    block: &Block<COLUMNS>,
    sums: Sums<P, COLUMNS, PARTS>,
    next: &mut Row<i32>,
    first: usize,
) {
    let unit = products.unit();
    let mut multipliers = [unit.splat(0); COLUMNS];
    for row in 0..COLUMNS {
        multipliers[row] = unit.splat(block.multipliers[row]);
    }
    for part in 0..PARTS {
        let mut columns = [sums[0][part]; COLUMNS];
        for column in 0..COLUMNS {
            columns[column] = sums[column][part];
        }
        unit.store(next, first + part, products.scale_and_pack(columns, multipliers));
    }
}

#[cfg(test)]
#[path = "dense_tests.rs"]
mod tests;
