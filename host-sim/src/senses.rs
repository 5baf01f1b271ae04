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
//! fn spy(senses: &host_sim::senses::Senses<'_>) -> u16 {
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

use crate::base_station::{Announcements, NO_PLACE};
use crate::imperfections::HeardBroadcasts;
use crate::lanes::{LANES, Row, Rows, Vectors, floor};
use crate::presence::Presence;
use crate::stream::WorldKey;
use firmware::measurement;
use firmware::measurement::{Broadcast, Measurement, Place};
use firmware::ring::{Open, Ring};
use firmware::units::{Age, Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, Weight};

/// What the receivers of all units take in at the beginning of a slot, before their modems round it.
#[derive(Clone, Copy, Debug)]
pub struct Readings<'t> {
    /// Gain of the slot in dB over noise at full power, `[vehicle][sub_channel][world]`.
    pub gains_db: &'t Rows<f32>,
    /// Noise plus others' power in the slot before, in dB over noise, `[vehicle][sub_channel][world]`.
    pub interferences_db: &'t Rows<f32>,
    /// Slots since the last acknowledgement, `[vehicle][world]`.
    pub ages: &'t Rows<u16>,
    /// 1 where a vehicle sent in the slot before, `[vehicle][world]`; `None` where acknowledgements come at once.
    pub sent: Option<&'t Rows<u8>>,
    /// Where those who were not told their place were last received and know it, or [`NO_PLACE`]; `[vehicle][world]`.
    pub found: &'t Rows<u16>,
    /// Slots until the last acknowledgement that may be under way has arrived, `[vehicle][world]`; `None` if they come at once.
    pub awaited: Option<&'t Rows<u8>>,
    /// What the base station assigned and broadcasts.
    pub announcements: &'t Announcements,
    /// What each vehicle last heard of its broadcasts; `None` if everybody hears all of them.
    pub heard: Option<&'t HeardBroadcasts>,
    /// Whether each modem measured in the slot: 1 or 0, `[vehicle][world]`; `None` if all did.
    pub measured: Option<&'t Rows<u8>>,
}

/// What comes between the truth and the units: an imperfection is one of these, and may contain another.
pub trait Sensing: Send + Sync {
    /// A vehicle's unit begins, with this age as it knows it in the slot that was begun last, so one more in the next: it knows nothing
    /// of who had its index before.
    fn begin_unit(&mut self, _world: usize, _vehicle: usize, _age: Age) {}

