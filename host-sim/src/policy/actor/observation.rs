//! Observations of a row of worlds at a time, encoded as [`firmware::observation::Observation::encode`] encodes one.
//!
//! The formulas are the firmware's, lane by lane; what it keeps in tables it is asked for once. The tests go through all
//! ages, periods, differences of gains and joiner probabilities.

use crate::lanes::{LANES, Row, pair};
use crate::senses::{Broadcasts, Senses};
use firmware::measurement::{Broadcast, Measurement};
use firmware::observation::{INPUTS, ONE, Observation, STRONG};
use firmware::units::{JoinerProbability, Level, Period, SUB_CHANNELS, SlotIndex, SubChannel};

/// Difference of two levels from which their share is constant, in 1/256 dB (40 dB).
const SHARE_RANGE: i32 = 40 << 8;

/// Spacing of the firmware's table of shares in 1/256 dB, as a power of two: 0.5 dB. Between its entries the share is a line.
const SHARE_STEP_BITS: u32 = 7;

/// Length of the table of shares: the power of two that holds all differences.
const SHARES: usize = 128;

const _: () = assert!((SHARE_RANGE >> SHARE_STEP_BITS) < SHARES as i32);

/// What the vehicles of every group hear, in every world of a block. `[group][world]`.
#[derive(Clone, Debug)]
struct Groups {
    period: [Row<i32>; SUB_CHANNELS],
    /// 65536 over the period, rounded up.
    period_reciprocal: [Row<i32>; SUB_CHANNELS],
    /// 65536 over the joiner probability in 256ths, rounded up.
    joiner_reciprocal: [Row<i32>; SUB_CHANNELS],
}

/// What one vehicle knows in every world of a block: many [`Observation`]s, with the home sub-channel first.
#[derive(Clone, Debug)]
pub struct View {
    /// Index of the home sub-channel; none of theirs in a lane without a world.
    pub home: Row<i32>,
    /// Levels in 1/256 dB.
    pub gain: [Row<i32>; SUB_CHANNELS],
    interference: [Row<i32>; SUB_CHANNELS],
    age: Row<i32>,
    turn_lost_after: Row<i32>,
    period: Row<i32>,
    period_reciprocal: Row<i32>,
    joiner_reciprocal: Row<i32>,
}

/// Encodes for networks of one required SINR.
#[derive(Clone, Debug)]
pub struct Encoder {
    /// In 1/256 dB.
    required: i32,
    /// The smaller part of two powers and what it loses in the next step, a [`pair`], by steps of difference.
    shares: [i32; SHARES],
    /// 65536 over the index, rounded up.
    reciprocals: [i32; 257],
    /// Of the block in work.
    groups: Groups,
}

/// The smaller part of two powers that are this many steps of difference apart, in 1/65536.
fn smaller_part(steps: usize) -> i32 {
    let difference = SHARE_RANGE.min((steps << SHARE_STEP_BITS) as i32);
    let gain = [Level::ZERO, Level::ZERO, Level::from_bits(difference as i16)];
    let view = SubChannel::new(0).zip(Period::new(1)).and_then(|(home, period)| {
        let broadcast = Broadcast {
            home,
            period,
            joiner_probability: JoinerProbability::ONE,
        };
        let quiet = [Level::ZERO; SUB_CHANNELS];
        let measurement = Measurement::new(SlotIndex(0), gain, quiet, None, broadcast);
        measurement.ok().map(|measurement| Observation::new(&measurement))
    });
    let part = view.map_or(0, |view| view.private_uniform() as i32);
    // At no difference it is half.
    part.min(65_536 - part)
}

impl Encoder {
    /// For networks of this required SINR.
    pub fn new(required: Level) -> Self {
        let nothing = [[0; LANES]; SUB_CHANNELS];
        let share = |steps| {
            let part = smaller_part(steps);
            pair(part, part - smaller_part(steps + 1))
        };
        Self {
            required: i32::from(required.to_bits()),
            shares: std::array::from_fn(share),
            reciprocals: std::array::from_fn(|n| 65_536_u32.div_ceil(n.max(1) as u32) as i32),
            groups: Groups {
                period: nothing,
                period_reciprocal: nothing,
                joiner_reciprocal: nothing,
            },
        }
    }

