//! What the frames say.

use super::{LinkError, StatusFrame};
use crate::decision::{Decision, POWER_CEILING};
use crate::measurement::{Broadcast, Measurement, MeasurementError, Place, Readings};
use crate::ring::{Open, Ring};
use crate::table::CHECKSUM;
use crate::unit::{Event, Report, Silence, State};
use crate::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannel, SubChannels, Weight};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Room for any frame on the wire with its delimiter. The longest measurement, of [`MAX_SUB_CHANNELS`], takes 139 bytes: 133 of fields, 4
/// of checksum, one of byte stuffing, the delimiter; one of 3 sub-channels at most 61, the longest chunk of an update 45, the longest
/// decision 18.
pub const MAX_FRAME: usize = 140;

/// Bytes of a package in one frame: the largest word that a flash writes at once ([`WORD`](crate::table_store::WORD)).
pub const CHUNK_LEN: usize = 32;

/// From the modem: one of the first two once a slot, the others now and then.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ModemFrame {
    /// The slot's readings.
    Measurement(MeasurementFrame),
    /// A slot in which the modem could not measure.
    Missed {
        /// The slot's index.
        slot: u32,
    },
    /// How long a slot is, if not 1 ms. Refused outside the range of [`crate::slot_clock::SlotLength`], and on silicon: see
    /// [`crate::session::Session::set_in_emulator`].
    SlotLength {
        /// In microseconds.
        microseconds: u32,
    },
    /// A step of a table update.
    Update(UpdateFrame),
    /// The number under which the base station knows the vehicle (LTE's C-RNTI): from now on the unit's lots are drawn under it, no
    /// longer under the chip's identity.
    Identity {
        /// The number.
        number: u32,
    },
    /// Asks for a [`StatusFrame`].
    Status,
}

/// One step of an update, of the table or of the image. Every step has an [`UpdateAnswer`], and the modem waits for it before the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateFrame {
    /// A signed package is coming.
    Begin {
        /// Its length in bytes.
        length: u32,
    },
    /// The package's next bytes, in order. The last chunk is filled up with anything. With the last one of the header the unit
    /// checks it, and only then makes room.
    Chunk {
        /// Where in the package they lie.
        offset: u32,
        /// What they are.
        bytes: [u8; CHUNK_LEN],
    },
    /// The package is complete: check it and try it.
    Commit,
    /// A signed package with an image is coming; its chunks and its commit are as a table's.
    BeginImage {
        /// Its length in bytes.
        length: u32,
    },
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
    /// The table or the image is checked and stored, and will be tried: how that goes, [`StatusFrame`](super::StatusFrame) says.
    Stored {
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
    /// The package is too short, does not fit a slot, or is not as long as its header says.
    Length,
    /// Chunks are missing.
    Incomplete,
    /// The flash does not hold what was written.
    Flash,
    /// The package's header is wrong or of a format that this unit does not know.
    Header,
    /// The table inside fails its own check, or is for another geometry or another number of sub-channels.
    Table,
    /// The version is not above all tables that were confirmed, rejected or stored, or not above the running image's, or is the largest.
    Version,
    /// The signature is not that of this unit's key.
    Signature,
    /// The table or the image is not the one that the header was signed for.
    Digest,
    /// Another table, or the running image, is on trial; begin again after its verdict.
    OnTrial,
    /// Too many erases since the start, or ever.
    Worn,
    /// The unit has no boot loader that could exchange its image.
    NoBootLoader,
}

/// From the unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UnitMessage {
    /// A slot's decision.
    Decision(UnitFrame),
    /// What became of a step of a table update.
    Update(UpdateAnswer),
    /// How the unit is.
    Status(StatusFrame),
}

/// One level for every sub-channel, in 1/256 dB over noise.
pub type Levels = Vec<i16, MAX_SUB_CHANNELS>;

/// A slot's readings as they are sent; [`Readings`] says what they mean.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasurementFrame {
    /// Index of the slot to be decided.
    pub slot: u32,
    /// Levels at full power: as many as the cell has sub-channels.
    pub gain: Levels,
    /// Noise plus interference of the slot before.
    pub interference: Levels,
    /// The latest acknowledged slot. A modem may leave it out once it is 65,535 slots old, since ages saturate there, and must
    /// before it is 2^31 slots old, from where it would lie in the future.
    pub last_acknowledged: Option<u32>,
    /// The vehicle's place in the ring, and whether it was handed out.
    pub place: Option<(u16, bool)>,
    /// Whether an acknowledgement may be under way.
    pub awaits_acknowledgement: bool,
    /// Places of the ring.
    pub places: u16,
    /// Sub-channels that are open in this slot ([`Open`]).
    pub open: u16,
    /// Least priority with which to contend in it.
    pub threshold: u32,
    /// What the sub-channels that vehicles like are drawn with.
    pub salt: u8,
    /// Whether gains still hold when they are used.
    pub gains_hold: bool,
    /// What the vehicle's age is weighed with, in 1/32.
    pub weight: u8,
    /// The most that vehicles may send with, in 1/256 dBm.
    pub max_power: i16,
}

