//! The built-in traffic: every lane a queue with room for so many vehicles, moved from event to event.
//!
//! A vehicle runs to its road's end at the speed of the road, waits behind those before it on its lane, leaves no sooner than
//! the lane's headway after the last one, and only if a lane of the next road has room and has taken nobody within its own
//! headway. Room that a vehicle frees at the end appears at the beginning once the gap has travelled back through the queue:
//! together this is the triangular fundamental diagram of Newell's simplified theory (1993), in the form of the link
//! transmission model (Yperman 2007), vehicle by vehicle. A vehicle takes the lane with the fewest vehicles and stays on it, so
//! who waits for a full road holds up one lane. Queues spill back over crossings; the crossings themselves hold nobody
//! up, since a planning network's capacities contain them. A queue that discharges passes less than the capacity
//! (Hall and Agyemang-Duah 1991). Whoever sets out gives way to all who are on the road: otherwise the crowd that waits to set out on a
//! jammed road locks the roads before it.
//!
//! No time step enters: halving the steps at which somebody looks changes nothing.

mod calendar;
mod lane;
#[cfg(test)]
mod tests;

use super::incidents::Incidents;
use super::roads::{Road, RoadMap, SPACING_M};
use super::{Arrival, OnRoad, STUCK_S, TrafficModel};
use calendar::{Calendar, LaneOf, What};
use kit::error::{Error, Result};
use lane::Lane;
use std::collections::VecDeque;

/// Share of the capacity that is lost where a queue discharges, since drivers who start from it leave longer gaps: about 6 %
/// (F. L. Hall and K. Agyemang-Duah: *Freeway capacity drop and the definition of capacity*, Transportation Research Record
/// 1320, 1991).
const CAPACITY_DROP: f64 = 0.06;

/// How fast drivers slow down and speed up, in m/s² (chosen: comfortable). Who stops from a speed and starts again loses the
/// speed over this in time; who is held up for less has not stood.
const COMFORTABLE_M_PER_S2: f64 = 2.5;

/// Vehicles that move from queue to queue.
pub struct Queues<'m> {
    map: &'m RoadMap,
    incidents: &'m Incidents,
    roads: Vec<Queue>,
    /// By vehicle; those that have not departed yet have no way.
    vehicles: Vec<Vehicle>,
    calendar: Calendar,
    time_s: f64,
    let_through: u64,
}

/// The state of a road.
#[derive(Clone, Debug)]
struct Queue {
    lanes: Vec<Lane>,
    /// Vehicles at the ends of other roads that want to enter, first come, first served.
    waiting: VecDeque<u32>,
    /// Vehicles that set out here, each as soon as nobody waits on another road.
    departing: VecDeque<u32>,
    /// The instant of its next admission, if one is due.
    admission_s: f64,
}

impl Queue {
    /// Of the lanes that a vehicle may take now, or of all, the one with the fewest vehicles.
    fn shortest_lane(&mut self, open_at_s: Option<f64>) -> Option<usize> {
        let lanes = self.lanes.iter_mut().enumerate();
        let open = lanes.filter_map(|(index, lane)| {
            let is_open = open_at_s.is_none_or(|time_s| lane.opens_s(time_s) == Some(time_s));
            is_open.then_some((lane.vehicles().len(), index))
        });
        open.min().map(|(_, index)| index)
    }
}

/// A vehicle.
#[derive(Clone, Debug, Default)]
struct Vehicle {
    /// Roads still to drive, the next one last.
    onward: Vec<u32>,
    at: Option<LaneOf>,
    entered_s: f64,
    /// When it would be at its road's end if it were alone.
    at_end_s: f64,
    /// Since when it asks to enter the next road.
    asks_since_s: Option<f64>,
}

impl<'m> Queues<'m> {
    /// Empty roads at time 0.
    pub fn new(map: &'m RoadMap, incidents: &'m Incidents) -> Self {
        let queue = |road: &Road| Queue {
            lanes: vec![Lane::new(road); road.lanes as usize],
            waiting: VecDeque::new(),
            departing: VecDeque::new(),
            admission_s: f64::INFINITY,
        };
        Self {
            map,
            incidents,
            roads: map.roads().iter().map(queue).collect(),
            vehicles: Vec::new(),
            calendar: Calendar::default(),
            time_s: 0.0,
            let_through: 0,
        }
    }

