//! The built-in traffic: every road a queue with room for so many vehicles, moved from event to event.
//!
//! A vehicle runs to its road's end at the speed of the road, waits behind those before it, leaves no sooner than the road's
//! headway after the last one, and only if the next road has room and has taken nobody within its own headway. Room that a
//! vehicle frees at the end appears at the beginning once the gap has travelled back through the queue: together this is the
//! triangular fundamental diagram of Newell's simplified theory (1993), in the form of the link transmission model (Yperman
//! 2007), vehicle by vehicle. Queues spill back over crossings; the crossings themselves hold nobody up, since a planning
//! network's capacities contain them. Whoever sets out gives way to all who are on the road: otherwise the crowd that waits to
//! set out on a jammed road locks the roads before it.
//!
//! No time step enters: halving the steps at which somebody looks changes nothing.

use super::incidents::Incidents;
use super::roads::{Road, RoadMap, SPACING_M};
use super::{Arrival, OnRoad, STUCK_S, TrafficModel};
use kit::error::{Error, Result};
use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, VecDeque};

/// Vehicles that move from queue to queue.
pub struct Queues<'m> {
    map: &'m RoadMap,
    incidents: &'m Incidents,
    roads: Vec<Queue>,
    /// By vehicle; those that have not departed yet have no way.
    vehicles: Vec<Vehicle>,
    events: BinaryHeap<Reverse<Event>>,
    /// Orders events of the same instant as they were made.
    next_number: u64,
    time_s: f64,
    let_through: u64,
}

/// The state of a road.
#[derive(Clone, Debug)]
struct Queue {
    /// Who is on it, the first to leave in front.
    vehicles: VecDeque<u32>,
    /// When gaps from its end arrive at its beginning; ascending.
    gaps_s: VecDeque<f64>,
    /// Room for vehicles and gaps.
    storage: usize,
    /// Time that a gap travels.
    gap_delay_s: f64,
    next_exit_s: f64,
    next_entry_s: f64,
    /// Other roads whose first vehicle wants to enter, first come, first served.
    waiting: VecDeque<u32>,
    /// Vehicles that set out here, each as soon as nobody waits on another road.
    departing: VecDeque<u32>,
    /// The instant of its next admission, if one is due.
    admission_s: f64,
}

/// A vehicle.
#[derive(Clone, Debug, Default)]
struct Vehicle {
    /// Roads still to drive, the next one last.
    onward: Vec<u32>,
    road: Option<u32>,
    entered_s: f64,
    /// When it would be at its road's end if it were alone.
    at_end_s: f64,
    /// Since when it asks to enter the next road.
    asks_since_s: Option<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Event {
    time_s: f64,
    number: u64,
    what: What,
}

#[derive(Clone, Copy, Debug)]
enum What {
    /// The first vehicle of a road may leave it.
    Exit(u32),
    /// A road may take somebody.
    Admission(u32),
    /// A vehicle at the head of a road has waited long enough.
    Stuck { road: u32, vehicle: u32 },
}

impl PartialEq for Event {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_time = self.time_s.total_cmp(&other.time_s);
        by_time.then(self.number.cmp(&other.number))
    }
}

impl<'m> Queues<'m> {
    /// Empty roads at time 0.
    pub fn new(map: &'m RoadMap, incidents: &'m Incidents) -> Self {
        let queue = |road: &Road| Queue {
            vehicles: VecDeque::new(),
            gaps_s: VecDeque::new(),
            storage: road.storage() as usize,
            gap_delay_s: (road.length_m * road.reaction_time_s() / SPACING_M).max(0.0),
            next_exit_s: 0.0,
            next_entry_s: 0.0,
            waiting: VecDeque::new(),
            departing: VecDeque::new(),
            admission_s: f64::INFINITY,
        };
        Self {
            map,
            incidents,
            roads: map.roads().iter().map(queue).collect(),
            vehicles: Vec::new(),
            events: BinaryHeap::new(),
            next_number: 0,
            time_s: 0.0,
            let_through: 0,
        }
    }

    fn schedule(&mut self, time_s: f64, what: What) {
        let number = self.next_number;
        self.next_number += 1;
        self.events.push(Reverse(Event { time_s, number, what }));
    }

