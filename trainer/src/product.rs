//! The one matrix product behind every dense layer, forwards and backwards.
//!
//! Each element is one chain of additions in ascending order of the summation index, whatever the vector width: the bits of a
//! product are the same on every machine. That is why this is written here and not taken from a library, whose
//! sums depend on the instruction set found at run time. The instruction set (AVX-512, AVX2 or none) is `pulp`'s choice.

use pulp::{Arch, Simd, WithSimd};

/// Rows of a register tile: 6 x 4 vectors fill 24 of the 32 registers of AVX-512.
const TILE_ROWS: usize = 6;

/// Rows of the tiles below the last whole one: as few as hide what an addition takes.
const LAST_ROWS: usize = 2;

/// Rows of the result that are finished together, so that a strip of the right factor stays in the nearest cache while it is used.
/// More rows of a wide result would lie on more pages than the processor keeps at hand (chosen: the fastest of 24 to 96).
const ROWS_TOGETHER: usize = 8 * TILE_ROWS;

/// Lines of a transposed left factor that are read side by side (chosen: the fastest of 8 to 128 on a core with AVX-512 whose
/// caches others use too).
const SIDE_BY_SIDE: usize = 32;

/// Space for packed factors.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    strips: Vec<f32>,
    edge: Vec<f32>,
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

/// How a term joins its sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// Product and sum are rounded once, together: fast.
    Fused,
    /// The product is rounded, then the sum: the arithmetic of [`crate::network`].
    Each,
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
    /// How terms join their sums.
    pub rounding: Rounding,
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
        match self.rounding {
            Rounding::Fused => widths::<S, true>(simd, self),
            Rounding::Each => widths::<S, false>(simd, self),
        }
    }
}

/// As many sums as registers hold; fewer where the columns fill no more.
#[inline(always)]
fn widths<S: Simd, const FUSED: bool>(simd: S, product: Product<'_>) {
    if product.columns <= S::F32_LANES {
        tiles::<S, 1, FUSED>(simd, product);
    } else if S::F32_LANES < 16 || product.columns <= 2 * S::F32_LANES {
        tiles::<S, 2, FUSED>(simd, product);
    } else {
        tiles::<S, 4, FUSED>(simd, product);
    }
}

/// Packs the right factor so that inner loops read it in order, and visits the tiles.
#[inline(always)]
fn tiles<S: Simd, const VECTORS: usize, const FUSED: bool>(simd: S, product: Product<'_>) {
    let Product {
        left,
        right,
        depth,
        columns,
        start,
        rectify,
        rounding: _,
        result,
        scratch,
    } = product;
    if columns == 0 {
        return;
    }
    let width = VECTORS * S::F32_LANES;
    let rows = result.len() / columns;
    let Scratch { strips, edge } = scratch;
    edge.resize(TILE_ROWS * width, 0.0);
    let strips: &[f32] = match right {
        Factor::Plain(right) if columns == width => &right[..depth * width],
        right => {
            pack_strips(right, depth, columns, width, strips);
            strips
        }
    };
    // The lines of a transposed factor are read side by side, as many as the processor fetches ahead.
    let part = match left {
        Factor::Plain(_) => depth.max(1),
        Factor::Transposed(_) => SIDE_BY_SIDE,
    };
    for first_term in (0..depth.max(1)).step_by(part) {
        let terms = first_term..depth.min(first_term + part);
        for first_row in (0..rows).step_by(ROWS_TOGETHER) {
            let end = rows.min(first_row + ROWS_TOGETHER);
            for (strip, first_column) in (0..columns).step_by(width).enumerate() {
                let strip = &strips[strip * depth * width..][..depth * width];
                let used = width.min(columns - first_column);
                let mut row = first_row;
                while row < end {
                    let tile_rows = match end - row {
                        TILE_ROWS.. => TILE_ROWS,
                        LAST_ROWS.. => LAST_ROWS,
                        _ => 1,
                    };
                    let tile = Tile {
                        left,
                        rows,
                        row,
                        terms: terms.clone(),
                        strip: &strip[terms.start * width..terms.end * width],
                        start: if first_term == 0 { start } else { Start::Add },
                        rectify: rectify && terms.end == depth,
                    };
                    let result = &mut result[row * columns + first_column..];
                    if used == width {
                        tile.compute::<S, VECTORS, FUSED>(simd, tile_rows, result, columns);
                    } else {
                        // A tile that stands out over the edge is computed beside the result.
                        for (beside, line) in edge
                            .chunks_exact_mut(width)
                            .zip(result.chunks(columns))
                            .take(tile_rows)
                        {
                            beside[..used].copy_from_slice(&line[..used]);
                        }
                        tile.compute::<S, VECTORS, FUSED>(simd, tile_rows, edge, width);
                        for (beside, line) in edge
                            .chunks_exact(width)
                            .zip(result.chunks_mut(columns))
                            .take(tile_rows)
                        {
                            line[..used].copy_from_slice(&beside[..used]);
                        }
                    }
                    row += tile_rows;
                }
            }
        }
    }
}