    fn lane(&mut self, at: LaneOf) -> &mut Lane {
        &mut self.roads[at.road as usize].lanes[at.lane]
    }

    /// Speed on a road and time between two vehicles that leave or enter one of its lanes, at a time.
    fn state(&self, road: u32, time_s: f64) -> (f64, f64) {
        let road = &self.map.roads()[road as usize];
        let headway_s = 3600.0 * f64::from(road.lanes) / road.capacity_veh_per_h;
        if self.incidents.active(road.block, time_s) {
            let left = self.incidents.capacity_left();
            (road.crawl_speed_m_per_s(left), headway_s / left)
        } else {
            (road.free_speed_m_per_s, headway_s)
        }
    }

    /// Time until a lane of the road lets the next vehicle in or out after one that stood in a queue, or did not.
    fn headway_s(&self, road: u32, stood: bool) -> f64 {
        let (_, headway_s) = self.state(road, self.time_s);
        if stood {
            headway_s / (1.0 - CAPACITY_DROP)
        } else {
            headway_s
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

    /// The first vehicle of a lane is known: it may leave when it has come to the end and the headway has passed.
    fn schedule_exit(&mut self, at: LaneOf) {
        if let Some(due_s) = self.exit_s(at) {
            self.calendar.schedule(due_s.max(self.time_s), What::Exit(at));
        }
    }

    fn exit_s(&self, at: LaneOf) -> Option<f64> {
        let lane = &self.roads[at.road as usize].lanes[at.lane];
        let &head = lane.vehicles().front()?;
        Some(self.vehicles[head as usize].at_end_s.max(lane.next_exit_s()))
    }

    /// The next admission takes place as soon as headway and room on a lane allow.
    fn schedule_admission(&mut self, road: u32) {
        let time_s = self.time_s;
        let queue = &mut self.roads[road as usize];
        if queue.waiting.is_empty() && queue.departing.is_empty() {
            return;
        }
        let opens_s = queue.lanes.iter_mut().filter_map(|lane| lane.opens_s(time_s));
        let at_s = opens_s.fold(f64::INFINITY, f64::min);
        if at_s < queue.admission_s {
            queue.admission_s = at_s;
            self.calendar.schedule(at_s, What::Admission(road));
        }
    }

    fn admit(&mut self, road: u32) {
        let time_s = self.time_s;
        let queue = &mut self.roads[road as usize];
        if queue.admission_s != time_s {
            return;
        }
        queue.admission_s = f64::INFINITY;
        if let Some(lane) = queue.shortest_lane(Some(time_s))
            && let Some(vehicle) = queue.waiting.pop_front().or_else(|| queue.departing.pop_front())
        {
            self.enter(LaneOf { road, lane }, vehicle);
        }
        self.schedule_admission(road);
    }

    /// A vehicle leaves the road that it is on, if any, and enters the next.
    fn enter(&mut self, at: LaneOf, vehicle: u32) {
        let stood = self.leave(vehicle);
        let headway_s = self.headway_s(at.road, stood);
        let (_, at_end_s) = self.run(at.road, self.time_s, f64::INFINITY);
        let time_s = self.time_s;
        let state = &mut self.vehicles[vehicle as usize];
        state.onward.pop();
        state.at = Some(at);
        state.entered_s = time_s;
        state.at_end_s = at_end_s;
        let lane = self.lane(at);
        lane.take(vehicle, time_s, headway_s);
        if lane.vehicles().len() == 1 {
            self.schedule_exit(at);
        }
    }

    /// A vehicle leaves the lane whose first it is, if it is on one. Whether it stood in a queue there.
    fn leave(&mut self, vehicle: u32) -> bool {
        let time_s = self.time_s;
        let state = &mut self.vehicles[vehicle as usize];
        state.asks_since_s = None;
        let Some(at) = state.at.take() else {
            return false;
        };
        let free_speed_m_per_s = self.map.roads()[at.road as usize].free_speed_m_per_s;
        let stood = time_s - state.at_end_s > free_speed_m_per_s / COMFORTABLE_M_PER_S2;
        let headway_s = self.headway_s(at.road, stood);
        self.lane(at).let_go(time_s, headway_s);
        self.schedule_exit(at);
        self.schedule_admission(at.road);
        stood
    }

    /// The first vehicle of a lane is at its end and may leave it: it arrives, or asks to enter its next road.
    fn exit(&mut self, at: LaneOf, arrived: &mut Vec<Arrival>) {
        let time_s = self.time_s;
        let is_due = self.exit_s(at).is_some_and(|due_s| due_s <= time_s);
        let Some(&vehicle) = self.lane(at).vehicles().front().filter(|_| is_due) else {
            return;
        };
        let state = &mut self.vehicles[vehicle as usize];
        if state.asks_since_s.is_some() {
            return;
        }
        let Some(&next) = state.onward.last() else {
            self.leave(vehicle);
            arrived.push(Arrival { vehicle, time_s });
            return;
        };
        state.asks_since_s = Some(time_s);
        self.calendar
            .schedule(time_s + STUCK_S, What::Stuck { at, vehicle });
        self.roads[next as usize].waiting.push_back(vehicle);
        self.schedule_admission(next);
    }

    fn let_through_if_stuck(&mut self, at: LaneOf, vehicle: u32) {
        let state = &self.vehicles[vehicle as usize];
        let since_s = state.asks_since_s.filter(|_| state.at == Some(at));
        let is_stuck = since_s.is_some_and(|since_s| since_s + STUCK_S <= self.time_s);
        if let (true, Some(&road)) = (is_stuck, state.onward.last())
            && let Some(lane) = self.roads[road as usize].shortest_lane(None)
        {
            self.let_through += 1;
            self.withdraw(vehicle, road);
            self.enter(LaneOf { road, lane }, vehicle);
        }
    }

    /// A vehicle no longer asks to enter a road.
    fn withdraw(&mut self, vehicle: u32, road: u32) {
        let waiting = &mut self.roads[road as usize].waiting;
        waiting.retain(|&other| other != vehicle);
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
        while let Some((at_s, what)) = self.calendar.next_until(time_s) {
            self.time_s = at_s;
            match what {
                What::Exit(at) => self.exit(at, arrived),
                What::Admission(road) => self.admit(road),
                What::Stuck { at, vehicle } => self.let_through_if_stuck(at, vehicle),
            }
        }
        self.time_s = time_s;
        Ok(())
    }

    fn on_roads(&mut self, vehicles: &mut Vec<OnRoad>) -> Result<()> {
        vehicles.clear();
        for (road, queue) in (0..).zip(&self.roads) {
            let length_m = self.map.roads()[road as usize].length_m;
            for (ahead, &vehicle) in queue
                .lanes
                .iter()
                .flat_map(|lane| lane.vehicles().iter().enumerate())
            {
                let state = &self.vehicles[vehicle as usize];
                let alone_m = if state.at_end_s <= self.time_s {
                    length_m
                } else {
                    self.run(road, state.entered_s, self.time_s).0
                };
                // Who let others through may be one more than there is room for.
                let behind_m = (length_m - SPACING_M * ahead as f64).max(0.0);
                let along_m = alone_m.min(behind_m);
                vehicles.push(OnRoad {
                    vehicle,
                    road,
                    along_m,
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
        let Some(at) = state.at else {
            return Ok(());
        };
        let before = state.onward.last().copied();
        state.onward = onward.iter().rev().copied().collect();
        let asked = state.asks_since_s;
        if let (Some(_), Some(before)) = (asked, before)
            && before != onward.first().copied().unwrap_or(u32::MAX)
        {
            state.asks_since_s = None;
            self.withdraw(vehicle, before);
            self.calendar.schedule(self.time_s, What::Exit(at));
        }
        Ok(())
    }

    fn let_through(&self) -> u64 {
        self.let_through
    }
}
