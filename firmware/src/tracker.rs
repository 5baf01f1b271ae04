//! Follows a vehicle's large-scale gain, so that a level can be predicted when a measurement is missing.

use crate::units::Level;
use nalgebra::{Matrix2, RowVector2, Vector2};

/// A steady-state Kalman filter over (level in dB, change in dB per slot).
///
/// Path loss and shadowing are common to all sub-channels and change slowly; fast fading is new in every slot and cannot be
/// predicted. The filter therefore follows the mean over sub-channels of the measured levels. Rayleigh fading in dB has
/// mean -2.51 and standard deviation 5.57, so the mean of three varies by 10.3 dB^2; shadowing with 8 dB and 50 m moves
/// a vehicle at 12 m/s by 0.03 dB^2 in a slot. Those two give the gain of the level; the small gain of the change is
/// chosen for damping.
///
/// Measured on such tracks (`tests/tracker.rs`): RMS error of the mean level 0.79 dB one slot ahead, 1.2 dB after 20 slots,
/// 2.3 dB after 99, where repeating the last sample has 5.5 dB.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelTracker {
    state: Option<Vector2<f32>>,
}

/// sqrt(0.03 / 10.3), the steady-state gain of a random walk in noise, and 1/200 of it.
const GAIN: Vector2<f32> = Vector2::new(0.054, 0.000_27);
/// Of a [`Level`].
const STEPS_PER_DB: f32 = 256.0;
const OBSERVED: RowVector2<f32> = RowVector2::new(1.0, 0.0);
/// One slot: the level moves by its change.
const TRANSITION: Matrix2<f32> = Matrix2::new(1.0, 1.0, 0.0, 1.0);

impl LevelTracker {
    /// Before the first measurement.
    pub const fn new() -> Self {
        Self { state: None }
    }

    /// Takes in one slot's measured levels.
    #[allow(clippy::arithmetic_side_effects, reason = "floating point")]
    pub fn measure(&mut self, gain: &[Level]) {
        // In steps, whose sum is exact: the conversion of `Level` takes longer for some levels than for others.
        let sum: i32 = gain.iter().map(|level| i32::from(level.to_bits())).sum();
        let mean = sum as f32 / (gain.len().max(1) as f32 * STEPS_PER_DB);
        self.state = Some(match self.state {
            None => Vector2::new(mean, 0.0),
            Some(state) => {
                let predicted = TRANSITION * state;
                predicted + GAIN * (mean - (OBSERVED * predicted).x)
            }
        });
    }

    /// Lets one slot without a measurement pass.
    #[allow(clippy::arithmetic_side_effects, reason = "floating point")]
    pub fn miss(&mut self) {
        self.state = self.state.map(|state| TRANSITION * state);
    }

    /// The level to expect on any sub-channel, or `None` before the first measurement.
    #[allow(
        clippy::arithmetic_side_effects,
        clippy::cast_possible_truncation,
        reason = "floating point"
    )]
    pub fn predicted(&self) -> Option<Level> {
        // `Level::saturating_from_num` panics on a NaN; this cast saturates, and makes 0 of it.
        self.state
            .map(|state| Level::from_bits((state.x * STEPS_PER_DB) as i16))
    }
}
