//! The one matrix product behind every dense layer, forwards and backwards.
//!
//! Each element is one chain of fused multiply-adds in ascending order of the summation index, whatever the vector width: the
//! bits of a product are the same on every machine. That is why this is written here and not taken from a library, whose
//! sums depend on the instruction set found at run time. The instruction set (AVX-512, AVX2 or none) is `pulp`'s choice.

use pulp::{Arch, Simd, WithSimd};

/// Rows of a register tile: 6 x 4 vectors fill 24 of the 32 registers of AVX-512.
const TILE_ROWS: usize = 6;

/// Rows whose part of a transposed left factor is packed together: sixteen tiles, and six whole cache lines.
const PANEL_ROWS: usize = 16 * TILE_ROWS;

/// Space for packed factors.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    strips: Vec<f32>,
    panel: Vec<f32>,
}

/// A factor, row after row.
#[derive(Clone, Copy)]
pub enum Factor<'a> {
    /// The matrix itself.
    Plain(&'a [f32]),
    /// The matrix is the transpose of this one.
    Transposed(&'a [f32]),
}

/// What a product starts from.
#[derive(Clone, Copy)]
pub enum Start<'a> {
    /// Zero.
    Zero,
    /// One value for each row: a layer's biases.
    Rows(&'a [f32]),
    /// What stands in the result.
    Add,
}

/// `result[i][j] = start + sum over p of left(i, p) right[p][j]`.
pub struct Product<'a> {
    /// `[rows, depth]`.
    pub left: Factor<'a>,
    /// `[depth, columns]`.
    pub right: Factor<'a>,
    /// Length of the sums.
    pub depth: usize,
    /// Columns of `right` and of the result.
    pub columns: usize,
    /// Where the sums start.
    pub start: Start<'a>,
    /// Whether negative results become zero.
    pub rectify: bool,
    /// `[rows, columns]`, row after row.
    pub result: &'a mut [f32],
    /// Kept between calls.
    pub scratch: &'a mut Scratch,
}

impl Product<'_> {
    /// Computes the result.
    ///
    /// # Panics
    /// If a factor is shorter than its shape says.
    pub fn compute(self) {
        Arch::new().dispatch(self);
    }
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // As many sums as registers hold; fewer where the columns fill no more.
        if self.columns <= S::F32_LANES {
            tiles::<S, 1>(simd, self);
        } else if S::F32_LANES >= 16 {
            tiles::<S, 4>(simd, self);
        } else {
            tiles::<S, 2>(simd, self);
        }
    }
}

/// Packs the factors so that inner loops read memory in order, and visits the tiles.
#[inline(always)]
fn tiles<S: Simd, const VECTORS: usize>(simd: S, product: Product<'_>) {
    let Product {
        left,
        right,
        depth,
        columns,
        start,
        rectify,
        result,
        scratch,
    } = product;
    if columns == 0 {
        return;
    }
    let width = VECTORS * S::F32_LANES;
    let rows = result.len() / columns;
    let Scratch { strips, panel } = scratch;
    let strips: &[f32] = match right {
        Factor::Plain(right) if columns == width => &right[..depth * width],
        right => {
            strips.clear();
            strips.resize(columns.div_ceil(width) * depth * width, 0.0);
            pack_strips(right, depth, columns, width, strips);
            strips
        }
    };
    for (panel_index, result) in result.chunks_mut(PANEL_ROWS * columns).enumerate() {
        let panel_row = panel_index * PANEL_ROWS;
        let panel_rows = result.len() / columns;
        let left = match left {
            Factor::Plain(values) => Factor::Plain(&values[panel_row * depth..]),
            Factor::Transposed(values) => {
                pack_panel(values, rows, panel_row..panel_row + panel_rows, panel);
                Factor::Transposed(panel)
            }
        };
        let start = match start {
            Start::Rows(values) => Start::Rows(&values[panel_row..]),
            other => other,
        };
        let mut row = 0;
        while row < panel_rows {
            let tile_rows = if row + TILE_ROWS <= panel_rows {
                TILE_ROWS
            } else {
                1
            };
            for (strip, first) in (0..columns).step_by(width).enumerate() {
                let strip = &strips[strip * depth * width..][..depth * width];
                let tile = Tile {
                    left,
                    left_rows: panel_rows,
                    strip,
                    start,
                    rectify,
                    row,
                    columns: first..columns.min(first + width),
                    stride: columns,
                };
                let result = &mut result[row * columns..];
                if tile_rows == TILE_ROWS {
                    tile.compute::<S, TILE_ROWS, VECTORS>(simd, result);
                } else {
                    tile.compute::<S, 1, VECTORS>(simd, result);
                }
            }
            row += tile_rows;
        }
    }
}

