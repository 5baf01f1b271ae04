//! From slots to seconds: every few minutes of traffic one second of radio runs slot by slot, and tells for every report of
//! those minutes how long it takes and whether it comes at all.
//!
//! A moment is who is connected in one cell at one instant. The cell of `host-sim run` plays it for a second after warming
//! up, with the vehicles driving on; what is kept are the slots in which each was received. A report of any vehicle in those
//! minutes then takes what it would have taken from the sampled vehicle at the most similar distance from the base station:
//! until its next reception, or, if it had none in the rest of the second, a second more and the next similar vehicle.
//!
//! What a vehicle sends is always the newest that it has, so a report that comes late is one that fresher ones overtake. A
//! hand-over inside a second is not played: it joins anew, which costs a tenth of a millisecond on average.

use super::OnRoad;
use super::delays::Delays;
use super::town::Town;
use super::trips::Trip;
use crate::age::{AgeSummary, WorldAges};
use crate::environment::Environment;
use crate::lanes::LANES;
use crate::mobility::{Mobility, MobilitySource, Place};
use crate::policy::Kind;
use crate::scenario::{PlanningScenario, Scenario};
use crate::simulation::{Extent, run_worlds};
use crate::stream::{Purpose, WorldKey};
use firmware::table::Table;
use kit::error::Result;
use rayon::prelude::*;

/// Slots of a second.
const SECOND: u32 = 1000;

/// Slots before, in which units find their places (chosen: three times what the cold start takes).
const WARMUP: u32 = 300;

/// Most seconds that a report is tried in (chosen; fresher ones are long there).
const TRIES: usize = 60;

/// A connected vehicle at an instant, seen from its base station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Connected {
    /// Eastwards of the station in m.
    pub x_m: f64,
    /// Northwards of the station in m.
    pub y_m: f64,
    /// Eastwards in m/s.
    pub x_m_per_s: f64,
    /// Northwards in m/s.
    pub y_m_per_s: f64,
}

/// Who is connected in one cell at one instant.
pub type Moment = Vec<Connected>;

/// A played second: by distance from the station in m, the slots in which a vehicle was received.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadioSecond {
    vehicles: Vec<(f64, Vec<u16>)>,
}

impl RadioSecond {
    /// Time in s until a report is received that a vehicle at this distance has ready at a phase of the second, from 0 to 1.
    fn delay_s(&self, distance_m: f64, phase: f64) -> Option<f64> {
        let nearest = self
            .vehicles
            .partition_point(|&(distance, _)| distance < distance_m);
        // Whatever is ready within a slot has to wait for the next.
        let ready = (phase * f64::from(SECOND)).floor();
        for attempt in 0..TRIES {
            let (_, slots) = &self.vehicles[(nearest + attempt) % self.vehicles.len()];
            // After the first second a report waits from the beginning.
            let from = if attempt == 0 { ready } else { 0.0 };
            if let Some(&slot) = slots.get(slots.partition_point(|&slot| f64::from(slot) < from)) {
                let waited = f64::from(slot) + 1.0 - ready;
                return Some(attempt as f64 + waited / f64::from(SECOND));
            }
        }
        None
    }
}

/// Moments as worlds for the cell, by descending load, so that a row of worlds is full of vehicles.
#[derive(Debug)]
struct Moments<'m> {
    moments: &'m [(usize, &'m Moment)],
    /// Vehicles of the fullest world of this row.
    most: usize,
}

/// Vehicles that drive straight on.
struct Straight<'m> {
    moment: &'m Moment,
    station_m: (f64, f64),
    slots: u32,
}

impl MobilitySource for Moments<'_> {
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        Box::new(Straight {
            moment: self.moments[key.world as usize].1,
            station_m: (scenario.cell.base_station_x_m, scenario.cell.base_station_y_m),
            slots: 0,
        })
    }

    fn describe(&self, _scenario: &Scenario) -> String {
        format!("{} moments", self.moments.len())
    }

    fn vehicles(&self, _scenario: &Scenario) -> usize {
        self.most
    }

    fn worlds_differ(&self) -> bool {
        true
    }
}

