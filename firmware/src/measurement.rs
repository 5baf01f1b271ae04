//! What a unit can really sense in a slot, validated once at the border.

use crate::ring::{Open, Ring};
use crate::units::{Age, Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, Weight};

/// What the base station tells everybody.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Broadcast {
    /// Whose turn it is, and on how many sub-channels.
    pub ring: Ring,
    /// On which of them anybody may contend in this slot; none if that was not heard.
    pub open: Open,
    /// The least priority ([`Quantities::priority`](crate::observation::Quantities::priority)) with which to contend in this slot.
    pub threshold: u32,
    /// What the sub-channels that vehicles like are drawn with where gains do not hold ([`liking`](crate::observation::liking)).
    pub salt: u8,
    /// Whether a gain as it was measured still says that a transmission will be received: not where it is old and fading has moved on.
    pub gains_hold: bool,
    /// The most that vehicles may send with (LTE's P-Max).
    pub max_power: Dbm,
}

/// A place in the ring that is a vehicle's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Place {
    /// Which one. One that the ring does not have never comes round.
    pub index: u16,
    /// Whether the base station handed it out at association. Otherwise the vehicle was last received in it, as the
    /// acknowledgement said: its own until it has not been received for too long.
    pub assigned: bool,
}

/// One slot's readings as a modem has them.
#[derive(Clone, Copy, Debug)]
pub struct Readings<'r> {
    /// The slot that is about to be decided.
    pub slot: SlotIndex,
    /// `gain[n]`: the level at which the base station would receive this vehicle on sub-channel `n` in this slot at full power.
    pub gain: &'r [Level],
    /// `interference[n]`: noise plus other vehicles' power that the base station received on sub-channel `n` in the slot
    /// before, over noise alone: at least 0 dB.
    pub interference: &'r [Level],
    /// The latest slot in which the base station received this vehicle, if it ever did.
    pub last_acknowledged: Option<SlotIndex>,
    /// The vehicle's place, if it has one.
    pub place: Option<Place>,
    /// What the base station weighs its age with.
    pub weight: Weight,
    /// Whether an acknowledgement of what the vehicle sent may still be under way.
    pub awaits_acknowledgement: bool,
    /// What the vehicle last heard.
    pub broadcast: Broadcast,
}

/// One slot's measurement.
///
/// This is the paper's observation `h_v[n], I_v[n], A_v`, the vehicle's [`Place`] and the base station's [`Broadcast`], nothing
/// else about other vehicles. The age follows from the last acknowledgement, so a lost measurement cannot make it wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measurement {
    slot: SlotIndex,
    gain: [Level; MAX_SUB_CHANNELS],
    interference: [Level; MAX_SUB_CHANNELS],
    last_acknowledged: Option<SlotIndex>,
    place: Option<Place>,
    weight: Weight,
    awaits_acknowledgement: bool,
    broadcast: Broadcast,
}

/// Why a set of readings is no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MeasurementError {
    /// Not one gain and one interference for each of the announced sub-channels.
    SubChannels {
        /// How many gains, or interferences if the gains are right.
        found: u8,
        /// How many sub-channels.
        expected: u8,
    },
    /// Noise plus interference below the noise floor on this sub-channel.
    InterferenceBelowNoise(u8),
    /// The last acknowledged slot is not before the measured slot.
    AcknowledgedInFuture,
    /// The announced ring cannot be ([`Ring::new`]).
    Ring {
        /// Its places.
        places: u16,
        /// Sub-channels.
        sub_channels: u8,
    },
}

impl core::fmt::Display for MeasurementError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::SubChannels { found, expected } => {
                write!(
                    formatter,
                    "gain, interference: found {found} levels, expected {expected}, one for each sub-channel"
                )
            }
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
            Self::Ring { places, sub_channels } => write!(
                formatter,
                "ring: found {places} places on {sub_channels} sub-channels; expected 1 to \
                 {MAX_SUB_CHANNELS} sub-channels, and from as many places to {}",
                crate::ring::MAX_PLACES
            ),
        }
    }
}

impl core::error::Error for MeasurementError {}

