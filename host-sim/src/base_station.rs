//! What the base station does besides listening: it puts vehicles into groups and broadcasts periods and joiner
//! probabilities, from what it knows and with its delay.

use crate::lanes::{LANES, Row, Rows, Vectors};
use crate::scenario::BroadcastScenario;
use firmware::measurement::Broadcast;
use firmware::observation::turn_lost_after;
use firmware::units::{JoinerProbability, Period, SUB_CHANNELS, SubChannel};
use std::collections::VecDeque;

/// The group of a vehicle that has none.
const NO_GROUP: u8 = u8::MAX;

/// What vehicles are told, in a batch of worlds: their group at association, periods and joiner probabilities by broadcast.
/// There is a group for every sub-channel.
#[derive(Clone, Debug)]
pub struct Announcements {
    /// Group of every vehicle. `[vehicle][world]`.
    home: Rows<u8>,
    /// The announced period; 0 for a group that is too large. `[group][world]`.
    period: Rows<u8>,
    /// Age up to which each vehicle keeps its turn. `[vehicle][world]`.
    turn_lost_after: Rows<u8>,
    /// Code of the joiner probability by the number of joiners.
    codes: Vec<u8>,
    /// Joiner counts of the last slots. `[slot modulo the ring's length]`, of `[group][world]`.
    joiners: Vec<Rows<u16>>,
    /// The counts that vehicles now hear of.
    heard: usize,
    groups: usize,
}

/// Groups and broadcasts of a batch of worlds.
#[derive(Clone, Debug)]
pub struct BaseStation {
    shrink_delay_slots: u32,
    announcements: Announcements,
    /// Slot in which each vehicle associated. `[vehicle][world]`.
    associated_at: Rows<u32>,
    /// `[group][world]`.
    members: Rows<u16>,
    /// Sizes of the past that still count, each with the last slot in which it held: a decrease is announced late.
    past: VecDeque<(u32, Rows<u16>)>,
    /// Buffers of forgotten sizes.
    spare: Vec<Rows<u16>>,
    /// Whether the sizes that count have changed since the periods were made.
    changed: bool,
    slot: u32,
}

impl BaseStation {
    /// A base station for `vehicles` vehicles, of which none is associated yet.
    pub fn new(scenario: &BroadcastScenario, worlds: usize, vehicles: usize, sub_channels: usize) -> Self {
        let code = |joiners: usize| {
            let probability = (scenario.joiner_load / joiners.max(1) as f64).min(1.0);
            let code = (probability * 256.0).round().max(1.0) as u16 - 1;
            code.min(255) as u8
        };
        let counts = Rows::new(worlds, sub_channels, 0);
        Self {
            shrink_delay_slots: scenario.shrink_delay_slots,
            associated_at: Rows::new(worlds, vehicles, 0),
            members: counts.clone(),
            past: VecDeque::new(),
            spare: Vec::new(),
            changed: true,
            announcements: Announcements {
                home: Rows::new(worlds, vehicles, NO_GROUP),
                period: Rows::new(worlds, sub_channels, 0),
                turn_lost_after: Rows::new(worlds, vehicles, 0),
                codes: (0..=vehicles).map(code).collect(),
                joiners: vec![counts; scenario.joiner_count_delay_slots as usize + 1],
                heard: 0,
                groups: sub_channels,
            },
            slot: 0,
        }
    }

    /// What vehicles are told.
    pub fn announcements(&self) -> &Announcements {
        &self.announcements
    }

    /// Slot, counted from the start, in which each present vehicle associated. `[vehicle][world]`.
    pub fn associated_at(&self) -> &Rows<u32> {
        &self.associated_at
    }

    /// Associates the vehicles of `arrivals` in one world and lets go those of `departures`. Vehicles that arrive together are
    /// dealt in ascending large-scale gain, each to the smallest group, so that weak vehicles spread over all groups.
    pub fn update(
        &mut self,
        world: usize,
        arrivals: &mut [usize],
        departures: &[usize],
        large_scale_db: &Rows<f32>,
    ) {
        if arrivals.is_empty() && departures.is_empty() {
            return;
        }
        self.remember_sizes();
        for &vehicle in departures {
            self.leave(world, vehicle);
        }
        let gain_db = |vehicle| large_scale_db.get(world, vehicle);
        arrivals.sort_unstable_by(|&a, &b| gain_db(a).total_cmp(&gain_db(b)).then(a.cmp(&b)));
        for &vehicle in arrivals.iter() {
            self.join(world, vehicle);
        }
    }

