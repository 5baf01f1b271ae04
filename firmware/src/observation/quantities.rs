//! The arithmetic of an observation: each formula once, on plain integers. [`Observation`](super::Observation) calls it for
//! its vehicle, the simulator for a row of worlds, lane by lane; so nothing here branches on a value.

use crate::units::{Level, Period, SUB_CHANNELS};

/// Length of the actor's input.
pub const INPUTS: usize = 20;

/// The int8 code of 1.0: inputs are in steps of 1/64 and saturate at -2 and +1.984.
pub const ONE: i8 = 64;

/// From this level on some sub-channel, a vehicle without success for three periods gives its turn up and joins anew
/// (chosen: 20 dB). It parts two strong vehicles that share a turn, and leaves weak ones theirs.
pub const STRONG: Level = Level::lit("20");

/// What one vehicle knows in one slot, in plain integers, with the reciprocals that stand for divisions. Levels are in
/// 1/256 dB, home first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantities {
    /// The age of information in slots, 1 to 100.
    pub age: i32,
    /// The group's period in slots, 1 to 100.
    pub period: i32,
    /// [`reciprocal`](crate::reciprocal::reciprocal) of the period.
    pub period_reciprocal: i32,
    /// [`turn_lost_after`] of the period.
    pub turn_lost_after: i32,
    /// [`reciprocal`](crate::reciprocal::reciprocal) of the joiner probability in 256ths.
    pub joiner_reciprocal: i32,
    /// Levels at the base station at full power.
    pub gain: [i32; SUB_CHANNELS],
    /// Noise plus interference over noise in the slot before.
    pub interference: [i32; SUB_CHANNELS],
}

impl Quantities {
    /// The age in periods, in 1/65536: less than 1/655 too large, so its whole periods are exact.
    const fn periods(&self) -> i32 {
        self.age.wrapping_mul(self.period_reciprocal)
    }

    /// Whether the age is a multiple of the period.
    #[inline(always)]
    pub const fn own_turn(&self) -> bool {
        self.age == (self.periods() >> 16).wrapping_mul(self.period)
    }

    /// Whether the last success is so long ago that the vehicle's turn is lost.
    #[inline(always)]
    pub const fn turn_lost(&self) -> bool {
        self.age > self.turn_lost_after
    }

    /// Whether the last success is more than three periods ago.
    #[inline(always)]
    pub const fn overdue(&self) -> bool {
        self.age > self.period.wrapping_mul(3)
    }

    /// Whether some sub-channel is [`STRONG`].
    #[inline(always)]
    pub const fn strong(&self) -> bool {
        let [a, b, c] = self.gain;
        let strong = STRONG.to_bits() as i32;
        (a >= strong) | (b >= strong) | (c >= strong)
    }

    /// Private randomness without a generator, uniform on 0 to 65536: u = a / (a + b) of the two foreign sub-channels'
    /// gains, whose fast fading is independent and exponential.
    #[inline(always)]
    pub fn private_uniform(&self) -> i32 {
        let [_, a, b] = self.gain;
        share(a, b)
    }

    /// [`Quantities::private_uniform`] over the joiner probability, in 1/65536, at most 2^24: a joiner should send below 65536, and
    /// the value is then uniform again. Below 65536 the reciprocal costs at most 0.0039 (`tests/observation.rs`).
    #[inline(always)]
    pub fn thinned_uniform(&self) -> i32 {
        // No share is a whole, so the product stays below 2^32.
        const _: () = assert!(matches!(SHARES.last(), Some(entry) if *entry & 0xffff > 0));
        let product = (self.private_uniform() as u32).wrapping_mul(self.joiner_reciprocal as u32);
        (product >> 8) as i32
    }

    /// The actor's input in steps of 1/64, each in the range of i8; for its shape see
    /// [`Observation::encode`](super::Observation::encode). `required_sinr` is in 1/256 dB.
    #[inline(always)]
    pub fn encode(&self, required_sinr: i32) -> [i32; INPUTS] {
        let [gain_0, gain_1, gain_2] = self.gain;
        let [interference_0, interference_1, interference_2] = self.interference;
        let thinned = self.thinned_uniform();
        [
            flag(self.own_turn()),
            flag(self.turn_lost()),
            flag(self.overdue()),
            ((self.periods() >> 6).wrapping_mul(AGE_CODES) >> 16).min(i32::from(ONE)),
            // 64 / 20 = 16 / 5 codes a slot
            saturate(self.period.wrapping_mul(16) / 5),
            gain_code(gain_0),
            gain_code(gain_1),
            gain_code(gain_2),
            flag(gain_0 >= required_sinr),
            flag(gain_1 >= required_sinr),
            flag(gain_2 >= required_sinr),
            flag(self.strong()),
            // 65536 is 1.0 = 64.
            (thinned >> 10).min(LARGEST_THINNED),
            flag(thinned < QUARTER),
            flag(thinned < 2 * QUARTER),
            flag(thinned < 3 * QUARTER),
            flag(thinned < 4 * QUARTER),
            interference_code(interference_0),
            interference_code(interference_1),
            interference_code(interference_2),
        ]
    }
}

