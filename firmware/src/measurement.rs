//! What a unit can really sense in a slot, validated once at the border.

use crate::units::{Age, JoinerProbability, Level, Period, SUB_CHANNELS, SlotIndex, SubChannel};

/// What the base station tells a vehicle: its group at association, the other two by broadcast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Broadcast {
    /// The sub-channel of the vehicle's group.
    pub home: SubChannel,
    /// Slots between two turns: the size of the group.
    pub period: Period,
    /// How often joiners should send.
    pub joiner_probability: JoinerProbability,
}

/// One slot's measurement.
///
/// This is the paper's observation `h_v[n], I_v[n], A_v` and the base station's [`Broadcast`], nothing else about other
/// vehicles. The age follows from the last acknowledgement, so a lost measurement cannot make it wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measurement {
    slot: SlotIndex,
    gain: [Level; SUB_CHANNELS],
    interference: [Level; SUB_CHANNELS],
    last_acknowledged: Option<SlotIndex>,
    broadcast: Broadcast,
}

/// Why a set of readings is no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MeasurementError {
    /// Noise plus interference below the noise floor on this sub-channel.
    InterferenceBelowNoise(u8),
    /// The last acknowledged slot is not before the measured slot.
    AcknowledgedInFuture,
    /// The home sub-channel does not exist.
    Home(u8),
    /// The period is not in 1 to 100 slots.
    Period(u8),
}

impl core::fmt::Display for MeasurementError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::InterferenceBelowNoise(n) => {
                write!(
                    formatter,
                    "interference[{n}]: noise plus interference is below 0 dB over noise"
                )
            }
            Self::AcknowledgedInFuture => {
                write!(
                    formatter,
                    "last_acknowledged: not before the slot of the measurement"
                )
            }
            Self::Home(found) => write!(
                formatter,
                "home: found {found}, expected 0 to {}",
                SUB_CHANNELS.saturating_sub(1)
            ),
            Self::Period(found) => write!(formatter, "period: found {found}, expected 1 to {}", Period::MAX),
        }
    }
}

impl core::error::Error for MeasurementError {}

impl Measurement {
    /// Checks and keeps one slot's readings.
    ///
    /// * `gain[n]`: the level at which the base station would receive this vehicle on sub-channel `n` in this slot at full
    ///   power.
    /// * `interference[n]`: noise plus other vehicles' power that the base station received on sub-channel `n` in the
    ///   slot before, over noise alone: at least 0 dB.
    /// * `last_acknowledged`: the latest slot in which the base station received this vehicle, if it ever did.
    ///
    /// # Errors
    /// [`MeasurementError`] names the first reading that cannot be.
    pub fn new(
        slot: SlotIndex,
        gain: [Level; SUB_CHANNELS],
        interference: [Level; SUB_CHANNELS],
        last_acknowledged: Option<SlotIndex>,
        broadcast: Broadcast,
    ) -> Result<Self, MeasurementError> {
        for (n, level) in (0_u8..).zip(interference) {
            if level < Level::ZERO {
                return Err(MeasurementError::InterferenceBelowNoise(n));
            }
        }
        if let Some(acknowledged) = last_acknowledged {
            let elapsed = slot.since(acknowledged);
            if elapsed == 0 || elapsed > u32::MAX / 2 {
                return Err(MeasurementError::AcknowledgedInFuture);
            }
        }
        Ok(Self {
            slot,
            gain,
            interference,
            last_acknowledged,
            broadcast,
        })
    }

    /// The slot that is about to be decided.
    pub const fn slot(&self) -> SlotIndex {
        self.slot
    }

    /// Level at the base station at full power, for every sub-channel.
    pub const fn gain(&self) -> &[Level; SUB_CHANNELS] {
        &self.gain
    }

    /// Noise plus interference over noise in the slot before, for every sub-channel.
    pub const fn interference(&self) -> &[Level; SUB_CHANNELS] {
        &self.interference
    }

    /// The latest slot in which the base station received this vehicle.
    pub const fn last_acknowledged(&self) -> Option<SlotIndex> {
        self.last_acknowledged
    }

    /// What the base station broadcasts.
    pub const fn broadcast(&self) -> &Broadcast {
        &self.broadcast
    }

    /// The vehicle's age of information at the beginning of the slot.
    pub fn age(&self) -> Age {
        age_at(self.slot, self.last_acknowledged)
    }
}

/// The age at the beginning of `slot` when `last_acknowledged` was the latest success; [`Age::MAX`] if there was none.
pub(crate) fn age_at(slot: SlotIndex, last_acknowledged: Option<SlotIndex>) -> Age {
    // A success so long ago stands for none, so that both take the same instructions.
    let longest_ago = SlotIndex(slot.0.wrapping_sub(u32::from(Age::MAX.slots())));
    Age::after(slot.since(last_acknowledged.unwrap_or(longest_ago)))
}