/// A slot's decision, once a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitFrame {
    /// The decided slot.
    pub slot: u32,
    /// `None`: silent. Otherwise the sub-channel and the power in 1/256 dBm, never above [`POWER_CEILING`].
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
            Self::SlotLength { .. } | Self::Update(_) | Self::Identity { .. } | Self::Status => None,
        }
    }
}

impl MeasurementFrame {
    /// The checked measurement.
    ///
    /// # Errors
    /// The first reading that cannot be.
    pub fn measurement(&self) -> Result<Measurement, MeasurementError> {
        let ring = SubChannels::new(self.gain.len())
            .and_then(|sub_channels| Ring::new(self.places, sub_channels))
            .ok_or(MeasurementError::Ring {
                places: self.places,
                sub_channels: self.gain.len() as u8,
            })?;
        Measurement::new(&Readings {
            slot: SlotIndex(self.slot),
            gain: &levels(&self.gain),
            interference: &levels(&self.interference),
            last_acknowledged: self.last_acknowledged.map(SlotIndex),
            place: self.place.map(|(index, assigned)| Place { index, assigned }),
            weight: Weight(self.weight),
            awaits_acknowledgement: self.awaits_acknowledgement,
            broadcast: Broadcast {
                ring,
                open: Open(self.open),
                threshold: self.threshold,
                salt: self.salt,
                gains_hold: self.gains_hold,
                max_power: Dbm::from_bits(self.max_power),
            },
        })
    }
}

/// Pushed one by one, since collecting could panic as far as the compiler knows.
fn levels(bits: &Levels) -> Vec<Level, MAX_SUB_CHANNELS> {
    let mut levels = Vec::new();
    for &bits in bits {
        let _ = levels.push(Level::from_bits(bits));
    }
    levels
}

impl From<&Measurement> for MeasurementFrame {
    fn from(measurement: &Measurement) -> Self {
        let broadcast = measurement.broadcast();
        let bits = |levels: &[Level]| levels.iter().map(|level| level.to_bits()).collect();
        Self {
            slot: measurement.slot().0,
            gain: bits(measurement.gain()),
            interference: bits(measurement.interference()),
            last_acknowledged: measurement.last_acknowledged().map(|slot| slot.0),
            place: measurement.place().map(|place| (place.index, place.assigned)),
            awaits_acknowledgement: measurement.awaits_acknowledgement(),
            places: broadcast.ring.places(),
            open: broadcast.open.0,
            threshold: broadcast.threshold,
            salt: broadcast.salt,
            gains_hold: broadcast.gains_hold,
            weight: measurement.weight().0,
            max_power: broadcast.max_power.to_bits(),
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
                    Some((sub_channel.index() as u8, power.min(POWER_CEILING).to_bits()))
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
    // A place before the fields for the length of the first block.
    let mut wire = [0; MAX_FRAME];
    let (_, room) = wire.split_at_mut(1);
    let length = postcard::to_slice(frame, room)
        .map_err(|_| LinkError::Encoding)?
        .len();
    let (fields, rest) = room.split_at_mut_checked(length).ok_or(LinkError::Encoding)?;
    *rest.first_chunk_mut().ok_or(LinkError::Encoding)? = CHECKSUM.checksum(fields).to_le_bytes();
    let length = length.saturating_add(5);
    let (stuffed, rest) = wire.split_at_mut_checked(length).ok_or(LinkError::Encoding)?;
    // Every zero becomes the distance to the next; no frame has blocks as long as COBS's longest.
    let mut distance = 1_u8;
    for byte in stuffed.iter_mut().rev() {
        let next = distance.wrapping_add(1);
        if *byte == 0 {
            (*byte, distance) = (distance, 1);
        } else {
            distance = next;
        }
    }
    // The delimiter.
    *rest.first_mut().ok_or(LinkError::Encoding)? = 0;
    let wire = wire.get(..=length).ok_or(LinkError::Encoding)?;
    Vec::from_slice(wire).map_err(|_| LinkError::Encoding)
}
