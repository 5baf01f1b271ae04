//! Fixed-time signals at the crossings, and the queues before them.
//!
//! Both streets of a crossing have red for the same share of a cycle, half a cycle apart; when a cycle begins differs from crossing to
//! crossing (chosen: uniform). Whoever has red halts before the crossing, whoever comes behind keeps its distance, and stands
//! where there is none. Who turns into a lane, or is new on it, may be closer to others, and they wait for each other then.
//! Vehicles that stand for good are beside the lane and in nobody's way.

use super::streets::Streets;
use super::{Heading, Vehicle};
use crate::scenario::MobilityScenario;
use crate::stream::Stream;
use std::ops::Range;

/// How long vehicles move between two looks at signals and neighbours, in slots (chosen: as often as the paper moves them).
const STEP_SLOTS: i64 = 100;

/// How far before a crossing its signal holds vehicles, in m (chosen).
const HALT_M: f64 = 1.0;

/// Cycles that have passed when a world begins, so that it begins with queues (chosen).
const LEAD_IN_CYCLES: f64 = 2.0;

/// The signals of one world.
#[derive(Clone)]
pub(super) struct Signals {
    cycle_s: f64,
    red_share: f64,
    spacing_m: f64,
    /// What part of a cycle has passed at slot 0, by crossing, and crossings by the streets along x.
    phases: Vec<Vec<f64>>,
    /// Vehicles in the order in which they move: those ahead on a lane first.
    order: Vec<usize>,
}

impl Signals {
    /// The scenario's signals, if it has any.
    pub fn new(scenario: &MobilityScenario) -> Option<Self> {
        let (x, y) = (scenario.blocks_x as usize + 1, scenario.blocks_y as usize + 1);
        (scenario.signal_cycle_s > 0.0).then(|| Self {
            cycle_s: scenario.signal_cycle_s,
            red_share: scenario.signal_red_share,
            spacing_m: scenario.queue_spacing_m,
            phases: vec![vec![0.0; x]; y],
            order: Vec::new(),
        })
    }

    /// Draws when cycles begin.
    pub fn begin(&mut self, stream: &mut Stream) {
        for phase in self.phases.iter_mut().flatten() {
            *phase = f64::from(stream.uniform());
        }
    }

    /// Lets vehicles drive until there are queues.
    pub fn lead_in(&mut self, streets: &Streets<'_>, vehicles: &mut [Vehicle], stream: &mut Stream) {
        let slots = libm::ceil(LEAD_IN_CYCLES * self.cycle_s * 1000.0) as i64;
        self.steps(-slots..0, streets, vehicles, stream);
    }

    /// Moves all vehicles from one slot to another.
    pub fn drive(
        &mut self,
        slots: Range<u32>,
        streets: &Streets<'_>,
        vehicles: &mut [Vehicle],
        stream: &mut Stream,
    ) {
        vehicles.iter_mut().for_each(|vehicle| vehicle.moved_m = 0.0);
        self.steps(slots.start.into()..slots.end.into(), streets, vehicles, stream);
    }

    fn steps(
        &mut self,
        slots: Range<i64>,
        streets: &Streets<'_>,
        vehicles: &mut [Vehicle],
        stream: &mut Stream,
    ) {
        let mut slot = slots.start;
        while slot < slots.end {
            let next = slots.end.min(slot + STEP_SLOTS);
            self.step(slot..next, streets, vehicles, stream);
            slot = next;
        }
    }

    fn step(
        &mut self,
        slots: Range<i64>,
        streets: &Streets<'_>,
        vehicles: &mut [Vehicle],
        stream: &mut Stream,
    ) {
        let seconds = (slots.end - slots.start) as f64 / 1000.0;
        let end_s = slots.end as f64 / 1000.0;
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        order.extend((0..vehicles.len()).filter(|&index| vehicles[index].free_speed_m_per_s > 0.0));
        order.sort_unstable_by(|&one, &other| {
            let (a, b) = (&vehicles[one], &vehicles[other]);
            let lanes = (a.heading as u8)
                .cmp(&(b.heading as u8))
                .then(a.across_m.total_cmp(&b.across_m));
            lanes
                .then((b.along_m * b.heading.sign()).total_cmp(&(a.along_m * a.heading.sign())))
                .then(one.cmp(&other))
        });
        // The last on its lane of those who have moved, unless it left the lane.
        let mut last: Option<(Heading, f64, f64)> = None;
        for &index in &order {
            let vehicle = &mut vehicles[index];
            let (heading, across_m) = (vehicle.heading, vehicle.across_m);
            let gap_m = last
                .filter(|last| (last.0, last.1) == (heading, across_m))
                .map_or(f64::INFINITY, |last| vehicle.distance_m(last.2) - self.spacing_m);
            let way_m = (vehicle.free_speed_m_per_s * seconds).min(gap_m).max(0.0);
            let moved_m = streets.drive(vehicle, way_m, stream, |streets, vehicle| {
                self.free_m(streets, vehicle, end_s)
            });
            vehicle.moved_m += moved_m;
            vehicle.speed_m_per_s = moved_m / seconds;
            if (vehicle.heading, vehicle.across_m) == (heading, across_m) {
                last = Some((heading, across_m, vehicle.along_m));
            }
        }
        self.order = order;
    }