/// The age in slots up to which a vehicle keeps its turn: seven periods, at least 50 and at most 98 slots (chosen; measured
/// best from 5 to 60 vehicles).
pub fn turn_lost_after(period: Period) -> u8 {
    period.slots().saturating_mul(7).clamp(50, 98)
}

/// Codes of an age a period, in 1/64: 64 / 5 = 12.8.
const AGE_CODES: i32 = 819;

/// Codes of a gain in 1/256 dB, in 1/65536: 64 / 20 a dB, to 2e-4.
const GAIN_CODES: i32 = 819;

/// What the gain's code is at 0 dB, below 0: 64 x 3.5 / 2.
const GAIN_OFFSET: i32 = 112;

/// Codes of an interference in 1/256 dB, in 1/65536: 64 / 40 a dB, to 1e-3.
const INTERFERENCE_CODES: i32 = 410;

/// Code of the largest thinned uniform that is told from larger ones: 1.25.
const LARGEST_THINNED: i32 = 80;

/// A quarter, in 1/65536: below so many of them a joiner sends at the first, second, third or fourth level.
const QUARTER: i32 = 1 << 14;

/// The input for a yes or a no.
#[inline(always)]
pub(super) const fn flag(condition: bool) -> i32 {
    // No branch: `bool as i32` is 0 or 1.
    (condition as i32).wrapping_mul(ONE as i32)
}

/// The nearest number in the range of i8.
#[inline(always)]
pub(super) fn saturate(value: i32) -> i32 {
    value.clamp(i32::from(i8::MIN), i32::from(i8::MAX))
}

/// Code of a gain in 1/256 dB: 64 (dB / 10 - 3.5) / 2 = 3.2 dB - 112, rounded down; at most 1.06 steps off.
#[inline(always)]
pub(super) fn gain_code(gain: i32) -> i32 {
    saturate((gain.wrapping_mul(GAIN_CODES) >> 16).wrapping_sub(GAIN_OFFSET))
}

/// Code of an interference in 1/256 dB: 64 dB / 40 = 1.6 dB, rounded down.
#[inline(always)]
pub(super) fn interference_code(interference: i32) -> i32 {
    saturate(interference.wrapping_mul(INTERFERENCE_CODES) >> 16)
}

/// Difference of two levels from which their share is constant, in 1/256 dB: 40 dB.
const SHARE_RANGE: u32 = 40 << 8;

/// Spacing of [`SHARES`] in 1/256 dB, as a power of two: 0.5 dB.
const SHARE_STEP_BITS: u32 = 7;

/// In the lower half of entry `i` 65536 / (1 + 10^(i / 20)), the smaller part of two powers that are i/2 dB apart; in the
/// upper half what it loses in the next half dB.
static SHARES: [u32; (SHARE_RANGE >> SHARE_STEP_BITS) as usize + 1] = {
    // 10^(1/20) in 1/2^32.
    const RATIO: u128 = 4_819_032_567;
    let mut table = [0; (SHARE_RANGE >> SHARE_STEP_BITS) as usize + 1];
    let mut power: u128 = 1 << 32;
    let mut i = 0;
    while i < table.len() {
        #[allow(
            clippy::indexing_slicing,
            clippy::arithmetic_side_effects,
            clippy::cast_possible_truncation,
            reason = "evaluated at compile time"
        )]
        {
            let part = ((1_u128 << 48) / ((1 << 32) + power)) as u32;
            power = (power * RATIO) >> 32;
            let next = ((1_u128 << 48) / ((1 << 32) + power)) as u32;
            table[i] = part | ((part - next) << 16);
            i += 1;
        }
    }
    table
};

/// a / (a + b) in 1/65536 for two powers of levels `a` and `b` in 1/256 dB.
///
/// Measured against f64: at most 1.7e-4 off (`tests/observation.rs`), constant beyond 40 dB.
#[inline(always)]
fn share(a: i32, b: i32) -> i32 {
    let distance = a.abs_diff(b).min(SHARE_RANGE);
    let entry = SHARES
        .get((distance >> SHARE_STEP_BITS) as usize)
        .copied()
        .unwrap_or(0);
    let position = distance & ((1 << SHARE_STEP_BITS) - 1);
    let loss = (entry >> 16).wrapping_mul(position) >> SHARE_STEP_BITS;
    let smaller = (entry & 0xffff).wrapping_sub(loss) as i32;
    if a < b {
        smaller
    } else {
        65_536_i32.wrapping_sub(smaller)
    }
}
