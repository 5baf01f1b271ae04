//! Where vehicles are: on the urban grid or the streets of a loaded network for ever, or in a recorded trace for as long as
//! it shows them.

pub mod floating_car_data;
mod streets;
mod urban_grid;

use crate::scenario::Scenario;
use crate::stream::{Role, WorldKey};
use floating_car_data::{Cursor, Trace};
use kit::error::{Error, Result};
use std::path::Path;
pub use streets::{Scale, StreetMap, Streets};
pub use urban_grid::{Heading, UrbanGrid};

/// A vehicle's place in metres, in the coordinates of the base station: from the grid's south-west corner, or as in the trace.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Eastwards.
    pub x_m: f64,
    /// Northwards.
    pub y_m: f64,
    /// Way driven since the last update, which decorrelates its shadowing.
    pub moved_m: f64,
}

/// Where no vehicle has a chance of being heard (chosen).
const REACH_M: f64 = 10_000.0;

/// What moves the vehicles of every world.
#[derive(Debug)]
pub enum MobilitySource {
    /// The scenario's urban grid, another in each world.
    Grid,
    /// The streets of a loaded network, with other vehicles on them in each world.
    Streets(Box<StreetMap>),
    /// A recorded trace, the same in each world.
    Trace(Trace),
}

impl MobilitySource {
    /// `grid`, or a file of SUMO floating-car data.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn read(name: &str) -> Result<Self> {
        if name == "grid" {
            Ok(Self::Grid)
        } else {
            Trace::read(Path::new(name)).map(Self::Trace)
        }
    }

    /// The most vehicles at once.
    pub fn most_vehicles(&self, scenario: &Scenario) -> usize {
        match self {
            Self::Grid | Self::Streets(_) => scenario.cell.vehicles as usize,
            Self::Trace(trace) => trace.max_simultaneous().0,
        }
    }

    /// How many vehicles ever appear.
    pub fn vehicles(&self, scenario: &Scenario) -> usize {
        match self {
            Self::Grid | Self::Streets(_) => scenario.cell.vehicles as usize,
            Self::Trace(trace) => trace.vehicle_ids().len(),
        }
    }

    /// A vehicle's name.
    pub fn vehicle_name(&self, vehicle: usize) -> String {
        match self {
            Self::Grid | Self::Streets(_) => vehicle.to_string(),
            Self::Trace(trace) => trace.vehicle_ids()[vehicle].clone(),
        }
    }

    /// Checks that the scenario replaces vehicles on the urban grid only, and that a trace passes the base station.
    ///
    /// # Errors
    /// [`Error::Input`] if the first is not so, or no vehicle ever comes within 10 km: the trace is then in other
    /// coordinates.
    pub fn check_places(&self, scenario: &Scenario) -> Result<()> {
        let probability = scenario.cell.replacement_probability;
        if probability > 0.0 && !matches!(self, Self::Grid) {
            let expected = "0 but on the urban grid";
            return Err(Error::input(
                "cell.replacement_probability",
                probability,
                expected,
            ));
        }
        let Self::Trace(trace) = self else { return Ok(()) };
        let (x_m, y_m) = (scenario.cell.base_station_x_m, scenario.cell.base_station_y_m);
        let mut cursor = trace.cursor();
        let mut nearest_m = f64::INFINITY;
        for slot in (0..=trace.duration_slots()).step_by(scenario.radio.slow_update_slots as usize) {
            for (_, position) in cursor.advance_to(slot) {
                nearest_m = nearest_m.min(libm::hypot(position.x_m - x_m, position.y_m - y_m));
            }
        }
        if nearest_m <= REACH_M {
            return Ok(());
        }
        let expected =
            format!("at most {REACH_M} m: set cell.base_station_x_m and _y_m in the trace's coordinates");
        Err(Error::input(
            "distance of the trace from the base station",
            format!("{nearest_m:.0} m"),
            expected,
        ))
    }

    /// Checks that the source moves vehicles for this many slots.
    ///
    /// # Errors
    /// [`Error::Input`] if the trace is shorter.
    pub fn check_slots(&self, slots: u32) -> Result<()> {
        match self {
            Self::Trace(trace) if slots > trace.duration_slots() => {
                let expected = format!("at most {}, the length of the trace", trace.duration_slots());
                Err(Error::input("warmup + slots", slots, expected))
            }
            _ => Ok(()),
        }
    }
}

/// The moving vehicles of one world. A vehicle keeps its index for good; not every vehicle is always present.
pub enum Mobility<'s> {
    /// On the urban grid of 3GPP TR 36.885 A.1.2.
    Grid(Box<UrbanGrid<'s>>),
    /// On the streets of a loaded network.
    Streets(Box<Streets<'s>>),
    /// In a trace.
    Trace {
        /// The present step.
        cursor: Cursor<'s>,
        /// Every vehicle's last known coordinates.
        last: Vec<Option<(f64, f64)>>,
    },
}

impl<'s> Mobility<'s> {
    /// Vehicles at their starting places.
    pub fn new(source: &'s MobilitySource, scenario: &'s Scenario, key: &WorldKey) -> Self {
        match source {
            MobilitySource::Grid => {
                let stream = key.stream(Role::Mobility, 0);
                Self::Grid(Box::new(UrbanGrid::new(
                    &scenario.mobility,
                    scenario.cell.vehicles,
                    stream,
                )))
            }
            MobilitySource::Streets(map) => {
                let stream = key.stream(Role::Mobility, 0);
                let vehicles = scenario.cell.vehicles;
                Self::Streets(Box::new(Streets::new(map, &scenario.mobility, vehicles, stream)))
            }
            MobilitySource::Trace(trace) => Self::Trace {
                cursor: trace.cursor(),
                last: vec![None; trace.vehicle_ids().len()],
            },
        }
    }

    /// How many vehicles ever appear.
    pub fn vehicles(&self) -> usize {
        match self {
            Self::Grid(grid) => grid.vehicles(),
            Self::Streets(streets) => streets.vehicles(),
            Self::Trace { last, .. } => last.len(),
        }
    }

    /// Another vehicle takes a vehicle's index; its place. Only on the urban grid are vehicles replaced.
    pub fn replace(&mut self, vehicle: usize) -> Option<Place> {
        match self {
            Self::Grid(grid) => Some(grid.replace(vehicle)),
            Self::Streets(_) | Self::Trace { .. } => None,
        }
    }

    /// Moves on to `slots` after the start and hands over every present vehicle with its place, by ascending index.
    pub fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) {
        match self {
            Self::Grid(grid) => grid.advance(slots, places),
            Self::Streets(streets) => streets.advance(slots, places),
            Self::Trace { cursor, last } => {
                places.clear();
                for (vehicle, position) in cursor.advance_to(slots) {
                    let (x_m, y_m) = (position.x_m, position.y_m);
                    let moved_m = last[vehicle].map_or(0.0, |(x, y)| libm::hypot(x_m - x, y_m - y));
                    last[vehicle] = Some((x_m, y_m));
                    places.push((vehicle, Place { x_m, y_m, moved_m }));
                }
            }
        }
    }
}