impl Measurement {
    /// Checks and keeps one slot's readings.
    ///
    /// # Errors
    /// [`MeasurementError`] names the first reading that cannot be.
    pub fn new(readings: &Readings<'_>) -> Result<Self, MeasurementError> {
        let expected = readings.broadcast.ring.sub_channels().count();
        for found in [readings.gain.len(), readings.interference.len()] {
            if found != expected {
                return Err(MeasurementError::SubChannels {
                    found: found.min(usize::from(u8::MAX)) as u8,
                    expected: expected as u8,
                });
            }
        }
        Self::with_levels(readings, padded(readings.gain), padded(readings.interference))
    }

    /// The same with levels of all sub-channels that a cell may have, zeros where it has none, instead of the readings' own.
    #[inline(always)]
    pub(crate) fn with_levels(
        readings: &Readings<'_>,
        gain: [Level; MAX_SUB_CHANNELS],
        interference: [Level; MAX_SUB_CHANNELS],
    ) -> Result<Self, MeasurementError> {
        let count = readings.broadcast.ring.sub_channels().count();
        for (n, &level) in (0_u8..).zip(interference.iter().take(count)) {
            if level < Level::ZERO {
                return Err(MeasurementError::InterferenceBelowNoise(n));
            }
        }
        if let Some(acknowledged) = readings.last_acknowledged {
            let elapsed = readings.slot.since(acknowledged);
            if elapsed == 0 || elapsed > u32::MAX / 2 {
                return Err(MeasurementError::AcknowledgedInFuture);
            }
        }
        Ok(Self {
            slot: readings.slot,
            gain,
            interference,
            last_acknowledged: readings.last_acknowledged,
            place: readings.place,
            weight: readings.weight,
            awaits_acknowledgement: readings.awaits_acknowledgement,
            broadcast: readings.broadcast,
        })
    }

    /// The slot that is about to be decided.
    pub const fn slot(&self) -> SlotIndex {
        self.slot
    }

    /// Level at the base station at full power, for every sub-channel.
    pub fn gain(&self) -> &[Level] {
        self.used(&self.gain)
    }

    /// Noise plus interference over noise in the slot before, for every sub-channel.
    pub fn interference(&self) -> &[Level] {
        self.used(&self.interference)
    }

    /// The same, zeros where the cell has no sub-channel.
    pub(crate) const fn all_gains(&self) -> &[Level; MAX_SUB_CHANNELS] {
        &self.gain
    }

    /// The same.
    pub(crate) const fn all_interferences(&self) -> &[Level; MAX_SUB_CHANNELS] {
        &self.interference
    }

    fn used<'m>(&self, levels: &'m [Level; MAX_SUB_CHANNELS]) -> &'m [Level] {
        let count = self.broadcast.ring.sub_channels().count();
        levels.get(..count).unwrap_or(levels)
    }

    /// The latest slot in which the base station received this vehicle.
    pub const fn last_acknowledged(&self) -> Option<SlotIndex> {
        self.last_acknowledged
    }

    /// The vehicle's place.
    pub const fn place(&self) -> Option<Place> {
        self.place
    }

    /// What the base station weighs its age with.
    pub const fn weight(&self) -> Weight {
        self.weight
    }

    /// Whether an acknowledgement may still be under way.
    pub const fn awaits_acknowledgement(&self) -> bool {
        self.awaits_acknowledgement
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

/// Levels of all sub-channels that a cell may have: zeros where it has none.
fn padded(levels: &[Level]) -> [Level; MAX_SUB_CHANNELS] {
    let mut padded = [Level::ZERO; MAX_SUB_CHANNELS];
    for (padded, &level) in padded.iter_mut().zip(levels) {
        *padded = level;
    }
    padded
}

/// The age at the beginning of `slot` when `last_acknowledged` was the latest success; [`Age::MAX`] if there was none.
pub(crate) fn age_at(slot: SlotIndex, last_acknowledged: Option<SlotIndex>) -> Age {
    // A success so long ago stands for none, so that both take the same instructions.
    let longest_ago = SlotIndex(slot.0.wrapping_sub(u32::from(Age::MAX.slots())));
    Age::after(slot.since(last_acknowledged.unwrap_or(longest_ago)))
}