    /// Takes in the truth at the beginning of a slot, before anybody reads it.
    fn begin_slot(&mut self, slot: SlotIndex, truth: &Readings<'_>);

    /// What the units read in this slot.
    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t>;

    /// Goes on with as many other worlds before their first slot, in the same memory. `false` if it cannot: then nothing but what the
    /// scenario says comes between.
    fn reset(&mut self, _keys: &[WorldKey]) -> bool {
        false
    }

    /// The same, which goes on by itself: for [`Environment::copy`](crate::Environment::copy).
    fn copy(&self) -> Box<dyn Sensing>;
}

/// Units that read the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Perfect;

impl Sensing for Perfect {
    fn begin_slot(&mut self, _slot: SlotIndex, _truth: &Readings<'_>) {}

    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t> {
        truth
    }

    fn copy(&self) -> Box<dyn Sensing> {
        Box::new(*self)
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
            slot: self.slot,
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

    /// The numbers under which the vehicle is known, which its lots follow from ([`Identity`](firmware::lots::Identity)).
    #[inline(always)]
    pub fn identities(&self) -> &Row<u32> {
        let identities = self.readings.announcements.identities();
        identities.row(self.block, self.vehicle)
    }

    /// What the vehicle's age is weighed with ([`Weight`]).
    #[inline(always)]
    pub fn weights(&self) -> &Row<u8> {
        self.readings
            .announcements
            .weights()
            .row(self.block, self.vehicle)
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
    pub fn ages(&self) -> &Row<u16> {
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

    /// The place in the ring that is the vehicle's own, or [`NO_PLACE`], and 1 where it was handed out at association.
    #[inline(always)]
    pub fn places(&self) -> (Row<u16>, &Row<u8>) {
        let told = self.readings.announcements.told().row(self.block, self.vehicle);
        let booked = self.readings.announcements.booked().row(self.block, self.vehicle);
        let found = self.readings.found.row(self.block, self.vehicle);
        let mut places = [NO_PLACE; LANES];
        for lane in 0..LANES {
            // By a mask: of a choice the compiler makes one of addresses, lane after lane.
            let mask = u16::from(told[lane] > 0).wrapping_neg();
            places[lane] = booked[lane] & mask | found[lane] & !mask;
        }
        (places, told)
    }

    /// The same in one world.
    fn place(&self, lane: usize) -> Option<Place> {
        let announcements = self.readings.announcements;
        let assigned = announcements.told().row(self.block, self.vehicle)[lane] > 0;
        let places = if assigned {
            announcements.booked()
        } else {
            self.readings.found
        };
        let index = places.row(self.block, self.vehicle)[lane];
        (index != NO_PLACE).then_some(Place { index, assigned })
    }

    /// Slots until the last acknowledgement that may be under way has arrived.
    fn awaited_slots(&self, lane: usize) -> u8 {
        let awaited = self.readings.awaited;
        awaited.map_or(0, |awaited| awaited.row(self.block, self.vehicle)[lane])
    }

    /// The vehicle's place in the frame in which everybody has one, that of those who know nothing better. `None` where that did not get
    /// through, and where it is absent.
    pub fn frame_place(&self, lane: usize) -> Option<u16> {
        let world = self.block * LANES + lane;
        self.readings.announcements.frame_place(world, self.vehicle)
    }

    /// 1 where an acknowledgement of what the vehicle sent may be under way.
    #[inline(always)]
    pub fn awaits(&self) -> Row<u8> {
        let mut awaits = [0; LANES];
        if let Some(awaited) = self.readings.awaited {
            let awaited = awaited.row(self.block, self.vehicle);
            for lane in 0..LANES {
                awaits[lane] = u8::from(awaited[lane] > 0);
            }
        }
        awaits
    }

    /// 1 where the vehicle's modem measured in the slot, else 0; `None` where all do.
    #[inline(always)]
    pub fn measured(&self) -> Option<&Row<u8>> {
        let measured = self.readings.measured;
        measured.map(|measured| measured.row(self.block, self.vehicle))
    }

    /// What the vehicle last heard, where not everybody hears all.
    #[inline(always)]
    pub fn heard(&self) -> Option<Heard<'_>> {
        self.readings
            .heard
            .map(|heard| heard.of(self.block, self.vehicle))
    }

    /// What the vehicle knows from the base station in a world of the row. `None` where it is absent, and where the ring cannot be
    /// announced.
    pub fn broadcast(&self, lane: usize) -> Option<Broadcast> {
        let world = self.block * LANES + lane;
        if self.readings.announcements.associated().get(world, self.vehicle) == 0 {
            return None;
        }
        let now = self.readings.announcements.broadcast(world)?;
        let Some(heard) = self.heard() else {
            return Some(now);
        };
        Some(Broadcast {
            ring: Ring::new(heard.places[lane], now.ring.sub_channels())?,
            open: Open(heard.open[lane]),
            threshold: heard.thresholds[lane],
            salt: heard.salts[lane],
            ..now
        })
    }

    /// What the vehicle's modem measures in a world of the row; `None` as [`Senses::broadcast`], and where it measures nothing.
    pub fn measurement(&self, lane: usize) -> Option<Measurement> {
        if self.measured().is_some_and(|measured| measured[lane] == 0) {
            return None;
        }
        let broadcast = self.broadcast(lane)?;
        let count = broadcast.ring.sub_channels().count();
        let levels = |values: &Rows<f32>| {
            let mut levels = [Level::ZERO; MAX_SUB_CHANNELS];
            for (sub_channel, bits) in levels.iter_mut().enumerate().take(count) {
                let row = values.row(self.block, self.vehicle * count + sub_channel);
                *bits = Level::from_bits(level(row[lane]) as i16);
            }
            levels
        };
        let (gain, interference) = (
            levels(self.readings.gains_db),
            levels(self.readings.interferences_db),
        );
        let age = u32::from(self.ages()[lane]);
        let heard = age < u32::from(Age::MAX.slots());
        Measurement::new(&measurement::Readings {
            slot: self.slot,
            gain: &gain[..count],
            interference: &interference[..count],
            last_acknowledged: heard.then(|| SlotIndex(self.slot.0.wrapping_sub(age))),
            place: self.place(lane),
            weight: Weight(self.weights()[lane]),
            awaits_acknowledgement: self.awaited_slots(lane) > 0,
            broadcast,
        })
        .ok()
    }
}

/// What everybody in a row of worlds can hear in a slot.
#[derive(Clone, Copy, Debug)]
pub struct Broadcasts<'t> {
    slot: SlotIndex,
    block: usize,
    worlds: usize,
    presence: &'t Presence,
    announcements: &'t Announcements,
}

impl Broadcasts<'_> {
    /// The slot that is about to be decided.
    pub fn slot(&self) -> SlotIndex {
        self.slot
    }

    /// How many worlds of the row there are.
    pub fn worlds(&self) -> usize {
        self.worlds
    }

    /// How many vehicles share the cell in a world of the row.
    pub fn vehicles(&self, lane: usize) -> usize {
        self.presence.count(self.block * LANES + lane)
    }

    /// The ring in a world of the row; `None` where it cannot be announced.
    pub fn ring(&self, lane: usize) -> Option<Ring> {
        self.announcements.ring(self.block * LANES + lane)
    }

    /// The frame in which everybody has a place, in a world of the row; `None` where it cannot be announced.
    pub fn frame(&self, lane: usize) -> Option<Ring> {
        self.announcements.frame(self.block * LANES + lane)
    }

    /// The first place of the slot.
    #[inline(always)]
    pub fn first_places(&self) -> &Row<u16> {
        self.announcements.first_places().row(self.block, 0)
    }

    /// Which sub-channels are open ([`Open`]).
    #[inline(always)]
    pub fn open(&self) -> &Row<u16> {
        self.announcements.open().row(self.block, 0)
    }

    /// The least priorities with which to contend.
    #[inline(always)]
    pub fn thresholds(&self) -> &Row<u32> {
        self.announcements.thresholds().row(self.block, 0)
    }

    /// What the sub-channels that vehicles like are drawn with.
    #[inline(always)]
    pub fn salts(&self) -> &Row<u8> {
        self.announcements.salts().row(self.block, 0)
    }

    /// Whether gains still hold when they are used.
    pub fn gains_hold(&self) -> bool {
        self.announcements.gains_hold()
    }

    /// The most that vehicles may send with.
    pub fn max_power(&self) -> Dbm {
        self.announcements.max_power()
    }
}

/// What one vehicle last heard of the broadcasts, in a row of worlds.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'t> {
    /// How many places the ring has; 0 where it never heard.
    pub places: &'t Row<u16>,
    /// Which sub-channels are open in this slot ([`Open`]), as far as it knows.
    pub open: &'t Row<u16>,
    /// The least priority with which to contend in it.
    pub thresholds: &'t Row<u32>,
    /// What the sub-channels that it likes are drawn with.
    pub salts: &'t Row<u8>,
}

/// dB as units measure it, in 1/256 dB: rounded down, so that a vehicle never believes to be heard where it is not, and within
/// the receiver's range of -128 to +127.996 dB.
#[inline(always)]
fn level(db: f32) -> i32 {
    floor((db * 256.0).clamp(-32_768.0, 32_767.0))
}
