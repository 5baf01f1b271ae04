//! What the base station does besides listening: it hands out places in the ring, confirms those that vehicles found by themselves, and
//! broadcasts the ring and who is called to contend, from what it knows and with its delay.

mod book;
mod calls;

use crate::lanes::{LANES, Rows};
use crate::scenario::Scenario;
use crate::stream::{Role, Stream, WorldKey};
use book::Book;
use calls::{Caller, Slot};
use firmware::lots::Identity;
use firmware::measurement::Broadcast;
use firmware::observation::{place_lost, until_turn};
use firmware::ring::{MAX_PLACES, Open, Ring, carrier, hop};
use firmware::units::{Dbm, SlotIndex, SubChannels, Weight};
use rand_core::Rng;

/// The place of a vehicle that has none.
pub const NO_PLACE: u16 = u16::MAX;

/// How places are shared out and ages weighed (all chosen: best in a prototype of the hard cell).
#[derive(Clone, Copy, Debug)]
struct Sharing {
    /// Chance that a transmission at full power carries C_min, over fading, from which a vehicle gets a place of its own where there are
    /// open ones for the others.
    owners_chance: f64,
    /// Open places for each vehicle that fails surely, less what is rounded down.
    open_per_failure: f64,
    rounded_down: f64,
    /// The weight of a vehicle's age is this for one that never fails, and for others their chance to that power of it.
    full_weight: f64,
    weight_power: f64,
    /// Priorities to this power are what the base station adds up.
    value_power: f64,
}

/// Where gains hold, and who is called sends only if its gain suffices: the weak are called more often.
const WITH_GAINS: Sharing = Sharing {
    owners_chance: 0.74,
    open_per_failure: 3.0,
    rounded_down: 0.1,
    full_weight: 32.0,
    weight_power: -0.55,
    value_power: 1.0,
};

/// Where they do not, and every call of a weak vehicle is likely wasted.
const WITHOUT_GAINS: Sharing = Sharing {
    owners_chance: 0.6,
    open_per_failure: 2.5,
    rounded_down: 0.87,
    full_weight: 255.0,
    weight_power: 0.61,
    value_power: 1.89,
};

/// Minus the logarithm of the least chance that weights tell apart, 1e-9.
const MOST_FAILURE: f64 = 20.723_265_836_946_41;

/// How far the chance of an owner may fall below that, or must rise above it to become one: so that nobody comes and goes (chosen).
const CHANCE_MARGIN: f64 = 0.03;

/// What vehicles are told, in a batch of worlds: places and weights at association, places by acknowledgement, the ring and who is
/// called by broadcast.
#[derive(Clone, Debug)]
pub struct Announcements {
    sub_channels: usize,
    max_power: Dbm,
    /// Whether gains still hold when they are used.
    gains_hold: bool,
    vehicles: usize,
    /// The number under which each vehicle is known. `[vehicle][world]`.
    identities: Rows<u32>,
    /// 1 where a vehicle is associated. `[vehicle][world]`.
    associated: Rows<u8>,
    /// 1 where what a vehicle was told at association got through. `[vehicle][world]`.
    reached: Rows<u8>,
    /// Places in the ring.
    ring: Book,
    /// Places in a frame in which everybody has one: for those who know nothing better.
    frame: Book,
    /// 1 where a vehicle was told its place in the ring. `[vehicle][world]`.
    told: Rows<u8>,
    /// The booked place where the vehicle was last received in it, of those who were not told. `[vehicle][world]`.
    found: Rows<u16>,
    /// [`Weight`] of each vehicle's age. `[vehicle][world]`.
    weights: Rows<u8>,
    /// The place on the first sub-channel before it hopped. One item.
    first: Rows<u16>,
    /// What was decided in the last slots for as many slots later. `[slot modulo the ring's length]`.
    decided: Vec<Contention>,
    /// What vehicles now hear of it.
    heard: usize,
}

/// Who may contend in a slot. One item each.
#[derive(Clone, Debug)]
struct Contention {
    /// Bits of the sub-channels whose places are nobody's.
    open: Rows<u16>,
    /// The least priority of those who are called.
    threshold: Rows<u32>,
    /// What the sub-channels that they like are drawn with, if gains do not hold.
    salt: Rows<u8>,
}

/// Places and broadcasts of a batch of worlds.
#[derive(Clone, Debug)]
pub struct BaseStation {
    sharing: Sharing,
    required_db: f64,
    announcements: Announcements,
    /// Slot in which each present vehicle associated. `[vehicle][world]`.
    associated_at: Rows<u32>,
    /// Chance of a transmission of each present vehicle. `[vehicle][world]`.
    chances: Rows<f32>,
    /// Whether a vehicle is among those who arrive, while places are planned.
    arrives: Vec<bool>,
    /// Whether places are kept open on purpose, by world.
    keeps_open: Vec<bool>,
    /// Whether owners of such a world have changed, by world.
    changed: Vec<bool>,
    /// Whether some place may be nobody's, by world.
    contended: Vec<bool>,
    slot: u32,
    /// Share of vehicles that are not told their place.
    place_loss: f64,
    /// Who is not; by world.
    losses: Vec<Stream>,
    caller: Caller,
}

