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
pub fn reciprocal(n: u16) -> i32 {
    RECIPROCAL.get(usize::from(n)).copied().unwrap_or(0)
}
