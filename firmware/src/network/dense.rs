//! One dense layer: the exact integer specification that every kernel must reproduce bit for bit, on the packed form in
//! which a table holds it.
#![deny(clippy::float_arithmetic)]

use super::activations::Activations;
use super::error::ReadError;
use super::geometry::{BLOCK_COLUMNS, Geometry, MAX_OUTPUTS, MAX_WIDTH, QUAD_ROWS};

/// Largest magnitude of a bias. With at most [`MAX_WIDTH`] products of at most 255 x 128, an accumulator then stays
/// below 2^31.
const MAX_BIAS: i32 = 1 << 30;

/// An even row's accumulator stays in `-EVEN_ROW_LIMIT..EVEN_ROW_LIMIT`: the kernel holds 256 times it in 32 bits.
pub const EVEN_ROW_LIMIT: i32 = 1 << 23;

/// One layer's parameters, read in place from a table. [`crate::table`] describes the bytes.
///
/// # Specification
/// For every row `r`, in 32-bit integers that cannot overflow,
///
/// ```text
/// accumulator = bias[r] + sum over c of weight[r][c] * activation[c]
/// scaled      = (accumulator * multiplier[r] + 2^31) >> 32          (64-bit product, arithmetic shift)
/// hidden      = clamp(scaled, 0, 255)                               (ReLU and saturation)
/// output      = scaled
/// ```
///
/// Input activations are int8, hidden ones 0 to 255. The rounding shift is the Cortex-M4's SMMULR, the clamp its USAT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DenseLayer<'t> {
    geometry: Geometry,
    /// `[rows]` little-endian i32, a quad's together.
    biases: &'t [[u8; 16]],
    /// Quads of rows.
    stream: &'t [u8],
}

impl<'t> DenseLayer<'t> {
    /// Checks a layer's bytes and returns it with the bytes behind it.
    ///
    /// Everything that the kernel takes for granted is checked here: lengths, padding of zeros, sums to start from that
    /// follow from biases and weights, and rows that stay in their range whatever the activations are.
    ///
    /// # Errors
    /// [`ReadError`] names the first field that does not fit.
    pub fn parse(geometry: Geometry, bytes: &'t [u8]) -> Result<(Self, &'t [u8]), ReadError> {
        let most_outputs = if geometry.last { MAX_OUTPUTS } else { MAX_WIDTH };
        for (width, most) in [(geometry.inputs, MAX_WIDTH), (geometry.outputs, most_outputs)] {
            if width == 0 || width > most {
                return Err(ReadError::field("width", width as i32, most as i32));
            }
        }
        let (biases, bytes) = split(bytes, geometry.rows().saturating_mul(4))?;
        let (stream, rest) = split(bytes, geometry.stream_len())?;
        let (biases, _) = biases.as_chunks::<16>();
        let layer = Self {
            geometry,
            biases,
            stream,
        };
        let mut rows_left = geometry.outputs;
        for quad in layer.quads() {
            quad.check(&geometry, rows_left)?;
            rows_left = rows_left.saturating_sub(QUAD_ROWS);
        }
        Ok((layer, rest))
    }

    /// Shape and place.
    pub const fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The quads of rows, for a kernel.
    pub const fn stream(&self) -> &'t [u8] {
        self.stream
    }

    /// Computes a hidden layer's activations, by the specification.
    pub fn hidden(&self, activations: &Activations, next: &mut Activations) {
        let (next, _) = next.0.as_chunks_mut::<QUAD_ROWS>();
        for (next, quad) in next.iter_mut().zip(self.quads()) {
            #[allow(clippy::cast_possible_truncation, reason = "clamped to 0..=255")]
            {
                *next = quad.scaled(activations).map(|scaled| scaled.clamp(0, 255) as i16);
            }
        }
    }

    /// Computes the last layer's outputs, by the specification. Those that the layer does not have are 0.
    pub fn outputs(&self, activations: &Activations) -> [i32; MAX_OUTPUTS] {
        let mut outputs = [0; MAX_OUTPUTS];
        let (quads, _) = outputs.as_chunks_mut::<QUAD_ROWS>();
        for (outputs, quad) in quads.iter_mut().zip(self.quads()) {
            *outputs = quad.scaled(activations);
        }
        outputs
    }

    /// The quads of rows, one after the other.
    pub fn quads(&self) -> impl Iterator<Item = Quad<'t>> + use<'t> {
        let quads = self.stream.chunks_exact(self.geometry.quad_len());
        quads.zip(self.biases).filter_map(|(bytes, biases)| {
            let (start, rest) = bytes.split_first_chunk::<16>()?;
            let (weights, multipliers) = rest.split_last_chunk::<16>()?;
            let (weights, _) = weights.as_chunks::<16>();
            Some(Quad {
                biases,
                start,
                weights,
                multipliers,
            })
        })
    }
}

