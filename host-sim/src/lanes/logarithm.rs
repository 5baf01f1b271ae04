//! Logarithms of single precision that vectorise.

/// 10 / ln 10.
const DECIBELS_PER_NEPER: f32 = 4.342_945;

/// Natural logarithm of a positive normal number.
///
/// Method and coefficients are those of Cephes' `logf` (S. Moshier 1989): the argument is brought to 1/sqrt 2 .. sqrt 2 and a
/// polynomial taken of what it exceeds 1 by. Error at most 2 units in the last place (`ln_is_accurate` compares with f64 over
/// every significand); exactly 0 at 1. Means nothing for zeros, subnormal or negative numbers, infinities and NaN.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    // Subtracting the bits of 1/sqrt 2 makes the exponent count from there.
    const ROOT_HALF: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(ROOT_HALF);
    let exponent = ((shifted as i32) >> 23) as f32;
    let x = f32::from_bits((shifted & 0x007f_ffff).wrapping_add(ROOT_HALF)) - 1.0;
    let square = x * x;
    let mut polynomial = 7.037_683_6e-2;
    for coefficient in [
        -1.151_461e-1,
        1.167_699_9e-1,
        -1.242_014_1e-1,
        1.424_932_3e-1,
        -1.666_805_8e-1,
        2.000_071_5e-1,
        -2.499_999_4e-1,
        3.333_333e-1,
    ] {
        polynomial = polynomial * x + coefficient;
    }
    // ln 2 in two parts, the first exact in every product.
    let tail = polynomial * x * square + exponent * -2.121_944_4e-4 - 0.5 * square;
    exponent * 0.693_359_4 + (x + tail)
}

/// A positive normal ratio of powers in dB.
#[inline(always)]
pub fn decibels(ratio: f32) -> f32 {
    DECIBELS_PER_NEPER * ln(ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ln_is_accurate() {
        // Every significand around 1, where the result is small, and of three far exponents; every exponent besides.
        let significands = (0..1 << 23).flat_map(|bits| {
            [1_u32, 126, 127, 128, 254].map(|exponent| f32::from_bits(exponent << 23 | bits))
        });
        let exponents = (1..255)
            .flat_map(|exponent| (0..1024).map(move |bits| f32::from_bits(exponent << 23 | bits << 13)));
        for x in significands.chain(exponents) {
            let exact = libm::log(f64::from(x));
            let unit = f64::from((exact as f32).abs().next_up()) - f64::from((exact as f32).abs());
            let error = (f64::from(ln(x)) - exact).abs() / unit;
            assert!(error <= 2.0, "ln {x:e} is {error} units off");
        }
        assert_eq!(ln(1.0), 0.0);
    }
}