    /// Another vehicle takes a vehicle's index in one world: it associates anew.
    pub fn replace(&mut self, world: usize, vehicle: usize) {
        self.remember_sizes();
        self.leave(world, vehicle);
        self.join(world, vehicle);
    }

    /// Keeps the sizes of the slot before, which are about to change.
    fn remember_sizes(&mut self) {
        self.changed = true;
        let known = self.past.back().map(|&(last_slot, _)| last_slot + 1);
        if self.slot > 0 && known != Some(self.slot) {
            let mut before = self.spare.pop().unwrap_or_else(|| self.members.clone());
            before.as_flat_mut().copy_from_slice(self.members.as_flat());
            self.past.push_back((self.slot - 1, before));
        }
    }

    fn leave(&mut self, world: usize, vehicle: usize) {
        let group = usize::from(self.announcements.home.get(world, vehicle));
        if group < self.announcements.groups {
            let members = self.members.get(world, group);
            self.members.set(world, group, members - 1);
        }
        self.announcements.home.set(world, vehicle, NO_GROUP);
    }

    /// Puts a vehicle into the smallest group.
    fn join(&mut self, world: usize, vehicle: usize) {
        let smallest = (0..self.announcements.groups).min_by_key(|&group| self.members.get(world, group));
        if let Some(group) = smallest {
            self.announcements.home.set(world, vehicle, group as u8);
            self.associated_at.set(world, vehicle, self.slot);
            let members = self.members.get(world, group);
            self.members.set(world, group, members + 1);
        }
    }

    /// Prepares the next slot's broadcasts. `ages` are the present vehicles' as the base station knows them.
    pub fn prepare(&mut self, vectors: Vectors, present: &[usize], ages: &Rows<u8>) {
        while let Some((last_slot, _)) = self.past.front()
            && self.slot - last_slot > self.shrink_delay_slots
        {
            self.spare.extend(self.past.pop_front().map(|(_, sizes)| sizes));
            self.changed = true;
        }
        if self.changed {
            self.announce(present);
            self.changed = false;
        }
        let Announcements {
            home,
            turn_lost_after,
            joiners: counts,
            heard,
            groups,
            ..
        } = &mut self.announcements;
        let (ring, groups) = (counts.len(), *groups);
        if self.slot == 0 {
            // Before the first count arrives, everybody is a joiner.
            for joiners in counts.iter_mut() {
                joiners.as_flat_mut().copy_from_slice(self.members.as_flat());
            }
        }
        let now = self.slot as usize % ring;
        *heard = (now + 1) % ring;
        let joiners = &mut counts[now];
        joiners.as_flat_mut().fill(0);
        for block in 0..home.blocks() {
            vectors.run(
                #[inline(always)]
                || {
                    for &vehicle in present {
                        let (home, age) = (*home.row(block, vehicle), *ages.row(block, vehicle));
                        let limit = *turn_lost_after.row(block, vehicle);
                        let mut joins = [NO_GROUP; LANES];
                        for lane in 0..LANES {
                            joins[lane] = if age[lane] > limit[lane] {
                                home[lane]
                            } else {
                                NO_GROUP
                            };
                        }
                        for group in 0..groups {
                            let mut count = *joiners.row(block, group);
                            for lane in 0..LANES {
                                count[lane] += u16::from(joins[lane] == group as u8);
                            }
                            *joiners.row_mut(block, group) = count;
                        }
                    }
                },
            );
        }
        self.slot += 1;
    }

    /// Makes periods and the ages at which turns are lost from the sizes that count.
    fn announce(&mut self, present: &[usize]) {
        let Announcements {
            home,
            period,
            turn_lost_after: limits,
            ..
        } = &mut self.announcements;
        let members = self.members.as_flat();
        for (place, period) in period.as_flat_mut().iter_mut().enumerate() {
            let past = self.past.iter().map(|(_, sizes)| sizes.as_flat()[place]);
            let most = past.fold(members[place], u16::max);
            *period = u8::try_from(most)
                .ok()
                .and_then(Period::new)
                .map_or(0, Period::slots);
        }
        for &vehicle in present {
            for block in 0..home.blocks() {
                let home: Row<u8> = *home.row(block, vehicle);
                for (lane, group) in home.into_iter().enumerate() {
                    let period = (group != NO_GROUP)
                        .then(|| period.row(block, usize::from(group))[lane])
                        .and_then(Period::new);
                    limits.row_mut(block, vehicle)[lane] = period.map_or(0, turn_lost_after);
                }
            }
        }
    }
}

impl Announcements {
    /// The group of every vehicle, 255 for an absent one. `[vehicle][world]`.
    pub fn homes(&self) -> &Rows<u8> {
        &self.home
    }

