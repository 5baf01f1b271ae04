//! What the frames say.

use super::{LinkError, MeasurementFrame, StatusFrame, measurement};
use crate::decision::{Decision, POWER_CEILING};
use crate::table::CHECKSUM;
use crate::unit::{Report, Silence, State};
use crate::units::{Dbm, MAX_SUB_CHANNELS, SubChannel};
use heapless::Vec;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Room for any frame on the wire with its delimiter. The longest measurement, of [`MAX_SUB_CHANNELS`], takes 95 bytes: 89 of fields, 4
/// of checksum, one of byte stuffing, the delimiter; one of 3 sub-channels 43, the longest chunk of an update 45, the longest status 80, a
/// decision 15.
pub const MAX_FRAME: usize = 96;

/// The version of all frames, raised with each change. A unit tells it to whoever says hello; that question and its answer never change.
pub const PROTOCOL: u8 = 2;

/// Bytes of a package in one frame: the largest word that a flash writes at once ([`WORD`](crate::table_store::WORD)).
pub const CHUNK_LEN: usize = 32;

/// From the modem: a measurement or a miss once a slot, the others now and then.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ModemFrame {
    /// Asks for the unit's [`PROTOCOL`].
    Hello,
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
    /// The slot's readings. The last, since its layout is its own.
    #[serde(skip)]
    Measurement(MeasurementFrame),
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
    /// Which frames the unit speaks.
    Hello {
        /// Its [`PROTOCOL`].
        protocol: u8,
    },
    /// What became of a step of a table update.
    Update(UpdateAnswer),
    /// How the unit is.
    Status(StatusFrame),
    /// A slot's decision. The last, since its layout is its own.
    #[serde(skip)]
    Decision(UnitFrame),
}

/// One level for every sub-channel, in 1/256 dB over noise.
pub type Levels = Vec<i16, MAX_SUB_CHANNELS>;

/// A slot's decision, once a slot.
///
/// # Layout
///
/// | byte | bytes | field |
/// |---|---|---|
/// | 0 | 1 | 3, this kind of message |
/// | 1 | 4 | slot, little-endian |
/// | 5 | 1 | sub-channel, 255 for silence |
/// | 6 | 2 | power, little-endian and two's complement; 0 for silence |
/// | 8 | 1 | state |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnitFrame {
    /// The decided slot.
    pub slot: u32,
    /// `None`: silent. Otherwise the sub-channel and the power in 1/256 dBm, never above [`POWER_CEILING`].
    pub transmit: Option<(u8, i16)>,
    /// [`State`]: 0 nominal, 1 degraded, 2 silent without a table, 3 silent without a measurement.
    pub state: u8,
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

/// The kind of message, in its first byte.
const DECISION_KIND: u8 = 3;
/// Bytes of a decision.
const DECISION: usize = 9;
/// In place of a sub-channel.
const SILENCE: u8 = u8::MAX;

impl UnitFrame {
    const fn layout(&self) -> [u8; DECISION] {
        let (sub_channel, power) = match self.transmit {
            Some(transmit) => transmit,
            None => (SILENCE, 0),
        };
        let [s0, s1, s2, s3] = self.slot.to_le_bytes();
        let [p0, p1] = power.to_le_bytes();
        [DECISION_KIND, s0, s1, s2, s3, sub_channel, p0, p1, self.state]
    }

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

/// What goes over the line.
pub trait Frame: Sized {
    /// Writes the fields. Their length, or `None` if they do not fit.
    fn write(&self, room: &mut [u8]) -> Option<usize>;

    /// The frame of these fields, if they are one's.
    fn read(fields: &[u8]) -> Option<Self>;
}

impl Frame for ModemFrame {
    fn write(&self, room: &mut [u8]) -> Option<usize> {
        match self {
            Self::Measurement(measurement) => measurement.write(room),
            _ => write(self, room),
        }
    }

    #[inline(always)]
    fn read(fields: &[u8]) -> Option<Self> {
        match fields.first() {
            Some(&measurement::KIND) => MeasurementFrame::read(fields).map(Self::Measurement),
            _ => read(fields),
        }
    }
}

impl Frame for UnitMessage {
    #[inline(always)]
    fn write(&self, room: &mut [u8]) -> Option<usize> {
        match self {
            Self::Decision(decision) => {
                *room.first_chunk_mut()? = decision.layout();
                Some(DECISION)
            }
            _ => write(self, room),
        }
    }

    fn read(fields: &[u8]) -> Option<Self> {
        match *fields {
            [DECISION_KIND, s0, s1, s2, s3, sub_channel, p0, p1, state] => {
                let slot = u32::from_le_bytes([s0, s1, s2, s3]);
                let power = i16::from_le_bytes([p0, p1]);
                let transmit = (sub_channel != SILENCE).then_some((sub_channel, power));
                Some(Self::Decision(UnitFrame {
                    slot,
                    transmit,
                    state,
                }))
            }
            _ => read(fields),
        }
    }
}

fn write(frame: &impl Serialize, room: &mut [u8]) -> Option<usize> {
    Some(postcard::to_slice(frame, room).ok()?.len())
}

fn read<T: DeserializeOwned>(fields: &[u8]) -> Option<T> {
    // Bytes behind the fields belong to no frame.
    postcard::take_from_bytes(fields)
        .ok()
        .and_then(|(frame, rest)| rest.is_empty().then_some(frame))
}

/// A frame as it goes over the wire, delimiter included.
///
/// # Errors
/// [`LinkError::Encoding`] if the frame does not fit [`MAX_FRAME`]; no frame of this module is that long.
pub fn encode<T: Frame>(frame: &T) -> Result<Vec<u8, MAX_FRAME>, LinkError> {
    let mut wire = [0; MAX_FRAME];
    let length = encode_into(frame, &mut wire)?;
    let wire = wire.get(..length).ok_or(LinkError::Encoding)?;
    Vec::from_slice(wire).map_err(|_| LinkError::Encoding)
}

/// The same into memory that is there. Gives the length.
///
/// # Errors
/// [`LinkError::Encoding`] if the frame does not fit.
pub fn encode_into<T: Frame>(frame: &T, wire: &mut [u8]) -> Result<usize, LinkError> {
    // A place before the fields for the length of the first block.
    let (first, room) = wire.split_first_mut().ok_or(LinkError::Encoding)?;
    *first = 0;
    let length = frame.write(room).ok_or(LinkError::Encoding)?;
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
    Ok(length.saturating_add(1))
}