    /// Speed on a road and time between two vehicles that leave or enter it, at a time.
    fn state(&self, road: u32, time_s: f64) -> (f64, f64) {
        let road = &self.map.roads()[road as usize];
        let headway_s = 3600.0 / road.capacity_veh_per_h;
        if self.incidents.active(road.block, time_s) {
            let left = self.incidents.capacity_left();
            (road.crawl_speed_m_per_s(left), headway_s / left)
        } else {
            (road.free_speed_m_per_s, headway_s)
        }
    }

    /// Where a vehicle alone is at `until_s` that was at `along_m` at `from_s`, and when it is at the end.
    fn run(&self, road: u32, mut from_s: f64, until_s: f64) -> (f64, f64) {
        let Road { block, length_m, .. } = self.map.roads()[road as usize];
        let mut along_m = 0.0;
        loop {
            let (speed, _) = self.state(road, from_s);
            let change_s = self.incidents.next_change_s(block, from_s).min(until_s);
            let at_end_s = from_s + (length_m - along_m) / speed;
            if at_end_s <= change_s {
                return (length_m, at_end_s);
            }
            along_m += speed * (change_s - from_s);
            from_s = change_s;
            if change_s >= until_s {
                return (along_m, f64::INFINITY);
            }
        }
    }

    /// The first vehicle of a road is known: it may leave when it has come to the end and the headway has passed.
    fn schedule_exit(&mut self, road: u32) {
        let queue = &self.roads[road as usize];
        if let Some(&head) = queue.vehicles.front() {
            let time_s = self.vehicles[head as usize].at_end_s.max(queue.next_exit_s);
            self.schedule(time_s.max(self.time_s), What::Exit(road));
        }
    }

    /// The next admission takes place as soon as headway and room allow; without a gap on its way it waits for one.
    fn schedule_admission(&mut self, road: u32) {
        let time_s = self.time_s;
        let queue = &mut self.roads[road as usize];
        while queue.gaps_s.front().is_some_and(|&gap_s| gap_s <= time_s) {
            queue.gaps_s.pop_front();
        }
        if queue.waiting.is_empty() && queue.departing.is_empty() {
            return;
        }
        let taken = queue.vehicles.len() + queue.gaps_s.len();
        let mut at_s = queue.next_entry_s.max(time_s);
        if taken >= queue.storage {
            // The gap after which there is room for one more.
            match queue.gaps_s.get(taken - queue.storage) {
                Some(&gap_s) => at_s = at_s.max(gap_s),
                None => return,
            }
        }
        if at_s < queue.admission_s {
            queue.admission_s = at_s;
            self.schedule(at_s, What::Admission(road));
        }
    }

    fn admit(&mut self, road: u32, arrived: &mut Vec<Arrival>) {
        let time_s = self.time_s;
        let queue = &mut self.roads[road as usize];
        if queue.admission_s != time_s {
            return;
        }
        queue.admission_s = f64::INFINITY;
        while queue.gaps_s.front().is_some_and(|&gap_s| gap_s <= time_s) {
            queue.gaps_s.pop_front();
        }
        let room = queue.vehicles.len() + queue.gaps_s.len() < queue.storage;
        if room && queue.next_entry_s <= time_s {
            let vehicle = match queue.waiting.pop_front() {
                Some(from) => self.leave(from, arrived),
                None => queue.departing.pop_front(),
            };
            if let Some(vehicle) = vehicle {
                self.enter(road, vehicle);
            }
        }
        self.schedule_admission(road);
    }

    /// A vehicle enters the road now.
    fn enter(&mut self, road: u32, vehicle: u32) {
        let (_, headway_s) = self.state(road, self.time_s);
        let (_, at_end_s) = self.run(road, self.time_s, f64::INFINITY);
        let state = &mut self.vehicles[vehicle as usize];
        state.onward.pop();
        state.road = Some(road);
        state.entered_s = self.time_s;
        state.at_end_s = at_end_s;
        let queue = &mut self.roads[road as usize];
        queue.next_entry_s = self.time_s + headway_s;
        queue.vehicles.push_back(vehicle);
        if queue.vehicles.len() == 1 {
            self.schedule_exit(road);
        }
    }

    /// The first vehicle leaves a road; it arrives if it has no more to drive.
    fn leave(&mut self, road: u32, arrived: &mut Vec<Arrival>) -> Option<u32> {
        let (_, headway_s) = self.state(road, self.time_s);
        let queue = &mut self.roads[road as usize];
        let vehicle = queue.vehicles.pop_front()?;
        queue.next_exit_s = self.time_s + headway_s;
        queue.gaps_s.push_back(self.time_s + queue.gap_delay_s);
        let state = &mut self.vehicles[vehicle as usize];
        state.asks_since_s = None;
        state.road = None;
        if state.onward.is_empty() {
            arrived.push(Arrival {
                vehicle,
                time_s: self.time_s,
            });
        }
        self.schedule_exit(road);
        self.schedule_admission(road);
        Some(vehicle)
    }