impl Mobility for Straight<'_> {
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        let seconds = f64::from(slots) / 1000.0;
        let since = f64::from(slots - self.slots) / 1000.0;
        self.slots = slots;
        places.clear();
        for (index, vehicle) in self.moment.iter().enumerate() {
            let speed_m_per_s = libm::hypot(vehicle.x_m_per_s, vehicle.y_m_per_s);
            let place = Place {
                x_m: self.station_m.0 + vehicle.x_m + seconds * vehicle.x_m_per_s,
                y_m: self.station_m.1 + vehicle.y_m + seconds * vehicle.y_m_per_s,
                moved_m: since * speed_m_per_s,
                speed_m_per_s,
            };
            places.push((index, place));
        }
        Ok(())
    }
}

/// Plays a second of every moment under a policy, on the current rayon pool: the seconds in the order of moments, and the ages
/// over all of them. The result does not depend on the number of threads.
///
/// # Errors
/// What [`Kind::check`] refuses.
pub fn play(
    scenario: &Scenario,
    seed: u64,
    policy: &Kind,
    table: &Table<'_>,
    moments: &[Moment],
) -> Result<(Vec<RadioSecond>, Option<AgeSummary>)> {
    let mut ordered: Vec<(usize, &Moment)> = moments
        .iter()
        .enumerate()
        .filter(|(_, moment)| !moment.is_empty())
        .collect();
    ordered.sort_by_key(|&(index, moment)| (std::cmp::Reverse(moment.len()), index));
    let most = ordered.first().map_or(0, |(_, moment)| moment.len());
    if most > 0 {
        policy.check(scenario, most, table)?;
    }
    let extent = Extent {
        seed,
        worlds: ordered.len() as u32,
        slots: SECOND,
        warmup: WARMUP,
    };
    let rows = ordered.chunks(LANES).enumerate().collect::<Vec<_>>();
    let rows = rows
        .into_par_iter()
        .map(|(row, worlds)| {
            let source = Moments {
                moments: &ordered,
                most: worlds[0].1.len(),
            };
            let first = (row * LANES) as u64;
            let range = first..first + worlds.len() as u64;
            let mut environment = Environment::new(scenario, &source, seed, Purpose::Evaluation, range);
            let mut decider = (policy.build)(&environment.setup(), table);
            let mut received: Vec<Vec<Vec<u16>>> = worlds
                .iter()
                .map(|(_, moment)| vec![Vec::new(); moment.len()])
                .collect();
            let ages = run_worlds(&mut environment, &mut decider, &extent, |environment| {
                let Some(slot) = (environment.elapsed() - 1).checked_sub(WARMUP) else {
                    return;
                };
                for (world, received) in received.iter_mut().enumerate() {
                    for (vehicle, slots) in received.iter_mut().enumerate() {
                        if environment.received(world, vehicle) {
                            slots.push(slot as u16);
                        }
                    }
                }
            })?;
            Ok((ages, received))
        })
        .collect::<Result<Vec<_>>>()?;
    let (ages, received): (Vec<Vec<WorldAges>>, Vec<_>) = rows.into_iter().unzip();
    let mut seconds = vec![RadioSecond::default(); moments.len()];
    for (&(index, moment), received) in ordered.iter().zip(received.into_iter().flatten()) {
        let distance = |vehicle: &Connected| libm::hypot(vehicle.x_m, vehicle.y_m);
        let mut vehicles: Vec<(f64, Vec<u16>)> = moment.iter().map(distance).zip(received).collect();
        vehicles.sort_by(|a, b| a.0.total_cmp(&b.0));
        seconds[index] = RadioSecond { vehicles };
    }
    Ok((seconds, AgeSummary::new(&ages.concat())))
}

/// The delays of one world's reports, from its played seconds.
pub struct Sampled<'s> {
    town: &'s Town,
    /// By sample, then by station.
    seconds: &'s [RadioSecond],
    sample_s: f64,
}

impl<'s> Sampled<'s> {
    /// From the seconds of a world, sample by sample and in each station by station.
    pub fn new(town: &'s Town, seconds: &'s [RadioSecond], sample_s: f64) -> Self {
        Self {
            town,
            seconds,
            sample_s,
        }
    }
}

