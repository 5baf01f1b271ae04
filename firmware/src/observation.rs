//! A measurement as the actor sees it: home sub-channel first, and encoded as int8. All normalisation lives here, so
//! training, simulation and deployment cannot differ in it.

use crate::form::{ONE_HOT_AGES, ONE_HOT_INPUTS, PAPER_INPUTS, UNIFORM_ONE};
use crate::measurement::Measurement;
use crate::reciprocal::{reciprocal, remainder};
use crate::units::{Age, JoinerProbability, Level, Period, SUB_CHANNELS, SubChannel};

/// Length of the actor's input.
pub const INPUTS: usize = 20;

/// The int8 code of 1.0: inputs are in steps of 1/64 and saturate at -2 and +1.984.
pub const ONE: i8 = 64;

/// Fractions of 65536.
type Fraction = u32;

/// From this level on some sub-channel, a vehicle without success for three periods gives its turn up and joins anew
/// (chosen: 20 dB). It parts two strong vehicles that share a turn, and leaves weak ones theirs.
pub const STRONG: Level = Level::lit("20");

/// What one vehicle knows in one slot, with its home sub-channel first.
///
/// Sub-channel `k` of the arrays is the cell's sub-channel `(home + k) mod 3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    age: Age,
    home: SubChannel,
    period: Period,
    joiner_probability: JoinerProbability,
    gain: [Level; SUB_CHANNELS],
    interference: [Level; SUB_CHANNELS],
}

impl Observation {
    /// The view of a measurement from its vehicle.
    pub fn new(measurement: &Measurement) -> Self {
        let broadcast = measurement.broadcast();
        Self {
            age: measurement.age(),
            home: broadcast.home,
            period: broadcast.period,
            joiner_probability: broadcast.joiner_probability,
            gain: rotated(measurement.gain(), broadcast.home.index()),
            interference: rotated(measurement.interference(), broadcast.home.index()),
        }
    }

    /// The age of information.
    pub const fn age(&self) -> Age {
        self.age
    }

    /// The sub-channel of the vehicle's group.
    pub const fn home(&self) -> SubChannel {
        self.home
    }

    /// The group's period.
    pub const fn period(&self) -> Period {
        self.period
    }

    /// Level at the base station at full power; home first.
    pub const fn gain(&self) -> &[Level; SUB_CHANNELS] {
        &self.gain
    }

    /// Level at the base station at full power on the home sub-channel.
    pub const fn home_gain(&self) -> Level {
        let [home, ..] = self.gain;
        home
    }

    /// Whether it is this vehicle's turn: its age is a multiple of the period.
    pub fn own_turn(&self) -> bool {
        remainder(self.age.slots(), self.period.slots()) == 0
    }

    /// Whether the last success is so long ago that the vehicle's turn is lost: older than seven periods, at least 50 and
    /// at most 98 slots.
    pub fn turn_lost(&self) -> bool {
        turn_lost(self.age, self.period)
    }

    /// Whether the last success is more than three periods ago.
    pub fn overdue(&self) -> bool {
        u32::from(self.age.slots()) > u32::from(self.period.slots()).saturating_mul(3)
    }

    /// Whether some sub-channel is [`STRONG`].
    pub fn strong(&self) -> bool {
        // Not `any`, which stops at the first: the same instructions for all gains.
        self.gain
            .iter()
            .fold(false, |strong, &gain| strong | (gain >= STRONG))
    }

    /// Private randomness without a generator, uniform on 0 to 65536: u = a / (a + b) of the other two sub-channels'
    /// gains, whose fast fading is independent and exponential.
    pub fn private_uniform(&self) -> Fraction {
        let [_, a, b] = self.gain;
        share(i32::from(a.to_bits()).saturating_sub(i32::from(b.to_bits())))
    }

    /// [`Observation::private_uniform`] over the joiner probability, in 1/65536: a joiner should send below 65536, and the value
    /// is then uniform again. Below 65536 the reciprocal costs at most 0.0039 (`tests/observation.rs`).
    pub fn thinned_uniform(&self) -> Fraction {
        let quotient = u64::from(self.private_uniform())
            .wrapping_mul(u64::from(reciprocal(self.joiner_probability.in_256ths())))
            >> 8;
        quotient.min(u64::from(u32::MAX)) as Fraction
    }

