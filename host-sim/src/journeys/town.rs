//! A town for journeys: its roads for traffic and for ways, the usual ways, and its base stations.

use super::guidance::Choice;
use super::hour::{Times, World};
use super::incidents::Incidents;
use super::roads::{LANE_CAPACITY_VEH_PER_H, Road, RoadMap, SPACING_M};
use super::trips;
use crate::scenario::{PlanningScenario, Scenario};
use crate::stream::WorldKey;
use crate::traffic::road_grid;
use assignment::coordinates::{LengthUnit, NodePlaces};
use assignment::grid::Grid;
use assignment::{Demand, Network, Options, PathFlow, assign};
use kit::error::{Error, Result};
use std::collections::HashMap;

/// Relative gap of the equilibrium whose paths are the usual ways (chosen).
const RELATIVE_GAP: f64 = 1e-6;

/// Mean free speed in m/s to which a network is scaled whose coordinates have no known unit (chosen: 50 km/h).
const URBAN_SPEED_M_PER_S: f64 = 50.0 / 3.6;

/// How far apart the places of a network may lie, in m (chosen).
const LARGEST_M: f64 = 1e6;

/// Mean free speeds in m/s that a network may have (chosen: 4 to 540 km/h).
const PLAUSIBLE_M_PER_S: std::ops::RangeInclusive<f64> = 1.1..=150.0;

/// Most base stations (chosen).
const MOST_STATIONS: f64 = 10_000.0;

/// What the numbers of a network mean. Chosen by the format or its reader's options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// Metres for each unit of the coordinates; `None` scales a network of unknown unit so that its vehicles drive at 50 km/h
    /// on average when alone.
    pub metres_per_coordinate: Option<f64>,
    /// Seconds for each unit of travel time.
    pub seconds_per_time: f64,
}

/// A town.
#[derive(Debug)]
pub struct Town {
    map: RoadMap,
    network: Network,
    paths: Vec<PathFlow>,
    /// Flow over capacity on the usual ways, where it is largest.
    most_v_over_c: f64,
    stations_m: Vec<(f64, f64)>,
    /// Metres for each unit of a loaded network's coordinates.
    metres_per_coordinate: f64,
}

impl Town {
    /// The scenario's grid with its one base station.
    ///
    /// # Errors
    /// As [`Grid::network`].
    pub fn of_grid(scenario: &Scenario) -> Result<Self> {
        let (mobility, planning) = (&scenario.mobility, &scenario.planning);
        let grid = Grid {
            capacity: planning.lane_capacity_veh_per_h * f64::from(mobility.lanes_per_direction),
            volume_per_pair: planning.demand_factor * planning.trips_per_pair_veh_per_h,
            ..road_grid(scenario)
        };
        let network = grid.network()?;
        let nodes = 0..network.numbering().nodes;
        let place = |node| {
            let (column, row) = (node % grid.columns, node / grid.columns);
            (
                f64::from(column) * grid.block_length_x,
                f64::from(row) * grid.block_length_y,
            )
        };
        let lanes = |_: f64| mobility.lanes_per_direction;
        let map = road_map(&network, nodes.map(place).collect(), 1.0, lanes)?;
        let station = (scenario.cell.base_station_x_m, scenario.cell.base_station_y_m);
        Self::new(map, network, &grid.demand()?, vec![station], 1.0)
    }

