//! One world's hour on the roads: departures, traffic, reports, beliefs, advice, arrivals.

use super::delays::Delays;
use super::guidance::{Choice, Guide};
use super::incidents::Incidents;
use super::knowledge::{Estimator, Knowledge, Report};
use super::roads::RoadMap;
use super::trips::Trip;
use super::{Arrival, OnRoad, TrafficModel};
use crate::stream::WorldKey;
use assignment::{Network, PathFlow};
use kit::error::Result;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A vehicle that is slower between two looks stands in a queue, in m/s: 5 km/h, as the field counts.
const QUEUE_M_PER_S: f64 = 5.0 / 3.6;

/// Times of an hour, in s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// Trips that depart before do not count.
    pub warmup_s: f64,
    /// Nobody departs later.
    pub horizon_s: f64,
    /// Who has not arrived then counts as arriving then.
    pub end_s: f64,
    /// Time between two looks at the roads, whole seconds or a whole part of one.
    pub look_s: f64,
    /// Time between two pieces of advice to a vehicle.
    pub advice_s: f64,
}

impl Times {
    /// Whether what happens at a time counts.
    fn counts(&self, time_s: f64) -> bool {
        (self.warmup_s..=self.horizon_s).contains(&time_s)
    }
}

/// What does not depend on who knows what: one world's roads, trips and incidents.
#[derive(Clone, Copy)]
pub struct World<'w> {
    /// Draws tastes.
    pub key: WorldKey,
    /// The roads for traffic.
    pub map: &'w RoadMap,
    /// The same roads for ways.
    pub network: &'w Network,
    /// The usual ways.
    pub paths: &'w [PathFlow],
    /// By departure.
    pub trips: &'w [Trip],
    /// What happens.
    pub incidents: &'w Incidents,
    /// Speed by road in m/s when nothing happens.
    pub usual_speeds_m_per_s: &'w [f64],
    /// When.
    pub times: Times,
    /// How advice is given.
    pub choice: Choice,
}

/// Who learns what of the roads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// Nobody anything: all take the usual ways.
    Blind,
    /// The mean speed on every road, at once.
    Everything,
    /// The mean speed on every road that a connected vehicle drives on.
    ConnectedRoads,
    /// Every connected vehicle's own speed, through a detector that takes this time of driving.
    OwnSpeeds(f64),
}

/// Who knows and follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// What is seen.
    pub sight: Sight,
    /// Share of vehicles that report.
    pub connected_share: f64,
    /// Share of vehicles that follow advice.
    pub obeying_share: f64,
    /// Time in which beliefs fade, in s.
    pub fade_s: f64,
}

/// What came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Mean time of the trips that count, in s from departure to arrival.
    pub trip_time_s: f64,
    /// Trips that count.
    pub trips: u32,
    /// Of them, those that had not arrived at the end.
    pub unfinished: u32,
    /// How often a stuck vehicle was let through.
    pub let_through: u64,
    /// Vehicles on the roads, mean over the looks that count.
    pub vehicles: f64,
    /// Of them, those that stand in a queue: slower than 5 km/h since the look before.
    pub queued: f64,
    /// Vehicles that want to set out and found no room yet, mean likewise.
    pub waiting: f64,
    /// Time in s since the newest known report of a road was measured, mean over roads and looks that count, at most an hour;
    /// roads never heard of count with the time since the start.
    pub road_age_s: f64,
    /// Speed by road in m/s over all driving on it; NaN where nobody drove.
    pub speeds_m_per_s: Vec<f64>,
    /// Flow over capacity while trips count, mean over roads.
    pub v_over_c: f64,
}

/// A report on its way, by arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Underway {
    arrival_s: f64,
    report: Report,
}

impl Eq for Underway {}

impl Ord for Underway {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let by_time = self.arrival_s.total_cmp(&other.arrival_s);
        let by_measurement = self.report.measured_s.total_cmp(&other.report.measured_s);
        by_time
            .then(by_measurement)
            .then(self.report.road.cmp(&other.report.road))
            .then(self.report.speed_m_per_s.total_cmp(&other.report.speed_m_per_s))
    }
}