impl BaseStation {
    /// A base station for `vehicles` vehicles, of which none is associated yet.
    pub fn new(scenario: &Scenario, keys: &[WorldKey], vehicles: usize) -> Self {
        let (worlds, sub_channels) = (keys.len(), scenario.radio.sub_channels as usize);
        let broadcast = &scenario.broadcast;
        let one = Rows::new(worlds, 1, 0);
        let book = || {
            Book::new(
                worlds,
                vehicles,
                sub_channels as u16,
                broadcast.shrink_delay_slots,
            )
        };
        let contention = Contention {
            open: one.clone(),
            threshold: Rows::new(worlds, 1, u32::MAX),
            salt: Rows::new(worlds, 1, 0),
        };
        let mut station = Self {
            sharing: if gains_hold(scenario) {
                WITH_GAINS
            } else {
                WITHOUT_GAINS
            },
            required_db: 10.0 * libm::log10(scenario.radio.required_sinr()),
            associated_at: Rows::new(worlds, vehicles, 0),
            chances: Rows::new(worlds, vehicles, 1.0),
            arrives: vec![false; vehicles],
            keeps_open: vec![false; worlds],
            changed: vec![false; worlds],
            contended: vec![true; worlds],
            announcements: Announcements {
                sub_channels,
                max_power: scenario.radio.max_power(),
                gains_hold: gains_hold(scenario),
                vehicles,
                identities: Rows::new(worlds, vehicles, 0),
                associated: Rows::new(worlds, vehicles, 0),
                reached: Rows::new(worlds, vehicles, 0),
                ring: book(),
                frame: book(),
                told: Rows::new(worlds, vehicles, 0),
                found: Rows::new(worlds, vehicles, NO_PLACE),
                weights: Rows::new(worlds, vehicles, Weight::ONE.0),
                first: one,
                decided: vec![contention; broadcast.call_delay_slots as usize + 1],
                heard: 0,
            },
            slot: 0,
            place_loss: scenario.feedback.place_loss,
            losses: keys.iter().map(|key| key.stream(Role::Losses, 3)).collect(),
            caller: Caller::new(worlds, vehicles, broadcast.call_delay_slots as usize),
        };
        station.announcements.reset(keys);
        station
    }

