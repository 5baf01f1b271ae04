//! A measurement as the actor sees it: home sub-channel first, and encoded as int8. All normalisation lives here, so
//! training, simulation and deployment cannot differ in it.

mod quantities;

pub use quantities::{INPUTS, ONE, Quantities, STRONG, turn_lost_after};

use crate::measurement::{Broadcast, Measurement};
use crate::reciprocal::reciprocal;
use crate::units::{Age, JoinerProbability, Level, Period, SUB_CHANNELS, SubChannel};
use quantities::{flag, gain_code, interference_code, saturate};

/// Ages that [`Observation::encode_age_one_hot`] tells apart; older ones are alike (chosen: seven periods of twenty vehicles).
pub const ONE_HOT_AGES: usize = 51;

/// Inputs of [`Observation::encode_age_one_hot`].
pub const ONE_HOT_INPUTS: usize = ONE_HOT_AGES + 10;

/// The code that stands there for a private uniform of 1.
pub const UNIFORM_ONE: i8 = i8::MAX;

/// Inputs of [`Observation::encode_paper`].
pub const PAPER_INPUTS: usize = 2 * SUB_CHANNELS + 1;

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

    /// What a vehicle supposes in a slot without a measurement: this level on every sub-channel, and no interference.
    pub(crate) const fn predicted(level: Level, age: Age, broadcast: &Broadcast) -> Self {
        Self {
            age,
            home: broadcast.home,
            period: broadcast.period,
            joiner_probability: broadcast.joiner_probability,
            gain: [level; SUB_CHANNELS],
            interference: [Level::ZERO; SUB_CHANNELS],
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

    /// The same in plain integers: whose turn it is, and what to draw from.
    #[inline(always)]
    pub fn quantities(&self) -> Quantities {
        let period = u16::from(self.period.slots());
        Quantities {
            age: i32::from(self.age.slots()),
            period: i32::from(period),
            period_reciprocal: reciprocal(period),
            turn_lost_after: i32::from(turn_lost_after(self.period)),
            joiner_reciprocal: reciprocal(self.joiner_probability.in_256ths()),
            gain: bits(self.gain),
            interference: bits(self.interference),
        }
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
    /// | 12 | [`Quantities::thinned_uniform`], at most 1.25 |
    /// | 13-16 | flags: thinned uniform below 1/4, 1/2, 3/4, 1 |
    /// | 17-19 | interference in 40 dB; home first |
    pub fn encode(&self, required_sinr: Level) -> [i8; INPUTS] {
        self.quantities()
            .encode(i32::from(required_sinr.to_bits()))
            .map(|input| input as i8)
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
    /// | 60 | [`Quantities::private_uniform`], [`UNIFORM_ONE`] for 1 |
    pub fn encode_age_one_hot(&self, required_sinr: Level) -> [i8; ONE_HOT_INPUTS] {
        let age = usize::from(self.age.slots()).min(ONE_HOT_AGES);
        let uniform = self
            .quantities()
            .private_uniform()
            .wrapping_mul(i32::from(UNIFORM_ONE));
        let encoded = self.encode(required_sinr);
        let levels = encoded.iter().skip(5).take(6).chain(encoded.iter().skip(17));
        let rest = levels
            .copied()
            .chain([saturate(uniform.wrapping_add(1 << 15) >> 16) as i8]);
        let mut inputs = [0; ONE_HOT_INPUTS];
        let (ages, others) = inputs.split_at_mut(ONE_HOT_AGES);
        for (slots, input) in (1..).zip(ages) {
            *input = flag(slots == age) as i8;
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
        let [gain_0, gain_1, gain_2] = bits(rotated(&self.gain, back));
        let [interference_0, interference_1, interference_2] = bits(rotated(&self.interference, back));
        // Half a code more, then rounded down.
        let gain = |level: i32| gain_code(level.wrapping_add(HALF_A_GAIN_CODE));
        let interference = |level: i32| interference_code(level.wrapping_add(HALF_AN_INTERFERENCE_CODE));
        [
            gain(gain_0),
            gain(gain_1),
            gain(gain_2),
            interference(interference_0),
            interference(interference_1),
            interference(interference_2),
            saturate(i32::from(self.age.slots())),
        ]
        .map(|input| input as i8)
    }
}

/// Half a code of a gain and of an interference, 10/64 dB and 20/64 dB, in 1/256 dB.
const HALF_A_GAIN_CODE: i32 = 40;
const HALF_AN_INTERFERENCE_CODE: i32 = 80;

/// Levels in 1/256 dB.
#[inline(always)]
fn bits(levels: [Level; SUB_CHANNELS]) -> [i32; SUB_CHANNELS] {
    levels.map(|level| i32::from(level.to_bits()))
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
