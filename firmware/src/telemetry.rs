//! Counters for people. Nothing here takes part in a decision.

use crate::decision::Decision;
use crate::link::Counters;
use crate::unit::{Report, State};
use micromath::F32Ext;

/// What a unit did since it started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Telemetry {
    /// Decided slots.
    pub slots: u32,
    /// Slots in which it sent.
    pub transmissions: u32,
    /// Slots decided without a measurement.
    pub degraded: u32,
    /// Slots decided because their frame had not come by the deadline.
    pub overdue: u32,
    /// Frames dropped as damaged or invalid.
    pub dropped_frames: u32,
    /// Frames whose slot did not follow the one before, and that no next frame has confirmed.
    pub doubted_frames: u32,
    /// Sum of transmit power over slots, in nW. An f32 stops growing after some hours; this holds 2^32 slots of 4 W.
    power_nw: u64,
}

impl Telemetry {
    /// Counts one slot.
    #[allow(clippy::arithmetic_side_effects, reason = "floating point")]
    pub fn count(&mut self, report: &Report) {
        self.slots = self.slots.saturating_add(1);
        if report.state == State::Degraded {
            self.degraded = self.degraded.saturating_add(1);
        }
        if let Decision::Transmit { power, .. } = report.decision {
            self.transmissions = self.transmissions.saturating_add(1);
            let power_nw = milliwatts(power.value().to_num()) * 1.0e6;
            self.power_nw = self.power_nw.saturating_add(power_nw as u64);
        }
    }

    /// The counters as they are sent.
    pub const fn counters(&self) -> Counters {
        Counters {
            slots: self.slots,
            transmissions: self.transmissions,
            degraded: self.degraded,
            overdue: self.overdue,
            dropped_frames: self.dropped_frames,
            doubted_frames: self.doubted_frames,
        }
    }

    /// Mean transmit power over all slots in mW, to 0.24 % (see [`milliwatts`]).
    #[allow(clippy::arithmetic_side_effects, reason = "floating point")]
    pub fn mean_power_mw(&self) -> f32 {
        if self.slots == 0 {
            0.0
        } else {
            self.power_nw as f32 / self.slots as f32 / 1.0e6
        }
    }
}

/// Power in mW.
///
/// micromath's exponential is at most 0.24 % off here and 0.05 % RMS (`tests/telemetry.rs`, -40 to 30 dBm); that is 0.01 dB,
/// enough for a person and too coarse to decide with. Called by its full path, since std's method of the same name would replace it
/// silently on a host.
#[allow(clippy::arithmetic_side_effects, reason = "floating point")]
pub fn milliwatts(dbm: f32) -> f32 {
    F32Ext::exp(dbm * (core::f32::consts::LN_10 / 10.0))
}