/// Four rows as they lie in the stream.
#[derive(Clone, Copy, Debug)]
pub struct Quad<'t> {
    /// `[row]` i32.
    biases: &'t [u8; 16],
    /// For each pair of rows: 256 x even bias + odd bias, then the odd bias minus the products of the odd row's own weights.
    start: &'t [u8; 16],
    /// Four columns at a time: the first pair's halfwords, then the second's; each is 256 x even weight + odd weight.
    weights: &'t [[u8; 16]],
    /// `[row]` i32.
    multipliers: &'t [u8; 16],
}

/// The largest halfword: 256 x 127 + 127. Those above would need an even weight of 128.
const MAX_HALFWORD: i16 = 0x7f7f;

/// The weight of a halfword's even row. The halfword is at most [`MAX_HALFWORD`], so the sum does not overflow.
const fn even(halfword: i16) -> i16 {
    halfword.wrapping_add(128) >> 8
}

/// The weight of a halfword's odd row.
const fn odd(halfword: i16) -> i16 {
    halfword as i8 as i16
}

impl<'t> Quad<'t> {
    /// `[row]`.
    pub fn biases(&self) -> [i32; QUAD_ROWS] {
        words(self.biases)
    }

    /// `[row]`, in 2^-32.
    pub fn multipliers(&self) -> [i32; QUAD_ROWS] {
        words(self.multipliers)
    }

    /// The weights of four columns after the other, `[row][column]`, with the padding.
    pub fn weights(&self) -> impl Iterator<Item = [[i16; 4]; QUAD_ROWS]> + use<'t> {
        self.weights.iter().map(|block| {
            let [h_0, h_1, h_2, h_3, h_4, h_5, h_6, h_7] = halfwords(block);
            let (first, second) = ([h_0, h_1, h_2, h_3], [h_4, h_5, h_6, h_7]);
            [first.map(even), first.map(odd), second.map(even), second.map(odd)]
        })
    }

    /// The rows' results by the specification, before any clamp.
    fn scaled(&self, activations: &Activations) -> [i32; QUAD_ROWS] {
        let accumulators = zip_with(self.sums(activations), self.biases(), i32::wrapping_add);
        zip_with(accumulators, self.multipliers(), rescale)
    }

    /// The rows' sums of weight times activation.
    fn sums(&self, activations: &Activations) -> [i32; QUAD_ROWS] {
        let (activations, _) = activations.0.as_chunks::<BLOCK_COLUMNS>();
        let (blocks, _) = self.weights.as_chunks::<2>();
        // Eight columns at a time, with a sum for each, as hosts' vector units multiply.
        let mut sums = [[0_i32; BLOCK_COLUMNS]; QUAD_ROWS];
        for ([left, right], activations) in blocks.iter().zip(activations) {
            // Does nothing, but keeps the compiler from vectorising over blocks instead of inside one, which was measured to
            // take 2.5 times as long on x86-64.
            core::hint::black_box(());
            let ([a_0, a_1, a_2, a_3, b_0, b_1, b_2, b_3], [a_4, a_5, a_6, a_7, b_4, b_5, b_6, b_7]) =
                (halfwords(left), halfwords(right));
            let first = [a_0, a_1, a_2, a_3, a_4, a_5, a_6, a_7];
            let second = [b_0, b_1, b_2, b_3, b_4, b_5, b_6, b_7];
            let rows = [first.map(even), first.map(odd), second.map(even), second.map(odd)];
            for (sums, weights) in sums.iter_mut().zip(rows) {
                for ((sum, weight), &activation) in sums.iter_mut().zip(weights).zip(activations) {
                    *sum = sum.wrapping_add(i32::from(weight).wrapping_mul(i32::from(activation)));
                }
            }
        }
        sums.map(|sums| sums.into_iter().fold(0, i32::wrapping_add))
    }

    /// Checks what the kernel relies on. All rows behind the first `used` are padding.
    fn check(&self, geometry: &Geometry, used: usize) -> Result<(), ReadError> {
        let biases = self.biases();
        let (least, greatest) = geometry.activation_range();
        let mut low = biases;
        let mut high = low;
        let mut own_products = [0_i32; QUAD_ROWS];
        let mut column = 0_usize;
        for block in self.weights {
            if let Some(&halfword) = halfwords(block).iter().find(|&&half| half > MAX_HALFWORD) {
                return Err(ReadError::field(
                    "weight pair",
                    i32::from(halfword),
                    i32::from(MAX_HALFWORD),
                ));
            }
        }
        for rows in self.weights() {
            for (((row, weights), (low, high)), own) in rows
                .iter()
                .enumerate()
                .zip(low.iter_mut().zip(&mut high))
                .zip(&mut own_products)
            {
                for (index, &weight) in weights.iter().enumerate() {
                    let inside = row < used && column.saturating_add(index) < geometry.inputs;
                    if weight != 0 && !inside {
                        return Err(ReadError::field("padding", i32::from(weight), 0));
                    }
                    let ends = [least, greatest].map(|end| i32::from(weight).wrapping_mul(end));
                    let [first, second] = ends;
                    *low = low.saturating_add(first.min(second));
                    *high = high.saturating_add(first.max(second));
                }
                let [w0, w1, w2, w3] = weights.map(i32::from);
                *own = own
                    .wrapping_add(w0.wrapping_mul(w2))
                    .wrapping_add(w1.wrapping_mul(w3));
            }
            column = column.saturating_add(4);
        }
        for (row, (&bias, multiplier)) in biases.iter().zip(self.multipliers()).enumerate() {
            if row >= used && (bias != 0 || multiplier != 0) {
                return Err(ReadError::field("padding", bias | multiplier, 0));
            }
            if bias.unsigned_abs() > MAX_BIAS.unsigned_abs() {
                return Err(ReadError::field("bias", bias, MAX_BIAS));
            }
        }
        let [low_0, _, low_2, _] = low;
        let [high_0, _, high_2, _] = high;
        for (low, high) in [(low_0, high_0), (low_2, high_2)] {
            if low < EVEN_ROW_LIMIT.wrapping_neg() || high >= EVEN_ROW_LIMIT {
                let worst = if high >= EVEN_ROW_LIMIT { high } else { low };
                return Err(ReadError::field("even row sum", worst, EVEN_ROW_LIMIT));
            }
        }
        let [bias_0, bias_1, bias_2, bias_3] = biases;
        let [_, own_1, _, own_3] = own_products;
        let expected = [
            bias_0.wrapping_mul(256).wrapping_add(bias_1),
            bias_1.wrapping_sub(own_1),
            bias_2.wrapping_mul(256).wrapping_add(bias_3),
            bias_3.wrapping_sub(own_3),
        ];
        for (found, expected) in words(self.start).into_iter().zip(expected) {
            if found != expected {
                return Err(ReadError::field("start of sums", found, expected));
            }
        }
        Ok(())
    }
}