impl PartialOrd for Underway {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// A traveller between departure and arrival.
#[derive(Clone, Debug)]
struct Traveller {
    way: Vec<u32>,
    /// Roads of the way that are done; the present one is the first that is not.
    done: usize,
    next_advice_s: f64,
    arrived_s: Option<f64>,
}

/// The hour as it goes on.
struct Hour<'w, 't> {
    world: World<'w>,
    case: Case,
    traffic: &'t mut dyn TrafficModel,
    delays: &'t mut dyn Delays,
    travellers: Vec<Traveller>,
    /// How many of them have arrived.
    arrived: usize,
    knowledge: Knowledge<'w>,
    guide: Guide<'w>,
    underway: BinaryHeap<Reverse<Underway>>,
    /// Everybody at the last look and at this one.
    before: Vec<OnRoad>,
    now: Vec<OnRoad>,
    /// How many of them stand in a queue.
    queued: u32,
    /// By road: way and time of everybody since the last look, and while trips count.
    lately: Vec<(f64, f64)>,
    in_all: Vec<(f64, f64)>,
    /// By road: how many drove it to its end while trips count.
    passed: Vec<u32>,
}

/// Runs an hour. `watch` sees everybody at every look.
///
/// # Errors
/// What stops the traffic.
pub fn run(
    world: World<'_>,
    case: Case,
    traffic: &mut dyn TrafficModel,
    delays: &mut dyn Delays,
    mut watch: impl FnMut(f64, &[OnRoad]),
) -> Result<Outcome> {
    let Times { end_s, look_s, .. } = world.times;
    let roads = world.map.roads().len();
    let memory_s = match case.sight {
        Sight::OwnSpeeds(memory_s) => memory_s,
        _ => 0.0,
    };
    let estimator = Estimator {
        memory_s,
        report_s: look_s,
        fade_s: case.fade_s,
    };
    let mut hour = Hour {
        case,
        traffic,
        delays,
        travellers: Vec::with_capacity(world.trips.len()),
        arrived: 0,
        knowledge: Knowledge::new(world.map, world.usual_speeds_m_per_s, estimator),
        guide: Guide::new(world.network, world.choice),
        underway: BinaryHeap::new(),
        before: Vec::new(),
        now: Vec::new(),
        queued: 0,
        lately: vec![(0.0, 0.0); roads],
        in_all: vec![(0.0, 0.0); roads],
        passed: vec![0; roads],
        world,
    };
    let mut arrived = Vec::new();
    let (mut vehicles, mut queued, mut waiting) = (0.0, 0.0, 0.0);
    let (mut road_age_s, mut looks) = (0.0, 0.0);
    let mut look = 0_u32;
    loop {
        let last_s = f64::from(look) * look_s;
        look += 1;
        let time_s = f64::from(look) * look_s;
        hour.knowledge.look(last_s);
        hour.travel(last_s, time_s, &mut arrived)?;
        hour.observe(time_s, look_s)?;
        watch(time_s, &hour.now);
        hour.hear(time_s);
        if world.times.counts(time_s) {
            looks += 1.0;
            vehicles += hour.now.len() as f64;
            queued += f64::from(hour.queued);
            waiting += hour.waiting() as f64;
            road_age_s += hour.road_age_s(time_s);
        }
        let all_gone = hour.arrived == world.trips.len();
        if all_gone || time_s >= end_s {
            break;
        }
    }
    Ok(Outcome {
        vehicles: vehicles / looks,
        queued: queued / looks,
        waiting: waiting / looks,
        road_age_s: road_age_s / looks,
        ..hour.outcome()
    })
}

impl Hour<'_, '_> {
    /// From one look to the next: reports arrive and advice is given in the order of time, vehicles drive second by second.
    fn travel(&mut self, last_s: f64, time_s: f64, arrived: &mut Vec<Arrival>) -> Result<()> {
        self.advise(last_s, time_s)?;
        let mut second_s = last_s;
        while second_s < time_s {
            second_s = (second_s + 1.0).floor().min(time_s);
            arrived.clear();
            self.traffic.advance(second_s, arrived)?;
            for arrival in arrived.iter() {
                let traveller = &mut self.travellers[arrival.vehicle as usize];
                traveller.arrived_s = Some(arrival.time_s);
                self.arrived += 1;
                if self.world.times.counts(arrival.time_s) {
                    for &road in &traveller.way[traveller.done..] {
                        self.passed[road as usize] += 1;
                    }
                }
            }
            // Whoever has set out meanwhile enters at a whole second.
            if second_s == second_s.floor() {
                self.depart(second_s)?;
            }
        }
        Ok(())
    }