impl Delays for Sampled<'_> {
    fn arrival_s(&mut self, from: &OnRoad, time_s: f64) -> Option<f64> {
        let place = self.town.map().place_m(from);
        let (station, distance_m) = self.town.nearest_station(place);
        let stations = self.town.stations_m().len();
        let samples = self.seconds.len() / stations;
        let sample = ((time_s / self.sample_s) as usize).min(samples - 1);
        // A cell that was empty at this sample is taken from the nearest one before, or after, that was not.
        let others = (0..=sample).rev().chain(sample + 1..samples);
        let mut seconds = others.map(|sample| &self.seconds[sample * stations + station]);
        let second = seconds.find(|second| !second.vehicles.is_empty());
        // A vehicle that looks at whole seconds does not send in step with all others.
        let phase = (f64::from(from.vehicle) * 0.618_033_988_749_895).fract();
        match second {
            Some(second) => second.delay_s(distance_m, phase).map(|delay_s| time_s + delay_s),
            // Nobody was ever sampled in this cell: it is alone, and heard in the next slot.
            None => Some(time_s + 1.0 / f64::from(SECOND)),
        }
    }
}

/// Takes moments of an hour at even distances, as its looks go by.
#[derive(Debug)]
pub struct Sampler<'s> {
    town: &'s Town,
    trips: &'s [Trip],
    planning: &'s PlanningScenario,
    before: Vec<OnRoad>,
    samples: u32,
    moments: Vec<Moment>,
}

impl<'s> Sampler<'s> {
    /// Before the first look.
    pub fn new(town: &'s Town, trips: &'s [Trip], planning: &'s PlanningScenario) -> Self {
        Self {
            town,
            trips,
            planning,
            before: Vec::new(),
            samples: 0,
            moments: Vec::new(),
        }
    }

    /// Sees everybody at a look.
    pub fn look(&mut self, time_s: f64, now: &[OnRoad]) {
        let planning = self.planning;
        // In the middle of the time that it stands for.
        let due_s = planning.radio_sample_s * (f64::from(self.samples) + 0.5);
        if time_s >= due_s && time_s <= planning.horizon_s {
            self.samples += 1;
            let connected = |vehicle: u32| {
                let trip = &self.trips[vehicle as usize];
                trip.connected(planning.connected_share)
            };
            let moments = moments(self.town, &self.before, now, planning.look_s, connected);
            self.moments.extend(moments);
        }
        self.before.clear();
        self.before.extend_from_slice(now);
    }

    /// Sample by sample, and in each station by station.
    pub fn moments(self) -> Vec<Moment> {
        self.moments
    }
}

/// Who is connected in every cell, as seen at two looks.
pub fn moments(
    town: &Town,
    before: &[OnRoad],
    now: &[OnRoad],
    look_s: f64,
    connected: impl Fn(u32) -> bool,
) -> Vec<Moment> {
    let mut moments = vec![Moment::new(); town.stations_m().len()];
    let mut before = before.iter().peekable();
    for on_road in now {
        while before.next_if(|last| last.vehicle < on_road.vehicle).is_some() {}
        if !connected(on_road.vehicle) {
            continue;
        }
        let (x_m, y_m) = town.map().place_m(on_road);
        let moved_m = match before.peek() {
            Some(last) if last.vehicle == on_road.vehicle && last.road == on_road.road => {
                (on_road.along_m - last.along_m).max(0.0)
            }
            // On this road for less than a look.
            _ => on_road.along_m,
        };
        let (along_x, along_y) = town.map().direction(on_road.road);
        let (station, _) = town.nearest_station((x_m, y_m));
        let place = town.stations_m()[station];
        moments[station].push(Connected {
            x_m: x_m - place.0,
            y_m: y_m - place.1,
            x_m_per_s: along_x * moved_m / look_s,
            y_m_per_s: along_y * moved_m / look_s,
        });
    }
    moments
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_waits_for_the_next_reception_of_whom_it_resembles() {
        let second = RadioSecond {
            vehicles: vec![(10.0, vec![0, 100, 200]), (20.0, vec![]), (30.0, vec![400])],
        };
        let slots = |distance, phase| (1000.0 * second.delay_s(distance, phase).unwrap()).round();
        assert_eq!(slots(5.0, 0.0), 1.0);
        assert_eq!(slots(5.0, 0.15), 51.0);
        // Nothing more in this second: another, with the next vehicles that had some.
        assert_eq!(slots(5.0, 0.5), 2000.0 + 401.0 - 500.0);
        assert_eq!(slots(20.0, 0.25), 1000.0 + 401.0 - 250.0);
        let silent = RadioSecond {
            vehicles: vec![(10.0, vec![])],
        };
        assert_eq!(silent.delay_s(1.0, 0.0), None);
    }
}
