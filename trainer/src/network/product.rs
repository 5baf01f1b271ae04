//! The one matrix product behind every dense layer, forwards and backwards.
//!
//! Each element is one chain of additions in ascending order of the summation index, whatever the vector width: the bits of a
//! product are the same on every machine. That is why this is written here and not taken from a library, whose
//! sums depend on the instruction set found at run time. The instruction set (AVX-512, AVX2 or none) is `pulp`'s choice.
//!
//! Lines of a plain factor that hold nothing but zeros are left out: beside finite numbers they add nothing. So a unit that its
//! rectifier silences for a whole batch costs nothing in the product of the next layer, and in backward runs neither in the product
//! with its weights nor in that of their gradient. Beside NaN or infinity such a line would have made NaN; learners look for those
//! in their parameters ([`crate::laboratory::state::State::check_finite`]).

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

/// Space for packed factors, and for lists of lines.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    strips: Vec<f32>,
    /// Terms whose line of the right factor is not all zeros.
    terms: Vec<usize>,
    /// Rows whose line of the left factor is not all zeros.
    live: Vec<usize>,
    /// The other rows.
    silent: Vec<usize>,
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
    /// The product is rounded, then the sum: the arithmetic that the shipped table was made with.
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

impl<'a> Product<'a> {
    /// The plain product, of which one may change what it starts from and how it ends.
    pub fn new(
        left: Factor<'a>,
        right: Factor<'a>,
        [depth, columns]: [usize; 2],
        rounding: Rounding,
        result: &'a mut [f32],
        scratch: &'a mut Scratch,
    ) -> Self {
        Self {
            left,
            right,
            depth,
            columns,
            start: Start::Zero,
            rectify: false,
            rounding,
            result,
            scratch,
        }
    }

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
        strips::<S, 1, FUSED>(simd, product);
    } else if S::F32_LANES < 16 || product.columns <= 2 * S::F32_LANES {
        strips::<S, 2, FUSED>(simd, product);
    } else {
        strips::<S, 4, FUSED>(simd, product);
    }
}

/// Packs the right factor so that inner loops read it in order, and visits the tiles of all strips.
#[inline(always)]
fn strips<S: Simd, const VECTORS: usize, const FUSED: bool>(simd: S, product: Product<'_>) {
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
    let Scratch {
        strips,
        terms,
        live,
        silent,
    } = scratch;
    terms.clear();
    match right {
        Factor::Plain(right) => terms.extend((0..depth).filter(|&term| !is_zero(right, term, columns))),
        Factor::Transposed(_) => terms.extend(0..depth),
    }
    let strips: &[f32] = match right {
        Factor::Plain(right) if columns == width && terms.len() == depth => &right[..depth * width],
        right => {
            pack_strips(right, depth, terms, columns, width, strips);
            strips
        }
    };
    // The lines of a transposed factor are read side by side, as many as the processor fetches ahead.
    let part = match left {
        Factor::Plain(_) => terms.len().max(1),
        Factor::Transposed(_) => SIDE_BY_SIDE,
    };
    for first_term in (0..terms.len().max(1)).step_by(part) {
        let part = first_term..terms.len().min(first_term + part);
        for first_row in (0..rows).step_by(ROWS_TOGETHER) {
            let together = first_row..rows.min(first_row + ROWS_TOGETHER);
            live.clear();
            silent.clear();
            match left {
                Factor::Plain(left) => {
                    for row in together {
                        let list = if is_zero(left, row, depth) {
                            &mut *silent
                        } else {
                            &mut *live
                        };
                        list.push(row);
                    }
                }
                Factor::Transposed(_) => live.extend(together),
            }
            for (strip, first_column) in (0..columns).step_by(width).enumerate() {
                let packed = &strips[strip * terms.len() * width..];
                let strip = Strip {
                    left,
                    rows,
                    depth,
                    terms: &terms[part.clone()],
                    packed: &packed[part.start * width..part.end * width],
                    start: if first_term == 0 { start } else { Start::Add },
                    rectify: rectify && part.end == terms.len(),
                    columns,
                    first_column,
                };
                strip.compute::<S, VECTORS, FUSED>(simd, live, result);
            }
            for &row in silent.iter() {
                finish_silent(start, rectify, row, &mut result[row * columns..][..columns]);
            }
        }
    }
}

/// Whether a line of a matrix holds nothing but zeros. Looks at as few values as say so.
#[inline(always)]
fn is_zero(matrix: &[f32], line: usize, length: usize) -> bool {
    const TOGETHER: usize = 32;
    let mut parts = matrix[line * length..][..length].chunks(TOGETHER);
    // Without its sign, a zero's bits are zero.
    parts.all(|part| part.iter().fold(0, |bits, value| bits | value.to_bits() << 1) == 0)
}

