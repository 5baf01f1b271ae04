//! What the frames say.

use super::LinkError;
use crate::decision::Decision;
use crate::measurement::{Broadcast, Measurement, MeasurementError};
use crate::table::CHECKSUM;
use crate::unit::{Event, Report, Silence, State};
use crate::units::{Dbm, JoinerProbability, Level, Period, SUB_CHANNELS, SlotIndex, SubChannel};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Room for any frame on the wire with its delimiter. The longest measurement takes 39 bytes: 33 of fields, 4 of checksum,
/// one of byte stuffing, the delimiter; the longest chunk of an update 45, the longest answer 18.
pub const MAX_FRAME: usize = 64;

/// Bytes of a package in one frame (chosen: a multiple of the flash's words that keeps the frame within [`MAX_FRAME`]).
pub const CHUNK_LEN: usize = 32;

/// From the modem: one of the first two once a slot, the others now and then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ModemFrame {
    /// The slot's readings.
    Measurement(MeasurementFrame),
    /// A slot in which the modem could not measure.
    Missed {
        /// The slot's index.
        slot: u32,
    },
    /// How long a slot is, if not 1 ms. A length outside the range of [`crate::slot_clock::SlotLength`] is refused.
    SlotLength {
        /// In microseconds.
        microseconds: u32,
    },
    /// A step of a table update.
    Update(UpdateFrame),
}

/// One step of a table update. Every step has an [`UpdateAnswer`], and the modem waits for it before the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateFrame {
    /// A signed package is coming.
    Begin {
        /// Its length in bytes.
        length: u32,
    },
    /// The package's next bytes, in order. The last chunk is filled up with anything.
    Chunk {
        /// Where in the package they lie.
        offset: u32,
        /// What they are.
        bytes: [u8; CHUNK_LEN],
    },
    /// The package is complete: check it and run it.
    Commit,
}

/// What became of a step of a table update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum UpdateAnswer {
    /// Send the package from here on: after a begin, a chunk, and a chunk that was out of order.
    Continue {
        /// Offset of the next chunk.
        offset: u32,
    },
    /// The package is checked and stored, and decides from the next slot on.
    Activated {
        /// Its version.
        version: u32,
    },
    /// The update is over; the unit keeps the table it has.
    Refused(Refusal),
    /// The step before is still at work; send this one again.
    Busy,
}

/// Why an update ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// No update has begun.
    NotBegun,
    /// The package is too short or does not fit a slot.
    Length,
    /// Chunks are missing.
    Incomplete,
    /// The flash does not hold what was written.
    Flash,
    /// The package's header is wrong or of a format that this unit does not know.
    Header,
    /// The table inside fails its own check, or is for another geometry or another number of sub-channels.
    Table,
    /// The version is not above the one that runs.
    Version,
    /// The signature is not that of this unit's key.
    Signature,
}

/// From the unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UnitMessage {
    /// A slot's decision.
    Decision(UnitFrame),
    /// What became of a step of a table update.
    Update(UpdateAnswer),
}

/// A slot's readings as they are sent; [`Measurement`] says what they mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasurementFrame {
    /// Index of the slot to be decided.
    pub slot: u32,
    /// Level at full power in 1/256 dB over noise.
    pub gain: [i16; SUB_CHANNELS],
    /// Noise plus interference of the slot before in 1/256 dB over noise.
    pub interference: [i16; SUB_CHANNELS],
    /// The latest acknowledged slot. A modem may leave it out once it is 100 slots old, since ages saturate there, and must
    /// before it is 2^31 slots old, from where it would lie in the future.
    pub last_acknowledged: Option<u32>,
    /// The home sub-channel.
    pub home: u8,
    /// The period in slots.
    pub period: u8,
    /// The joiner probability, `256 p - 1`.
    pub joiner_probability: u8,
}