    /// A loaded network at its real size, under base stations on a square lattice.
    ///
    /// # Errors
    /// As [`assign`], and [`Error::Input`] for units that are not positive or places that are all one.
    pub fn of_network(
        network: Network,
        demand: &Demand,
        nodes: &NodePlaces,
        units: Units,
        planning: &PlanningScenario,
    ) -> Result<Self> {
        let seconds = units.seconds_per_time;
        if !(seconds.is_finite() && seconds > 0.0) {
            return Err(Error::input(
                "seconds per unit of time",
                seconds,
                "a positive number",
            ));
        }
        let length = |link: &assignment::Link| {
            let (from, to) = (
                nodes.places[link.init_node as usize - 1],
                nodes.places[link.term_node as usize - 1],
            );
            libm::hypot(to.0 - from.0, to.1 - from.1)
        };
        let total: f64 = network.links().iter().map(length).sum();
        let time: f64 = network.links().iter().map(|link| link.free_flow_time).sum();
        let metres = match (units.metres_per_coordinate, nodes.unit) {
            (Some(metres), _) => metres,
            (None, LengthUnit::Metre) => 1.0,
            (None, LengthUnit::Unknown) => URBAN_SPEED_M_PER_S * time * seconds / total,
        };
        if !(metres.is_finite() && metres > 0.0) {
            let expected = "a positive number, and nodes that do not all lie on one spot";
            return Err(Error::input("metres per unit of coordinates", metres, expected));
        }
        let places: Vec<(f64, f64)> = nodes
            .places
            .iter()
            .map(|&(x, y)| (metres * x, metres * y))
            .collect();
        let (x, y) = extents(&places);
        let far_m = (x.1 - x.0).max(y.1 - y.0);
        let mean_m_per_s = metres * total / (seconds * time);
        if far_m > LARGEST_M || !PLAUSIBLE_M_PER_S.contains(&mean_m_per_s) {
            let found = format!(
                "{metres:e} m for each unit of coordinates and {seconds:e} s for each of time, so {:.3e} km and {:.3e} km/h on average",
                far_m / 1000.0,
                3.6 * mean_m_per_s
            );
            let expected = "a town: --metres-per-unit and --seconds-per-unit say otherwise";
            return Err(Error::input("network", found, expected));
        }
        let stations = lattice(&places, planning.station_spacing_m)?;
        let lanes = |capacity: f64| (capacity / LANE_CAPACITY_VEH_PER_H).round().max(1.0) as u32;
        let map = road_map(&network, places, seconds, lanes)?;
        let demand = demand.scaled(planning.demand_factor)?;
        Self::new(map, network, &demand, stations, metres)
    }

    fn new(
        map: RoadMap,
        network: Network,
        demand: &Demand,
        stations_m: Vec<(f64, f64)>,
        metres_per_coordinate: f64,
    ) -> Result<Self> {
        let options = Options {
            gap: RELATIVE_GAP,
            ..Options::default()
        };
        let solution = assign(&network, demand, &options)?;
        let paths: Vec<PathFlow> = solution.path_flows.iter().collect();
        if paths.is_empty() {
            let expected = "trips between nodes that lie apart, times a planning.demand_factor above 0";
            return Err(Error::input("trips", "none of any length", expected));
        }
        let links = network.links().iter().zip(&solution.link_flows);
        let v_over_c = links.map(|(link, flow)| flow / link.capacity);
        Ok(Self {
            map,
            most_v_over_c: v_over_c.fold(0.0, f64::max),
            network,
            paths,
            stations_m,
            metres_per_coordinate,
        })
    }

    /// Speeds by road of a vehicle alone, in m/s.
    pub fn free_speeds_m_per_s(&self) -> Vec<f64> {
        let roads = self.map.roads().iter();
        roads.map(|road| road.free_speed_m_per_s).collect()
    }

    /// A world on these roads, whose speeds are known when nothing happens.
    pub fn world<'w>(
        &'w self,
        key: WorldKey,
        trips: &'w [trips::Trip],
        incidents: &'w Incidents,
        usual_speeds_m_per_s: &'w [f64],
        planning: &PlanningScenario,
    ) -> World<'w> {
        World {
            key,
            map: &self.map,
            network: &self.network,
            paths: &self.paths,
            trips,
            incidents,
            usual_speeds_m_per_s,
            times: Times {
                warmup_s: planning.warmup_s,
                horizon_s: planning.horizon_s,
                end_s: 2.0 * planning.horizon_s,
                look_s: planning.look_s,
                advice_s: planning.advice_s,
            },
            choice: Choice {
                spread: planning.choice_spread,
                gain: planning.choice_gain,
            },
        }
    }

    /// Its roads.
    pub fn map(&self) -> &RoadMap {
        &self.map
    }

    /// The usual ways, with vehicles an hour.
    pub fn paths(&self) -> &[PathFlow] {
        &self.paths
    }

    /// Trips an hour.
    pub fn trips_per_h(&self) -> f64 {
        self.paths.iter().map(|path| path.volume).sum()
    }

    /// Flow over capacity on the usual ways, where it is largest. Above 1, not everybody gets through.
    pub fn most_v_over_c(&self) -> f64 {
        self.most_v_over_c
    }

    /// Places of the base stations in m.
    pub fn stations_m(&self) -> &[(f64, f64)] {
        &self.stations_m
    }

    /// The station that a place hears best, which is the nearest, and how far it is in m.
    pub fn nearest_station(&self, (x_m, y_m): (f64, f64)) -> (usize, f64) {
        let distances = self
            .stations_m
            .iter()
            .map(|station| libm::hypot(station.0 - x_m, station.1 - y_m));
        distances
            .enumerate()
            .fold((0, f64::INFINITY), |best, (station, distance)| {
                if distance < best.1 {
                    (station, distance)
                } else {
                    best
                }
            })
    }

    /// Metres for each unit of the network's coordinates.
    pub fn metres_per_coordinate(&self) -> f64 {
        self.metres_per_coordinate
    }
}

