//! Whole numbers from single precision without a conversion, whose results out of range differ between machines.

/// Adding it to a number below 2^22 in magnitude rounds that to the nearest whole number, ties to even, and leaves this in the
/// lowest bits: 1.5 x 2^23.
pub(super) const ROUNDER: f32 = 12_582_912.0;

/// The largest whole number that is not above `x`, for magnitudes below 2^22.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    let shifted = x + ROUNDER;
    let nearest = shifted.to_bits() as i32 - ROUNDER.to_bits() as i32;
    nearest - i32::from(shifted - ROUNDER > x)
}

#[cfg(test)]
mod tests {
    use super::floor;

    #[test]
    fn floor_is_floor() {
        for step in -300_000..=300_000 {
            let x = step as f32 / 8.0;
            for x in [x, x.next_up(), x.next_down()] {
                assert_eq!(floor(x), libm::floor(f64::from(x)) as i32, "{x}");
            }
        }
    }
}