    /// How far a vehicle may go before its next signal holds it.
    fn free_m(&self, streets: &Streets<'_>, vehicle: &Vehicle, time_s: f64) -> f64 {
        let Some(crossing) = streets.next_crossing(vehicle.heading, vehicle.along_m) else {
            return f64::INFINITY;
        };
        // The street that the lane is one of.
        let (block_m, _) = streets.blocks(vehicle.heading.left());
        let street = (vehicle.across_m / block_m).round() as usize;
        let index = crossing.index as usize;
        let (x, y) = if vehicle.heading.along_y() {
            (street, index)
        } else {
            (index, street)
        };
        if self.is_red(vehicle.heading, self.phases[y][x] + time_s / self.cycle_s) {
            (vehicle.distance_m(crossing.begin_m) - HALT_M).max(0.0)
        } else {
            f64::INFINITY
        }
    }

    /// Whether a heading has red after so many cycles of a crossing.
    fn is_red(&self, heading: Heading, cycles: f64) -> bool {
        let since = if heading.along_y() { cycles } else { cycles + 0.5 };
        since - since.floor() < self.red_share
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Mobility as _, UrbanGrid};
    use super::*;
    use crate::scenario::ScenarioSource;
    use crate::stream::{Purpose, WorldKey};

    const KEY: WorldKey = WorldKey {
        seed: 5,
        purpose: Purpose::Evaluation,
        world: 0,
    };

    fn scenario(settings: &[&str]) -> MobilityScenario {
        let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
        ScenarioSource {
            settings,
            ..ScenarioSource::default()
        }
        .read()
        .unwrap()
        .mobility
    }

    #[test]
    fn nobody_passes_on_red_and_queues_keep_their_spacing() {
        for settings in [
            &["mobility.signal_cycle_s=60"][..],
            &["mobility.signal_cycle_s=60", "mobility.turns=\"per-crossing\""],
            &[
                "mobility.signal_cycle_s=20",
                "mobility.signal_red_share=0.7",
                "mobility.queue_spacing_m=12",
                "mobility.standing_share=0.2",
            ],
        ] {
            let scenario = scenario(settings);
            let mut grid = UrbanGrid::new(&scenario, 200, &KEY);
            let (mut held, mut queued) = (0, 0);
            let mut places = Vec::new();
            for update in 1..=1200 {
                let before = grid.vehicles.clone();
                let slots = update * 100;
                grid.advance(slots, &mut places).unwrap();
                let (streets, signals) = (&grid.streets, grid.signals.as_ref().unwrap());
                for (was, is) in before.iter().zip(&grid.vehicles) {
                    assert!(
                        (0.0..=is.free_speed_m_per_s * 0.1 + 1e-9).contains(&is.moved_m),
                        "{is:?}"
                    );
                    if signals
                        .free_m(streets, was, f64::from(slots) / 1000.0)
                        .is_finite()
                        && streets
                            .next_crossing(was.heading, was.along_m)
                            .is_some_and(|crossing| was.distance_m(crossing.begin_m) < 1.5)
                    {
                        held += 1;
                        assert_eq!((was.heading, was.across_m), (is.heading, is.across_m));
                        assert!(is.moved_m <= 0.5, "passed on red: {was:?}, {is:?}");
                    }
                }
                // In the areas of crossings vehicles come onto a lane from the side.
                let between = |vehicle: &Vehicle| {
                    let (block_m, _) = streets.blocks(vehicle.heading);
                    let from_middle_m = vehicle.along_m - (vehicle.along_m / block_m).round() * block_m;
                    from_middle_m.abs() > 7.0
                };
                let stands = |vehicle: &&Vehicle| {
                    vehicle.free_speed_m_per_s > 0.0 && vehicle.moved_m == 0.0 && between(vehicle)
                };
                let standing: Vec<&Vehicle> = grid.vehicles.iter().filter(stands).collect();
                for (index, a) in standing.iter().enumerate() {
                    assert_eq!(a.place().speed_m_per_s, 0.0);
                    for b in &standing[..index] {
                        if (a.heading, a.across_m) == (b.heading, b.across_m) {
                            let gap_m = (a.along_m - b.along_m).abs();
                            assert!(gap_m > scenario.queue_spacing_m - 1e-6, "{a:?}, {b:?}");
                            queued += u32::from(gap_m < scenario.queue_spacing_m + 1e-6);
                        }
                    }
                }
            }
            assert!(held > 1000 && queued > 1000, "{settings:?}: {held}, {queued}");
        }
    }

    #[test]
    fn queues_are_there_from_the_start_and_leave_on_green() {
        let scenario = scenario(&["mobility.signal_cycle_s=60"]);
        let mut grid = UrbanGrid::new(&scenario, 200, &KEY);
        let mut places = Vec::new();
        grid.advance(0, &mut places).unwrap();
        let stands = |places: &[(usize, super::super::Place)]| -> Vec<bool> {
            places
                .iter()
                .map(|(_, place)| place.speed_m_per_s == 0.0)
                .collect()
        };
        let first = stands(&places);
        let share = first.iter().filter(|&&stands| stands).count();
        // Half a cycle of red over the drive between two crossings and the mean wait there, roughly.
        assert!((20..=120).contains(&share), "{share} of 200 stand");
        let mut moved = vec![false; 200];
        for update in 1..=300 {
            grid.advance(update * 100, &mut places).unwrap();
            for (vehicle, stands) in stands(&places).into_iter().enumerate() {
                moved[vehicle] |= !stands;
            }
        }
        let left = first
            .iter()
            .zip(&moved)
            .filter(|(stood, moved)| **stood && **moved);
        assert!(
            left.count() * 10 > share * 9,
            "half a cycle lets nearly all of them go"
        );
    }
}