    /// Everybody whose departure lies before `until_s` sets out, advised if obedient.
    fn depart(&mut self, until_s: f64) -> Result<()> {
        let trips = self.world.trips;
        while let Some(trip) = trips
            .get(self.travellers.len())
            .filter(|trip| trip.departs_s <= until_s)
        {
            let vehicle = self.travellers.len() as u32;
            let mut way = self.world.paths[trip.path as usize].links.to_vec();
            if self.follows(trip) {
                self.hear(trip.departs_s);
                if let Some(better) = self.better_way(vehicle, &way) {
                    way = better;
                }
            }
            self.traffic.depart(vehicle, &way)?;
            self.travellers.push(Traveller {
                way,
                done: 0,
                next_advice_s: trip.departs_s + self.world.times.advice_s,
                arrived_s: None,
            });
        }
        Ok(())
    }

    fn follows(&self, trip: &Trip) -> bool {
        self.case.sight != Sight::Blind && trip.obeys(self.case.obeying_share)
    }

    fn better_way(&mut self, vehicle: u32, onward: &[u32]) -> Option<Vec<u32>> {
        let times_s = self.knowledge.times_s();
        self.guide.better_way(vehicle, onward, times_s, &self.world.key)
    }

    /// Takes in the reports that have arrived by a time.
    fn hear(&mut self, time_s: f64) {
        while let Some(Reverse(first)) = self.underway.peek() {
            if first.arrival_s > time_s {
                break;
            }
            self.knowledge.hear(&first.report);
            self.underway.pop();
        }
    }

    /// Advice between two looks, to those who are on a road at the first, at each one's own instant.
    fn advise(&mut self, last_s: f64, time_s: f64) -> Result<()> {
        if self.case.sight == Sight::Blind {
            return Ok(());
        }
        let mut due: Vec<(f64, u32)> = Vec::new();
        for on_road in &self.now {
            let traveller = &self.travellers[on_road.vehicle as usize];
            let trip = &self.world.trips[on_road.vehicle as usize];
            if traveller.next_advice_s <= time_s && trip.obeys(self.case.obeying_share) {
                due.push((traveller.next_advice_s.max(last_s), on_road.vehicle));
            }
        }
        due.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (at_s, vehicle) in due {
            self.hear(at_s);
            let traveller = &mut self.travellers[vehicle as usize];
            traveller.next_advice_s = at_s + self.world.times.advice_s;
            let onward_from = traveller.done + 1;
            let onward = traveller.way[onward_from..].to_vec();
            if let Some(better) = self.better_way(vehicle, &onward) {
                self.traffic.take_route(vehicle, &better)?;
                let way = &mut self.travellers[vehicle as usize].way;
                way.truncate(onward_from);
                way.extend(better);
            }
        }
        Ok(())
    }

