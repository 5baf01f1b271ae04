//! The border at which what is true in a cell becomes what a unit senses.
//!
//! [`Readings`] is what the units' receivers take in at the beginning of a slot. In an ideal cell it is the truth; a [`Sensing`]
//! may come between, such as one whose gains are late or whose acknowledgements are lost, and it does so for everybody who
//! asks: the units of one world, rows of worlds, images in QEMU, Python's arrays and the page. [`Senses`] is what one vehicle's
//! modem makes of it: levels in 1/256 dB, nothing about other vehicles.
//!
//! A decentralised [`Policy`](crate::policy::Policy) gets [`Senses`] and nothing else. Other vehicles' ages and true gains are
//! not in it:
//!
//! ```compile_fail,E0061
//! fn spy(senses: &host_sim::senses::Senses<'_>) -> u8 {
//!     let other_vehicle = 7;
//!     senses.ages(other_vehicle)[0]
//! }
//! ```
//!
//! ```compile_fail,E0599
//! fn clairvoyant(senses: &host_sim::senses::Senses<'_>) -> f32 {
//!     senses.gains_db().get(0, 0)
//! }
//! ```
//!
//! ```compile_fail,E0616
//! fn intruder(senses: &host_sim::senses::Senses<'_>) -> f32 {
//!     senses.readings.gains_db.get(0, 0)
//! }
//! ```

use crate::base_station::Announcements;
use crate::imperfections::HeardBroadcasts;
use crate::lanes::{LANES, Row, Rows, Vectors, floor};
use crate::presence::Presence;
use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, JoinerProbability, Level, Period, SUB_CHANNELS, SlotIndex};

/// What the receivers of all units take in at the beginning of a slot, before their modems round it.
#[derive(Clone, Copy, Debug)]
pub struct Readings<'t> {
    /// Gain of the slot in dB over noise at full power, `[vehicle][sub_channel][world]`.
    pub gains_db: &'t Rows<f32>,
    /// Noise plus others' power in the slot before, in dB over noise, `[vehicle][sub_channel][world]`.
    pub interferences_db: &'t Rows<f32>,
    /// Slots since the last acknowledgement, `[vehicle][world]`.
    pub ages: &'t Rows<u8>,
    /// What the base station assigned and broadcasts.
    pub announcements: &'t Announcements,
    /// What each vehicle last heard of its broadcasts; `None` if everybody hears all of them.
    pub heard: Option<&'t HeardBroadcasts>,
    /// Whether each modem measured in the slot: 1 or 0, `[vehicle][world]`; `None` if all did.
    pub measured: Option<&'t Rows<u8>>,
}

/// What comes between the truth and the units: an imperfection is one of these, and may contain another.
pub trait Sensing: Send + Sync {
    /// A vehicle's unit begins in the next slot, with this age as it knows it: it knows nothing of who had its index before.
    fn begin_unit(&mut self, _world: usize, _vehicle: usize, _age: Age) {}

    /// Takes in the truth at the beginning of a slot, before anybody reads it.
    fn begin_slot(&mut self, slot: SlotIndex, truth: &Readings<'_>);

    /// What the units read in this slot.
    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t>;
}

/// Units that read the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Perfect;

impl Sensing for Perfect {
    fn begin_slot(&mut self, _slot: SlotIndex, _truth: &Readings<'_>) {}

    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t> {
        truth
    }
}

/// All units of a batch of worlds in one slot; [`AllSenses::of`] is one vehicle's part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AllSenses<'t> {
    pub(crate) slot: SlotIndex,
    pub(crate) vectors: Vectors,
    pub(crate) worlds: usize,
    pub(crate) sub_channels: usize,
    pub(crate) presence: &'t Presence,
    /// Slots since the start.
    pub(crate) elapsed: u32,
    /// Slot, counted from the start, in which each vehicle associated. `[vehicle][world]`.
    pub(crate) associated_at: &'t Rows<u32>,
    pub(crate) readings: Readings<'t>,
}

impl<'t> AllSenses<'t> {
    /// What a vehicle senses in a row of worlds.
    #[inline(always)]
    pub(crate) fn of(&self, block: usize, vehicle: usize) -> Senses<'t> {
        Senses {
            slot: self.slot,
            vectors: self.vectors,
            worlds: (self.worlds - block * LANES).min(LANES),
            sub_channels: self.sub_channels,
            block,
            vehicle,
            here: self.presence.rows().map(|here| here.row(block, vehicle)),
            elapsed: self.elapsed,
            associated_at: self.associated_at,
            readings: self.readings,
        }
    }

