//! Vehicles on the streets of a loaded network. Each makes one trip after the other: it follows a path of the traffic
//! equilibrium, chosen in proportion to the path's flow, along straight lines between the nodes.

use super::{Mobility, MobilitySource, Place, Road};
use crate::scenario::{MobilityScenario, Scenario};
use crate::stream::{Role, Stream, WorldKey};
use assignment::coordinates::{LengthUnit, NodePlaces};
use assignment::{Demand, Network, Options, PathFlow, assign};
use kit::error::{Error, Result};

/// The streets of a network in the coordinates of the cell, and the trips on them.
#[derive(Debug)]
pub struct StreetMap {
    network: Network,
    demand: Demand,
    /// Equilibrium paths, by ascending origin.
    trips: Vec<PathFlow>,
    /// Flow of all drivable trips up to and including each.
    cumulative_volume: Vec<f64>,
    /// Of every node, in metres.
    places: Vec<(f64, f64)>,
    scale: Scale,
}

/// What a network's numbers mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Metres in the cell for each unit of the coordinates.
    pub metres_per_unit: f64,
    /// Seconds for each unit of the links' travel times.
    pub seconds_per_unit: f64,
}

impl StreetMap {
    /// Lays a network over the scenario's area, centre on centre: at `metres_per_unit`, or true to scale where its
    /// coordinates are metres, or as large as fits. Its travel times are in units of `seconds_per_unit`. `options` find the equilibrium whose paths the vehicles drive.
    ///
    /// # Errors
    /// As [`assign`], and [`Error::Input`] for a scale that is not positive, or a network without a path of any length.
    pub fn new(
        network: Network,
        demand: Demand,
        nodes: &NodePlaces,
        scenario: &Scenario,
        (metres_per_unit, seconds_per_unit): (Option<f64>, f64),
        options: &Options,
    ) -> Result<Self> {
        let mobility = &scenario.mobility;
        let area = (
            mobility.block_x_m * f64::from(mobility.blocks_x),
            mobility.block_y_m * f64::from(mobility.blocks_y),
        );
        let (x, y) = (
            extent(nodes.places.iter().map(|place| place.0)),
            extent(nodes.places.iter().map(|place| place.1)),
        );
        let metres_per_unit = match (metres_per_unit, nodes.unit) {
            (Some(metres), _) => metres,
            (None, LengthUnit::Metre) => 1.0,
            (None, LengthUnit::Unknown) => (area.0 / (x.1 - x.0)).min(area.1 / (y.1 - y.0)),
        };
        if !(metres_per_unit.is_finite() && metres_per_unit > 0.0) {
            let expected = "a positive number, and nodes that do not all lie on one spot";
            return Err(Error::input(
                "metres per unit of coordinates",
                metres_per_unit,
                expected,
            ));
        }
        if !(seconds_per_unit.is_finite() && seconds_per_unit > 0.0) {
            let place = "seconds per unit of time";
            return Err(Error::input(place, seconds_per_unit, "a positive number"));
        }
        let metres = |value: f64, (low, high): (f64, f64), length: f64| {
            0.5 * length + metres_per_unit * (value - 0.5 * (low + high))
        };
        let places: Vec<(f64, f64)> = nodes
            .places
            .iter()
            .map(|&place| (metres(place.0, x, area.0), metres(place.1, y, area.1)))
            .collect();
        let trips = assign(&network, &demand, options)?.path_flows;
        let mut map = Self {
            network,
            demand,
            trips,
            cumulative_volume: Vec::new(),
            places,
            scale: Scale {
                metres_per_unit,
                seconds_per_unit,
            },
        };
        let mut total = 0.0;
        for index in 0..map.trips.len() {
            let trip = &map.trips[index];
            if map.length_m(trip) > 0.0 {
                total += trip.volume;
            }
            map.cumulative_volume.push(total);
        }
        if total > 0.0 {
            return Ok(map);
        }
        Err(Error::input(
            "trips",
            "none of any length",
            "trips between nodes that lie apart",
        ))
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The demand for trips on it.
    pub fn demand(&self) -> &Demand {
        &self.demand
    }

    /// The paths of the equilibrium that vehicles follow.
    pub fn trips(&self) -> &[PathFlow] {
        &self.trips
    }

    /// What the network's numbers mean.
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// Where a link begins and ends.
    fn ends(&self, link: u32) -> ((f64, f64), (f64, f64)) {
        let link = &self.network.links()[link as usize];
        (
            self.places[link.init_node as usize - 1],
            self.places[link.term_node as usize - 1],
        )
    }

    fn link_length_m(&self, link: u32) -> f64 {
        let (from, to) = self.ends(link);
        libm::hypot(to.0 - from.0, to.1 - from.1)
    }

    fn length_m(&self, trip: &PathFlow) -> f64 {
        trip.links.iter().map(|&link| self.link_length_m(link)).sum()
    }

    /// A trip among those from `begin` to before `end`, in proportion to their flows; none where none can be driven.
    fn draw(&self, begin: usize, end: usize, stream: &mut Stream) -> Option<usize> {
        let before = |index: usize| {
            index
                .checked_sub(1)
                .map_or(0.0, |index| self.cumulative_volume[index])
        };
        let (low, high) = (before(begin), before(end));
        if high <= low {
            return None;
        }
        let drawn = stream.uniform_between(low, high);
        let index = self.cumulative_volume.partition_point(|&volume| volume <= drawn);
        Some(index.clamp(begin, end - 1))
    }

    /// Any trip.
    fn draw_any(&self, stream: &mut Stream) -> usize {
        self.draw(0, self.trips.len(), stream).unwrap_or(0)
    }

    /// A trip that starts in a zone; one from elsewhere where none does.
    fn draw_from(&self, zone: u32, stream: &mut Stream) -> usize {
        let begin = self.trips.partition_point(|trip| trip.origin < zone);
        let end = self.trips.partition_point(|trip| trip.origin <= zone);
        let trip = self.draw(begin, end, stream);
        trip.unwrap_or_else(|| self.draw_any(stream))
    }
}

/// Least and greatest.
fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

/// A vehicle on the leg of a trip.
#[derive(Debug, Clone, Copy)]
struct Vehicle {
    trip: usize,
    leg: usize,
    along_m: f64,
    speed_m_per_s: f64,
}

impl MobilitySource for StreetMap {
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        let stream = key.stream(Role::Mobility, 0);
        let vehicles = scenario.cell.vehicles;
        Box::new(Streets::new(self, &scenario.mobility, vehicles, stream))
    }

