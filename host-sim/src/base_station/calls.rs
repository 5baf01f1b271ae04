//! Whom the base station calls to contend in a slot: by one number that everybody hears, the least priority with which to send.
//!
//! A vehicle's priority follows from what both know: its age, its weight, its place and its lot. So the base station can count on
//! exactly those who will send, whom it cannot address one by one; it does not know which sub-channel each will choose, and whether
//! its gain suffices.

use super::BaseStation;
use crate::lanes::Rows;
use firmware::observation::{NOWHERE, Quantities, Sight, liking, places_reciprocal, until_turn};
use firmware::ring::{Open, Ring};
use firmware::units::{MAX_SUB_CHANNELS, SlotIndex};

/// Most vehicles that are called at once (chosen: far more than 16 sub-channels bear).
const MOST_CALLED: usize = 64;

/// Chance of sending that keeps the sums finite (chosen).
const MOST_SENDS: f64 = 0.9999;

/// Chance of a transmission from which a vehicle reaches all levels at which those who contend are received, and chance that one who
/// reaches them is not heard for another one who does: the other's level is higher, or the same (of four, 10/16).
const REACHES_ALL_LEVELS: f64 = 0.99;
const IS_CAPTURED: f64 = 0.625;

/// Salts that are tried, and most vehicles that are called with one (chosen).
const SALTS: u8 = 16;
const MOST_CHOOSING: usize = 20;

/// Who might be called.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    vehicle: usize,
    priority: i32,
    /// Chance that it still waits then, of those who were called in the slots before, and has a gain that suffices.
    sends: f64,
    /// Chance that it is received if nobody disturbs.
    received: f64,
    /// Chance that its transmission silences that of another one on the same sub-channel.
    disturbs: f64,
    /// What its reception is worth.
    value: f64,
    /// Its lot.
    lot: i32,
}

/// A slot of one world that the base station calls for.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// Which world.
    pub world: usize,
    /// Modulo the calls' delay and one.
    pub index: usize,
    /// When it is.
    pub at: SlotIndex,
    /// How many slots from now.
    pub ahead: u32,
    /// The sub-channels whose places are nobody's in it.
    pub open: Open,
}

/// Finds thresholds. Keeps its lists from slot to slot.
#[derive(Clone, Debug, Default)]
pub struct Caller {
    candidates: Vec<Candidate>,
    /// Whether there are others, of no larger priority.
    others: bool,
    /// Chance that a vehicle is received in a slot that it is called for. `[slot modulo the calls' delay and one][vehicle][world]`.
    received: Vec<Rows<f32>>,
    /// Whether one is. `[slot modulo the calls' delay and one][world]`.
    calls: Vec<Vec<bool>>,
    vehicles: usize,
}

impl Caller {
    /// Whether a vehicle is counted on in the slot with this index.
    #[cfg(test)]
    pub fn counts_on(&self, world: usize, vehicle: usize, index: usize) -> bool {
        self.received[index].get(world, vehicle) > 0.0
    }

    /// Calls that are decided so many slots ahead.
    pub fn new(worlds: usize, vehicles: usize, delay: usize) -> Self {
        Self {
            candidates: Vec::with_capacity(vehicles),
            others: false,
            received: vec![Rows::new(worlds, vehicles, 0.0); delay + 1],
            calls: vec![vec![false; worlds]; delay + 1],
            vehicles,
        }
    }