/// `[depth, columns]` as strips of `width` columns, each `[depth, width]`. Columns beyond the matrix stay as they are.
fn pack_strips(right: Factor<'_>, depth: usize, columns: usize, width: usize, strips: &mut [f32]) {
    let strips = strips.chunks_exact_mut(depth * width);
    for (strip, first) in strips.zip((0..columns).step_by(width)) {
        let used = width.min(columns - first);
        match right {
            Factor::Plain(right) => {
                for (packed, row) in strip.chunks_exact_mut(width).zip(right.chunks_exact(columns)) {
                    packed[..used].copy_from_slice(&row[first..first + used]);
                }
            }
            Factor::Transposed(right) => {
                transpose(&right[first * depth..][..used * depth], depth, strip, width);
            }
        }
    }
}

/// Writes `[rows][columns]` as `[columns][rows]` into lines of this length, in blocks of a cache line.
pub fn transpose(values: &[f32], columns: usize, result: &mut [f32], length: usize) {
    const BLOCK: usize = 16;
    let rows = values.len() / columns;
    for row_block in (0..rows).step_by(BLOCK) {
        for column_block in (0..columns).step_by(BLOCK) {
            for column in column_block..columns.min(column_block + BLOCK) {
                let line = &mut result[column * length..][..rows];
                for row in row_block..rows.min(row_block + BLOCK) {
                    line[row] = values[row * columns + column];
                }
            }
        }
    }
}

/// These columns of `[depth, rows]`, one row after the other.
fn pack_panel(values: &[f32], rows: usize, part: std::ops::Range<usize>, panel: &mut Vec<f32>) {
    let depth = values.len() / rows;
    panel.resize(depth * part.len(), 0.0);
    let lines = values.chunks_exact(rows).map(|line| &line[part.clone()]);
    if part.len() == PANEL_ROWS {
        // A length that is known when this is compiled spares a call of `memcpy` for every line.
        let (packed, _) = panel.as_chunks_mut::<PANEL_ROWS>();
        for (packed, line) in packed.iter_mut().zip(lines) {
            for (packed, value) in packed.iter_mut().zip(line) {
                *packed = *value;
            }
        }
    } else {
        for (packed, line) in panel.chunks_exact_mut(part.len()).zip(lines) {
            packed.copy_from_slice(line);
        }
    }
}

/// A register tile.
struct Tile<'a> {
    left: Factor<'a>,
    /// Rows of `left`.
    left_rows: usize,
    /// `[depth, width]`.
    strip: &'a [f32],
    start: Start<'a>,
    rectify: bool,
    /// First row within `left`.
    row: usize,
    /// Columns of the result.
    columns: std::ops::Range<usize>,
    /// Length of the result's rows.
    stride: usize,
}