    /// [`BaseStation::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self, keys: &[WorldKey]) {
        self.associated_at.fill_all(0);
        self.chances.fill_all(1.0);
        self.keeps_open.fill(false);
        self.changed.fill(false);
        self.contended.fill(true);
        self.announcements.reset(keys);
        self.slot = 0;
        for (losses, key) in self.losses.iter_mut().zip(keys) {
            *losses = key.stream(Role::Losses, 3);
        }
        self.caller.reset();
    }

    /// What vehicles are told.
    pub fn announcements(&self) -> &Announcements {
        &self.announcements
    }

    /// Slot, counted from the start, in which each present vehicle associated. `[vehicle][world]`.
    pub fn associated_at(&self) -> &Rows<u32> {
        &self.associated_at
    }

    /// Lets go the vehicles of `departures` in one world, associates those of `arrivals`, and plans anew for all that are then `present`,
    /// from their gains without fading, which a base station measures over time. Vehicles that arrive together get their places in
    /// ascending gain.
    pub fn update(
        &mut self,
        world: usize,
        arrivals: &mut [usize],
        departures: &[usize],
        present: impl Iterator<Item = usize> + Clone,
        large_scale_db: &Rows<f32>,
    ) {
        for &vehicle in departures {
            self.leave(world, vehicle);
        }
        let gain_db = |vehicle| large_scale_db.get(world, vehicle);
        arrivals.sort_unstable_by(|&a, &b| gain_db(a).total_cmp(&gain_db(b)).then(a.cmp(&b)));
        arrivals
            .iter()
            .for_each(|&vehicle| self.join(world, vehicle, gain_db(vehicle)));
        self.plan(world, arrivals, present, large_scale_db);
    }

    /// Another vehicle takes a vehicle's index in one world, from this slot on: it associates anew, and takes over its place, or one that
    /// comes round sooner (`hasten`). `ages` are those of the present vehicles.
    pub fn replace(
        &mut self,
        world: usize,
        vehicle: usize,
        slot: SlotIndex,
        ages: &Rows<u16>,
        large_scale_db: &Rows<f32>,
    ) {
        let place = self.announcements.ring.place(world, vehicle);
        self.leave(world, vehicle);
        self.join(world, vehicle, large_scale_db.get(world, vehicle));
        if let Some(place) = place {
            self.announcements.ring.give(world, vehicle, place);
            self.tell(world, vehicle);
            self.hasten(world, vehicle, place, slot, ages);
        }
    }

    /// Exchanges a newcomer's place with one that comes round as soon as both can have heard of it, in the slot after a call's delay: there,
    /// with that of the vehicle that was received last. A newcomer's age is the time constraint, so that each slot for which it waits costs
    /// more than one for which the other does.
    fn hasten(&mut self, world: usize, newcomer: usize, place: u16, slot: SlotIndex, ages: &Rows<u16>) {
        let announcements = &mut self.announcements;
        let (sub_channels, places) = (announcements.sub_channels, announcements.places().get(world, 0));
        let first = first_place(slot, sub_channels, places);
        // Places that are handed out before that slot, and until it is over.
        let before = sub_channels * announcements.decided.len();
        let after = before + sub_channels;
        let until = until_turn(place.into(), first.into(), places.into());
        if until < after as i32 || announcements.told.get(world, newcomer) == 0 {
            return;
        }
        let (ring, told) = (&mut announcements.ring, &announcements.told);
        let owner = |ahead| ring.owner(world, (usize::from(first) + ahead) % usize::from(places));
        let owners = (before..after).filter_map(owner);
        let hears = owners.filter(|&owner| told.get(world, owner) > 0);
        let other = hears.min_by_key(|&owner| ages.get(world, owner));
        if let Some(sooner) = other.and_then(|other| ring.place(world, other)) {
            ring.exchange(world, newcomer, sooner);
        }
    }

    fn leave(&mut self, world: usize, vehicle: usize) {
        self.release(world, vehicle);
        self.announcements.frame.release(world, vehicle);
        self.announcements.associated.set(world, vehicle, 0);
    }

    fn join(&mut self, world: usize, vehicle: usize, gain_db: f32) {
        let lost = self.place_loss > 0.0 && self.losses[world].chance(self.place_loss);
        self.announcements.reached.set(world, vehicle, u8::from(!lost));
        self.announcements.associated.set(world, vehicle, 1);
        self.announcements.frame.book(world, vehicle);
        self.associated_at.set(world, vehicle, self.slot);
        self.appraise(world, vehicle, gain_db);
    }

    /// Finds out a vehicle's chance in Rayleigh fading around its gain, and the weight of its age that follows.
    fn appraise(&mut self, world: usize, vehicle: usize, gain_db: f32) {
        let failure = libm::exp10((self.required_db - f64::from(gain_db)) / 10.0);
        self.chances.set(world, vehicle, libm::exp(-failure) as f32);
        // A power of the chance is one exponential more.
        let exponent = failure.min(MOST_FAILURE) * self.sharing.weight_power;
        let weight = self.sharing.full_weight * libm::exp(-exponent);
        // Rounded, within 1 and 255.
        let weight = ((weight + 0.5) as u8).max(1);
        self.announcements.weights.set(world, vehicle, weight);
    }

    /// Decides how many places are open and who owns one: where none is, everybody does.
    fn plan(
        &mut self,
        world: usize,
        arrivals: &[usize],
        present: impl Iterator<Item = usize> + Clone,
        large_scale_db: &Rows<f32>,
    ) {
        let mut failures = 0.0;
        for vehicle in present.clone() {
            self.appraise(world, vehicle, large_scale_db.get(world, vehicle));
            failures += 1.0 - f64::from(self.chances.get(world, vehicle));
        }
        let sharing = self.sharing;
        let open = (sharing.open_per_failure * failures - sharing.rounded_down).max(0.0) as u16;
        arrivals.iter().for_each(|&vehicle| self.arrives[vehicle] = true);
        let arrives = std::mem::take(&mut self.arrives);
        let others = present.filter(|&vehicle| !arrives[vehicle]);
        let mut owners = 0;
        let mut moved = false;
        for vehicle in others.chain(arrivals.iter().copied()) {
            let owns = self.announcements.ring.place(world, vehicle).is_some();
            let arrives = self.associated_at.get(world, vehicle) == self.slot;
            let margin = match (arrives, owns) {
                (true, _) => 0.0,
                (false, true) => -CHANCE_MARGIN,
                (false, false) => CHANCE_MARGIN,
            };
            let chance = f64::from(self.chances.get(world, vehicle));
            let should = open == 0 || chance >= sharing.owners_chance + margin;
            owners += u16::from(should);
            moved |= owns != should;
            match (owns, should) {
                (true, false) => self.release(world, vehicle),
                (false, true) => self.hand_out(world, vehicle),
                _ => {}
            }
        }
        self.arrives = arrives;
        arrivals.iter().for_each(|&vehicle| self.arrives[vehicle] = false);
        let least = self.announcements.sub_channels as u16;
        let everybody = self.announcements.frame.count(world) as u16;
        self.announcements
            .frame
            .need(world, everybody.max(least), self.slot);
        let most = MAX_PLACES.max(owners);
        let needed = owners.saturating_add(open).clamp(least, most.max(least));
        self.announcements.ring.need(world, needed, self.slot);
        self.keeps_open[world] = open > 0;
        self.changed[world] |= moved && open > 0;
    }

    /// Takes a vehicle's place back.
    fn release(&mut self, world: usize, vehicle: usize) {
        self.announcements.ring.release(world, vehicle);
        self.announcements.found.set(world, vehicle, NO_PLACE);
        self.announcements.told.set(world, vehicle, 0);
    }

    /// Books a place for a vehicle and tells it.
    fn hand_out(&mut self, world: usize, vehicle: usize) {
        self.announcements.ring.book(world, vehicle);
        self.tell(world, vehicle);
    }

    /// Tells a vehicle its place, which may get lost.
    fn tell(&mut self, world: usize, vehicle: usize) {
        let announcements = &mut self.announcements;
        announcements
            .told
            .set(world, vehicle, announcements.reached.get(world, vehicle));
    }

    /// Prepares a slot's broadcasts, and decides whom it `calls`, if anybody listens. `ages` are the present vehicles' as the base station
    /// knows them.
    pub fn prepare(&mut self, slot: SlotIndex, present: &[usize], ages: &Rows<u16>, calls: bool) {
        let Announcements {
            ring, frame, found, ..
        } = &mut self.announcements;
        let mut forget = |world, vehicle| found.set(world, vehicle, NO_PLACE);
        frame.begin_slot(self.slot, present, |_, _| ());
        ring.begin_slot(self.slot, present, &mut forget);
        self.announcements.turn();
        let mut contended = std::mem::take(&mut self.contended);
        for world in 0..self.keeps_open.len() {
            let ring = &mut self.announcements.ring;
            // By this world alone, whatever its batch.
            let resized = ring.has_resized(world) || self.slot == 0;
            let moved = std::mem::take(&mut self.changed[world]);
            if (resized || moved) && self.keeps_open[world] {
                let found = &mut self.announcements.found;
                ring.spread(world, |world, vehicle| found.set(world, vehicle, NO_PLACE));
            }
            if resized {
                let first = self.first_place(world, slot);
                self.announcements.first.set(world, 0, first);
            }
        }
        let delay = self.announcements.decided.len() - 1;
        let now = self.slot as usize % (delay + 1);
        self.announcements.heard = (now + 1) % (delay + 1);
        for (world, contended) in contended.iter_mut().enumerate() {
            let places = usize::from(self.announcements.places().get(world, 0));
            let may = self.place_loss > 0.0 || self.announcements.ring.count(world) < places;
            if !may && *contended {
                self.announcements.close(world);
            }
            *contended = may;
            if !(may && calls) {
                continue;
            }
            self.decide(world, now, slot, delay as u32, present, ages);
            if self.slot == 0 {
                // What the first slots hear was decided before anybody sent.
                for ahead in 0..delay {
                    self.decide(world, ahead + 1, slot, ahead as u32, present, ages);
                }
            }
        }
        self.contended = contended;
        self.slot += 1;
    }

    fn first_place(&self, world: usize, slot: SlotIndex) -> u16 {
        let announcements = &self.announcements;
        first_place(
            slot,
            announcements.sub_channels,
            announcements.places().get(world, 0),
        )
    }

    /// Decides who may contend in the slot that is so far ahead.
    fn decide(
        &mut self,
        world: usize,
        index: usize,
        slot: SlotIndex,
        ahead: u32,
        present: &[usize],
        ages: &Rows<u16>,
    ) {
        let then = SlotIndex(slot.0.wrapping_add(ahead));
        let open = self.open(world, then, ages);
        let mut caller = std::mem::take(&mut self.caller);
        let (threshold, salt) = if open == Open::default() {
            caller.call_nobody(world, index);
            (u32::MAX, 0)
        } else {
            let slot = Slot {
                world,
                index,
                at: then,
                ahead,
                open,
            };
            caller.call(self, slot, present, ages)
        };
        self.caller = caller;
        let decided = &mut self.announcements.decided[index];
        decided.open.set(world, 0, open.0);
        decided.threshold.set(world, 0, threshold);
        decided.salt.set(world, 0, salt);
    }

    /// Which sub-channels carry places in a slot that are nobody's.
    fn open(&self, world: usize, slot: SlotIndex, ages: &Rows<u16>) -> Open {
        let Some(ring) = self.announcements.ring(world) else {
            return Open::default();
        };
        let (sub_channels, places) = (ring.sub_channels(), usize::from(ring.places()));
        let first = usize::from(self.first_place(world, slot));
        let hop = hop(slot, sub_channels);
        let mut open = 0;
        for offset in 0..sub_channels.count() {
            if self.keeper(world, (first + offset) % places, ages).is_none() {
                open |= 1 << carrier(offset, hop, sub_channels);
            }
        }
        Open(open)
    }

    /// Whose place it is: of who was told it, or of who found it and keeps it.
    fn keeper(&self, world: usize, place: usize, ages: &Rows<u16>) -> Option<usize> {
        let owner = self.announcements.ring.owner(world, place)?;
        self.keeps(world, owner, ages).then_some(owner)
    }

    /// Whether a vehicle is counted on to contend in the slot that was prepared last, where calls come at once.
    #[cfg(test)]
    pub(crate) fn counts_on(&self, world: usize, vehicle: usize) -> bool {
        self.caller.counts_on(world, vehicle, 0)
    }

    /// Whether a vehicle has a place that it knows of.
    #[inline]
    pub(crate) fn keeps(&self, world: usize, vehicle: usize, ages: &Rows<u16>) -> bool {
        let Announcements {
            sub_channels,
            told,
            found,
            ring,
            ..
        } = &self.announcements;
        let (age, places) = (ages.get(world, vehicle), ring.places().get(world, 0));
        let lost = place_lost(age.into(), *sub_channels as i32, places.into());
        told.get(world, vehicle) > 0 || (found.get(world, vehicle) != NO_PLACE && !lost)
    }

    /// Hears who was received on which sub-channel in a slot, and confirms where those who were not told have found a place: where no
    /// told vehicle's is, nor that of another one who found it and keeps it. `received_on` is the sub-channel of a vehicle that was
    /// received; `ages` are those before the slot.
    pub fn receive(
        &mut self,
        slot: SlotIndex,
        present: &[usize],
        ages: &Rows<u16>,
        received_on: impl Fn(usize, usize) -> Option<usize>,
    ) {
        if self.place_loss == 0.0 {
            return;
        }
        for world in 0..self.keeps_open.len() {
            let Some(ring) = self.announcements.ring(world) else {
                continue;
            };
            let (first, sub_channels) = (self.first_place(world, slot), ring.sub_channels());
            let hop = hop(slot, sub_channels);
            for &vehicle in present {
                let told = self.announcements.told.get(world, vehicle) > 0;
                let Some(sub_channel) = received_on(world, vehicle).filter(|_| !told) else {
                    continue;
                };
                let mut offsets = 0..sub_channels.count();
                let offset = offsets.find(|&offset| carrier(offset, hop, sub_channels) == sub_channel);
                let place = (first + offset.unwrap_or(0) as u16) % ring.places();
                let found = if self.confirms(world, vehicle, place, ages) {
                    place
                } else {
                    NO_PLACE
                };
                self.announcements.found.set(world, vehicle, found);
            }
        }
    }

    /// Books a place for a vehicle that was received in it, if it should have one and this is nobody else's.
    fn confirms(&mut self, world: usize, vehicle: usize, place: u16, ages: &Rows<u16>) -> bool {
        match self.announcements.ring.place(world, vehicle) {
            None => return false,
            Some(booked) if booked == place => return true,
            Some(_) => {}
        }
        if self.keeper(world, place.into(), ages).is_some() {
            return false;
        }
        if let Some(other) = self.announcements.ring.exchange(world, vehicle, place) {
            self.announcements.found.set(world, other, NO_PLACE);
        }
        true
    }
}

