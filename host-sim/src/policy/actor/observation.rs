//! Observations of a row of worlds at a time, encoded as [`firmware::observation::Observation::encode`] encodes one.

use crate::base_station::BaseStation;
use crate::environment::Environment;
use crate::lanes::{LANES, Row, floor};
use firmware::measurement::{Broadcast, Measurement};
use firmware::observation::{INPUTS, ONE, Observation, STRONG};
use firmware::units::{Age, JoinerProbability, Level, Period, SUB_CHANNELS, SlotIndex, SubChannel};

/// Inputs that follow from age and period.
const TURN_INPUTS: usize = 5;

/// Difference of two levels from which their share is constant, in 1/256 dB (40 dB).
const SHARE_RANGE: i32 = 40 << 8;

/// What the firmware's encoding gives for small domains, asked once, and the rest of it for rows.
#[derive(Clone, Debug)]
pub struct Encoder {
    required: i32,
    /// Inputs 0 to 4. `[period][age]`.
    turns: Vec<[i8; TURN_INPUTS]>,
    /// [`Observation::private_uniform`] by the difference of the two levels plus [`SHARE_RANGE`].
    shares: Vec<u32>,
    /// 65536 over the joiner probability in 256ths, rounded up, by its code.
    reciprocals: Vec<u32>,
}

/// The observation of made-up readings at home on sub-channel 0.
fn observation(age: u8, period: Period, gain: [Level; SUB_CHANNELS]) -> Option<Observation> {
    let slot = SlotIndex(u32::from(Age::MAX.slots()));
    let broadcast = Broadcast {
        home: SubChannel::new(0)?,
        period,
        joiner_probability: JoinerProbability::ONE,
    };
    let acknowledged = Some(SlotIndex(slot.0 - u32::from(age)));
    let measurement = Measurement::new(slot, gain, [Level::ZERO; SUB_CHANNELS], acknowledged, broadcast);
    measurement.ok().map(|measurement| Observation::new(&measurement))
}

impl Encoder {
    /// For networks of this required SINR.
    pub fn new(required: Level) -> Self {
        let quiet = [Level::ZERO; SUB_CHANNELS];
        let ages = usize::from(Age::MAX.slots()) + 1;
        let mut turns = vec![[0; TURN_INPUTS]; ages * (usize::from(Period::MAX) + 1)];
        for period in (1..=Period::MAX).filter_map(Period::new) {
            for age in 1..=Age::MAX.slots() {
                let inputs = observation(age, period, quiet).map(|view| view.encode(required));
                let place = usize::from(period.slots()) * ages + usize::from(age);
                if let Some(inputs) = inputs {
                    turns[place].copy_from_slice(&inputs[..TURN_INPUTS]);
                }
            }
        }
        let share = |difference: i32| {
            let gain = [Level::ZERO, Level::from_bits(difference as i16), Level::ZERO];
            let view = Period::new(1).and_then(|period| observation(1, period, gain));
            view.map_or(0, |view| view.private_uniform())
        };
        Self {
            required: i32::from(required.to_bits()),
            turns,
            shares: (-SHARE_RANGE..=SHARE_RANGE).map(share).collect(),
            reciprocals: (1..=256).map(|n| 65_536_u32.div_ceil(n)).collect(),
        }
    }

