//! What the base station does besides listening: it puts vehicles into groups and broadcasts periods and joiner
//! probabilities, from what it knows and with its delay.

use crate::scenario::BroadcastScenario;
use firmware::measurement::Broadcast;
use firmware::observation::turn_lost_after;
use firmware::units::{JoinerProbability, Period, SUB_CHANNELS, SubChannel};
use std::collections::VecDeque;

/// Groups and broadcasts of one cell.
#[derive(Clone, Debug)]
pub struct BaseStation {
    scenario: BroadcastScenario,
    /// Group of every present vehicle.
    group: Vec<Option<SubChannel>>,
    groups: [Group; SUB_CHANNELS],
}

#[derive(Clone, Debug, Default)]
struct Group {
    members: u32,
    /// Sizes of the last slots, newest last: a decrease is announced late.
    sizes: VecDeque<u32>,
    /// Joiner counts of the last slots, newest last.
    joiners: VecDeque<u32>,
    announced: u32,
}

impl BaseStation {
    /// A base station for `vehicles` vehicles, of which none is associated yet.
    pub fn new(scenario: &BroadcastScenario, vehicles: usize) -> Self {
        Self {
            scenario: scenario.clone(),
            group: vec![None; vehicles],
            groups: Default::default(),
        }
    }

    /// Associates the vehicles of `arrivals` and lets go those of `departures`. Vehicles that arrive together are dealt in
    /// ascending large-scale gain, each to the smallest group, so that weak vehicles spread over all groups.
    pub fn update(
        &mut self,
        arrivals: &mut [usize],
        departures: &[usize],
        large_scale_db: impl Fn(usize) -> f32,
    ) {
        for &vehicle in departures {
            if let Some(group) = self.group[vehicle].take() {
                self.groups[group.index()].members -= 1;
            }
        }
        arrivals.sort_by(|&a, &b| large_scale_db(a).total_cmp(&large_scale_db(b)).then(a.cmp(&b)));
        for &vehicle in arrivals.iter() {
            let smallest = (0..SUB_CHANNELS as u8)
                .filter_map(SubChannel::new)
                .min_by_key(|group| self.groups[group.index()].members);
            if let Some(group) = smallest {
                self.group[vehicle] = Some(group);
                self.groups[group.index()].members += 1;
            }
        }
    }

    /// Prepares the next slot's broadcasts. `age_slots` is every present vehicle's age as the base station knows it.
    pub fn prepare(&mut self, present: &[usize], age_slots: impl Fn(usize) -> u8) {
        let shrink_delay = self.scenario.shrink_delay_slots as usize;
        for group in &mut self.groups {
            group.sizes.push_back(group.members);
            if group.sizes.len() > shrink_delay + 1 {
                let _ = group.sizes.pop_front();
            }
            group.announced = group.sizes.iter().copied().max().unwrap_or(group.members);
        }
        let mut joiners = [0; SUB_CHANNELS];
        for &vehicle in present {
            if let Some(group) = self.group[vehicle] {
                let limit = self.groups[group.index()].period().map_or(0, turn_lost_after);
                joiners[group.index()] += u32::from(age_slots(vehicle) > limit);
            }
        }
        let count_delay = self.scenario.joiner_count_delay_slots as usize;
        for (group, joiners) in self.groups.iter_mut().zip(joiners) {
            if group.joiners.is_empty() {
                // Before the first count arrives, everybody is a joiner.
                group.joiners.resize(count_delay, group.members);
            }
            group.joiners.push_back(joiners);
            if group.joiners.len() > count_delay + 1 {
                let _ = group.joiners.pop_front();
            }
        }
    }

    /// What a present vehicle hears. `None` for an absent one.
    pub fn broadcast(&self, vehicle: usize) -> Option<Broadcast> {
        let home = self.group[vehicle]?;
        let group = &self.groups[home.index()];
        let joiners = f64::from(group.joiners.front().copied().unwrap_or(group.members).max(1));
        let probability = (self.scenario.joiner_load / joiners).min(1.0);
        let code = (probability * 256.0).round().max(1.0) as u16 - 1;
        Some(Broadcast {
            home,
            period: group.period()?,
            joiner_probability: JoinerProbability::from_code(code.min(255) as u8),
        })
    }
}

impl Group {
    fn period(&self) -> Option<Period> {
        Period::new(u8::try_from(self.announced).ok()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;

    fn station(vehicles: usize) -> BaseStation {
        BaseStation::new(&ScenarioSource::default().read().unwrap().broadcast, vehicles)
    }

    #[test]
    fn groups_are_even_and_spread_weak_vehicles() {
        let mut station = station(20);
        let mut all: Vec<_> = (0..20).collect();
        station.update(&mut all, &[], |vehicle| vehicle as f32);
        station.prepare(&all, |_| 100);
        let homes: Vec<_> = (0..20)
            .map(|v| station.broadcast(v).unwrap().home.index())
            .collect();
        assert_eq!(homes[..6], [0, 1, 2, 0, 1, 2]);
        assert_eq!(station.broadcast(0).unwrap().period.slots(), 7);
        assert_eq!(station.broadcast(2).unwrap().period.slots(), 6);
        // 1.5 joiners a slot out of 7: 0.214 = 55 / 256.
        assert_eq!(station.broadcast(0).unwrap().joiner_probability.in_256ths(), 55);
    }

    #[test]
    fn growth_is_told_at_once_and_shrinking_after_its_delay() {
        let mut station = station(7);
        let mut first: Vec<_> = (0..6).collect();
        station.update(&mut first, &[], |_| 0.0);
        let present: Vec<_> = (0..6).collect();
        station.prepare(&present, |_| 1);
        assert_eq!(station.broadcast(0).unwrap().period.slots(), 2);
        station.update(&mut [6], &[], |_| 0.0);
        station.prepare(&present, |_| 1);
        assert_eq!(station.broadcast(0).unwrap().period.slots(), 3);
        station.update(&mut [], &[6], |_| 0.0);
        for _ in 0..100 {
            station.prepare(&present, |_| 1);
            assert_eq!(station.broadcast(0).unwrap().period.slots(), 3);
        }
        station.prepare(&present, |_| 1);
        assert_eq!(station.broadcast(0).unwrap().period.slots(), 2);
        assert_eq!(station.broadcast(6), None);
    }

    #[test]
    fn joiner_counts_arrive_with_their_delay() {
        let mut station = station(6);
        let mut all: Vec<_> = (0..6).collect();
        station.update(&mut all, &[], |_| 0.0);
        let all: Vec<_> = (0..6).collect();
        for _ in 0..5 {
            station.prepare(&all, |_| 1);
            assert_eq!(station.broadcast(0).unwrap().joiner_probability.in_256ths(), 192);
        }
        station.prepare(&all, |_| 1);
        assert_eq!(station.broadcast(0).unwrap().joiner_probability.in_256ths(), 256);
    }
}