    /// The announced period of every group in slots, 0 where it is too long to be announced. `[group][world]`.
    pub fn periods(&self) -> &Rows<u8> {
        &self.period
    }

    /// Ages in slots up to which vehicles keep their turn. `[vehicle][world]`.
    pub fn turns_lost_after(&self) -> &Rows<u8> {
        &self.turn_lost_after
    }

    /// The code of every group's joiner probability.
    #[inline(always)]
    pub fn joiner_code(&self, world: usize, group: usize) -> u8 {
        self.codes[usize::from(self.joiners[self.heard].get(world, group))]
    }

    /// What a present vehicle hears. `None` for an absent one, one in a group that is too large, or on a sub-channel that units
    /// do not know.
    pub fn broadcast(&self, world: usize, vehicle: usize) -> Option<Broadcast> {
        let home = self.home.get(world, vehicle);
        let group = usize::from(home);
        if group >= self.groups || self.groups != SUB_CHANNELS {
            return None;
        }
        Some(Broadcast {
            home: SubChannel::new(home)?,
            period: Period::new(self.period.get(world, group))?,
            joiner_probability: JoinerProbability::from_code(self.joiner_code(world, group)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;

    /// Two rows of worlds; the last one is looked at.
    const WORLDS: usize = LANES + 3;

    fn station(vehicles: usize) -> BaseStation {
        let scenario = ScenarioSource::default().read().unwrap().broadcast;
        BaseStation::new(&scenario, WORLDS, vehicles, SUB_CHANNELS)
    }

    /// The same arrivals and departures in every world; gains grow with the vehicles' numbers.
    fn update(station: &mut BaseStation, arrivals: &[usize], departures: &[usize]) {
        let mut gains = Rows::new(WORLDS, 20, 0.0);
        (0..20).for_each(|vehicle| gains.fill(vehicle, vehicle as f32));
        for world in 0..WORLDS {
            station.update(world, &mut arrivals.to_vec(), departures, &gains);
        }
    }

    fn heard(station: &BaseStation, vehicle: usize) -> Broadcast {
        station.announcements().broadcast(WORLDS - 1, vehicle).unwrap()
    }

    #[test]
    fn groups_are_even_and_spread_weak_vehicles() {
        let mut station = station(20);
        let all: Vec<_> = (0..20).collect();
        update(&mut station, &all, &[]);
        station.prepare(Vectors::widest(), &all, &Rows::new(WORLDS, 20, 100));
        let homes: Vec<_> = (0..20).map(|v| heard(&station, v).home.index()).collect();
        assert_eq!(homes[..6], [0, 1, 2, 0, 1, 2]);
        assert_eq!(heard(&station, 0).period.slots(), 7);
        assert_eq!(heard(&station, 2).period.slots(), 6);
        // 1.5 joiners a slot out of 7: 0.214 = 55 / 256.
        assert_eq!(heard(&station, 0).joiner_probability.in_256ths(), 55);
    }

    #[test]
    fn growth_is_told_at_once_and_shrinking_after_its_delay() {
        let mut station = station(7);
        let ages = Rows::new(WORLDS, 7, 1);
        let plain = Vectors::plain();
        let present: Vec<_> = (0..6).collect();
        update(&mut station, &present, &[]);
        station.prepare(plain, &present, &ages);
        assert_eq!(heard(&station, 0).period.slots(), 2);
        update(&mut station, &[6], &[]);
        station.prepare(plain, &[0, 1, 2, 3, 4, 5, 6], &ages);
        assert_eq!(heard(&station, 0).period.slots(), 3);
        update(&mut station, &[], &[6]);
        for _ in 0..100 {
            station.prepare(plain, &present, &ages);
            assert_eq!(heard(&station, 0).period.slots(), 3);
        }
        station.prepare(plain, &present, &ages);
        assert_eq!(heard(&station, 0).period.slots(), 2);
        assert_eq!(station.announcements().broadcast(WORLDS - 1, 6), None);
    }

    #[test]
    fn joiner_counts_arrive_with_their_delay() {
        let mut station = station(6);
        let all: Vec<_> = (0..6).collect();
        update(&mut station, &all, &[]);
        let ages = Rows::new(WORLDS, 6, 1);
        for _ in 0..5 {
            station.prepare(Vectors::widest(), &all, &ages);
            assert_eq!(heard(&station, 0).joiner_probability.in_256ths(), 192);
        }
        station.prepare(Vectors::widest(), &all, &ages);
        assert_eq!(heard(&station, 0).joiner_probability.in_256ths(), 256);
    }
}
