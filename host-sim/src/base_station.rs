//! What the base station does besides listening: it puts vehicles into groups and broadcasts periods and joiner
//! probabilities, from what it knows and with its delay.

use crate::lanes::{LANES, Row, Rows, Vectors};
use crate::scenario::Scenario;
use crate::stream::{Role, Stream, WorldKey};
use firmware::measurement::Broadcast;
use firmware::observation::turn_lost_after;
use firmware::units::{JoinerProbability, Period, SUB_CHANNELS, SubChannel};
use std::collections::VecDeque;

/// The group of a vehicle that has none.
const NO_GROUP: u8 = u8::MAX;

/// The position of a vehicle in no frame.
const NO_POSITION: u16 = u16::MAX;

/// What vehicles are told, in a batch of worlds: their group at association, periods and joiner probabilities by broadcast.
/// There is a group for every sub-channel.
#[derive(Clone, Debug)]
pub struct Announcements {
    /// Group of every vehicle. `[vehicle][world]`.
    home: Rows<u8>,
    /// Slot of its group's frame that is a vehicle's own. `[vehicle][world]`.
    position: Rows<u16>,
    /// 1 where a vehicle was told its position. `[vehicle][world]`.
    placed: Rows<u8>,
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
    /// Share of vehicles that are not told their position.
    place_loss: f64,
    /// Who is not; by world.
    losses: Vec<Stream>,
}

impl BaseStation {
    /// A base station for `vehicles` vehicles, of which none is associated yet.
    pub fn new(scenario: &Scenario, keys: &[WorldKey], vehicles: usize) -> Self {
        let (worlds, sub_channels) = (keys.len(), scenario.radio.sub_channels as usize);
        let place_loss = scenario.feedback.place_loss;
        let scenario = &scenario.broadcast;
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
                position: Rows::new(worlds, vehicles, NO_POSITION),
                placed: Rows::new(worlds, vehicles, 0),
                period: Rows::new(worlds, sub_channels, 0),
                turn_lost_after: Rows::new(worlds, vehicles, 0),
                codes: (0..=vehicles).map(code).collect(),
                joiners: vec![counts; scenario.joiner_count_delay_slots as usize + 1],
                heard: 0,
                groups: sub_channels,
            },
            slot: 0,
            place_loss,
            losses: keys.iter().map(|key| key.stream(Role::Losses, 3)).collect(),
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
        self.announcements.position.set(world, vehicle, NO_POSITION);
    }

    /// Puts a vehicle into the smallest group.
    fn join(&mut self, world: usize, vehicle: usize) {
        let smallest = (0..self.announcements.groups).min_by_key(|&group| self.members.get(world, group));
        if let Some(group) = smallest {
            let position = self.announcements.free_position(world, group as u8);
            self.announcements.position.set(world, vehicle, position);
            let lost = self.place_loss > 0.0 && self.losses[world].chance(self.place_loss);
            self.announcements.placed.set(world, vehicle, u8::from(!lost));
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

    /// Makes periods and the ages at which turns are lost from the sizes that count. Where a frame shrinks, whose slot it no longer
    /// has is told another one.
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
        self.announcements.move_into_frames(present);
    }
}

impl Announcements {
    /// The first slot of a group's frame that is nobody's.
    fn free_position(&self, world: usize, group: u8) -> u16 {
        let vehicles = 0..self.codes.len() - 1;
        let members = vehicles.filter(|&vehicle| self.home.get(world, vehicle) == group);
        let mut taken: Vec<u16> = members.map(|vehicle| self.position.get(world, vehicle)).collect();
        taken.sort_unstable();
        // Sorted positions are all different: the first that is not its own index is behind a gap.
        let gap = taken
            .iter()
            .enumerate()
            .find(|&(index, &position)| index != usize::from(position));
        gap.map_or(taken.len(), |(index, _)| index) as u16
    }

    /// Gives vehicles whose slot is behind their group's frame the first free slots in it.
    fn move_into_frames(&mut self, present: &[usize]) {
        for &vehicle in present {
            for block in 0..self.home.blocks() {
                for lane in 0..LANES {
                    let (home, position) = (
                        self.home.row(block, vehicle)[lane],
                        self.position.row(block, vehicle)[lane],
                    );
                    if position == NO_POSITION || usize::from(home) >= self.groups {
                        continue;
                    }
                    let period = self.period.row(block, usize::from(home))[lane];
                    if period > 0 && position >= u16::from(period) {
                        let free = self.free_position(block * LANES + lane, home);
                        self.position.row_mut(block, vehicle)[lane] = free;
                    }
                }
            }
        }
    }

    /// The slot of its group's frame that is a vehicle's own; `None` if it was not told, or is absent. The frame has as many slots
    /// as the announced period.
    pub fn position(&self, world: usize, vehicle: usize) -> Option<u16> {
        let position = self.position.get(world, vehicle);
        let told = self.placed.get(world, vehicle) > 0;
        (told && position != NO_POSITION).then_some(position)
    }

    /// The group of every vehicle, 255 for an absent one. `[vehicle][world]`.
    pub fn homes(&self) -> &Rows<u8> {
        &self.home
    }

    /// How many groups there are, one for every sub-channel.
    pub fn groups(&self) -> usize {
        self.groups
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
    use crate::stream::Purpose;

    /// Two rows of worlds; the last one is looked at.
    const WORLDS: usize = LANES + 3;

    fn station(vehicles: usize) -> BaseStation {
        let scenario = ScenarioSource::default().read().unwrap();
        let key = |world| WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world,
        };
        let keys: Vec<WorldKey> = (0..WORLDS as u64).map(key).collect();
        BaseStation::new(&scenario, &keys, vehicles)
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
        let places: Vec<_> = (0..20)
            .map(|v| station.announcements().position(WORLDS - 1, v))
            .collect();
        assert_eq!(
            places[..7],
            [Some(0), Some(0), Some(0), Some(1), Some(1), Some(1), Some(2)]
        );
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
        // Vehicle 0 leaves instead of the last: its slot is free, and the last moves there when the frame shrinks.
        let position = |station: &BaseStation, vehicle| station.announcements().position(WORLDS - 1, vehicle);
        assert_eq!(position(&station, 6), Some(2));
        update(&mut station, &[], &[0]);
        let present: Vec<_> = (1..7).collect();
        for _ in 0..100 {
            station.prepare(plain, &present, &ages);
            assert_eq!(heard(&station, 6).period.slots(), 3);
            assert_eq!(position(&station, 6), Some(2));
        }
        station.prepare(plain, &present, &ages);
        assert_eq!(heard(&station, 6).period.slots(), 2);
        assert_eq!((position(&station, 6), position(&station, 0)), (Some(0), None));
        assert_eq!(station.announcements().broadcast(WORLDS - 1, 0), None);
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