/// A slot's decision, once a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitFrame {
    /// The decided slot.
    pub slot: u32,
    /// `None`: silent. Otherwise the sub-channel and the power in 1/256 dBm.
    pub transmit: Option<(u8, i16)>,
    /// [`State`]: 0 nominal, 1 degraded, 2 silent without a table, 3 silent without a measurement.
    pub state: u8,
}

impl ModemFrame {
    /// The event that the frame reports, or the first reading that cannot be; `None` if it reports no slot.
    pub fn event(&self) -> Option<Result<Event, MeasurementError>> {
        match self {
            Self::Missed { slot } => Some(Ok(Event::Missed(SlotIndex(*slot)))),
            Self::Measurement(frame) => Some(frame.measurement().map(Event::Measured)),
            Self::SlotLength { .. } | Self::Update(_) => None,
        }
    }
}

impl MeasurementFrame {
    /// The checked measurement.
    ///
    /// # Errors
    /// The first reading that cannot be.
    pub fn measurement(&self) -> Result<Measurement, MeasurementError> {
        let broadcast = Broadcast {
            home: SubChannel::new(self.home).ok_or(MeasurementError::Home(self.home))?,
            period: Period::new(self.period).ok_or(MeasurementError::Period(self.period))?,
            joiner_probability: JoinerProbability::from_code(self.joiner_probability),
        };
        Measurement::new(
            SlotIndex(self.slot),
            self.gain.map(Level::from_bits),
            self.interference.map(Level::from_bits),
            self.last_acknowledged.map(SlotIndex),
            broadcast,
        )
    }
}

impl From<&Measurement> for MeasurementFrame {
    fn from(measurement: &Measurement) -> Self {
        let broadcast = measurement.broadcast();
        Self {
            slot: measurement.slot().0,
            gain: measurement.gain().map(Level::to_bits),
            interference: measurement.interference().map(Level::to_bits),
            last_acknowledged: measurement.last_acknowledged().map(|slot| slot.0),
            home: broadcast.home.index() as u8,
            period: broadcast.period.slots(),
            joiner_probability: broadcast.joiner_probability.code(),
        }
    }
}

impl From<&Report> for UnitFrame {
    fn from(report: &Report) -> Self {
        Self {
            slot: report.slot.0,
            transmit: match report.decision {
                Decision::Silent => None,
                Decision::Transmit { sub_channel, power } => {
                    Some((sub_channel.index() as u8, power.to_bits()))
                }
            },
            state: match report.state {
                State::Nominal => 0,
                State::Degraded => 1,
                State::Silent(Silence::NoTable) => 2,
                State::Silent(Silence::NoMeasurement) => 3,
            },
        }
    }
}

impl UnitFrame {
    /// The decision, or `None` for a sub-channel that does not exist.
    pub fn decision(&self) -> Option<Decision> {
        match self.transmit {
            None => Some(Decision::Silent),
            Some((sub_channel, power)) => Some(Decision::Transmit {
                sub_channel: SubChannel::new(sub_channel)?,
                power: Dbm::from_bits(power),
            }),
        }
    }
}

/// A frame as it goes over the wire, delimiter included.
///
/// # Errors
/// [`LinkError::Encoding`] if the frame does not fit [`MAX_FRAME`]; no frame of this module is that long.
pub fn encode<T: Serialize>(frame: &T) -> Result<Vec<u8, MAX_FRAME>, LinkError> {
    let mut plain = [0; MAX_FRAME];
    let fields =
        postcard::to_slice_crc32(frame, &mut plain, CHECKSUM.digest()).map_err(|_| LinkError::Encoding)?;
    let mut wire = Vec::new();
    wire.resize_default(MAX_FRAME).map_err(|_| LinkError::Encoding)?;
    let length = cobs::try_encode(fields, &mut wire).map_err(|_| LinkError::Encoding)?;
    wire.truncate(length);
    wire.push(0).map_err(|_| LinkError::Encoding)?;
    Ok(wire)
}
