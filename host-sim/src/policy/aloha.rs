//! Slotted ALOHA, and ALOHA from an age threshold on (Atabay et al. 2020; Yavascan and Uysal 2021): a random sub-channel
//! at full power.

use super::{Policy, dbm, transmit};
use crate::cell::Cell;
use crate::scenario::Scenario;
use crate::stream::Stream;
use firmware::decision::Decision;
use firmware::units::{Dbm, SUB_CHANNELS};

/// Sends with one probability in every slot.
pub struct Aloha {
    max_power: Dbm,
    load: f64,
    stream: Stream,
}

impl Aloha {
    /// ALOHA in this scenario.
    pub fn new(scenario: &Scenario, stream: Stream) -> Self {
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
            load: scenario.baselines.aloha_load,
            stream,
        }
    }
}

impl Policy for Aloha {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        let probability = self.load * SUB_CHANNELS as f64 / cell.present().len().max(1) as f64;
        for &vehicle in cell.present() {
            let sub_channel = self.stream.below(SUB_CHANNELS as u32) as usize;
            if self.stream.chance(probability) {
                decisions[vehicle] = transmit(sub_channel, self.max_power);
            }
        }
    }
}

/// Sends with one probability once its age has reached the threshold.
pub struct AgeThreshold {
    max_power: Dbm,
    load: f64,
    probability: f64,
    stream: Stream,
}

impl AgeThreshold {
    /// Age-threshold ALOHA in this scenario.
    pub fn new(scenario: &Scenario, stream: Stream) -> Self {
        let baselines = &scenario.baselines;
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
            load: baselines.age_threshold_load,
            probability: baselines.age_threshold_probability,
            stream,
        }
    }
}

impl Policy for AgeThreshold {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        let threshold = (self.load * cell.present().len() as f64 / SUB_CHANNELS as f64).round();
        for &vehicle in cell.present() {
            let sub_channel = self.stream.below(SUB_CHANNELS as u32) as usize;
            let send = self.stream.chance(self.probability);
            if send && f64::from(cell.age(vehicle).slots()) >= threshold {
                decisions[vehicle] = transmit(sub_channel, self.max_power);
            }
        }
    }
}