    /// The first vehicle of a road is at its end and may leave it.
    fn exit(&mut self, road: u32, arrived: &mut Vec<Arrival>) {
        let queue = &self.roads[road as usize];
        let Some(&head) = queue.vehicles.front() else {
            return;
        };
        let vehicle = &self.vehicles[head as usize];
        let due_s = vehicle.at_end_s.max(queue.next_exit_s);
        if due_s > self.time_s || vehicle.asks_since_s.is_some() {
            return;
        }
        match vehicle.onward.last().copied() {
            None => {
                self.leave(road, arrived);
            }
            Some(next) => {
                self.vehicles[head as usize].asks_since_s = Some(self.time_s);
                let stuck = What::Stuck { road, vehicle: head };
                self.schedule(self.time_s + STUCK_S, stuck);
                self.roads[next as usize].waiting.push_back(road);
                self.schedule_admission(next);
            }
        }
    }

    fn let_through_if_stuck(&mut self, road: u32, vehicle: u32, arrived: &mut Vec<Arrival>) {
        let state = &self.vehicles[vehicle as usize];
        let waits = state.road == Some(road)
            && state
                .asks_since_s
                .is_some_and(|since_s| since_s + STUCK_S <= self.time_s);
        if let (true, Some(&next)) = (waits, state.onward.last()) {
            self.let_through += 1;
            self.withdraw(road, next);
            self.leave(road, arrived);
            self.enter(next, vehicle);
        }
    }

    /// The head of a road no longer asks to enter another.
    fn withdraw(&mut self, road: u32, next: u32) {
        let waiting = &mut self.roads[next as usize].waiting;
        waiting.retain(|&other| other != road);
    }
}