    /// What everybody in a row of worlds can hear.
    pub(crate) fn broadcasts(&self, block: usize) -> Broadcasts<'t> {
        Broadcasts {
            block,
            worlds: (self.worlds - block * LANES).min(LANES),
            presence: self.presence,
            announcements: self.readings.announcements,
        }
    }
}

/// What one vehicle senses at the beginning of a slot, in a row of worlds.
#[derive(Clone, Copy, Debug)]
pub struct Senses<'t> {
    slot: SlotIndex,
    vectors: Vectors,
    worlds: usize,
    sub_channels: usize,
    block: usize,
    vehicle: usize,
    here: Option<&'t Row<u8>>,
    elapsed: u32,
    associated_at: &'t Rows<u32>,
    readings: Readings<'t>,
}

impl Senses<'_> {
    /// The slot that is about to be decided.
    pub fn slot(&self) -> SlotIndex {
        self.slot
    }

    /// The vector unit for loops over the row.
    #[inline(always)]
    pub fn vectors(&self) -> Vectors {
        self.vectors
    }

    /// How many worlds of the row there are; lanes behind them mean nothing.
    #[inline(always)]
    pub fn worlds(&self) -> usize {
        self.worlds
    }

    /// Which row of worlds.
    #[inline(always)]
    pub fn block(&self) -> usize {
        self.block
    }

    /// Which vehicle senses.
    #[inline(always)]
    pub fn vehicle(&self) -> usize {
        self.vehicle
    }

    /// How many sub-channels the cell has.
    #[inline(always)]
    pub fn sub_channels(&self) -> usize {
        self.sub_channels
    }

    /// Whether the vehicle is present in a world of the row; where it is not, its decision counts for nothing.
    #[inline(always)]
    pub fn is_present(&self, lane: usize) -> bool {
        self.here.is_none_or(|here| here[lane] > 0)
    }

    /// Whether the vehicle associates in this slot in a world of the row: it knows nothing of who had its index before, and has
    /// sensed no slot yet.
    #[inline(always)]
    pub fn is_new(&self, lane: usize) -> bool {
        self.associated_at.row(self.block, self.vehicle)[lane] == self.elapsed
    }

    /// The vehicle's age of information at the beginning of the slot, in slots.
    #[inline(always)]
    pub fn ages(&self) -> &Row<u8> {
        self.readings.ages.row(self.block, self.vehicle)
    }

    /// The level at which the base station would receive the vehicle on a sub-channel at full power, in 1/256 dB over noise.
    #[inline(always)]
    pub fn gain(&self, sub_channel: usize) -> Row<i32> {
        self.levels(self.readings.gains_db, sub_channel)
    }

    /// Noise plus others' power on a sub-channel in the slot before, in 1/256 dB over noise.
    #[inline(always)]
    pub fn interference(&self, sub_channel: usize) -> Row<i32> {
        self.levels(self.readings.interferences_db, sub_channel)
    }

    #[inline(always)]
    fn levels(&self, values_db: &Rows<f32>, sub_channel: usize) -> Row<i32> {
        let values_db = values_db.row(self.block, self.vehicle * self.sub_channels + sub_channel);
        let mut levels = [0; LANES];
        for lane in 0..LANES {
            levels[lane] = level(values_db[lane]);
        }
        levels
    }

    /// The sub-channel of the vehicle's group; none of theirs where it has no group.
    #[inline(always)]
    pub fn homes(&self) -> &Row<u8> {
        self.readings.announcements.homes().row(self.block, self.vehicle)
    }

    /// The slot of its group's frame that was handed to the vehicle at association, and is its own as long as it is told no other
    /// one. `None` where that did not get through, and where it is absent.
    pub fn position(&self, lane: usize) -> Option<u16> {
        let world = self.block * LANES + lane;
        self.readings.announcements.position(world, self.vehicle)
    }

    /// The age in slots up to which the vehicle keeps its turn, which follows from its period.
    #[inline(always)]
    pub fn turns_lost_after(&self) -> &Row<u8> {
        if let Some(heard) = self.readings.heard {
            return heard.turns_lost_after(self.block, self.vehicle);
        }
        let ages = self.readings.announcements.turns_lost_after();
        ages.row(self.block, self.vehicle)
    }

    /// What the vehicle last heard of its group's broadcast, where not everybody hears all: periods in slots, 0 where it is too
    /// long to be announced, and codes of the joiner probability.
    #[inline(always)]
    pub fn heard(&self) -> Option<(&Row<u8>, &Row<u8>)> {
        self.readings.heard.map(|heard| {
            (
                heard.periods(self.block, self.vehicle),
                heard.joiner_codes(self.block, self.vehicle),
            )
        })
    }

    /// What the vehicle knows from the base station in a world of the row. `None` where it is absent, in a group that is too
    /// large, or on a sub-channel that units do not know.
    pub fn broadcast(&self, lane: usize) -> Option<Broadcast> {
        let world = self.block * LANES + lane;
        let now = self.readings.announcements.broadcast(world, self.vehicle)?;
        let Some((periods, codes)) = self.heard() else {
            return Some(now);
        };
        Some(Broadcast {
            period: Period::new(periods[lane])?,
            joiner_probability: JoinerProbability::from_code(codes[lane]),
            ..now
        })
    }

    /// What the vehicle's modem measures in a world of the row; `None` as [`Senses::broadcast`], and where it measures nothing.
    pub fn measurement(&self, lane: usize) -> Option<Measurement> {
        if let Some(measured) = self.readings.measured
            && measured.row(self.block, self.vehicle)[lane] == 0
        {
            return None;
        }
        let broadcast = self.broadcast(lane)?;
        let levels = |values: &Rows<f32>| -> [Level; SUB_CHANNELS] {
            std::array::from_fn(|sub_channel| {
                let row = values.row(self.block, self.vehicle * SUB_CHANNELS + sub_channel);
                Level::from_bits(level(row[lane]) as i16)
            })
        };
        let (gain, interference) = (
            levels(self.readings.gains_db),
            levels(self.readings.interferences_db),
        );
        let age = u32::from(self.ages()[lane]);
        let heard = age < u32::from(Age::MAX.slots());
        let last_acknowledged = heard.then(|| SlotIndex(self.slot.0 - age));
        Measurement::new(self.slot, gain, interference, last_acknowledged, broadcast).ok()
    }
}

