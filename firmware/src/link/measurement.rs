//! A slot's readings as they are sent. Every field has its place, so that a unit reads them without looking for them.

use super::Levels;
use crate::measurement::{Broadcast, Measurement, MeasurementError, Place, Readings};
use crate::ring::{Open, Ring};
use crate::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannels, Weight};

/// A slot's readings as they are sent; [`Readings`] says what they mean.
///
/// # Layout
/// Numbers of several bytes are little-endian, levels and powers two's complement.
///
/// | byte | bytes | field |
/// |---|---|---|
/// | 0 | 1 | 6, this kind of frame |
/// | 1 | 1 | sub-channels |
/// | 2 | 1 | bits from the lowest: acknowledged ever, has a place, it was handed out, awaits an acknowledgement, gains hold; the others are 0 |
/// | 3 | 1 | weight |
/// | 4 | 4 | slot |
/// | 8 | 4 | last acknowledged slot, if ever |
/// | 12 | 4 | threshold |
/// | 16 | 2 | places of the ring |
/// | 18 | 2 | place, if any |
/// | 20 | 2 | open sub-channels |
/// | 22 | 2 | most power |
/// | 24 | 1 | salt |
/// | 25 | 2 each | gains, then interferences |
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeasurementFrame {
    /// Index of the slot to be decided.
    pub slot: u32,
    /// Levels at full power: as many as the cell has sub-channels.
    pub gain: Levels,
    /// Noise plus interference of the slot before, for as many.
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

/// The kind of frame, in its first byte.
pub(super) const KIND: u8 = 6;
/// Bytes before the levels.
const FIXED: usize = 25;

/// Bits of the flags.
const ACKNOWLEDGED: u8 = 1;
const HAS_PLACE: u8 = 1 << 1;
const ASSIGNED: u8 = 1 << 2;
const AWAITS: u8 = 1 << 3;
const GAINS_HOLD: u8 = 1 << 4;
const FLAGS: u8 = ACKNOWLEDGED | HAS_PLACE | ASSIGNED | AWAITS | GAINS_HOLD;

impl MeasurementFrame {
    /// Writes the layout. The length, or `None` if there is no room or not an interference for each gain.
    pub(super) fn write(&self, room: &mut [u8]) -> Option<usize> {
        let (place, assigned) = self.place.unwrap_or_default();
        let flag = |is_set: bool, bit: u8| if is_set { bit } else { 0 };
        let flags = flag(self.last_acknowledged.is_some(), ACKNOWLEDGED)
            | flag(self.place.is_some(), HAS_PLACE)
            | flag(assigned, ASSIGNED)
            | flag(self.awaits_acknowledgement, AWAITS)
            | flag(self.gains_hold, GAINS_HOLD);
        let (fixed, levels) = room.split_first_chunk_mut::<FIXED>()?;
        let (kind, count, weight, salt) = (KIND, self.gain.len() as u8, self.weight, self.salt);
        let [s0, s1, s2, s3] = self.slot.to_le_bytes();
        let [a0, a1, a2, a3] = self.last_acknowledged.unwrap_or_default().to_le_bytes();
        let [t0, t1, t2, t3] = self.threshold.to_le_bytes();
        let ([r0, r1], [p0, p1]) = (self.places.to_le_bytes(), place.to_le_bytes());
        let ([o0, o1], [m0, m1]) = (self.open.to_le_bytes(), self.max_power.to_le_bytes());
        #[rustfmt::skip]
        let bytes = [
            kind, count, flags, weight,
            s0, s1, s2, s3, a0, a1, a2, a3, t0, t1, t2, t3,
            r0, r1, p0, p1, o0, o1, m0, m1, salt,
        ];
        *fixed = bytes;
        if self.interference.len() != self.gain.len() {
            return None;
        }
        let length = self.gain.len().saturating_mul(4);
        let (places, _) = levels.get_mut(..length)?.as_chunks_mut();
        for (place, level) in places.iter_mut().zip(self.gain.iter().chain(&self.interference)) {
            *place = level.to_le_bytes();
        }
        Some(FIXED.saturating_add(length))
    }

    /// Reads the layout; `None` for any other bytes.
    pub(super) fn read(fields: &[u8]) -> Option<Self> {
        let layout = Layout::of(fields)?;
        // Pushed one by one, since collecting could panic as far as the compiler knows.
        let levels = |bytes: &[[u8; 2]]| {
            let mut levels = Levels::new();
            for &bytes in bytes {
                let _ = levels.push(i16::from_le_bytes(bytes));
            }
            levels
        };
        Some(Self {
            slot: layout.slot,
            gain: levels(layout.gain),
            interference: levels(layout.interference),
            last_acknowledged: layout.last_acknowledged(),
            place: layout.place(),
            awaits_acknowledgement: layout.has(AWAITS),
            places: layout.places,
            open: layout.open,
            threshold: layout.threshold,
            salt: layout.salt,
            gains_hold: layout.has(GAINS_HOLD),
            weight: layout.weight,
            max_power: layout.max_power,
        })
    }

    /// The checked measurement.
    ///
    /// # Errors
    /// The first reading that cannot be.
    pub fn measurement(&self) -> Result<Measurement, MeasurementError> {
        let mut fields = [0; FIXED + 4 * MAX_SUB_CHANNELS];
        let length = self.write(&mut fields);
        let layout = length.and_then(|length| Layout::of(fields.get(..length)?));
        layout
            .ok_or(MeasurementError::SubChannels {
                found: self.interference.len() as u8,
                expected: self.gain.len() as u8,
            })?
            .measurement()
    }
}

/// The checked measurement of a frame's fields; `None` if they are another frame's.
#[inline(always)]
pub fn measurement(fields: &[u8]) -> Option<Result<Measurement, MeasurementError>> {
    Some(Layout::of(fields)?.measurement())
}

/// Fields at their places.
struct Layout<'f> {
    flags: u8,
    weight: u8,
    slot: u32,
    last_acknowledged: u32,
    threshold: u32,
    places: u16,
    place: u16,
    open: u16,
    max_power: i16,
    salt: u8,
    gain: &'f [[u8; 2]],
    interference: &'f [[u8; 2]],
}