impl TrafficModel for Queues<'_> {
    fn depart(&mut self, vehicle: u32, route: &[u32]) -> Result<()> {
        let Some(&first) = route.first() else {
            let place = format!("route of vehicle {vehicle}");
            return Err(Error::input(place, "no road", "at least one"));
        };
        let count = self.vehicles.len().max(vehicle as usize + 1);
        self.vehicles.resize_with(count, Vehicle::default);
        self.vehicles[vehicle as usize].onward = route.iter().rev().copied().collect();
        self.roads[first as usize].departing.push_back(vehicle);
        self.schedule_admission(first);
        Ok(())
    }

    fn advance(&mut self, time_s: f64, arrived: &mut Vec<Arrival>) -> Result<()> {
        while let Some(&Reverse(event)) = self.events.peek() {
            if event.time_s > time_s {
                break;
            }
            self.events.pop();
            self.time_s = event.time_s;
            match event.what {
                What::Exit(road) => self.exit(road, arrived),
                What::Admission(road) => self.admit(road, arrived),
                What::Stuck { road, vehicle } => self.let_through_if_stuck(road, vehicle, arrived),
            }
        }
        self.time_s = time_s;
        Ok(())
    }

    fn on_roads(&mut self, vehicles: &mut Vec<OnRoad>) -> Result<()> {
        vehicles.clear();
        for (index, queue) in self.roads.iter().enumerate() {
            let road = &self.map.roads()[index];
            let spacing_m = SPACING_M / f64::from(road.lanes);
            for (ahead, &vehicle) in queue.vehicles.iter().enumerate() {
                let state = &self.vehicles[vehicle as usize];
                let alone_m = if state.at_end_s <= self.time_s {
                    road.length_m
                } else {
                    self.run(index as u32, state.entered_s, self.time_s).0
                };
                // Who let others through may be one more than there is room for.
                let behind_m = (road.length_m - spacing_m * ahead as f64).max(0.0);
                vehicles.push(OnRoad {
                    vehicle,
                    road: index as u32,
                    along_m: alone_m.min(behind_m),
                });
            }
        }
        vehicles.sort_unstable_by_key(|vehicle| vehicle.vehicle);
        Ok(())
    }

    fn take_route(&mut self, vehicle: u32, onward: &[u32]) -> Result<()> {
        let Some(state) = self.vehicles.get_mut(vehicle as usize) else {
            return Ok(());
        };
        let Some(road) = state.road else {
            return Ok(());
        };
        let before = state.onward.last().copied();
        state.onward = onward.iter().rev().copied().collect();
        let asked = state.asks_since_s;
        if let (Some(_), Some(before)) = (asked, before)
            && before != onward.first().copied().unwrap_or(u32::MAX)
        {
            state.asks_since_s = None;
            self.withdraw(road, before);
            self.schedule(self.time_s, What::Exit(road));
        }
        Ok(())
    }

    fn let_through(&self) -> u64 {
        self.let_through
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of roads, each 500 m long at 10 m/s with one lane of 1,800 veh/h but for the last, which has `last`.
    fn chain(count: u32, last: f64) -> RoadMap {
        let road = |index: u32| Road {
            from: index,
            to: index + 1,
            length_m: 500.0,
            free_speed_m_per_s: 10.0,
            lanes: 1,
            capacity_veh_per_h: if index + 1 == count { last } else { 1800.0 },
            block: Some(index),
        };
        let places = (0..=count).map(|node| (500.0 * f64::from(node), 0.0)).collect();
        RoadMap::new((0..count).map(road).collect(), places).unwrap()
    }

    fn arrivals(
        map: &RoadMap,
        incidents: &Incidents,
        departures_s: &[f64],
        route: &[u32],
        step_s: f64,
    ) -> Vec<f64> {
        let mut queues = Queues::new(map, incidents);
        let mut arrived = Vec::new();
        let mut departed = 0;
        let mut time_s = 0.0;
        while arrived.len() < departures_s.len() {
            while departed < departures_s.len() && departures_s[departed] <= time_s {
                queues.depart(departed as u32, route).unwrap();
                departed += 1;
            }
            time_s += step_s;
            queues.advance(time_s, &mut arrived).unwrap();
            assert!(time_s < 1e5, "{arrived:?}");
        }
        let mut times = vec![0.0; departures_s.len()];
        for arrival in arrived {
            times[arrival.vehicle as usize] = arrival.time_s;
        }
        times
    }

    #[test]
    fn alone_a_vehicle_takes_the_free_time() {
        let map = chain(3, 1800.0);
        let times = arrivals(&map, &Incidents::none(3), &[0.0], &[0, 1, 2], 1.0);
        assert_eq!(times, [150.0]);
    }

    #[test]
    fn a_bottleneck_lets_through_its_capacity_and_the_queue_spills_back() {
        let map = chain(3, 600.0);
        let departures: Vec<f64> = (0..200).map(|n| f64::from(2 * n)).collect();
        let times = arrivals(&map, &Incidents::none(3), &departures, &[0, 1, 2], 1.0);
        // The kth passes no sooner than the headways of 6 s before it allow, and no later.
        for (n, time_s) in times.iter().enumerate() {
            assert!(
                (time_s - (150.0 + 6.0 * n as f64)).abs() < 1e-6,
                "vehicle {n}: {time_s}"
            );
        }
        // 66 vehicles stand on 500 m: after 400 s the queue of 200 - 42 reaches through two roads into the first.
        let incidents = Incidents::none(3);
        let mut queues = Queues::new(&map, &incidents);
        let mut arrived = Vec::new();
        for n in 0..200 {
            queues.advance(f64::from(2 * n), &mut arrived).unwrap();
            queues.depart(n, &[0, 1, 2]).unwrap();
        }
        let mut vehicles = Vec::new();
        queues.on_roads(&mut vehicles).unwrap();
        let on = |road| vehicles.iter().filter(|vehicle| vehicle.road == road).count();
        // At 600 veh/h the last road is in the free branch: what waits stands before it.
        assert!((8..=9).contains(&on(2)), "{}", on(2));
        assert!(on(1) >= 45 && on(0) > 20, "{} {}", on(1), on(0));
    }

    #[test]
    fn a_jam_flows_at_the_speed_of_its_density() {
        // On the triangular diagram 600 veh/h flow at this density in the queue before the bottleneck.
        let map = chain(2, 600.0);
        let incidents = Incidents::none(2);
        let mut queues = Queues::new(&map, &incidents);
        let mut arrived = Vec::new();
        for n in 0..400 {
            queues.advance(f64::from(2 * n), &mut arrived).unwrap();
            queues.depart(n, &[0, 1]).unwrap();
        }
        let mut vehicles = Vec::new();
        queues.on_roads(&mut vehicles).unwrap();
        let on = vehicles.iter().filter(|vehicle| vehicle.road == 0).count();
        // A vehicle takes its spacing and the way that the headway leaves beyond the reaction time.
        let share_moving = map.roads()[0].reaction_time_s() / 6.0;
        let expected = 500.0 * (1.0 - share_moving) / SPACING_M;
        assert!((on as f64 - expected).abs() < 2.0, "{on} against {expected}");
    }

    #[test]
    fn an_incident_slows_and_its_end_frees() {
        let map = chain(1, 1800.0);
        let incidents = Incidents::scripted(vec![vec![(20.0, 120.0)]], 0.4);
        let crawl = map.roads()[0].crawl_speed_m_per_s(0.4);
        let times = arrivals(&map, &incidents, &[0.0], &[0], 1.0);
        let expected = 120.0 + (500.0 - 200.0 - 100.0 * crawl) / 10.0;
        assert!((times[0] - expected).abs() < 1e-9, "{} {expected}", times[0]);
    }

    #[test]
    fn looking_more_often_changes_nothing() {
        let map = chain(3, 700.0);
        let incidents = Incidents::scripted(vec![vec![(30.0, 90.0)], vec![], vec![(100.0, 300.0)]], 0.3);
        let departures: Vec<f64> = (0..100).map(|n| f64::from(2 * n)).collect();
        let of = |step_s| arrivals(&map, &incidents, &departures, &[0, 1, 2], step_s);
        assert_eq!(of(2.0), of(1.0));
    }

    #[test]
    fn a_circle_of_full_roads_lets_somebody_through() {
        let road = |index: u32| Road {
            from: index,
            to: (index + 1) % 3,
            length_m: 15.0,
            free_speed_m_per_s: 5.0,
            lanes: 1,
            capacity_veh_per_h: 1800.0,
            block: Some(index),
        };
        let map = RoadMap::new((0..3).map(road).collect(), vec![(0.0, 0.0); 3]).unwrap();
        let incidents = Incidents::none(3);
        let mut queues = Queues::new(&map, &incidents);
        for n in 0..6 {
            let start = n % 3;
            queues
                .depart(n, &[start, (start + 1) % 3, (start + 2) % 3])
                .unwrap();
        }
        let mut arrived = Vec::new();
        queues.advance(STUCK_S - 1.0, &mut arrived).unwrap();
        assert!(arrived.is_empty());
        queues.advance(10.0 * STUCK_S, &mut arrived).unwrap();
        assert_eq!(arrived.len(), 6);
        assert!(queues.let_through() > 0);
    }

    #[test]
    fn whoever_sets_out_gives_way() {
        let map = chain(2, 600.0);
        let incidents = Incidents::none(2);
        let mut queues = Queues::new(&map, &incidents);
        for n in 0..100 {
            queues.depart(n, &[1]).unwrap();
        }
        for n in 100..110 {
            queues.depart(n, &[0, 1]).unwrap();
        }
        let mut arrived = Vec::new();
        queues.advance(300.0, &mut arrived).unwrap();
        let on_the_road = arrived.iter().filter(|arrival| arrival.vehicle >= 100).count();
        assert_eq!(on_the_road, 10, "{arrived:?}");
    }

    #[test]
    fn another_route_is_taken_also_while_waiting() {
        // From road 0 on to road 1, which is full for ever, or to road 2.
        let road = |from, to, length_m| Road {
            from,
            to,
            length_m,
            free_speed_m_per_s: 10.0,
            lanes: 1,
            capacity_veh_per_h: 1800.0,
            block: Some(0),
        };
        let roads = vec![
            road(0, 1, 100.0),
            road(1, 2, 7.5),
            road(1, 3, 100.0),
            road(2, 4, 7.5),
        ];
        let map = RoadMap::new(roads, vec![(0.0, 0.0); 5]).unwrap();
        let incidents = Incidents::none(1);
        let mut queues = Queues::new(&map, &incidents);
        let mut arrived = Vec::new();
        queues.depart(0, &[3]).unwrap();
        queues.roads[3].next_exit_s = 1e9;
        queues.depart(1, &[1, 3]).unwrap();
        queues.depart(2, &[0, 1]).unwrap();
        queues.advance(50.0, &mut arrived).unwrap();
        assert!(arrived.is_empty());
        queues.take_route(2, &[2]).unwrap();
        queues.advance(61.0, &mut arrived).unwrap();
        assert_eq!(
            arrived,
            [Arrival {
                vehicle: 2,
                time_s: 60.0
            }]
        );
    }
}