/// `[depth, columns]` as strips of `width` columns, each `[depth, width]`. Columns beyond the matrix stay as they are.
#[inline(always)]
fn pack_strips(right: Factor<'_>, depth: usize, columns: usize, width: usize, strips: &mut Vec<f32>) {
    strips.resize(columns.div_ceil(width) * depth * width, 0.0);
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
#[inline(always)]
pub fn transpose(values: &[f32], columns: usize, result: &mut [f32], length: usize) {
    const BLOCK: usize = 16;
    let rows = values.len() / columns;
    for row in (0..rows).step_by(BLOCK) {
        for column in (0..columns).step_by(BLOCK) {
            if row + BLOCK <= rows && column + BLOCK <= columns {
                let mut block = [[0.0_f32; BLOCK]; BLOCK];
                for (index, line) in block.iter_mut().enumerate() {
                    line.copy_from_slice(&values[(row + index) * columns + column..][..BLOCK]);
                }
                for index in 0..BLOCK {
                    let line = &mut result[(column + index) * length + row..][..BLOCK];
                    for (value, source) in line.iter_mut().zip(&block) {
                        *value = source[index];
                    }
                }
            } else {
                for column in column..columns.min(column + BLOCK) {
                    let line = &mut result[column * length..][..rows];
                    for row in row..rows.min(row + BLOCK) {
                        line[row] = values[row * columns + column];
                    }
                }
            }
        }
    }
}

/// A register tile.
struct Tile<'a> {
    left: Factor<'a>,
    /// Rows of the left factor, and the tile's first.
    rows: usize,
    row: usize,
    /// Terms of the sums that are added.
    terms: std::ops::Range<usize>,
    /// Their part of the right factor, `[terms, width]`.
    strip: &'a [f32],
    start: Start<'a>,
    rectify: bool,
}

