//! Readings with everything plain but what a test is about, and what they mean, computed apart from the library.

use firmware::lots::Identity;
use firmware::measurement::{self, Broadcast, Measurement, MeasurementError, Place};
use firmware::observation::Observation;
use firmware::ring::{MAX_PLACES, Open, Ring};
use firmware::unit::Event;
use firmware::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannels, Weight};
use proptest::prelude::*;

/// One slot's readings of one vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Readings {
    pub slot: u32,
    pub sub_channels: usize,
    /// The first `sub_channels` of them are read.
    pub gain: [i16; MAX_SUB_CHANNELS],
    pub interference: [i16; MAX_SUB_CHANNELS],
    /// Slots since the last acknowledged one.
    pub age: Option<u32>,
    /// Index, and whether it was handed out.
    pub place: Option<(u16, bool)>,
    pub awaits: bool,
    pub weight: u8,
    pub places: u16,
    pub open: u16,
    pub threshold: u32,
    pub salt: u8,
    pub gains_hold: bool,
    pub max_power: i16,
    pub identity: u32,
}

impl Default for Readings {
    fn default() -> Self {
        Self {
            slot: 1_000,
            sub_channels: 3,
            gain: [25 << 8; MAX_SUB_CHANNELS],
            interference: [0; MAX_SUB_CHANNELS],
            age: Some(1),
            place: Some((0, true)),
            awaits: false,
            weight: 32,
            places: 20,
            open: 0,
            threshold: u32::MAX,
            salt: 0,
            gains_hold: true,
            max_power: 23 << 8,
            identity: 7,
        }
    }
}

impl Readings {
    pub fn read(&self) -> Result<Measurement, MeasurementError> {
        let levels = |bits: &[i16; MAX_SUB_CHANNELS]| bits.map(Level::from_bits);
        let sub_channels = SubChannels::new(self.sub_channels).unwrap();
        Measurement::new(&measurement::Readings {
            slot: SlotIndex(self.slot),
            gain: &levels(&self.gain)[..self.sub_channels],
            interference: &levels(&self.interference)[..self.sub_channels],
            last_acknowledged: self.age.map(|age| SlotIndex(self.slot.wrapping_sub(age))),
            place: self.place.map(|(index, assigned)| Place { index, assigned }),
            weight: Weight(self.weight),
            awaits_acknowledgement: self.awaits,
            broadcast: Broadcast {
                ring: Ring::new(self.places, sub_channels).unwrap(),
                open: Open(self.open),
                threshold: self.threshold,
                salt: self.salt,
                gains_hold: self.gains_hold,
                max_power: Dbm::from_bits(self.max_power),
            },
        })
    }

    pub fn measurement(&self) -> Measurement {
        self.read().unwrap()
    }

    pub fn event(&self) -> Event {
        Event::Measured(self.measurement())
    }

    pub fn identity(&self) -> Identity {
        Identity(self.identity)
    }

    pub fn observation(&self) -> Observation {
        Observation::new(&self.measurement(), self.identity())
    }

    /// The slot's sub-channels in the order of the places that they carry, with these places.
    pub fn carried(&self) -> Vec<(usize, u64)> {
        let (slot, count) = (u64::from(self.slot), self.sub_channels as u64);
        let hash = (slot * 0x9e37_79b1) & 0xffff_ffff;
        let hop = ((hash >> 16) * count) >> 16;
        (0..count)
            .map(|offset| {
                let sub_channel = (offset + hop) % count;
                (
                    sub_channel as usize,
                    (slot * count + offset) % u64::from(self.places),
                )
            })
            .collect()
    }

    /// The sub-channel that carries the vehicle's own place.
    pub fn own(&self) -> Option<usize> {
        let (index, _) = self.place?;
        let carried = self.carried();
        let own = carried.iter().find(|&&(_, place)| place == u64::from(index))?;
        Some(own.0)
    }

    /// The open sub-channels in the order of the places that they carry.
    pub fn open(&self) -> Vec<usize> {
        let carried = self.carried().into_iter().map(|(sub_channel, _)| sub_channel);
        carried
            .filter(|&sub_channel| self.open & 1 << sub_channel != 0)
            .collect()
    }

    /// Of the sub-channels that carry others' places the one with the largest gain, of equal ones the first.
    pub fn guest(&self) -> Option<usize> {
        let (own, open) = (self.own(), self.open());
        let carried = self.carried().into_iter().map(|(sub_channel, _)| sub_channel);
        let others = carried.filter(|sub_channel| Some(*sub_channel) != own && !open.contains(sub_channel));
        // The lowest level of all stands for none.
        let others = others.filter(|&sub_channel| self.gain[sub_channel] > i16::MIN);
        others.rev().max_by_key(|&sub_channel| self.gain[sub_channel])
    }

    /// The age as it saturates.
    pub fn slots(&self) -> u32 {
        self.age.unwrap_or(u32::MAX).min(65_535)
    }
}

/// Everything that a measurement can say.
pub fn any_readings() -> impl Strategy<Value = Readings> {
    let cell = (
        1..=MAX_SUB_CHANNELS,
        prop_oneof![0..60_u16, 0..=MAX_PLACES],
        any::<u16>(),
        prop_oneof![any::<u32>(), 0..1_u32 << 26, Just(0), Just(u32::MAX)],
        any::<u8>(),
        any::<bool>(),
        any::<i16>(),
    );
    let age = prop_oneof![
        1 => Just(None),
        8 => (1..150_u32).prop_map(Some),
        2 => (1..1_u32 << 31).prop_map(Some),
    ];
    let vehicle = (
        any::<u32>(),
        any::<u32>(),
        age,
        any::<Option<(u16, bool)>>(),
        prop::bool::weighted(0.9),
        any::<bool>(),
        any::<u8>(),
    );
    let levels = (
        prop::array::uniform16(any::<i16>()),
        prop::array::uniform16(0..=i16::MAX),
    );
    (cell, vehicle, levels).prop_map(|(cell, vehicle, (gain, interference))| {
        let (sub_channels, places, open, threshold, salt, gains_hold, max_power) = cell;
        let (slot, identity, age, place, place_exists, awaits, weight) = vehicle;
        let least = sub_channels as u16;
        let places = least + places % (MAX_PLACES + 1 - least);
        let place =
            place.map(|(index, assigned)| (if place_exists { index % places } else { index }, assigned));
        Readings {
            slot,
            sub_channels,
            gain,
            interference,
            age,
            place,
            awaits,
            weight,
            places,
            open,
            threshold,
            salt,
            gains_hold,
            max_power,
            identity,
        }
    })
}
