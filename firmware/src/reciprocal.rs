//! Division by small numbers without a divider: the Cortex-M4's UDIV takes 2 to 12 cycles depending on its operands
//! (Cortex-M4 TRM, table 3-1), a multiplication always one.

/// `RECIPROCAL[n]` is 65536 / n rounded up, for n in 1..=256; entry 0 is unused.
static RECIPROCAL: [i32; 257] = {
    let mut table = [0; 257];
    let mut n = 1;
    while n < table.len() {
        #[allow(
            clippy::indexing_slicing,
            clippy::arithmetic_side_effects,
            reason = "evaluated at compile time"
        )]
        {
            table[n] = 65_536_u32.div_ceil(n as u32) as i32;
            n += 1;
        }
    }
    table
};

/// 65536 / `n` rounded up, for `n` in 1..=256; 0 outside.
#[inline(always)]
pub fn reciprocal(n: u16) -> i32 {
    RECIPROCAL.get(usize::from(n)).copied().unwrap_or(0)
}

/// 2^24 over a number of places: exact to 2^-16 up to 256, and 1/16 too large from there on. The same instructions for every number.
#[inline(always)]
pub fn places_reciprocal(places: u16) -> i32 {
    // Two selections and one look-up, and no branch.
    let exact = places <= 256;
    let number = if exact { places } else { places >> 4 };
    let shift = if exact { 8 } else { 4 };
    reciprocal(number) << shift
}
