//! Who has which place of a ring, in a batch of worlds, and how many places it has: growth is told at once, shrinking late.

use super::NO_PLACE;
use crate::lanes::Rows;
use firmware::ring::MAX_PLACES;
use std::collections::VecDeque;

/// The places of a ring of every world.
#[derive(Clone, Debug)]
pub struct Book {
    /// Each vehicle's place, [`NO_PLACE`] for one without. `[vehicle][world]`.
    booked: Rows<u16>,
    /// Who has each place. `[world][place]`.
    owners: Vec<Vec<Option<u16>>>,
    /// How many of the first places are somebody's at least, by world: where to look for a free one.
    taken: Vec<usize>,
    /// How many vehicles have a place, by world.
    counts: Vec<usize>,
    /// Places of the ring. One item.
    places: Rows<u16>,
    /// Places that a world needs. One item.
    needed: Rows<u16>,
    /// Those of the past that still count, each with the last slot in which it held.
    past: VecDeque<(u32, Rows<u16>)>,
    /// Buffers of forgotten ones, and two to begin with: as many as count where vehicles move as often as rings shrink late.
    spare: Vec<Rows<u16>>,
    shrink_delay_slots: u32,
    /// Whether what counts has changed since the rings were made.
    changed: bool,
    /// Places of rings of which nobody needs any.
    least: u16,
    /// Whether a ring has another number of places than in the slot before, by world.
    resized: Vec<bool>,
    /// Owners in the order of their places, while they are spread.
    order: Vec<u16>,
}

impl Book {
    /// Nobody has a place in rings of at least so many.
    pub fn new(worlds: usize, vehicles: usize, least: u16, shrink_delay_slots: u32) -> Self {
        // So that no slot allocates, with as many open places as there may be.
        let room = (5 * vehicles + usize::from(least)).min(MAX_PLACES.into());
        Self {
            booked: Rows::new(worlds, vehicles, NO_PLACE),
            owners: (0..worlds).map(|_| Vec::with_capacity(room)).collect(),
            taken: vec![0; worlds],
            counts: vec![0; worlds],
            places: Rows::new(worlds, 1, least),
            needed: Rows::new(worlds, 1, least),
            past: VecDeque::with_capacity(2),
            spare: vec![Rows::new(worlds, 1, least); 2],
            shrink_delay_slots,
            changed: true,
            least,
            resized: vec![false; worlds],
            order: Vec::with_capacity(vehicles),
        }
    }