impl<'f> Layout<'f> {
    #[inline(always)]
    fn of(fields: &'f [u8]) -> Option<Self> {
        let (fixed, levels) = fields.split_first_chunk::<FIXED>()?;
        #[rustfmt::skip]
        let [
            kind, count, flags, weight,
            s0, s1, s2, s3, a0, a1, a2, a3, t0, t1, t2, t3,
            r0, r1, p0, p1, o0, o1, m0, m1, salt,
        ] = *fixed;
        let (levels, odd) = levels.as_chunks();
        let (gain, interference) = levels.split_at_checked(count.into())?;
        let fits = interference.len() == gain.len() && gain.len() <= MAX_SUB_CHANNELS && odd.is_empty();
        (kind == KIND && flags & !FLAGS == 0 && fits).then_some(Self {
            flags,
            weight,
            slot: u32::from_le_bytes([s0, s1, s2, s3]),
            last_acknowledged: u32::from_le_bytes([a0, a1, a2, a3]),
            threshold: u32::from_le_bytes([t0, t1, t2, t3]),
            places: u16::from_le_bytes([r0, r1]),
            place: u16::from_le_bytes([p0, p1]),
            open: u16::from_le_bytes([o0, o1]),
            max_power: i16::from_le_bytes([m0, m1]),
            salt,
            gain,
            interference,
        })
    }

    #[inline(always)]
    const fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }

    #[inline(always)]
    fn last_acknowledged(&self) -> Option<u32> {
        self.has(ACKNOWLEDGED).then_some(self.last_acknowledged)
    }

    #[inline(always)]
    fn place(&self) -> Option<(u16, bool)> {
        self.has(HAS_PLACE).then_some((self.place, self.has(ASSIGNED)))
    }

    #[inline(always)]
    fn measurement(&self) -> Result<Measurement, MeasurementError> {
        let ring = SubChannels::new(self.gain.len())
            .and_then(|sub_channels| Ring::new(self.places, sub_channels))
            .ok_or(MeasurementError::Ring {
                places: self.places,
                sub_channels: self.gain.len() as u8,
            })?;
        let readings = Readings {
            slot: SlotIndex(self.slot),
            gain: &[],
            interference: &[],
            last_acknowledged: self.last_acknowledged().map(SlotIndex),
            place: self.place().map(|(index, assigned)| Place { index, assigned }),
            weight: Weight(self.weight),
            awaits_acknowledgement: self.has(AWAITS),
            broadcast: Broadcast {
                ring,
                open: Open(self.open),
                threshold: self.threshold,
                salt: self.salt,
                gains_hold: self.has(GAINS_HOLD),
                max_power: Dbm::from_bits(self.max_power),
            },
        };
        Measurement::with_levels(&readings, levels(self.gain), levels(self.interference))
    }
}

/// Levels of all sub-channels that a cell may have.
#[inline(always)]
fn levels(bytes: &[[u8; 2]]) -> [Level; MAX_SUB_CHANNELS] {
    let mut levels = [Level::ZERO; MAX_SUB_CHANNELS];
    for (level, bytes) in levels.iter_mut().zip(bytes) {
        // Kept from the optimiser, which would call a function that copies any length.
        *level = Level::from_le_bytes(*core::hint::black_box(bytes));
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