    /// Goes on with another block of worlds, or another slot.
    pub fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        for group in 0..SUB_CHANNELS {
            let period = broadcasts.periods(group);
            for lane in 0..broadcasts.worlds() {
                let joiner = usize::from(broadcasts.joiner_code(lane, group)) + 1;
                self.groups.period[group][lane] = i32::from(period[lane]);
                self.groups.period_reciprocal[group][lane] = self.reciprocals[usize::from(period[lane])];
                self.groups.joiner_reciprocal[group][lane] = self.reciprocals[joiner];
            }
        }
    }

    /// What a vehicle knows in every world of the block that was heard last.
    #[inline(always)]
    pub fn view(&self, senses: &Senses<'_>) -> View {
        let home = senses.homes().map(i32::from);
        View {
            gain: home_first(|sub_channel| senses.gain(sub_channel), &home),
            interference: home_first(|sub_channel| senses.interference(sub_channel), &home),
            age: senses.ages().map(i32::from),
            turn_lost_after: senses.turns_lost_after().map(i32::from),
            period: of_home(&self.groups.period, &home, 0),
            period_reciprocal: of_home(&self.groups.period_reciprocal, &home, 0),
            joiner_reciprocal: of_home(&self.groups.joiner_reciprocal, &home, 0),
            home,
        }
    }

    /// The actor's inputs, each in the range of i8. `[input][world]`.
    #[inline(always)]
    pub fn encode(&self, view: &View, inputs: &mut [Row<i32>; INPUTS]) {
        for lane in 0..LANES {
            let (age, period) = (view.age[lane], view.period[lane]);
            let periods = age * view.period_reciprocal[lane];
            inputs[0][lane] = flag(age == (periods >> 16) * period);
            inputs[1][lane] = flag(age > view.turn_lost_after[lane]);
            inputs[2][lane] = flag(age > 3 * period);
            inputs[3][lane] = (((periods >> 6) * 819) >> 16).min(64);
            inputs[4][lane] = (period * 16 / 5).min(127);
        }
        let mut strong = [0; LANES];
        for (k, gain) in view.gain.iter().enumerate() {
            for lane in 0..LANES {
                inputs[5 + k][lane] = (((gain[lane] * 819) >> 16) - 112).clamp(-128, 127);
                inputs[8 + k][lane] = flag(gain[lane] >= self.required);
                strong[lane] |= flag(gain[lane] >= i32::from(STRONG.to_bits()));
            }
        }
        inputs[11] = strong;
        let thinned = self.thinned(view);
        for lane in 0..LANES {
            inputs[12][lane] = (thinned[lane] >> 10).min(80);
        }
        for (input, limit) in inputs[13..17].iter_mut().zip([16_384, 32_768, 49_152, 65_536]) {
            for lane in 0..LANES {
                input[lane] = flag(thinned[lane] < limit);
            }
        }
        for (input, interference) in inputs[17..].iter_mut().zip(&view.interference) {
            for lane in 0..LANES {
                input[lane] = ((interference[lane] * 410) >> 16).clamp(-128, 127);
            }
        }
    }

    /// [`Observation::thinned_uniform`].
    #[inline(always)]
    fn thinned(&self, view: &View) -> Row<i32> {
        let [_, a, b] = &view.gain;
        let (mut distance, mut shares) = ([0; LANES], [0; LANES]);
        for lane in 0..LANES {
            distance[lane] = (a[lane] - b[lane]).abs().min(SHARE_RANGE);
        }
        for lane in 0..LANES {
            shares[lane] = self.shares[(distance[lane] >> SHARE_STEP_BITS) as usize % SHARES];
        }
        let mut thinned = [0; LANES];
        for lane in 0..LANES {
            let position = distance[lane] & ((1 << SHARE_STEP_BITS) - 1);
            let smaller = (shares[lane] & 0xffff) - (((shares[lane] >> 16) * position) >> SHARE_STEP_BITS);
            let below = i32::from(a[lane] < b[lane]).wrapping_neg();
            let share = (below & smaller) | (!below & (65_536 - smaller));
            // The product over 256, in two parts that stay within 32 bits.
            let reciprocal = view.joiner_reciprocal[lane];
            thinned[lane] = (share >> 8) * reciprocal + (((share & 0xff) * reciprocal) >> 8);
        }
        thinned
    }
}