    /// The actor's input, in steps of 1/64.
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0-2 | flags: own turn, turn lost, overdue |
    /// | 3 | age in five periods, at most 1 |
    /// | 4 | period in 20 slots |
    /// | 5-7 | (gain in dB / 10 - 3.5) / 2; home first |
    /// | 8-10 | flags: the gain reaches `required_sinr`; home first |
    /// | 11 | flag: some gain is [`STRONG`] |
    /// | 12 | thinned uniform, at most 1.25 |
    /// | 13-16 | flags: thinned uniform below 1/4, 1/2, 3/4, 1 |
    /// | 17-19 | interference in 40 dB; home first |
    pub fn encode(&self, required_sinr: Level) -> [i8; INPUTS] {
        let [gain_0, gain_1, gain_2] = self.gain;
        let [interference_0, interference_1, interference_2] = self.interference;
        let thinned = self.thinned_uniform();
        [
            flag(self.own_turn()),
            flag(self.turn_lost()),
            flag(self.overdue()),
            self.age_in_five_periods(),
            // 64 m / 20 = 3.2 m
            saturate(i32::from(self.period.slots()).wrapping_mul(16) / 5),
            gain_code(gain_0),
            gain_code(gain_1),
            gain_code(gain_2),
            flag(gain_0 >= required_sinr),
            flag(gain_1 >= required_sinr),
            flag(gain_2 >= required_sinr),
            flag(self.strong()),
            // 65536 is 1.0 = 64, so 1.25 is 80.
            saturate(((thinned >> 10) as i32).min(80)),
            flag(thinned < 16384),
            flag(thinned < 32768),
            flag(thinned < 49152),
            flag(thinned < 65536),
            interference_code(interference_0),
            interference_code(interference_1),
            interference_code(interference_2),
        ]
    }

    /// The input of an actor that is to find a phase by itself.
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0-50 | flags: the age is 1, 2, ... 50, at least 51 |
    /// | 51-56 | 5-10 of [`Observation::encode`]: gains and their flags |
    /// | 57-59 | 17-19 of it: interference |
    /// | 60 | private uniform, [`UNIFORM_ONE`] for 1 |
    pub fn encode_age_one_hot(&self, required_sinr: Level) -> [i8; ONE_HOT_INPUTS] {
        let age = usize::from(self.age.slots()).min(ONE_HOT_AGES);
        let uniform = self
            .private_uniform()
            .wrapping_mul(u32::from(UNIFORM_ONE.unsigned_abs()));
        let encoded = self.encode(required_sinr);
        let levels = encoded.iter().skip(5).take(6).chain(encoded.iter().skip(17));
        let rest = levels
            .copied()
            .chain([saturate((uniform.wrapping_add(1 << 15) >> 16) as i32)]);
        let mut inputs = [0; ONE_HOT_INPUTS];
        let (ages, others) = inputs.split_at_mut(ONE_HOT_AGES);
        for (slots, input) in (1..).zip(ages) {
            *input = flag(slots == age);
        }
        for (input, value) in others.iter_mut().zip(rest) {
            *input = value;
        }
        inputs
    }

    /// The paper's state, rounded to the nearest code (or 0.12 of one further off), in the cell's order of sub-channels.
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0-2 | (gain in dB - 35) / 20 |
    /// | 3-5 | interference in 40 dB |
    /// | 6 | age, one code a slot |
    pub fn encode_paper(&self) -> [i8; PAPER_INPUTS] {
        let back = SUB_CHANNELS.saturating_sub(self.home.index());
        let [gain_0, gain_1, gain_2] = rotated(&self.gain, back);
        let [interference_0, interference_1, interference_2] = rotated(&self.interference, back);
        // Half a code more, then rounded down: 64 / 20 codes a dB for gains, 64 / 40 for interference.
        let gain = |level: Level| gain_code(level.saturating_add(HALF_A_GAIN_CODE));
        let interference = |level: Level| interference_code(level.saturating_add(HALF_AN_INTERFERENCE_CODE));
        [
            gain(gain_0),
            gain(gain_1),
            gain(gain_2),
            interference(interference_0),
            interference(interference_1),
            interference(interference_2),
            saturate(i32::from(self.age.slots())),
        ]
    }

