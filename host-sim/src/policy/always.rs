//! Everybody sends in every slot: what an own-age reward teaches, and a random choice.

use super::{Policy, best_sub_channel, dbm, transmit};
use crate::cell::Cell;
use crate::scenario::Scenario;
use crate::stream::Stream;
use firmware::decision::Decision;
use firmware::units::{Dbm, SUB_CHANNELS};

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
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        for &vehicle in cell.present() {
            decisions[vehicle] = transmit(best_sub_channel(cell.gain_db(vehicle)), self.max_power);
        }
    }
}

/// A uniformly drawn sub-channel and a uniformly drawn power between 0 W and full power.
pub struct Random {
    max_power_dbm: f64,
    stream: Stream,
}

impl Random {
    /// Random choices in this scenario.
    pub fn new(scenario: &Scenario, stream: Stream) -> Self {
        Self {
            max_power_dbm: scenario.radio.max_power_dbm,
            stream,
        }
    }
}

impl Policy for Random {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        for &vehicle in cell.present() {
            let sub_channel = self.stream.below(SUB_CHANNELS as u32) as usize;
            let fraction = f64::from(self.stream.uniform());
            decisions[vehicle] = transmit(
                sub_channel,
                dbm(self.max_power_dbm + 10.0 * libm::log10(fraction)),
            );
        }
    }
}