    /// Looks at the roads: how fast everybody drove since the last look, and what is reported of it.
    fn observe(&mut self, time_s: f64, look_s: f64) -> Result<()> {
        std::mem::swap(&mut self.before, &mut self.now);
        self.traffic.on_roads(&mut self.now)?;
        let counts = self.world.times.counts(time_s);
        for on_road in &self.now {
            let traveller = &mut self.travellers[on_road.vehicle as usize];
            let ahead = &traveller.way[traveller.done..];
            if let Some(passed) = ahead.iter().position(|&road| road == on_road.road) {
                if counts {
                    for &road in &ahead[..passed] {
                        self.passed[road as usize] += 1;
                    }
                }
                traveller.done += passed;
            }
        }
        // Two looks at one vehicle on the same road tell its speed.
        self.lately.fill((0.0, 0.0));
        let mut driven: Vec<(OnRoad, f64)> = Vec::new();
        let mut before = self.before.iter().peekable();
        for on_road in &self.now {
            while before.next_if(|last| last.vehicle < on_road.vehicle).is_some() {}
            if let Some(last) = before.next_if(|last| last.vehicle == on_road.vehicle)
                && last.road == on_road.road
            {
                let way_m = (on_road.along_m - last.along_m).max(0.0);
                driven.push((*on_road, way_m));
                let road = on_road.road as usize;
                self.lately[road].0 += way_m;
                self.lately[road].1 += look_s;
            }
        }
        if counts {
            for (all, lately) in self.in_all.iter_mut().zip(&self.lately) {
                all.0 += lately.0;
                all.1 += lately.1;
            }
        }
        let stand = driven.iter().filter(|(_, way_m)| *way_m < QUEUE_M_PER_S * look_s);
        self.queued = stand.count() as u32;
        self.report(&driven, time_s, look_s);
        Ok(())
    }

    fn report(&mut self, driven: &[(OnRoad, f64)], time_s: f64, look_s: f64) {
        let mean_speed = |(way_m, driven_s): (f64, f64)| way_m / driven_s;
        match self.case.sight {
            Sight::Blind => {}
            Sight::Everything => {
                for (index, road) in self.world.map.roads().iter().enumerate() {
                    let lately = self.lately[index];
                    let speed_m_per_s = if lately.1 > 0.0 {
                        mean_speed(lately)
                    } else if self.world.incidents.active(road.block, time_s) {
                        road.crawl_speed_m_per_s(self.world.incidents.capacity_left())
                    } else {
                        road.free_speed_m_per_s
                    };
                    self.knowledge.hear(&Report {
                        road: index as u32,
                        speed_m_per_s,
                        measured_s: time_s,
                    });
                }
            }
            Sight::ConnectedRoads | Sight::OwnSpeeds(_) => {
                for (on_road, way_m) in driven {
                    let trip = &self.world.trips[on_road.vehicle as usize];
                    if !trip.connected(self.case.connected_share) {
                        continue;
                    }
                    let Some(arrival_s) = self.delays.arrival_s(on_road, time_s) else {
                        continue;
                    };
                    let speed_m_per_s = match self.case.sight {
                        Sight::OwnSpeeds(_) => way_m / look_s,
                        _ => mean_speed(self.lately[on_road.road as usize]),
                    };
                    self.underway.push(Reverse(Underway {
                        arrival_s,
                        report: Report {
                            road: on_road.road,
                            speed_m_per_s,
                            measured_s: time_s,
                        },
                    }));
                }
            }
        }
    }

    /// Vehicles that are neither on a road nor at the end of their way.
    fn waiting(&self) -> usize {
        (self.travellers.len() - self.arrived).saturating_sub(self.now.len())
    }

    fn road_age_s(&self, time_s: f64) -> f64 {
        let roads = self.world.map.roads().len() as u32;
        let ages = (0..roads).map(|road| self.knowledge.age_s(road, time_s).min(time_s));
        ages.sum::<f64>() / f64::from(roads)
    }