    /// [`Book::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self) {
        self.booked.fill_all(NO_PLACE);
        self.owners.iter_mut().for_each(Vec::clear);
        self.taken.fill(0);
        self.counts.fill(0);
        self.places.fill_all(self.least);
        self.needed.fill_all(self.least);
        self.spare.extend(self.past.drain(..).map(|(_, needed)| needed));
        self.changed = true;
        self.resized.fill(false);
    }

    /// How many places each ring has. One item.
    pub fn places(&self) -> &Rows<u16> {
        &self.places
    }

    /// Each vehicle's place, [`NO_PLACE`] for one without. `[vehicle][world]`.
    pub fn booked(&self) -> &Rows<u16> {
        &self.booked
    }

    /// A vehicle's place.
    pub fn place(&self, world: usize, vehicle: usize) -> Option<u16> {
        Some(self.booked.get(world, vehicle)).filter(|&place| place != NO_PLACE)
    }

    /// Whose place it is.
    pub fn owner(&self, world: usize, place: usize) -> Option<usize> {
        self.owners[world].get(place).copied().flatten().map(usize::from)
    }

    /// How many vehicles have a place.
    pub fn count(&self, world: usize) -> usize {
        self.counts[world]
    }

    /// Gives a vehicle without a place the first free one.
    pub fn book(&mut self, world: usize, vehicle: usize) {
        let (owners, taken) = (&self.owners[world], self.taken[world]);
        let others = owners[taken..].iter();
        let free = taken + others.take_while(|owner| owner.is_some()).count();
        self.give(world, vehicle, free as u16);
        self.taken[world] = free + 1;
    }

    /// Gives a vehicle without a place one that is nobody's.
    pub fn give(&mut self, world: usize, vehicle: usize, place: u16) {
        let owners = &mut self.owners[world];
        owners.resize(owners.len().max(usize::from(place) + 1), None);
        owners[usize::from(place)] = Some(vehicle as u16);
        self.booked.set(world, vehicle, place);
        self.counts[world] += 1;
    }

    /// Takes a vehicle's place back, if it has one.
    pub fn release(&mut self, world: usize, vehicle: usize) {
        if let Some(place) = self.place(world, vehicle) {
            self.owners[world][usize::from(place)] = None;
            self.taken[world] = self.taken[world].min(place.into());
            self.booked.set(world, vehicle, NO_PLACE);
            self.counts[world] -= 1;
        }
    }

    /// Gives a vehicle that has a place another one; whoever had that gets its own. Says who that was.
    pub fn exchange(&mut self, world: usize, vehicle: usize, place: u16) -> Option<usize> {
        let before = self.place(world, vehicle)?;
        let other = self.owner(world, place.into());
        self.release(world, vehicle);
        if let Some(other) = other {
            self.release(world, other);
            self.give(world, other, before);
        }
        self.give(world, vehicle, place);
        other
    }

    /// From this slot on, counted from the start, a world needs so many places.
    pub fn need(&mut self, world: usize, places: u16, slot: u32) {
        if places == self.needed.get(world, 0) {
            return;
        }
        self.changed = true;
        let known = self.past.back().map(|&(last_slot, _)| last_slot + 1);
        if slot > 0 && known != Some(slot) {
            let mut before = self.spare.pop().unwrap_or_else(|| self.needed.clone());
            before.as_flat_mut().copy_from_slice(self.needed.as_flat());
            self.past.push_back((slot - 1, before));
        }
        self.needed.set(world, 0, places);
    }

    /// Makes the rings of a slot, counted from the start, of the needed places that count. Where a ring has shrunk, `moved` is told
    /// whose place it no longer has, and that got another one.
    pub fn begin_slot(&mut self, slot: u32, present: &[usize], mut moved: impl FnMut(usize, usize)) {
        while let Some((last_slot, _)) = self.past.front()
            && slot - last_slot > self.shrink_delay_slots
        {
            self.spare.extend(self.past.pop_front().map(|(_, needed)| needed));
            self.changed = true;
        }
        self.resized.fill(false);
        if !std::mem::take(&mut self.changed) {
            return;
        }
        for world in 0..self.owners.len() {
            let past = self.past.iter().map(|(_, needed)| needed.get(world, 0));
            let places = past.fold(self.needed.get(world, 0), u16::max);
            self.resized[world] = places != self.places.get(world, 0);
            self.places.set(world, 0, places);
            if self.owners[world].len() <= usize::from(places) {
                continue;
            }
            for &vehicle in present {
                if self.place(world, vehicle).is_some_and(|place| place >= places) {
                    self.release(world, vehicle);
                    self.book(world, vehicle);
                    moved(world, vehicle);
                }
            }
            self.owners[world].truncate(places.into());
            self.taken[world] = self.taken[world].min(places.into());
        }
    }

    /// Whether a world's ring has another number of places since the slot began.
    pub fn has_resized(&self, world: usize) -> bool {
        self.resized[world]
    }

    /// Spreads the places of a world that are nobody's evenly over its ring, between those of its owners, who keep their order; `moved`
    /// is told whose has changed.
    pub fn spread(&mut self, world: usize, mut moved: impl FnMut(usize, usize)) {
        let places = usize::from(self.places.get(world, 0));
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend(self.owners[world].iter().flatten());
        let free = places - order.len();
        // The free place number j stands at (j + 1/2) of their distance.
        let before = |end: usize| (2 * end * free + places) / (2 * places);
        let taken = (0..places).filter(|&place| before(place + 1) == before(place));
        self.owners[world].fill(None);
        (self.taken[world], self.counts[world]) = (0, 0);
        for (&owner, place) in order.iter().zip(taken) {
            let owner = usize::from(owner);
            if usize::from(self.booked.get(world, owner)) != place {
                moved(world, owner);
            }
            self.give(world, owner, place as u16);
        }
        self.order = order;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_told_at_once_and_shrinking_after_its_delay() {
        let mut book = Book::new(1, 4, 3, 2);
        (0..4).for_each(|vehicle| book.book(0, vehicle));
        book.need(0, 4, 0);
        book.begin_slot(0, &[0, 1, 2, 3], |_, _| ());
        assert!(book.has_resized(0));
        assert_eq!(book.places().get(0, 0), 4);
        // Vehicle 0 leaves instead of the last: its place is free, and the last moves there when the ring shrinks.
        book.release(0, 0);
        book.need(0, 3, 1);
        let mut moved = Vec::new();
        for slot in 1..=2 {
            book.begin_slot(slot, &[1, 2, 3], |_, vehicle| moved.push(vehicle));
            assert!(!book.has_resized(0));
            assert_eq!((book.places().get(0, 0), book.place(0, 3)), (4, Some(3)));
        }
        book.begin_slot(3, &[1, 2, 3], |_, vehicle| moved.push(vehicle));
        assert!(book.has_resized(0));
        assert_eq!((book.places().get(0, 0), book.place(0, 3)), (3, Some(0)));
        assert_eq!(moved, [3]);
    }

    #[test]
    fn free_places_are_spread_between_owners_who_keep_their_order() {
        let mut book = Book::new(1, 4, 1, 0);
        (0..4).for_each(|vehicle| book.book(0, vehicle));
        book.need(0, 6, 0);
        book.begin_slot(0, &[0, 1, 2, 3], |_, _| ());
        let mut moved = Vec::new();
        book.spread(0, |_, vehicle| moved.push(vehicle));
        let places: Vec<_> = (0..6).map(|place| book.owner(0, place)).collect();
        assert_eq!(places, [Some(0), None, Some(1), Some(2), None, Some(3)]);
        assert_eq!(moved, [1, 2, 3]);
        assert_eq!(book.exchange(0, 3, 0), Some(0));
        assert_eq!((book.place(0, 3), book.place(0, 0)), (Some(0), Some(5)));
        assert_eq!(book.exchange(0, 1, 1), None);
        assert_eq!((book.owner(0, 1), book.owner(0, 2)), (Some(1), None));
        assert_eq!(book.count(0), 4);
    }
}
