//! Ratios from dB in single precision that vectorise.

use super::rounding::ROUNDER;

/// log2(10) / 10.
const OCTAVES_PER_DECIBEL: f32 = 0.332_192_8;

/// The ratio of powers that is `decibels` dB, which are taken to be within -300 and 300.
///
/// 10^(dB/10) = 2^n 2^f with f within -1/2 and 1/2; 2^f by the polynomial of degree 5 that is exact at 0 and whose largest relative
/// error is smallest (E. Remez 1934). Relative error at most 2e-7 for the polynomial and 4e-8 for each dB of magnitude (`ratio_is_accurate`): 3e-6 at 60 dB, where one
/// step of the argument is 9e-7.
#[inline(always)]
pub fn ratio(decibels: f32) -> f32 {
    let octaves = decibels.clamp(-300.0, 300.0) * OCTAVES_PER_DECIBEL;
    let shifted = octaves + ROUNDER;
    let x = octaves - (shifted - ROUNDER);
    let mut polynomial = 1.326_473e-3;
    #[allow(
        clippy::approx_constant,
        reason = "of the polynomial, which is not the series of that constant"
    )]
    for coefficient in [9.671_513e-3, 5.550_733_6e-2, 2.402_224_2e-1, 6.931_47e-1, 1.0] {
        polynomial = polynomial * x + coefficient;
    }
    // The lowest bits of the shifted number are the whole number, and become the exponent.
    let scale = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
    polynomial * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratio_is_accurate() {
        for step in -300 * 1024..=300 * 1024 {
            let decibels = step as f32 / 1024.0;
            let exact = libm::exp10(f64::from(decibels) / 10.0);
            let error = (f64::from(ratio(decibels)) / exact - 1.0).abs();
            let bound = 2e-7 + 4e-8 * f64::from(decibels.abs());
            assert!(error <= bound, "ratio of {decibels} dB is {error:e} off");
        }
        assert_eq!(ratio(0.0), 1.0);
        assert!(ratio(f32::INFINITY).is_finite());
    }
}