/// As [`Ring::first_place`], by a divider.
fn first_place(slot: SlotIndex, sub_channels: usize, places: u16) -> u16 {
    (u64::from(slot.0) * sub_channels as u64 % u64::from(places)) as u16
}

/// Correlation of fading, from a gain's measurement to its use, from which it still holds (chosen).
const HOLDING_CORRELATION: f64 = 0.9;

/// Whether gains still hold when they are used, at the mean speed of those who drive.
fn gains_hold(scenario: &Scenario) -> bool {
    let (mobility, delay_slots) = (&scenario.mobility, scenario.knowledge.gain_delay_slots);
    let speed_m_per_s = f64::midpoint(mobility.min_speed_m_per_s, mobility.max_speed_m_per_s);
    let phase =
        std::f64::consts::TAU * scenario.radio.doppler_hz(speed_m_per_s) * f64::from(delay_slots) * 1e-3;
    let correlated = scenario.fading.follows_speed && libm::j0(phase).abs() >= HOLDING_CORRELATION;
    delay_slots == 0 || correlated
}

impl Announcements {
    /// Other worlds before their first slot: numbers of their own for all vehicles, of which none is associated.
    fn reset(&mut self, keys: &[WorldKey]) {
        for (world, key) in keys.iter().enumerate() {
            let mut stream = key.stream(Role::Identities, 0);
            (0..self.vehicles).for_each(|vehicle| self.identities.set(world, vehicle, stream.next_u32()));
        }
        self.associated.fill_all(0);
        self.reached.fill_all(0);
        self.ring.reset();
        self.frame.reset();
        self.told.fill_all(0);
        self.found.fill_all(NO_PLACE);
        self.weights.fill_all(Weight::ONE.0);
        self.first.fill_all(0);
        for decided in &mut self.decided {
            decided.open.fill_all(0);
            decided.threshold.fill_all(u32::MAX);
            decided.salt.fill_all(0);
        }
        self.heard = 0;
    }

