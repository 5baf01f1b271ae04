//! Division by small numbers without a divider: the Cortex-M4's UDIV takes 2 to 12 cycles depending on its operands
//! (Cortex-M4 TRM, table 3-1), a multiplication always one.

/// `RECIPROCAL[n]` is 65536 / n rounded up, for n in 1..=256; entry 0 is unused.
static RECIPROCAL: [u32; 257] = {
    let mut table = [0; 257];
    let mut n = 1;
    while n < table.len() {
        #[allow(
            clippy::indexing_slicing,
            clippy::arithmetic_side_effects,
            reason = "evaluated at compile time"
        )]
        {
            table[n] = 65536_u32.div_ceil(n as u32);
            n += 1;
        }
    }
    table
};

/// 65536 / `n` rounded up, for `n` in 1..=256; 0 outside.
pub(crate) fn reciprocal(n: u16) -> u32 {
    RECIPROCAL.get(usize::from(n)).copied().unwrap_or(0)
}

/// `value mod modulus`, exact for `value * modulus < 65536`.
pub(crate) fn remainder(value: u8, modulus: u8) -> u8 {
    let quotient = u32::from(value).wrapping_mul(reciprocal(u16::from(modulus))) >> 16;
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a remainder is below its u8 modulus"
    )]
    {
        u32::from(value).wrapping_sub(quotient.wrapping_mul(u32::from(modulus))) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::remainder;

    #[test]
    fn remainder_is_exact_for_every_age_and_period() {
        for age in 1..=100_u8 {
            for period in 1..=100_u8 {
                assert_eq!(remainder(age, period), age % period, "{age} mod {period}");
            }
        }
    }
}
