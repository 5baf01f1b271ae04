//! Observations of a row of worlds at a time: [`Quantities::encode`], which also encodes the firmware's
//! [`Observation`](firmware::observation::Observation), is called lane by lane. The tests go through all ages, periods, differences of
//! gains and joiner probabilities.

use crate::lanes::{LANES, Row};
use crate::senses::{Broadcasts, Senses};
use firmware::observation::{INPUTS, Quantities};
use firmware::reciprocal::reciprocal;
use firmware::units::{Level, SUB_CHANNELS};

/// What the vehicles of every group hear, in every world of a block. `[group][world]`.
#[derive(Clone, Debug)]
struct Groups {
    period: [Row<i32>; SUB_CHANNELS],
    /// [`reciprocal`] of the period.
    period_reciprocal: [Row<i32>; SUB_CHANNELS],
    /// [`reciprocal`] of the joiner probability in 256ths.
    joiner_reciprocal: [Row<i32>; SUB_CHANNELS],
}

/// What one vehicle knows in every world of a block: a row of [`Quantities`], with the home sub-channel first.
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
    /// [`reciprocal`] of the index.
    reciprocals: [i32; 257],
    /// Of the block in work.
    groups: Groups,
}

impl Encoder {
    /// For networks of this required SINR.
    pub fn new(required: Level) -> Self {
        let nothing = [[0; LANES]; SUB_CHANNELS];
        Self {
            required: i32::from(required.to_bits()),
            reciprocals: std::array::from_fn(|n| reciprocal(n as u16)),
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
        let groups = &self.groups;
        let (period, period_reciprocal, joiner_reciprocal) = match senses.heard() {
            None => (
                of_home(&groups.period, &home, 0),
                of_home(&groups.period_reciprocal, &home, 0),
                of_home(&groups.joiner_reciprocal, &home, 0),
            ),
            Some((periods, codes)) => (
                periods.map(i32::from),
                periods.map(|period| self.reciprocals[usize::from(period)]),
                codes.map(|code| self.reciprocals[usize::from(code) + 1]),
            ),
        };
        View {
            gain: home_first(&[senses.gain(0), senses.gain(1), senses.gain(2)], &home),
            interference: home_first(
                &[
                    senses.interference(0),
                    senses.interference(1),
                    senses.interference(2),
                ],
                &home,
            ),
            age: senses.ages().map(i32::from),
            turn_lost_after: senses.turns_lost_after().map(i32::from),
            period,
            period_reciprocal,
            joiner_reciprocal,
            home,
        }
    }

    /// The actor's inputs, each in the range of i8. `[input][world]`.
    #[inline(always)]
    pub fn encode(&self, view: &View, inputs: &mut [Row<i32>; INPUTS]) {
        for lane in 0..LANES {
            let codes = view.quantities(lane).encode(self.required);
            for (input, code) in inputs.iter_mut().zip(codes) {
                input[lane] = code;
            }
        }
    }
}

impl View {
    /// What the vehicle knows in one world.
    #[inline(always)]
    fn quantities(&self, lane: usize) -> Quantities {
        Quantities {
            age: self.age[lane],
            period: self.period[lane],
            period_reciprocal: self.period_reciprocal[lane],
            turn_lost_after: self.turn_lost_after[lane],
            joiner_reciprocal: self.joiner_reciprocal[lane],
            gain: self.gain.each_ref().map(|row| row[lane]),
            interference: self.interference.each_ref().map(|row| row[lane]),
        }
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
fn home_first(levels: &[Row<i32>; SUB_CHANNELS], home: &Row<i32>) -> [Row<i32>; SUB_CHANNELS] {
    [
        of_home(levels, home, 0),
        of_home(levels, home, 1),
        of_home(levels, home, 2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::measurement::{Broadcast, Measurement};
    use firmware::observation::Observation;
    use firmware::units::{Age, JoinerProbability, Period, SlotIndex, SubChannel};

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