    fn age_in_five_periods(&self) -> i8 {
        let periods = u32::from(self.age.slots()).wrapping_mul(reciprocal(u16::from(self.period.slots()))); // in 1/65536
        // 64 / 5 = 12.8 = 819 / 64
        saturate(((periods >> 6).wrapping_mul(819) >> 16).min(64) as i32)
    }
}

/// Whether a vehicle of this age has lost its turn: see [`Observation::turn_lost`].
pub(crate) fn turn_lost(age: Age, period: Period) -> bool {
    age.slots() > turn_lost_after(period)
}

/// The age in slots up to which a vehicle keeps its turn: seven periods, at least 50 and at most 98 slots (chosen; measured
/// best from 5 to 60 vehicles).
pub fn turn_lost_after(period: Period) -> u8 {
    period.slots().saturating_mul(7).clamp(50, 98)
}

/// The values from the one at `first`, at most [`SUB_CHANNELS`], around the end. By indexing, not by cases: the same
/// instructions for every home.
fn rotated(values: &[Level; SUB_CHANNELS], first: usize) -> [Level; SUB_CHANNELS] {
    let [a, b, c] = *values;
    let twice = [a, b, c, a, b, c];
    core::array::from_fn(|offset| {
        let place = first.saturating_add(offset);
        twice.get(place).copied().unwrap_or(a)
    })
}

const fn flag(condition: bool) -> i8 {
    if condition { ONE } else { 0 }
}

fn saturate(value: i32) -> i8 {
    #[allow(clippy::cast_possible_truncation, reason = "clamped to the range of i8")]
    {
        value.clamp(i32::from(i8::MIN), i32::from(i8::MAX)) as i8
    }
}

/// 64 (dB / 10 - 3.5) / 2 = 3.2 dB - 112, rounded down; at most 1.06 steps off.
fn gain_code(gain: Level) -> i8 {
    // 3.2 / 256 = 819 / 65536 to 2e-4
    saturate((i32::from(gain.to_bits()).wrapping_mul(819) >> 16).wrapping_sub(112))
}

/// 64 dB / 40 = 1.6 dB, rounded down.
fn interference_code(interference: Level) -> i8 {
    saturate(i32::from(interference.to_bits()).wrapping_mul(410) >> 16)
}

/// 10 / 64 dB and 20 / 64 dB.
const HALF_A_GAIN_CODE: Level = Level::lit("0.15625");
const HALF_AN_INTERFERENCE_CODE: Level = Level::lit("0.3125");

/// Spacing of [`SHARE`] in 1/256 dB, as a power of two: 0.5 dB.
const SHARE_STEP_BITS: u32 = 7;

/// `SHARE[i]` = 65536 / (1 + 10^(i / 20)): the smaller part of two powers that are i/2 dB apart, up to 40 dB.
static SHARE: [u32; 82] = {
    // 10^(1/20) in 1/2^32.
    const RATIO: u128 = 4_819_032_567;
    let mut table = [0; 82];
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
            table[i] = ((1_u128 << 48) / ((1 << 32) + power)) as u32;
            power = (power * RATIO) >> 32;
            i += 1;
        }
    }
    table
};

/// a / (a + b) in 1/65536 for two powers with a `difference` of a over b in 1/256 dB.
///
/// Measured against f64: at most 1.7e-4 off (`tests/observation.rs`), constant beyond 40 dB.
fn share(difference: i32) -> Fraction {
    let distance = difference.unsigned_abs().min(40 << 8);
    let index = (distance >> SHARE_STEP_BITS) as usize;
    let position = distance & ((1 << SHARE_STEP_BITS) - 1);
    let left = SHARE.get(index).copied().unwrap_or(0);
    let right = SHARE.get(index.saturating_add(1)).copied().unwrap_or(0);
    let smaller = left.wrapping_sub(left.wrapping_sub(right).wrapping_mul(position) >> SHARE_STEP_BITS);
    if difference < 0 {
        smaller
    } else {
        65536_u32.wrapping_sub(smaller)
    }
}