/// What everybody in a row of worlds can hear in a slot.
#[derive(Clone, Copy, Debug)]
pub struct Broadcasts<'t> {
    block: usize,
    worlds: usize,
    presence: &'t Presence,
    announcements: &'t Announcements,
}

impl Broadcasts<'_> {
    /// How many worlds of the row there are.
    pub fn worlds(&self) -> usize {
        self.worlds
    }

    /// How many vehicles share the cell in a world of the row.
    pub fn vehicles(&self, lane: usize) -> usize {
        self.presence.count(self.block * LANES + lane)
    }

    /// The announced period of a group in slots, 0 where it is too long to be announced.
    #[inline(always)]
    pub fn periods(&self, group: usize) -> &Row<u8> {
        self.announcements.periods().row(self.block, group)
    }

    /// The code of a group's joiner probability in a world of the row.
    #[inline(always)]
    pub fn joiner_code(&self, lane: usize, group: usize) -> u8 {
        self.announcements.joiner_code(self.block * LANES + lane, group)
    }
}

/// dB as units measure it, in 1/256 dB: rounded down, so that a vehicle never believes to be heard where it is not, and within
/// the receiver's range of -128 to +127.996 dB.
#[inline(always)]
fn level(db: f32) -> i32 {
    floor((db * 256.0).clamp(-32_768.0, 32_767.0))
}