/// Computes a row of the result to which no term adds anything.
fn finish_silent(start: Start<'_>, rectify: bool, row: usize, line: &mut [f32]) {
    match start {
        Start::Zero => line.fill(0.0),
        Start::Rows(values) => line.fill(values[row]),
        Start::Add => {}
    }
    if rectify {
        line.iter_mut().for_each(|value| *value = rectified(*value));
    }
}

/// A positive value, or 0. Not the maximum: whether that of 0 and -0 is 0 depends on the machine.
#[inline(always)]
pub fn rectified(value: f32) -> f32 {
    if value > 0.0 { value } else { 0.0 }
}

/// These terms of `[depth, columns]` as strips of `width` columns, each `[terms, width]`; of a transposed factor, all terms. Columns
/// beyond the matrix stay as they are, since nothing that is made of them is kept.
#[inline(always)]
fn pack_strips(
    right: Factor<'_>,
    depth: usize,
    terms: &[usize],
    columns: usize,
    width: usize,
    strips: &mut Vec<f32>,
) {
    let length = terms.len() * width;
    strips.resize(columns.div_ceil(width) * length, 0.0);
    let strips = strips.chunks_exact_mut(length.max(1));
    for (strip, first) in strips.zip((0..columns).step_by(width)) {
        let used = width.min(columns - first);
        match right {
            Factor::Plain(right) => {
                for (packed, &term) in strip.chunks_exact_mut(width).zip(terms) {
                    packed[..used].copy_from_slice(&right[term * columns + first..][..used]);
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

/// A strip of the result's columns, and what is added to it.
struct Strip<'a> {
    left: Factor<'a>,
    /// Rows of the left factor.
    rows: usize,
    /// Columns of the left factor.
    depth: usize,
    /// Terms of the sums that are added.
    terms: &'a [usize],
    /// Their part of the right factor, `[terms, width]`.
    packed: &'a [f32],
    start: Start<'a>,
    rectify: bool,
    /// Columns of the result.
    columns: usize,
    first_column: usize,
}

impl Strip<'_> {
    /// Computes the strip in these rows, tile by tile. If the left factor is transposed, the rows follow one another.
    #[inline(always)]
    fn compute<S: Simd, const VECTORS: usize, const FUSED: bool>(
        &self,
        simd: S,
        rows: &[usize],
        result: &mut [f32],
    ) {
        let (tiles, rest) = rows.as_chunks::<TILE_ROWS>();
        let (last, rest) = rest.as_chunks::<LAST_ROWS>();
        for rows in tiles {
            self.tile::<S, TILE_ROWS, VECTORS, FUSED>(simd, rows, result);
        }
        for rows in last {
            self.tile::<S, LAST_ROWS, VECTORS, FUSED>(simd, rows, result);
        }
        for &row in rest {
            self.tile::<S, 1, VECTORS, FUSED>(simd, &[row], result);
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
        &self,
        simd: S,
        rows: &[usize; ROWS],
        result: &mut [f32],
    ) {
        let width = VECTORS * S::F32_LANES;
        let used = width.min(self.columns - self.first_column);
        let first = rows.map(|row| row * self.columns + self.first_column);
        // Vectors that stand out over the edge are cut off.
        let lanes = |vector: usize| used.min(vector * S::F32_LANES)..used.min((vector + 1) * S::F32_LANES);
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        match self.start {
            Start::Zero => {}
            Start::Rows(values) => {
                for row in 0..ROWS {
                    sums[row] = [simd.splat_f32s(values[rows[row]]); VECTORS];
                }
            }
            Start::Add => {
                for row in 0..ROWS {
                    let line = &result[first[row]..][..used];
                    if used == width {
                        let (line, _) = S::as_simd_f32s(line);
                        sums[row].copy_from_slice(&line[..VECTORS]);
                    } else {
                        for vector in 0..VECTORS {
                            sums[row][vector] = simd.partial_load_f32s(&line[lanes(vector)]);
                        }
                    }
                }
            }
        }
        let (vectors, _) = S::as_simd_f32s(self.packed);
        let (vectors, _) = vectors.as_chunks::<VECTORS>();
        let mut sums = match self.left {
            Factor::Plain(values) => {
                let mut lines = [values; ROWS];
                for row in 0..ROWS {
                    lines[row] = &values[rows[row] * self.depth..][..self.depth];
                }
                along_lines::<S, ROWS, VECTORS, FUSED>(simd, sums, vectors, lines, self.terms)
            }
            Factor::Transposed(values) => {
                let lines = Lines {
                    values,
                    length: self.rows,
                    first: rows[0],
                };
                across_lines::<S, ROWS, VECTORS, FUSED>(simd, sums, vectors, lines, self.terms)
            }
        };
        if self.rectify {
            let zero = simd.splat_f32s(0.0);
            for sum in sums.as_flattened_mut() {
                // As `rectified`.
                *sum = simd.select_f32s(simd.greater_than_f32s(*sum, zero), *sum, zero);
            }
        }
        for row in 0..ROWS {
            let line = &mut result[first[row]..][..used];
            if used == width {
                let (line, _) = S::as_mut_simd_f32s(line);
                line[..VECTORS].copy_from_slice(&sums[row]);
            } else {
                for vector in 0..VECTORS {
                    simd.partial_store_f32s(&mut line[lanes(vector)], sums[row][vector]);
                }
            }
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
    terms: &[usize],
) -> [[S::f32s; VECTORS]; ROWS] {
    for (vectors, &term) in vectors.iter().zip(terms) {
        for row in 0..ROWS {
            add_products::<S, VECTORS, FUSED>(simd, &mut sums[row], vectors, lines[row][term]);
        }
    }
    sums
}

/// Parts of a matrix's lines.
struct Lines<'a> {
    values: &'a [f32],
    /// Length of a whole line.
    length: usize,
    /// Where the part begins in each.
    first: usize,
}

/// The inner loop with a term's factors side by side in a line.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "arrays side by side")]
fn across_lines<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    mut sums: [[S::f32s; VECTORS]; ROWS],
    vectors: &[[S::f32s; VECTORS]],
    lines: Lines<'_>,
    terms: &[usize],
) -> [[S::f32s; VECTORS]; ROWS] {
    for (vectors, &term) in vectors.iter().zip(terms) {
        let line = &lines.values[term * lines.length + lines.first..][..ROWS];
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

    /// Which values of the factors are zeros.
    #[derive(Clone, Copy, Debug)]
    enum Zeros {
        None,
        /// Every other row of the left factor, and two of three of the right one.
        SomeLines,
        AllLines,
        /// All of a line but its last value.
        Beginnings,
    }

    /// Also with a scratch that other products have used.
    #[test]
    fn every_form_is_the_plain_sum_bit_for_bit_whatever_the_vectors() {
        let mut scratch = Scratch::default();
        for zeros in [Zeros::None, Zeros::SomeLines, Zeros::AllLines, Zeros::Beginnings] {
            for size in SIZES {
                for rounding in [Rounding::Fused, Rounding::Each] {
                    for rectify in [false, true] {
                        check(zeros, size, rounding, rectify, &mut scratch);
                    }
                }
            }
        }
    }

    fn check(
        zeros: Zeros,
        (rows, depth, columns): (usize, usize, usize),
        rounding: Rounding,
        rectify: bool,
        scratch: &mut Scratch,
    ) {
        let mut stream = initial(1, 0);
        let mut numbers = |count: usize| -> Vec<f32> { (0..count).map(|_| stream.normal() as f32).collect() };
        let (mut left, mut right) = (numbers(rows * depth), numbers(depth * columns));
        for (matrix, length, period) in [(&mut left, depth, 2), (&mut right, columns, 3)] {
            for (index, line) in matrix.chunks_mut(length).enumerate() {
                let count = match zeros {
                    Zeros::SomeLines if !index.is_multiple_of(period) => length,
                    Zeros::AllLines => length,
                    Zeros::Beginnings => length - 1,
                    _ => 0,
                };
                // Both zeros are zeros.
                line[..count].fill(if index % 4 == 1 { -0.0 } else { 0.0 });
            }
        }
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
                        let (one, other) = (left[row * depth + p], right[p * columns + column]);
                        match rounding {
                            Rounding::Fused => libm::fmaf(one, other, sum),
                            Rounding::Each => sum + one * other,
                        }
                    });
                    if rectify { rectified(sum) } else { sum }
                })
                .collect();
            for left in [Factor::Plain(&left), Factor::Transposed(&left_turned)] {
                for right in [Factor::Plain(&right), Factor::Transposed(&right_turned)] {
                    let mut compute = |vectors: &str, run: &dyn Fn(Product<'_>)| {
                        let mut result = before.clone();
                        run(Product {
                            left,
                            right,
                            depth,
                            columns,
                            start,
                            rectify,
                            rounding,
                            result: &mut result,
                            scratch: &mut *scratch,
                        });
                        let transposed = [left, right].map(|factor| matches!(factor, Factor::Transposed(_)));
                        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                        assert!(
                            bits(&result) == bits(&expected),
                            "{rows} x {depth} x {columns}, {rounding:?}, rectify: {rectify}, \
                             transposed: {transposed:?}, zeros: {zeros:?}, vectors: {vectors}"
                        );
                    };
                    compute("widest", &|product| product.compute());
                    compute("none", &|product| product.with_simd(Scalar::new()));
                    #[cfg(target_arch = "x86_64")]
                    if let Some(simd) = pulp::x86::V3::try_new() {
                        compute("AVX2", &|product| Simd::vectorize(simd, product));
                    }
                }
            }
        }
    }
}