    /// [`Caller::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self) {
        self.received
            .iter_mut()
            .for_each(|received| received.fill_all(0.0));
        self.calls.iter_mut().for_each(|calls| calls.fill(false));
    }

    /// Nobody is called for the slot with this index.
    pub fn call_nobody(&mut self, world: usize, index: usize) {
        if std::mem::take(&mut self.calls[index][world]) {
            for vehicle in 0..self.vehicles {
                self.received[index].set(world, vehicle, 0.0);
            }
        }
    }

    /// The threshold for a slot: the vehicles with the largest priorities, so many that the expected sum of priorities received is
    /// largest, if each sends on the best of the open sub-channels whose gain suffices.
    pub fn call(
        &mut self,
        station: &BaseStation,
        slot: Slot,
        present: &[usize],
        ages: &Rows<u16>,
    ) -> (u32, u8) {
        let Slot {
            world,
            index,
            at,
            ahead,
            open,
        } = slot;
        self.call_nobody(world, index);
        let Some(stand) = Stand::new(station, world, at, ahead) else {
            return (u32::MAX, 0);
        };
        let (open_sub_channels, hold) = (open.0.count_ones(), station.announcements.gains_hold);
        let count = f64::from(open_sub_channels);
        self.candidates.clear();
        for &vehicle in present {
            let lot = lot(station, world, vehicle, at);
            let Some(priority) = stand.priority(station, vehicle, lot, ages) else {
                continue;
            };
            let waits: f64 = self
                .received
                .iter()
                .map(|received| 1.0 - f64::from(received.get(world, vehicle)))
                .product();
            let chance = f64::from(station.chances.get(world, vehicle));
            let (sends, received) = if hold {
                let none = (0..open_sub_channels).fold(1.0, |none, _| none * (1.0 - chance));
                (1.0 - none, 1.0)
            } else {
                (1.0, chance)
            };
            self.candidates.push(Candidate {
                vehicle,
                priority,
                sends: waits * sends,
                received,
                disturbs: if hold && chance >= REACHES_ALL_LEVELS {
                    IS_CAPTURED
                } else {
                    1.0
                },
                value: if hold {
                    priority.into()
                } else {
                    libm::pow(priority.into(), station.sharing.value_power)
                },
                lot,
            });
        }
        let most = self.candidates.len().min(MOST_CALLED + 1);
        let descending = |a: &Candidate, b: &Candidate| b.priority.cmp(&a.priority);
        self.others = most < self.candidates.len();
        if self.others {
            let _ = self.candidates.select_nth_unstable_by(most, descending);
        }
        self.candidates.truncate(most);
        self.candidates.sort_unstable_by(descending);
        let (called, salt) = if station.announcements.gains_hold {
            (self.call_by_chance(world, index, count), 0)
        } else {
            self.call_by_choice(world, index, open)
        };
        self.calls[index][world] = called > 0;
        // Nobody beside those who are called reaches it.
        let threshold = match self.candidates[..called].last() {
            None => u32::MAX,
            Some(last) => self.candidates.get(called).map_or(last.priority, |next| {
                (next.priority + 1).max(last.priority.midpoint(next.priority))
            }) as u32,
        };
        (threshold, salt)
    }
}

/// A vehicle's lot in the slot, as its unit draws it.
fn lot(station: &BaseStation, world: usize, vehicle: usize, slot: SlotIndex) -> i32 {
    (station.announcements.identity(world, vehicle).lot(slot) >> 16) as i32
}

/// The open sub-channel that a vehicle likes best if gains do not hold.
fn choice(open: Open, lot: i32, salt: u8) -> usize {
    let sub_channels = (0..MAX_SUB_CHANNELS).filter(|&sub_channel| open.contains(sub_channel));
    // That two are liked as much is rare enough to be no matter here.
    let best = sub_channels.max_by_key(|&sub_channel| liking(0, 0, lot, salt.into(), sub_channel as i32));
    best.unwrap_or(0)
}

impl Caller {
    /// Whether a threshold parts the first so many candidates from all others.
    fn is_parted(&self, number: usize) -> bool {
        match self.candidates.get(number) {
            Some(next) => next.priority < self.candidates[number - 1].priority,
            None => !self.others,
        }
    }