    /// The next slot hands out the next places.
    fn turn(&mut self) {
        let sub_channels = self.sub_channels as u16;
        for block in 0..self.first.blocks() {
            let (first, places) = (self.first.row_mut(block, 0), self.ring.places().row(block, 0));
            for lane in 0..LANES {
                // No ring has fewer places than a slot hands out.
                let next = first[lane].wrapping_add(sub_channels);
                first[lane] = next.min(next.wrapping_sub(places[lane]));
            }
        }
    }

    /// Nobody contends in a world.
    fn close(&mut self, world: usize) {
        for decided in &mut self.decided {
            decided.open.set(world, 0, 0);
            decided.threshold.set(world, 0, u32::MAX);
        }
    }

    /// The place that was handed to a vehicle at association, and is its own as long as it is told no other one. `None` where that did
    /// not get through, where it has none, and where it is absent.
    pub fn assigned_place(&self, world: usize, vehicle: usize) -> Option<u16> {
        let told = self.told.get(world, vehicle) > 0;
        self.ring.place(world, vehicle).filter(|_| told)
    }

    /// The number under which a vehicle is known, which its lots follow from.
    pub fn identity(&self, world: usize, vehicle: usize) -> Identity {
        Identity(self.identities.get(world, vehicle))
    }

    /// The same for all. `[vehicle][world]`.
    pub fn identities(&self) -> &Rows<u32> {
        &self.identities
    }

    /// 1 where a vehicle is associated. `[vehicle][world]`.
    pub fn associated(&self) -> &Rows<u8> {
        &self.associated
    }

    /// Places that are booked for the vehicles, [`NO_PLACE`] for one without. `[vehicle][world]`.
    pub fn booked(&self) -> &Rows<u16> {
        self.ring.booked()
    }

    /// The place that was handed to a vehicle in a frame in which everybody has one. `None` where that did not get through, and
    /// where it is absent.
    pub fn frame_place(&self, world: usize, vehicle: usize) -> Option<u16> {
        let reached = self.reached.get(world, vehicle) > 0;
        self.frame.place(world, vehicle).filter(|_| reached)
    }

    /// A world's frame in which everybody has a place, if it can be announced.
    pub fn frame(&self, world: usize) -> Option<Ring> {
        let sub_channels = SubChannels::new(self.sub_channels)?;
        Ring::new(self.frame.places().get(world, 0), sub_channels)
    }

    /// 1 where the association told a vehicle its place. `[vehicle][world]`.
    pub fn told(&self) -> &Rows<u8> {
        &self.told
    }

    /// Where those who were not told were last received, if that was confirmed; otherwise [`NO_PLACE`]. `[vehicle][world]`.
    pub fn found(&self) -> &Rows<u16> {
        &self.found
    }

    /// [`Weight`] of each vehicle's age. `[vehicle][world]`.
    pub fn weights(&self) -> &Rows<u8> {
        &self.weights
    }

    /// How many places the ring has. One item.
    pub fn places(&self) -> &Rows<u16> {
        self.ring.places()
    }

    /// The most that vehicles may send with.
    pub fn max_power(&self) -> Dbm {
        self.max_power
    }

    /// Whether gains still hold when they are used, which a base station finds by comparing them with what it receives.
    pub fn gains_hold(&self) -> bool {
        self.gains_hold
    }

    /// The place on the first sub-channel before it hopped. One item.
    pub fn first_places(&self) -> &Rows<u16> {
        &self.first
    }

    /// Bits of the sub-channels on which anybody may contend. One item.
    pub fn open(&self) -> &Rows<u16> {
        &self.decided[self.heard].open
    }

    /// The least priority of those who are called to contend. One item.
    pub fn thresholds(&self) -> &Rows<u32> {
        &self.decided[self.heard].threshold
    }

    /// What the sub-channels that vehicles like are drawn with. One item.
    pub fn salts(&self) -> &Rows<u8> {
        &self.decided[self.heard].salt
    }

    /// A world's ring, if it can be announced.
    pub fn ring(&self, world: usize) -> Option<Ring> {
        let sub_channels = SubChannels::new(self.sub_channels)?;
        Ring::new(self.places().get(world, 0), sub_channels)
    }