/// The links of a network as roads between these places; times are in units of `seconds`, capacities in vehicles an hour.
fn road_map(
    network: &Network,
    places_m: Vec<(f64, f64)>,
    seconds: f64,
    lanes: impl Fn(f64) -> u32,
) -> Result<RoadMap> {
    let mut alone = HashMap::<(u32, u32), Vec<u32>>::new();
    let mut blocks = 0;
    let mut block = |from: u32, to: u32| {
        if let Some(block) = alone.get_mut(&(to, from)).and_then(Vec::pop) {
            return block;
        }
        alone.entry((from, to)).or_default().push(blocks);
        blocks += 1;
        blocks - 1
    };
    let roads = network.links().iter().map(|link| {
        let (from, to) = (link.init_node - 1, link.term_node - 1);
        let (a, b) = (places_m[from as usize], places_m[to as usize]);
        // Connectors often have no length and no time: a vehicle's room, at the speed of a street.
        let length_m = libm::hypot(b.0 - a.0, b.1 - a.1).max(SPACING_M);
        let time_s = seconds * link.free_flow_time;
        let free_speed_m_per_s = if time_s > 0.0 {
            length_m / time_s
        } else {
            URBAN_SPEED_M_PER_S
        };
        Road {
            from,
            to,
            length_m,
            free_speed_m_per_s,
            lanes: lanes(link.capacity),
            capacity_veh_per_h: link.capacity,
            block: (a != b).then(|| block(from, to)),
        }
    });
    RoadMap::new(roads.collect(), places_m)
}

/// The least and the largest coordinate of places along x and y.
fn extents(places_m: &[(f64, f64)]) -> ((f64, f64), (f64, f64)) {
    let extent = |values: &mut dyn Iterator<Item = f64>| {
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        })
    };
    (
        extent(&mut places_m.iter().map(|place| place.0)),
        extent(&mut places_m.iter().map(|place| place.1)),
    )
}

/// Stations on a square lattice, centred over what it has to cover, none further than a spacing from all places.
fn lattice(places_m: &[(f64, f64)], spacing_m: f64) -> Result<Vec<(f64, f64)>> {
    let (x, y) = extents(places_m);
    let count = ((x.1 - x.0) / spacing_m + 1.0) * ((y.1 - y.0) / spacing_m + 1.0);
    if count > MOST_STATIONS {
        let found = format!("{spacing_m} m, so {count:.0} base stations");
        let expected = format!("at most {MOST_STATIONS} of them");
        return Err(Error::input("planning.station_spacing_m", found, expected));
    }
    let along = |(low, high): (f64, f64)| {
        let count = ((high - low) / spacing_m).ceil().max(1.0);
        let first = 0.5 * (low + high) - 0.5 * spacing_m * (count - 1.0);
        (0..count as u32)
            .map(move |n| first + spacing_m * f64::from(n))
            .collect::<Vec<f64>>()
    };
    let (columns, rows) = (along(x), along(y));
    let stations = rows.iter().flat_map(|&y| columns.iter().map(move |&x| (x, y)));
    let near = |&(x, y): &(f64, f64)| {
        places_m
            .iter()
            .any(|place| libm::hypot(place.0 - x, place.1 - y) <= spacing_m)
    };
    Ok(stations.filter(near).collect())
}
