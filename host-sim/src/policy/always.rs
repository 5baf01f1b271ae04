//! Everybody sends in every slot: what an own-age reward teaches, and a random choice.

use super::{Policy, below, dbm};
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::lanes::{LANES, LaneStream, decibels, unit_interval};
use crate::scenario::Scenario;
use firmware::units::Dbm;

/// Full power on the best sub-channel.
pub struct Always {
    max_power: Dbm,
}

impl Always {
    /// Always on in this scenario.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
        }
    }
}

impl Policy for Always {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        let (gains_db, sub_channels) = (environment.gains_db(), environment.sub_channels());
        for block in 0..gains_db.blocks() {
            environment.vectors().run(
                #[inline(always)]
                || {
                    for &vehicle in environment.present() {
                        let mut best_db = *gains_db.row(block, vehicle * sub_channels);
                        let mut best = [0_i32; LANES];
                        for sub_channel in 1..sub_channels {
                            let gain_db = gains_db.row(block, vehicle * sub_channels + sub_channel);
                            for lane in 0..LANES {
                                let better = gain_db[lane] > best_db[lane];
                                best[lane] = if better { sub_channel as i32 } else { best[lane] };
                                best_db[lane] = if better { gain_db[lane] } else { best_db[lane] };
                            }
                        }
                        let (sub_channel, power) = decisions.rows_mut(block, vehicle);
                        *sub_channel = best.map(|best| best as u8);
                        *power = [self.max_power.to_bits(); LANES];
                    }
                },
            );
        }
    }
}

/// A uniformly drawn sub-channel and a uniformly drawn power between 0 W and full power.
pub struct Random {
    max_power_dbm: f32,
    /// By block of worlds.
    streams: Vec<LaneStream>,
}

impl Random {
    /// Random choices in this scenario.
    pub fn new(scenario: &Scenario, streams: Vec<LaneStream>) -> Self {
        Self {
            max_power_dbm: scenario.radio.max_power_dbm as f32,
            streams,
        }
    }
}

impl Policy for Random {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        let sub_channels = environment.sub_channels() as u32;
        for (block, stream) in self.streams.iter_mut().enumerate() {
            environment.vectors().run(
                #[inline(always)]
                || {
                    for &vehicle in environment.present() {
                        let (sub_channel, power) = decisions.rows_mut(block, vehicle);
                        *sub_channel = below(stream.next_row(), sub_channels);
                        let words = stream.next_row();
                        for lane in 0..LANES {
                            let power_dbm = self.max_power_dbm + decibels(unit_interval(words[lane]));
                            power[lane] = (power_dbm * 256.0).floor() as i16;
                        }
                    }
                },
            );
        }
    }
}