    /// What everybody in a world hears. `None` where the ring cannot be announced.
    pub fn broadcast(&self, world: usize) -> Option<Broadcast> {
        Some(Broadcast {
            ring: self.ring(world)?,
            open: Open(self.open().get(world, 0)),
            threshold: self.thresholds().get(world, 0),
            salt: self.salts().get(world, 0),
            gains_hold: self.gains_hold,
            max_power: self.max_power,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;

    /// Two rows of worlds; the last one is looked at.
    const WORLDS: usize = LANES + 3;
    const WORLD: usize = WORLDS - 1;

    /// A transmission at this level carries C_min with a chance above 0.999.
    const STRONG_DB: f32 = 40.0;

    /// A base station and what it knows of its vehicles' gains, the same in every world.
    struct Cell {
        station: BaseStation,
        gains_db: Rows<f32>,
        present: Vec<usize>,
        slot: u32,
    }

    impl Cell {
        fn new(vehicles: usize, settings: &[&str]) -> Self {
            let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
            let source = ScenarioSource {
                settings,
                ..ScenarioSource::default()
            };
            let key = |world| WorldKey {
                seed: 1,
                purpose: Purpose::Evaluation,
                world,
            };
            let keys: Vec<WorldKey> = (0..WORLDS as u64).map(key).collect();
            Self {
                station: BaseStation::new(&source.read().unwrap(), &keys, vehicles),
                gains_db: Rows::new(WORLDS, vehicles, STRONG_DB),
                present: Vec::new(),
                slot: 0,
            }
        }

        /// Who comes and goes, and a plan for those who are then present.
        fn update(&mut self, arrivals: &[usize], departures: &[usize]) {
            self.present.retain(|vehicle| !departures.contains(vehicle));
            self.present.extend(arrivals);
            self.present.sort_unstable();
            for world in 0..WORLDS {
                let (mut arrivals, present) = (arrivals.to_vec(), self.present.iter().copied());
                self.station
                    .update(world, &mut arrivals, departures, present, &self.gains_db);
            }
        }

        /// Begins the next slot, and says which.
        fn prepare(&mut self, ages: &Rows<u16>) -> SlotIndex {
            let slot = SlotIndex(self.slot);
            self.station.prepare(slot, &self.present, ages, true);
            self.slot += 1;
            slot
        }

        fn heard(&self) -> Broadcast {
            self.station.announcements().broadcast(WORLD).unwrap()
        }

        fn place(&self, vehicle: usize) -> Option<u16> {
            self.station.announcements().assigned_place(WORLD, vehicle)
        }

        fn weight(&self, vehicle: usize) -> u8 {
            self.station.announcements().weights().get(WORLD, vehicle)
        }

        fn found(&self, vehicle: usize) -> u16 {
            self.station.announcements().found().get(WORLD, vehicle)
        }

        fn booked(&self) -> Vec<u16> {
            let booked = self.station.announcements().booked();
            let places = self.present.iter().map(|&vehicle| booked.get(WORLD, vehicle));
            let mut places: Vec<u16> = places.collect();
            places.sort_unstable();
            places
        }
    }

    #[test]
    fn where_all_are_strong_everybody_has_a_place_and_none_is_open() {
        let mut cell = Cell::new(20, &[]);
        (0..20).for_each(|vehicle| cell.gains_db.fill(vehicle, 60.0 + vehicle as f32));
        let all: Vec<_> = (0..20).rev().collect();
        cell.update(&all, &[]);
        let ages = Rows::new(WORLDS, 20, 100);
        for _ in 0..20 {
            cell.prepare(&ages);
            let heard = cell.heard();
            assert_eq!((heard.ring.places(), heard.open), (20, Open::default()));
            // Nobody is called.
            assert_eq!(heard.threshold, u32::MAX);
        }
        // In ascending gain.
        for vehicle in 0..20 {
            assert_eq!(cell.place(vehicle), Some(vehicle as u16));
            assert_eq!(cell.weight(vehicle), Weight::ONE.0);
        }
    }

    /// The chance that fading leaves a gain that suffices, and what follows from it; computed from what the constants say.
    #[test]
    fn the_weak_have_none_and_count_more_where_places_are_open() {
        let mut cell = Cell::new(20, &[]);
        let required_db = 10.0 * libm::log10(7.0);
        let weak_db = |vehicle: usize| 2.0 + 2.0 * vehicle as f64;
        let chance = |vehicle| libm::exp(-libm::exp10((required_db - weak_db(vehicle)) / 10.0));
        for vehicle in 0..4 {
            cell.gains_db.fill(vehicle, weak_db(vehicle) as f32);
        }
        let all: Vec<_> = (0..20).collect();
        cell.update(&all, &[]);
        let ages = Rows::new(WORLDS, 20, 100);
        cell.prepare(&ages);
        let strong_failure = 1.0 - libm::exp(-7.0 * libm::exp10(-f64::from(STRONG_DB) / 10.0));
        let failures: f64 = (0..4).map(|vehicle| 1.0 - chance(vehicle)).sum();
        let free = (3.0 * (failures + 16.0 * strong_failure) - 0.1).floor() as u16;
        assert!(free > 5, "{free}");
        let ring = cell.heard().ring;
        assert_eq!(ring.places(), 16 + free);
        for vehicle in 0..20 {
            assert_eq!(cell.place(vehicle).is_some(), vehicle >= 4);
        }
        let weights: Vec<u8> = (0..5).map(|vehicle| cell.weight(vehicle)).collect();
        let expected = |vehicle| (32.0 * libm::pow(chance(vehicle), -0.55)).round() as u8;
        assert_eq!(weights[..4], [0, 1, 2, 3].map(expected));
        assert!(weights.windows(2).all(|pair| pair[0] > pair[1]), "{weights:?}");
        // Every place is owned once at most, and the free ones lie apart alike.
        let owned: Vec<u16> = cell
            .booked()
            .into_iter()
            .filter(|&place| place != NO_PLACE)
            .collect();
        assert_eq!(owned.len(), 16);
        let free_places: Vec<u16> = (0..ring.places())
            .filter(|place| !owned.contains(place))
            .collect();
        assert_eq!(free_places.len(), usize::from(free));
        let gaps: Vec<u16> = free_places.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (least, most) = (gaps.iter().min().unwrap(), gaps.iter().max().unwrap());
        assert!(most - least <= 1, "{gaps:?}");
        // Exactly they are announced as open, each when it comes round, and somebody is called then.
        let mut counts = vec![0; ring.places().into()];
        for _ in 0..ring.places() {
            let slot = cell.prepare(&ages);
            let heard = cell.heard();
            let (first, hop) = (ring.first_place(slot), hop(slot, ring.sub_channels()));
            for offset in 0..3 {
                let place = (first + offset as u16) % ring.places();
                let open = heard.open.contains(carrier(offset, hop, ring.sub_channels()));
                assert_eq!(open, free_places.contains(&place), "{place}");
                counts[usize::from(place)] += u32::from(open);
            }
            let called = heard.threshold != u32::MAX;
            assert_eq!(called, heard.open != Open::default());
        }
        assert_eq!(counts.iter().sum::<u32>(), 3 * u32::from(free));
    }

    /// By the Bessel function of Clarke's model: 0.94 after a slot at the mean of 10 to 14 m/s and 2 GHz, 0.76 after two.
    #[test]
    fn gains_hold_while_fading_has_hardly_moved_on() {
        let hold = |settings: &[&str]| Cell::new(3, settings).station.announcements().gains_hold();
        let follows = "fading.follows_speed=true";
        for (delay, holds) in [(0, true), (1, true), (2, false), (4, false)] {
            let delay = format!("knowledge.gain_delay_slots={delay}");
            assert_eq!(hold(&[follows, &delay]), holds, "{delay}");
        }
        let late = "knowledge.gain_delay_slots=1";
        assert!(!hold(&[late]), "where fading is drawn anew");
        assert!(!hold(&[follows, late, "radio.carrier_ghz=5.9"]));
        let walking = ["mobility.min_speed_m_per_s=1", "mobility.max_speed_m_per_s=2"];
        assert!(hold(&[
            follows,
            "knowledge.gain_delay_slots=8",
            walking[0],
            walking[1]
        ]));
    }

    #[test]
    fn an_owner_stays_one_until_its_chance_is_clearly_lower() {
        let gain_db = |chance: f64| (10.0 * libm::log10(-7.0 / libm::log(chance))) as f32;
        let mut cell = Cell::new(10, &[]);
        // Weak enough that places are open.
        (0..3).for_each(|vehicle| cell.gains_db.fill(vehicle, 0.0));
        cell.gains_db.fill(8, gain_db(0.75));
        cell.gains_db.fill(9, gain_db(0.73));
        let all: Vec<_> = (0..10).collect();
        cell.update(&all, &[]);
        let ages = Rows::new(WORLDS, 10, 100);
        for (chances, owners) in [
            ([0.75, 0.73], [true, false]),
            ([0.72, 0.76], [true, false]),
            ([0.70, 0.78], [false, true]),
            ([0.76, 0.72], [false, true]),
        ] {
            cell.prepare(&ages);
            for (vehicle, chance) in [8, 9].into_iter().zip(chances) {
                cell.gains_db.fill(vehicle, gain_db(chance));
            }
            cell.update(&[], &[]);
            cell.prepare(&ages);
            assert_eq!([8, 9].map(|vehicle| cell.place(vehicle).is_some()), owners);
        }
    }

    #[test]
    fn no_ring_has_more_places_than_can_be_announced() {
        let vehicles = usize::from(MAX_PLACES);
        let mut cell = Cell::new(vehicles, &[]);
        // Half of them hopeless: 5,300 open places.
        (0..vehicles / 2).for_each(|vehicle| cell.gains_db.fill(vehicle, -30.0));
        let all: Vec<_> = (0..vehicles).collect();
        cell.update(&all, &[]);
        cell.prepare(&Rows::new(WORLDS, vehicles, 100));
        assert_eq!(cell.heard().ring.places(), MAX_PLACES);
        assert_eq!(cell.place(0), None);
        assert!(cell.place(vehicles - 1).is_some());
    }

    #[test]
    fn growth_is_told_at_once_and_shrinking_after_its_delay() {
        let mut cell = Cell::new(7, &[]);
        let ages = Rows::new(WORLDS, 7, 1);
        cell.update(&[0], &[]);
        cell.prepare(&ages);
        assert_eq!(cell.heard().ring.places(), 3, "one for each sub-channel");
        cell.update(&[1, 2, 3, 4, 5, 6], &[]);
        cell.prepare(&ages);
        assert_eq!(cell.heard().ring.places(), 7);
        // Vehicle 0 leaves instead of the last: its place is free, and the last moves there when the ring shrinks.
        cell.update(&[], &[0]);
        for _ in 0..100 {
            cell.prepare(&ages);
            assert_eq!(cell.heard().ring.places(), 7);
            assert_eq!(cell.place(6), Some(6));
        }
        cell.prepare(&ages);
        assert_eq!(cell.heard().ring.places(), 6);
        assert_eq!((cell.place(6), cell.place(0)), (Some(0), None));
    }

    /// Whoever comes has a turn in the slot after the next at the latest, and one other vehicle waits for the place that was left.
    #[test]
    fn a_newcomer_s_turn_comes_soon_at_the_expense_of_one_other() {
        for (weak, settings, delay) in [
            (0, &[][..], 0),
            (3, &[][..], 0),
            (0, &["broadcast.call_delay_slots=2"][..], 2),
        ] {
            let mut cell = Cell::new(20, settings);
            (0..weak).for_each(|vehicle| cell.gains_db.fill(vehicle, 0.0));
            let all: Vec<_> = (0..20).collect();
            cell.update(&all, &[]);
            let mut ages = Rows::new(WORLDS, 20, 100);
            (0..20).for_each(|vehicle| ages.fill(vehicle, 20 - vehicle as u16));
            cell.prepare(&ages);
            let mut hastened = 0;
            for newcomer in weak..20 {
                let ring = cell.heard().ring;
                let before = cell.station.announcements().booked().clone();
                ages.fill(newcomer, 100);
                let slot = SlotIndex(cell.slot);
                cell.station.replace(WORLD, newcomer, slot, &ages, &cell.gains_db);
                assert_eq!(cell.station.associated_at().get(WORLD, newcomer), cell.slot);
                cell.prepare(&ages);
                let after = cell.station.announcements().booked().clone();
                let moved = all
                    .iter()
                    .filter(|&&vehicle| after.get(WORLD, vehicle) != before.get(WORLD, vehicle));
                let moved: Vec<usize> = moved.copied().collect();
                let first = ring.first_place(slot).into();
                let place = after.get(WORLD, newcomer).into();
                let until = until_turn(place, first, ring.places().into()) / 3;
                if moved.is_empty() {
                    // Its place comes as soon, or all that do are nobody's.
                    assert!(until <= delay + 1 || weak > 0);
                    continue;
                }
                hastened += 1;
                assert_eq!(until, delay + 1);
                assert_eq!(moved.len(), 2);
                let other = moved[usize::from(moved[0] == newcomer)];
                assert_eq!(after.get(WORLD, other), before.get(WORLD, newcomer));
                // Of three who might wait, none is younger.
                let might = |vehicle: &usize| {
                    let place = before.get(WORLD, *vehicle).into();
                    let until = until_turn(place, first, ring.places().into()) / 3;
                    place < i32::from(ring.places()) && until == delay + 1
                };
                let youngest = all
                    .iter()
                    .copied()
                    .filter(might)
                    .map(|vehicle| ages.get(WORLD, vehicle))
                    .min();
                assert_eq!(Some(ages.get(WORLD, other)), youngest);
            }
            assert!(hastened > 5, "{hastened}");
        }
    }

    #[test]
    fn who_was_told_nothing_finds_a_place_that_is_nobody_else_s() {
        let mut cell = Cell::new(6, &["feedback.place_loss=1"]);
        let all: Vec<_> = (0..6).collect();
        cell.update(&all, &[]);
        let (ages, fresh) = (Rows::new(WORLDS, 6, 100), Rows::new(WORLDS, 6, 1));
        // In slot 2 the ring stands at place 0.
        let slot = [0, 1, 2].map(|_| cell.prepare(&ages))[2];
        let heard = cell.heard();
        assert_eq!((heard.ring.places(), heard.ring.first_place(slot)), (6, 0));
        assert_eq!((cell.place(0), heard.open), (None, Open(0b111)));
        assert_ne!(heard.threshold, u32::MAX);
        // Vehicle 5 is received in place 1, and then vehicle 4.
        let sub_channels = heard.ring.sub_channels();
        let second = carrier(1, hop(slot, sub_channels), sub_channels);
        let receive = |cell: &mut Cell, vehicle, ages: &Rows<u16>| {
            let received = |_, receiver| (receiver == vehicle).then_some(second);
            cell.station.receive(slot, &all, ages, received);
        };
        for vehicle in [5, 4] {
            receive(&mut cell, vehicle, &fresh);
            assert_eq!([cell.found(5), cell.found(4)], [1, NO_PLACE]);
        }
        // It is no longer open when it comes round.
        let later = [3, 4].map(|_| cell.prepare(&fresh))[1];
        assert_eq!(cell.heard().ring.first_place(later), 0);
        let again = carrier(1, hop(later, sub_channels), sub_channels);
        assert_eq!(cell.heard().open, Open(0b111 & !(1 << again)));
        // After long silence it is lost, and vehicle 4 may have it.
        receive(&mut cell, 4, &ages);
        assert_eq!([cell.found(5), cell.found(4)], [NO_PLACE, 1]);
        assert_eq!(cell.booked(), [0, 1, 2, 3, 4, 5]);
        // Who is received elsewhere moves there.
        let third = carrier(2, hop(slot, sub_channels), sub_channels);
        let received = |_, receiver| (receiver == 4).then_some(third);
        cell.station.receive(slot, &all, &fresh, received);
        assert_eq!([cell.found(5), cell.found(4)], [NO_PLACE, 2]);
        assert_eq!(cell.booked(), [0, 1, 2, 3, 4, 5]);
    }

    /// What happens in one world moves nobody's place in another, also where those are no longer spread.
    #[test]
    fn places_depend_on_their_own_world_alone() {
        let mut cell = Cell::new(12, &["feedback.place_loss=1"]);
        (0..3).for_each(|vehicle| cell.gains_db.fill(vehicle, 0.0));
        let all: Vec<_> = (0..12).collect();
        cell.update(&all, &[]);
        let (ages, fresh) = (Rows::new(WORLDS, 12, 100), Rows::new(WORLDS, 12, 1));
        let slot = cell.prepare(&ages);
        // Vehicle 11 finds a place that is not booked for anybody.
        let ring = cell.heard().ring;
        let (first, sub_channels) = (ring.first_place(slot), ring.sub_channels());
        let booked = cell.booked();
        let free = |offset: &usize| !booked.contains(&((first + *offset as u16) % ring.places()));
        let offset = (0..3).find(free).unwrap();
        let sub_channel = carrier(offset, hop(slot, sub_channels), sub_channels);
        let received = |_, vehicle| (vehicle == 11).then_some(sub_channel);
        cell.station.receive(slot, &all, &fresh, received);
        assert_eq!(cell.found(11), (first + offset as u16) % ring.places());
        let before = cell.station.announcements().booked().clone();
        // In another world a vehicle becomes weak.
        cell.gains_db.set(0, 5, 0.0);
        cell.update(&[], &[]);
        cell.prepare(&fresh);
        let booked = cell.station.announcements().booked();
        assert_ne!(booked.get(0, 5), before.get(0, 5));
        for vehicle in 0..12 {
            assert_eq!(booked.get(WORLD, vehicle), before.get(WORLD, vehicle));
        }
    }

    #[test]
    fn calls_arrive_with_their_delay() {
        let mut cell = Cell::new(6, &["feedback.place_loss=1", "broadcast.call_delay_slots=4"]);
        let mut prompt = Cell::new(6, &["feedback.place_loss=1"]);
        let all: Vec<_> = (0..6).collect();
        let fresh = Rows::new(WORLDS, 6, 1);
        for cell in [&mut cell, &mut prompt] {
            cell.update(&all, &[]);
            cell.prepare(&fresh);
        }
        // From the slot on from which all have found places nothing is open, but that is heard four slots later.
        for cell in [&mut cell, &mut prompt] {
            for vehicle in 0..6 {
                cell.station.announcements.found.fill(vehicle, vehicle as u16);
            }
        }
        for slot in 1..8 {
            cell.prepare(&fresh);
            prompt.prepare(&fresh);
            let open = |cell: &Cell| cell.heard().open.0;
            assert_eq!(open(&prompt), 0);
            assert_eq!(open(&cell), if slot < 5 { 0b111 } else { 0 }, "slot {slot}");
        }
    }
}