/// `accumulator * multiplier / 2^32`, rounded half up.
fn rescale(accumulator: i32, multiplier: i32) -> i32 {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a 64-bit product shifted by 32 fits 32 bits"
    )]
    {
        (scaled_product(i64::from(accumulator), i64::from(multiplier)) >> 32) as i32
    }
}

/// The product of an accumulator and a multiplier, both in the range of i32, plus one half: its upper 32 bits are the rounded result.
/// The simulator calls it for a row of worlds, lane by lane.
#[inline(always)]
pub const fn scaled_product(accumulator: i64, multiplier: i64) -> i64 {
    accumulator.wrapping_mul(multiplier).wrapping_add(1 << 31)
}

fn split(bytes: &[u8], length: usize) -> Result<(&[u8], &[u8]), ReadError> {
    bytes.split_at_checked(length).ok_or(ReadError::Truncated {
        found: bytes.len() as u32,
        expected: length as u32,
    })
}

/// Four little-endian words.
fn words(bytes: &[u8; 16]) -> [i32; 4] {
    let mut words = [0; 4];
    let (chunks, _) = bytes.as_chunks::<4>();
    for (word, bytes) in words.iter_mut().zip(chunks) {
        *word = i32::from_le_bytes(*bytes);
    }
    words
}

/// Eight little-endian halfwords.
fn halfwords(bytes: &[u8; 16]) -> [i16; 8] {
    let mut halfwords = [0; 8];
    let (chunks, _) = bytes.as_chunks::<2>();
    for (halfword, bytes) in halfwords.iter_mut().zip(chunks) {
        *halfword = i16::from_le_bytes(*bytes);
    }
    halfwords
}

fn zip_with<A: Copy, B: Copy, T>(a: [A; 4], b: [B; 4], f: impl Fn(A, B) -> T) -> [T; 4] {
    let ([a_0, a_1, a_2, a_3], [b_0, b_1, b_2, b_3]) = (a, b);
    [f(a_0, b_0), f(a_1, b_1), f(a_2, b_2), f(a_3, b_3)]
}

#[cfg(test)]
mod tests {
    use super::{MAX_HALFWORD, even, odd, rescale};

    #[test]
    fn rescale_rounds_half_up_and_takes_the_extremes() {
        assert_eq!(rescale(1, 1 << 30), 0);
        assert_eq!(rescale(2, 1 << 30), 1); // 0.5 rounds up
        assert_eq!(rescale(-2, 1 << 30), 0); // -0.5 rounds up
        assert_eq!(rescale(-3, 1 << 30), -1);
        assert_eq!(rescale(i32::MIN, i32::MIN), 1 << 30);
        assert_eq!(rescale(i32::MAX, i32::MAX), (1 << 30) - 1);
    }

    #[test]
    fn every_halfword_is_a_pair_of_weights() {
        for halfword in i16::MIN..=MAX_HALFWORD {
            let pair = 256 * i32::from(even(halfword)) + i32::from(odd(halfword));
            assert_eq!(pair, i32::from(halfword));
            assert!(i8::try_from(even(halfword)).is_ok() && i8::try_from(odd(halfword)).is_ok());
        }
    }
}
