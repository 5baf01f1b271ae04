//! One dense layer: the exact integer specification that every kernel must reproduce bit for bit.
#![deny(clippy::float_arithmetic)]

/// Widest layer a table may have (the paper's actor has 1024 units in its first hidden layer).
pub const MAX_WIDTH: usize = 1024;

/// Largest magnitude of a bias. With at most [`MAX_WIDTH`] products of at most 255 x 128, an accumulator then stays
/// below 2^31.
pub(crate) const MAX_BIAS: i32 = 1 << 30;

/// One layer's parameters, read in place from a table.
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
    /// Row length.
    inputs: usize,
    /// `[outputs]` little-endian i32.
    biases: &'t [[u8; 4]],
    /// `[outputs]` little-endian i32.
    multipliers: &'t [[u8; 4]],
    /// `[outputs][inputs]` i8.
    weights: &'t [u8],
}

impl<'t> DenseLayer<'t> {
    /// A layer over table bytes, which [`crate::table::Table`] has checked against each other.
    pub(crate) const fn new(
        inputs: usize,
        biases: &'t [[u8; 4]],
        multipliers: &'t [[u8; 4]],
        weights: &'t [u8],
    ) -> Self {
        Self {
            inputs,
            biases,
            multipliers,
            weights,
        }
    }

    /// Number of rows.
    pub const fn outputs_len(&self) -> usize {
        self.biases.len()
    }

    /// Row length.
    pub const fn inputs_len(&self) -> usize {
        self.inputs
    }

    /// Computes a hidden layer's activations.
    pub fn hidden(&self, activations: &[i16; MAX_WIDTH], next: &mut [i16; MAX_WIDTH]) {
        for (next, scaled) in next.iter_mut().zip(self.scaled(activations)) {
            #[allow(clippy::cast_possible_truncation, reason = "clamped to 0..=255")]
            {
                *next = scaled.clamp(0, 255) as i16;
            }
        }
    }

    /// Computes the last layer's outputs.
    pub fn outputs(&self, activations: &[i16; MAX_WIDTH], outputs: &mut [i32]) {
        for (output, scaled) in outputs.iter_mut().zip(self.scaled(activations)) {
            *output = scaled;
        }
    }

    fn scaled<'a>(&'a self, activations: &'a [i16; MAX_WIDTH]) -> impl Iterator<Item = i32> + 'a {
        let rows = self.weights.chunks_exact(self.inputs.max(1));
        rows.zip(self.biases)
            .zip(self.multipliers)
            .map(move |((row, bias), multiplier)| {
                let accumulator = row
                    .iter()
                    .zip(activations)
                    .map(|(&weight, &activation)| {
                        i32::from(weight.cast_signed()).wrapping_mul(i32::from(activation))
                    })
                    .fold(i32::from_le_bytes(*bias), i32::wrapping_add);
                rescale(accumulator, i32::from_le_bytes(*multiplier))
            })
    }
}

/// `accumulator * multiplier / 2^32`, rounded half up.
fn rescale(accumulator: i32, multiplier: i32) -> i32 {
    let product = i64::from(accumulator).wrapping_mul(i64::from(multiplier));
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a 64-bit product shifted by 32 fits 32 bits"
    )]
    {
        (product.wrapping_add(1 << 31) >> 32) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::rescale;

    #[test]
    fn rescale_rounds_half_up_and_takes_the_extremes() {
        assert_eq!(rescale(1, 1 << 30), 0);
        assert_eq!(rescale(2, 1 << 30), 1); // 0.5 rounds up
        assert_eq!(rescale(-2, 1 << 30), 0); // -0.5 rounds up
        assert_eq!(rescale(-3, 1 << 30), -1);
        assert_eq!(rescale(i32::MIN, i32::MIN), 1 << 30);
        assert_eq!(rescale(i32::MAX, i32::MAX), (1 << 30) - 1);
    }
}