    /// A present vehicle's inputs in every world of a block. `[input][world]`.
    #[inline(always)]
    pub fn encode(
        &self,
        environment: &Environment<'_>,
        block: usize,
        vehicle: usize,
        inputs: &mut [Row<i8>; INPUTS],
    ) {
        let station = environment.base_station();
        let home = station.homes().row(block, vehicle).map(i32::from);
        let gains: [Row<i32>; SUB_CHANNELS] = levels(environment.gains_db(), block, vehicle, &home);
        let interferences = levels(environment.interferences_db(), block, vehicle, &home);
        self.encode_turns(environment, station, block, vehicle, inputs);
        let thinned = self.thinned(station, block, &home, &gains);
        let mut strong = [false; LANES];
        for (k, gain) in gains.iter().enumerate() {
            for lane in 0..LANES {
                inputs[5 + k][lane] = saturated(((gain[lane] * 819) >> 16) - 112);
                inputs[8 + k][lane] = flag(gain[lane] >= self.required);
                strong[lane] |= gain[lane] >= i32::from(STRONG.to_bits());
            }
        }
        for lane in 0..LANES {
            inputs[11][lane] = flag(strong[lane]);
            inputs[12][lane] = (thinned[lane] >> 10).min(80) as i8;
        }
        for (input, limit) in inputs[13..17].iter_mut().zip([16_384, 32_768, 49_152, 65_536]) {
            for lane in 0..LANES {
                input[lane] = flag(thinned[lane] < limit);
            }
        }
        for (input, interference) in inputs[17..].iter_mut().zip(&interferences) {
            for lane in 0..LANES {
                input[lane] = saturated((interference[lane] * 410) >> 16);
            }
        }
    }

    #[inline(always)]
    fn encode_turns(
        &self,
        environment: &Environment<'_>,
        station: &BaseStation,
        block: usize,
        vehicle: usize,
        inputs: &mut [Row<i8>; INPUTS],
    ) {
        let ages = environment.ages().row(block, vehicle);
        let home = station.homes().row(block, vehicle);
        for lane in 0..LANES {
            let period = station
                .periods()
                .row(block, usize::from(home[lane]).min(SUB_CHANNELS - 1))[lane];
            let place = usize::from(period) * (usize::from(Age::MAX.slots()) + 1) + usize::from(ages[lane]);
            let turn = &self.turns[place];
            for (input, &value) in inputs.iter_mut().zip(turn) {
                input[lane] = value;
            }
        }
    }

    /// [`Observation::thinned_uniform`], bounded to 17 bits, where it makes no difference any more.
    #[inline(always)]
    fn thinned(
        &self,
        station: &BaseStation,
        block: usize,
        home: &Row<i32>,
        gains: &[Row<i32>; SUB_CHANNELS],
    ) -> Row<u32> {
        let mut thinned = [0; LANES];
        for lane in 0..LANES {
            let difference = (gains[1][lane] - gains[2][lane]).clamp(-SHARE_RANGE, SHARE_RANGE);
            let share = self.shares[(difference + SHARE_RANGE) as usize];
            let group = (home[lane] as usize).min(SUB_CHANNELS - 1);
            let code = station.joiner_code(block * LANES + lane, group);
            let quotient = (u64::from(share) * u64::from(self.reciprocals[usize::from(code)])) >> 8;
            thinned[lane] = quotient.min(1 << 17) as u32;
        }
        thinned
    }
}

/// Levels in 1/256 dB, the home sub-channel's first.
#[inline(always)]
fn levels(
    values_db: &crate::lanes::Rows<f32>,
    block: usize,
    vehicle: usize,
    home: &Row<i32>,
) -> [Row<i32>; SUB_CHANNELS] {
    let mut levels = [[0; LANES]; SUB_CHANNELS];
    for sub_channel in 0..SUB_CHANNELS {
        let values_db = values_db.row(block, vehicle * SUB_CHANNELS + sub_channel);
        let mut level = [0; LANES];
        for lane in 0..LANES {
            let steps = (values_db[lane] * 256.0).clamp(-32_768.0, 32_767.0);
            level[lane] = floor(steps);
        }
        for (offset, levels) in levels.iter_mut().enumerate() {
            let first = ((sub_channel + SUB_CHANNELS - offset) % SUB_CHANNELS) as i32;
            for lane in 0..LANES {
                levels[lane] |= i32::from(home[lane] == first).wrapping_neg() & level[lane];
            }
        }
    }
    levels
}

#[inline(always)]
fn flag(condition: bool) -> i8 {
    i8::from(condition) * ONE
}

#[inline(always)]
fn saturated(value: i32) -> i8 {
    value.clamp(-128, 127) as i8
}