impl Tile<'_> {
    /// `result` begins at the tile's first row.
    #[inline(always)]
    fn compute<S: Simd, const ROWS: usize, const VECTORS: usize>(self, simd: S, result: &mut [f32]) {
        let mut first_sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        match self.start {
            Start::Zero => {}
            Start::Rows(values) => {
                for (sums, &value) in first_sums.iter_mut().zip(&values[self.row..self.row + ROWS]) {
                    *sums = [simd.splat_f32s(value); VECTORS];
                }
            }
            Start::Add => {
                for (index, sums) in first_sums.iter_mut().enumerate() {
                    let line = &result[index * self.stride..][self.columns.clone()];
                    for (sum, values) in sums.iter_mut().zip(line.chunks(S::F32_LANES)) {
                        *sum = simd.partial_load_f32s(values);
                    }
                }
            }
        }
        let (vectors, _) = S::as_simd_f32s(self.strip);
        let (vectors, _) = vectors.as_chunks::<VECTORS>();
        let sums = match self.left {
            Factor::Plain(values) => {
                let depth = vectors.len();
                let lines: [&[f32]; ROWS] =
                    std::array::from_fn(|index| &values[(self.row + index) * depth..][..depth]);
                accumulate(simd, first_sums, vectors, |p| {
                    std::array::from_fn(|index| lines[index][p])
                })
            }
            Factor::Transposed(values) => accumulate(simd, first_sums, vectors, |p| {
                let line = &values[p * self.left_rows + self.row..][..ROWS];
                std::array::from_fn(|index| line[index])
            }),
        };
        let zero = simd.splat_f32s(0.0);
        for (index, sums) in sums.iter().enumerate() {
            let line = &mut result[index * self.stride..][self.columns.clone()];
            for (&sum, values) in sums.iter().zip(line.chunks_mut(S::F32_LANES)) {
                let sum = if self.rectify {
                    simd.max_f32s(sum, zero)
                } else {
                    sum
                };
                simd.partial_store_f32s(values, sum);
            }
        }
    }
}

/// The inner loop. Its sums are its own, so that they stay in registers.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "three arrays side by side")]
fn accumulate<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    start: [[S::f32s; VECTORS]; ROWS],
    vectors: &[[S::f32s; VECTORS]],
    factors: impl Fn(usize) -> [f32; ROWS],
) -> [[S::f32s; VECTORS]; ROWS] {
    let mut sums = start;
    for (p, vectors) in vectors.iter().enumerate() {
        let factors = factors(p);
        for row in 0..ROWS {
            let factor = simd.splat_f32s(factors[row]);
            for column in 0..VECTORS {
                sums[row][column] = simd.mul_add_f32s(factor, vectors[column], sums[row][column]);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random::initial;
    use pulp::Scalar;

    /// Odd sizes, so that every tail is met.
    const SIZES: [(usize, usize, usize); 6] = [
        (1, 1, 1),
        (7, 5, 3),
        (13, 64, 100),
        (50, 33, 65),
        (97, 20, 16),
        (6, 300, 130),
    ];

    /// The transpose of a matrix of so many columns.
    fn turned(values: &[f32], columns: usize) -> Vec<f32> {
        (0..columns)
            .flat_map(|column| values.iter().copied().skip(column).step_by(columns))
            .collect()
    }

    #[test]
    fn every_form_is_the_plain_sum_bit_for_bit_with_and_without_vectors() {
        let mut stream = initial(1, 0);
        let mut numbers = |count: usize| -> Vec<f32> { (0..count).map(|_| stream.normal() as f32).collect() };
        for (rows, depth, columns) in SIZES {
            let (left, right) = (numbers(rows * depth), numbers(depth * columns));
            let (biases, before) = (numbers(rows), numbers(rows * columns));
            let (left_turned, right_turned) = (turned(&left, depth), turned(&right, columns));
            for (form, start) in [Start::Zero, Start::Rows(&biases), Start::Add]
                .into_iter()
                .enumerate()
            {
                let expected: Vec<f32> = (0..rows * columns)
                    .map(|place| {
                        let (row, column) = (place / columns, place % columns);
                        let first = [0.0, biases[row], before[place]][form];
                        let sum = (0..depth).fold(first, |sum, p| {
                            libm::fmaf(left[row * depth + p], right[p * columns + column], sum)
                        });
                        sum.max(0.0)
                    })
                    .collect();
                for transposed in [false, true] {
                    for vectors in [true, false] {
                        let mut result = before.clone();
                        let factor = |plain, turned| {
                            if transposed {
                                Factor::Transposed(turned)
                            } else {
                                Factor::Plain(plain)
                            }
                        };
                        let product = Product {
                            left: factor(&left, &left_turned),
                            right: factor(&right, &right_turned),
                            depth,
                            columns,
                            start,
                            rectify: true,
                            result: &mut result,
                            scratch: &mut Scratch::default(),
                        };
                        if vectors {
                            product.compute();
                        } else {
                            product.with_simd(Scalar::new());
                        }
                        assert!(
                            result == expected,
                            "{rows} x {depth} x {columns}, transposed: {transposed}, vectors: {vectors}"
                        );
                    }
                }
            }
        }
    }
}