    /// What is known at the end; means over looks are not.
    fn outcome(self) -> Outcome {
        let Times {
            warmup_s,
            horizon_s,
            end_s,
            ..
        } = self.world.times;
        let hours = (horizon_s - warmup_s) / 3600.0;
        let roads = self.world.map.roads().iter().zip(&self.passed);
        let v_over_c: f64 = roads
            .map(|(road, &passed)| f64::from(passed) / hours / road.capacity_veh_per_h)
            .sum();
        let (mut sum_s, mut trips, mut unfinished) = (0.0, 0, 0);
        for (index, trip) in self.world.trips.iter().enumerate() {
            if trip.departs_s < warmup_s {
                continue;
            }
            let arrived_s = self.travellers.get(index).and_then(|t| t.arrived_s);
            sum_s += arrived_s.unwrap_or(end_s) - trip.departs_s;
            unfinished += u32::from(arrived_s.is_none());
            trips += 1;
        }
        Outcome {
            trip_time_s: sum_s / f64::from(trips),
            trips,
            unfinished,
            let_through: self.traffic.let_through(),
            speeds_m_per_s: self.in_all.iter().map(|(way_m, time_s)| way_m / time_s).collect(),
            v_over_c: v_over_c / self.in_all.len() as f64,
            ..Outcome::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journeys::delays::Fixed;
    use crate::journeys::queues::Queues;
    use crate::journeys::roads::Road;
    use crate::journeys::trips;
    use crate::stream::Purpose;
    use assignment::{CostWeights, Link, NodeNumbering};

    /// One way of 500 m, usual and blocked, and a detour of two roads of 300 m.
    #[test]
    fn whoever_follows_takes_the_plan_and_nobody_else() {
        let ends = [(0, 1, 500.0), (0, 2, 300.0), (2, 1, 300.0)];
        let roads = ends.iter().zip(0..).map(|(&(from, to, length_m), block)| Road {
            from,
            to,
            length_m,
            free_speed_m_per_s: 10.0,
            lanes: 1,
            capacity_veh_per_h: 1800.0,
            block: Some(block),
        });
        let map = RoadMap::new(roads.collect(), vec![(0.0, 0.0), (500.0, 0.0), (250.0, 165.8)]).unwrap();
        let links = ends.map(|(from, to, length)| Link {
            init_node: from + 1,
            term_node: to + 1,
            capacity: 1800.0,
            length,
            free_flow_time: length / 10.0,
            b: 0.15,
            power: 4.0,
            toll: 0.0,
        });
        let numbering = NodeNumbering {
            zones: 3,
            nodes: 3,
            first_thru_node: 1,
        };
        let network = Network::new(numbering, links.to_vec(), CostWeights::default()).unwrap();
        let paths = [PathFlow {
            origin: 1,
            destination: 2,
            volume: 200.0,
            links: vec![0].into(),
        }];
        let key = WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let incidents = Incidents::scripted(vec![vec![(0.0, 1e6)], vec![], vec![]], 0.3);
        let trips = trips::draw(&paths, 3600.0, &key);
        let world = World {
            key,
            map: &map,
            network: &network,
            paths: &paths,
            trips: &trips,
            incidents: &incidents,
            usual_speeds_m_per_s: &[10.0; 3],
            times: Times {
                warmup_s: 100.0,
                horizon_s: 3600.0,
                end_s: 7200.0,
                look_s: 2.0,
                advice_s: 60.0,
            },
            choice: Choice {
                spread: 0.1,
                gain: 0.05,
            },
        };
        let trip_time_s = |obeying_share| {
            let case = Case {
                sight: Sight::Everything,
                connected_share: 0.0,
                obeying_share,
                fade_s: 300.0,
            };
            let mut traffic = Queues::new(&map, &incidents);
            run(world, case, &mut traffic, &mut Fixed(0.0), |_, _| ())
                .unwrap()
                .trip_time_s
        };
        let blocked_s = 500.0 / map.roads()[0].crawl_speed_m_per_s(0.3);
        // Half a second until the next whole one, at which vehicles enter; some wait for one before them.
        assert!((60.5..62.0).contains(&trip_time_s(1.0)), "{}", trip_time_s(1.0));
        let usual = trip_time_s(0.0);
        assert!((blocked_s + 0.5..blocked_s + 6.0).contains(&usual), "{usual}");
        let half = trip_time_s(0.5);
        let between = (half - 60.5) / (blocked_s - 60.0);
        assert!((0.4..0.6).contains(&between), "{half}");
    }
}