/// Of three rows the one of each lane's home sub-channel, or the one that follows it at a distance.
#[inline(always)]
fn of_home(rows: &[Row<i32>; SUB_CHANNELS], home: &Row<i32>, offset: usize) -> Row<i32> {
    let mut chosen = [0; LANES];
    for (sub_channel, row) in rows.iter().enumerate() {
        let first = ((sub_channel + SUB_CHANNELS - offset) % SUB_CHANNELS) as i32;
        for lane in 0..LANES {
            chosen[lane] |= i32::from(home[lane] == first).wrapping_neg() & row[lane];
        }
    }
    chosen
}

/// Levels of all sub-channels in 1/256 dB, the home sub-channel's first.
#[inline(always)]
fn home_first(level: impl Fn(usize) -> Row<i32>, home: &Row<i32>) -> [Row<i32>; SUB_CHANNELS] {
    let levels = std::array::from_fn(level);
    [
        of_home(&levels, home, 0),
        of_home(&levels, home, 1),
        of_home(&levels, home, 2),
    ]
}

#[inline(always)]
fn flag(condition: bool) -> i32 {
    i32::from(condition) * i32::from(ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::units::Age;

    const REQUIRED: Level = Level::lit("8.45");

    /// A level that is not below noise, made of any.
    fn interference(level: i32) -> Level {
        Level::from_bits(level.abs().min(i32::from(i16::MAX)) as i16)
    }

    /// Compares a row of observations of age, period, code of the joiner probability and gains, all at home on sub-channel 0.
    fn compare(encoder: &Encoder, rows: &[(u8, u8, u8, [i32; SUB_CHANNELS])]) {
        let nothing = [0; LANES];
        let mut view = View {
            home: nothing,
            gain: [nothing; SUB_CHANNELS],
            interference: [nothing; SUB_CHANNELS],
            age: nothing,
            turn_lost_after: nothing,
            period: nothing,
            period_reciprocal: nothing,
            joiner_reciprocal: nothing,
        };
        let mut expected = Vec::new();
        for (lane, &(age, period, code, levels)) in rows.iter().enumerate() {
            let broadcast = Broadcast {
                home: SubChannel::new(0).unwrap(),
                period: Period::new(period).unwrap(),
                joiner_probability: JoinerProbability::from_code(code),
            };
            for (k, level) in levels.into_iter().enumerate() {
                view.gain[k][lane] = level;
                view.interference[k][lane] = i32::from(interference(level).to_bits());
            }
            view.age[lane] = i32::from(age);
            view.turn_lost_after[lane] = i32::from(firmware::observation::turn_lost_after(broadcast.period));
            view.period[lane] = i32::from(period);
            view.period_reciprocal[lane] = encoder.reciprocals[usize::from(period)];
            view.joiner_reciprocal[lane] = encoder.reciprocals[usize::from(code) + 1];
            let slot = SlotIndex(u32::from(Age::MAX.slots()));
            let measurement = Measurement::new(
                slot,
                levels.map(|level| Level::from_bits(level as i16)),
                levels.map(interference),
                Some(SlotIndex(slot.0 - u32::from(age))),
                broadcast,
            );
            expected.push(Observation::new(&measurement.unwrap()).encode(REQUIRED));
        }
        let mut inputs = [nothing; INPUTS];
        encoder.encode(&view, &mut inputs);
        for (lane, expected) in expected.iter().enumerate() {
            let found = std::array::from_fn(|input| inputs[input][lane]);
            assert_eq!(found, expected.map(i32::from), "{:?}", rows[lane]);
        }
    }

    #[test]
    fn every_age_period_level_and_share_is_encoded_as_the_firmware_does() {
        let encoder = Encoder::new(REQUIRED);
        let turns = (1..=100).flat_map(|age| (1..=100).map(move |period| (age, period, 255, [0; 3])));
        let levels = (-32_768..=32_767).map(|level| (1, 1, 255, [level, level / 2, -level / 3]));
        let differences = (-10_300..=10_300).map(|difference| (1, 1, difference as u8, [0, difference, 0]));
        let probabilities =
            (0..=255).flat_map(|code| (-81..=81).map(move |step| (1, 1, code, [0, 127 * step, -step])));
        let rows: Vec<_> = turns
            .chain(levels)
            .chain(differences)
            .chain(probabilities)
            .collect();
        for rows in rows.chunks(LANES) {
            compare(&encoder, rows);
        }
    }
}