    fn describe(&self, _scenario: &Scenario) -> String {
        format!("network of {} roads", self.network.links().len())
    }

    fn describe_vehicles(&self, scenario: &Scenario) -> String {
        let roads = self.network.links().len();
        format!(
            "{} vehicles on {roads} roads of a network",
            scenario.cell.vehicles
        )
    }

    fn vehicles(&self, scenario: &Scenario) -> usize {
        scenario.cell.vehicles as usize
    }

    fn streets(&self) -> Option<&StreetMap> {
        Some(self)
    }
}

/// Vehicles on the streets of a map.
struct Streets<'s> {
    map: &'s StreetMap,
    vehicles: Vec<Vehicle>,
    stream: Stream,
    slots: u32,
}

impl<'s> Streets<'s> {
    /// As many vehicles as the cell has, each somewhere on a trip, with a uniformly drawn speed.
    fn new(map: &'s StreetMap, scenario: &MobilityScenario, vehicles: u32, mut stream: Stream) -> Self {
        let vehicles = (0..vehicles)
            .map(|index| {
                let trip = map.draw_any(&mut stream);
                let speed_m_per_s = scenario.speed_m_per_s(index, vehicles, &mut stream);
                let mut vehicle = Vehicle {
                    trip,
                    leg: 0,
                    along_m: 0.0,
                    speed_m_per_s,
                };
                let way_m = stream.uniform_between(0.0, map.length_m(&map.trips[trip]));
                drive(&mut vehicle, way_m, map, &mut stream);
                vehicle
            })
            .collect();
        Self {
            map,
            vehicles,
            stream,
            slots: 0,
        }
    }

    /// The link that a vehicle drives on.
    fn link(&self, vehicle: usize) -> u32 {
        let Vehicle { trip, leg, .. } = self.vehicles[vehicle];
        self.map.trips[trip].links[leg]
    }
}

impl Mobility for Streets<'_> {
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        let seconds = f64::from(slots - self.slots) / 1000.0;
        self.slots = slots;
        places.clear();
        for index in 0..self.vehicles.len() {
            let vehicle = &mut self.vehicles[index];
            let moved_m = vehicle.speed_m_per_s * seconds;
            drive(vehicle, moved_m, self.map, &mut self.stream);
            let along_m = vehicle.along_m;
            let link = self.link(index);
            let (from, to) = self.map.ends(link);
            let length_m = self.map.link_length_m(link);
            let share = if length_m > 0.0 { along_m / length_m } else { 0.0 };
            let place = Place {
                x_m: from.0 + share * (to.0 - from.0),
                y_m: from.1 + share * (to.1 - from.1),
                moved_m,
                speed_m_per_s: self.vehicles[index].speed_m_per_s,
            };
            places.push((index, place));
        }
        Ok(())
    }

    fn road(&self, vehicle: usize) -> Option<Road> {
        Some(Road::Link(self.link(vehicle)))
    }
}

/// Drives `way_m` onwards; at the end of a trip the next one begins.
fn drive(vehicle: &mut Vehicle, way_m: f64, map: &StreetMap, stream: &mut Stream) {
    let mut remaining_m = way_m;
    loop {
        let trip = &map.trips[vehicle.trip];
        let left_m = map.link_length_m(trip.links[vehicle.leg]) - vehicle.along_m;
        if remaining_m < left_m {
            vehicle.along_m += remaining_m;
            return;
        }
        remaining_m -= left_m;
        vehicle.along_m = 0.0;
        vehicle.leg += 1;
        if vehicle.leg == trip.links.len() {
            vehicle.trip = map.draw_from(trip.destination, stream);
            vehicle.leg = 0;
        }
    }
}