    /// How many to call who each choose the sub-channel with the largest gain, if that suffices.
    fn call_by_chance(&mut self, world: usize, index: usize, count: f64) -> usize {
        let (mut sum, mut undisturbed) = (0.0, 1.0);
        let (mut best, mut called, mut best_undisturbed) = (0.0, 0, 1.0);
        let disturbs = |candidate: &Candidate| (candidate.disturbs * candidate.sends / count).min(MOST_SENDS);
        for (number, candidate) in (1..).zip(&self.candidates) {
            let silent = 1.0 - disturbs(candidate);
            sum += candidate.value * candidate.sends / silent;
            undisturbed *= silent;
            if sum * undisturbed > best && self.is_parted(number) {
                (best, called, best_undisturbed) = (sum * undisturbed, number, undisturbed);
            }
        }
        for candidate in &self.candidates[..called] {
            let received = candidate.sends * best_undisturbed / (1.0 - disturbs(candidate));
            debug_assert!((0.0..=1.0).contains(&received), "no chance: {received}");
            self.received[index].set(world, candidate.vehicle, received as f32);
        }
        called
    }

    /// How many to call whose sub-channels are known, and the salt with which these part best.
    fn call_by_choice(&mut self, world: usize, index: usize, open: Open) -> (usize, u8) {
        let (mut best, mut called, mut best_salt) = (0.0, 0, 0);
        for salt in 0..SALTS {
            let (mut values, mut silent) = ([0.0; MAX_SUB_CHANNELS], [1.0; MAX_SUB_CHANNELS]);
            for (number, candidate) in (1..).zip(self.candidates.iter().take(MOST_CHOOSING)) {
                let choice = choice(open, candidate.lot, salt);
                let (value, silent) = (&mut values[choice], &mut silent[choice]);
                let sends = candidate.sends.min(MOST_SENDS);
                *value = *value * (1.0 - sends) + candidate.value * sends * *silent;
                *silent *= 1.0 - sends;
                let sum: f64 = values.iter().sum();
                if sum > best && self.is_parted(number) {
                    (best, called, best_salt) = (sum, number, salt);
                }
            }
        }
        for candidate in &self.candidates[..called] {
            let received = candidate.sends * candidate.received;
            self.received[index].set(world, candidate.vehicle, received as f32);
        }
        (called, best_salt)
    }
}

/// Where a world's ring stands in a slot that is so far ahead.
struct Stand {
    world: usize,
    ahead: i32,
    ring: Ring,
    first: i32,
    places_reciprocal: i32,
    frame: i32,
}

impl Stand {
    fn new(station: &BaseStation, world: usize, slot: SlotIndex, ahead: u32) -> Option<Self> {
        let ring = station.announcements.ring(world)?;
        Some(Self {
            world,
            ahead: ahead as i32,
            first: station.first_place(world, slot).into(),
            places_reciprocal: places_reciprocal(ring.places()),
            frame: ring.frame(),
            ring,
        })
    }

    /// A vehicle's priority; `None` for one that is absent, has its turn, or does not matter.
    #[inline(always)]
    fn priority(&self, station: &BaseStation, vehicle: usize, lot: i32, ages: &Rows<u16>) -> Option<i32> {
        let (told, world) = (&station.announcements, self.world);
        if told.associated.get(world, vehicle) == 0 {
            return None;
        }
        let places = i32::from(self.ring.places());
        let keeps = station.keeps(world, vehicle, ages);
        let place = if keeps {
            i32::from(told.booked().get(world, vehicle))
        } else {
            NOWHERE
        };
        let until = until_turn(place, self.first, places);
        let sub_channels = self.ring.sub_channels().count() as i32;
        if keeps && until < sub_channels {
            return None;
        }
        // Who has a turn before the slot is taken to be received in it.
        let turn_was = self.ahead > 0 && keeps && places - until <= sub_channels * self.ahead;
        let age = if turn_was {
            (places - until + sub_channels - 1) / sub_channels
        } else {
            i32::from(ages.get(world, vehicle)) + self.ahead
        };
        let quantities = Quantities {
            age,
            sub_channels,
            places,
            places_reciprocal: self.places_reciprocal,
            frame: self.frame,
            place,
            // So that it keeps what it is known to keep.
            assigned: 1,
            awaits: 0,
            gains_hold: told.gains_hold.into(),
            places_until_turn: until,
            weight: told.weights.get(world, vehicle).into(),
            threshold: Quantities::NEVER,
            lot,
            sight: Sight::NOTHING,
        };
        let priority = quantities.priority();
        (priority > 0).then_some(priority)
    }
}