impl Tile<'_> {
    /// `result` begins with the tile's first element; its rows are `stride` apart.
    #[inline(always)]
    fn compute<S: Simd, const VECTORS: usize, const FUSED: bool>(
        &self,
        simd: S,
        rows: usize,
        result: &mut [f32],
        stride: usize,
    ) {
        match rows {
            TILE_ROWS => self.compute_rows::<S, TILE_ROWS, VECTORS, FUSED>(simd, result, stride),
            LAST_ROWS => self.compute_rows::<S, LAST_ROWS, VECTORS, FUSED>(simd, result, stride),
            _ => self.compute_rows::<S, 1, VECTORS, FUSED>(simd, result, stride),
        }
    }

    #[inline(always)]
    fn compute_rows<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
        &self,
        simd: S,
        result: &mut [f32],
        stride: usize,
    ) {
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        match self.start {
            Start::Zero => {}
            Start::Rows(values) => {
                let values = &values[self.row..][..ROWS];
                for row in 0..ROWS {
                    sums[row] = [simd.splat_f32s(values[row]); VECTORS];
                }
            }
            Start::Add => {
                for row in 0..ROWS {
                    let (line, _) = S::as_simd_f32s(&result[row * stride..][..VECTORS * S::F32_LANES]);
                    sums[row].copy_from_slice(&line[..VECTORS]);
                }
            }
        }
        let (vectors, _) = S::as_simd_f32s(self.strip);
        let (vectors, _) = vectors.as_chunks::<VECTORS>();
        let mut sums = match self.left {
            Factor::Plain(values) => {
                let depth = vectors.len();
                let mut lines = [values; ROWS];
                for row in 0..ROWS {
                    lines[row] = &values[(self.row + row) * depth..][..depth];
                }
                along_lines::<S, ROWS, VECTORS, FUSED>(simd, sums, vectors, lines)
            }
            Factor::Transposed(values) => {
                let lines = values[self.terms.start * self.rows + self.row..].chunks(self.rows);
                across_lines::<S, ROWS, VECTORS, FUSED>(simd, sums, vectors, lines)
            }
        };
        if self.rectify {
            let zero = simd.splat_f32s(0.0);
            for sum in sums.as_flattened_mut() {
                *sum = simd.max_f32s(*sum, zero);
            }
        }
        for row in 0..ROWS {
            let (line, _) = S::as_mut_simd_f32s(&mut result[row * stride..][..VECTORS * S::F32_LANES]);
            line[..VECTORS].copy_from_slice(&sums[row]);
        }
    }
}

/// The inner loop with a row's factors along a line. Its sums are its own, so that they stay in registers.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "arrays side by side")]
fn along_lines<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    mut sums: [[S::f32s; VECTORS]; ROWS],
    vectors: &[[S::f32s; VECTORS]],
    lines: [&[f32]; ROWS],
) -> [[S::f32s; VECTORS]; ROWS] {
    for (term, vectors) in vectors.iter().enumerate() {
        for row in 0..ROWS {
            add_products::<S, VECTORS, FUSED>(simd, &mut sums[row], vectors, lines[row][term]);
        }
    }
    sums
}

/// The inner loop with a term's factors at the beginning of a line.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "arrays side by side")]
fn across_lines<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    mut sums: [[S::f32s; VECTORS]; ROWS],
    vectors: &[[S::f32s; VECTORS]],
    lines: std::slice::Chunks<'_, f32>,
) -> [[S::f32s; VECTORS]; ROWS] {
    for (vectors, line) in vectors.iter().zip(lines) {
        let line = &line[..ROWS];
        for row in 0..ROWS {
            add_products::<S, VECTORS, FUSED>(simd, &mut sums[row], vectors, line[row]);
        }
    }
    sums
}

#[inline(always)]
fn add_products<S: Simd, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    sums: &mut [S::f32s; VECTORS],
    vectors: &[S::f32s; VECTORS],
    factor: f32,
) {
    let factor = simd.splat_f32s(factor);
    for column in 0..VECTORS {
        sums[column] = if FUSED {
            simd.mul_add_f32s(factor, vectors[column], sums[column])
        } else {
            simd.add_f32s(sums[column], simd.mul_f32s(factor, vectors[column]))
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random::initial;
    use pulp::Scalar;

    /// Odd sizes, so that every tail is met.
    const SIZES: [(usize, usize, usize); 7] = [
        (9, 11, 24),
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
                for rounding in [Rounding::Fused, Rounding::Each] {
                    let expected: Vec<f32> = (0..rows * columns)
                        .map(|place| {
                            let (row, column) = (place / columns, place % columns);
                            let first = [0.0, biases[row], before[place]][form];
                            let sum = (0..depth).fold(first, |sum, p| {
                                let (one, other) = (left[row * depth + p], right[p * columns + column]);
                                match rounding {
                                    Rounding::Fused => libm::fmaf(one, other, sum),
                                    Rounding::Each => sum + one * other,
                                }
                            });
                            sum.max(0.0)
                        })
                        .collect();
                    for (transposed, vectors) in [(false, false), (false, true), (true, false), (true, true)]
                    {
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
                            rounding,
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
                            "{rows} x {depth} x {columns}, {rounding:?}, transposed: {transposed}, vectors: {vectors}"
                        );
                    }
                }
            }
        }
    }
}
