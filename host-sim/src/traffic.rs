//! What the ages of a cell do to the road: capacity error, user equilibrium, volume over capacity, travel time.

use crate::capacity::{CapacityError, Planner, Staleness, TrafficState};
use crate::environment::Environment;
use crate::mobility::{Heading, Place, Road};
use crate::scenario::Scenario;
use assignment::grid::{Axis, Direction, Grid};
use assignment::{Demand, Options};
use firmware::units::Age;
use kit::error::Result;
use rayon::prelude::*;
use serde_json::{Value, json};

/// Relative gap of every equilibrium here (chosen: flows are then good to about 1e-6 veh/h on the paper's grid).
const RELATIVE_GAP: f64 = 1e-10;

/// The same on grids with more than [`MANY_PAIRS`] (chosen: times are then good to a part in a million, and a world of 8 x 8 blocks
/// takes less than a second).
const RELATIVE_GAP_OF_MANY: f64 = 1e-6;

/// See [`RELATIVE_GAP_OF_MANY`] (chosen: up to 5 x 5 blocks have fewer).
const MANY_PAIRS: usize = 2_000;

/// The road network between the crossings of a scenario's grid, and the flows planned on it.
pub struct TrafficModel {
    grid: Grid,
    planner: Planner,
    error: CapacityError,
}

/// What one policy's ages do to traffic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrafficSummary {
    /// Every road with the policy's mean age, as in the paper's figures.
    pub uniform: TrafficState,
    /// Every road with the age of its freshest vehicle: planned with what is believed. Means over worlds.
    pub stale: TrafficState,
    /// The same roads, planned with what is true. Means over worlds.
    pub informed: TrafficState,
}

impl TrafficSummary {
    /// The summary as JSON.
    pub fn to_json(&self) -> Value {
        json!({
            "uniform_mean_v_over_c": self.uniform.mean_volume_over_capacity,
            "uniform_mean_link_time_s": self.uniform.mean_link_time,
            "per_road_mean_v_over_c": self.stale.mean_volume_over_capacity,
            "per_road_mean_trip_time_s": self.stale.mean_trip_time,
            "informed_mean_trip_time_s": self.informed.mean_trip_time,
        })
    }
}

/// Age of what the base station knows of each road in one world, in ms.
pub type RoadAges = Vec<f64>;

impl TrafficModel {
    /// The network of a scenario, and what is planned there while all capacities are as believed.
    ///
    /// # Errors
    /// If the scenario's grid is no network, or has no equilibrium.
    pub fn new(scenario: &Scenario) -> Result<Self> {
        let traffic = &scenario.traffic;
        let grid = road_grid(scenario);
        let demand = grid.demand()?;
        let options = planning_options(&demand);
        Ok(Self {
            planner: Planner::new(grid.network()?, demand, options)?,
            grid,
            error: CapacityError {
                at_max_age: traffic.max_capacity_error_veh_per_h,
                max_age: f64::from(Age::TIME_CONSTRAINT.slots()),
            },
        })
    }

    /// The road that a vehicle at this place drives on.
    pub fn road(&self, heading: Heading, place: &Place) -> Option<usize> {
        let (axis, direction) = match heading {
            Heading::North => (Axis::Y, Direction::Forward),
            Heading::South => (Axis::Y, Direction::Backward),
            Heading::East => (Axis::X, Direction::Forward),
            Heading::West => (Axis::X, Direction::Backward),
        };
        let (columns, rows) = (
            place.x_m / self.grid.block_length_x,
            place.y_m / self.grid.block_length_y,
        );
        let (street, block) = if axis == Axis::X {
            (rows, columns)
        } else {
            (columns, rows)
        };
        // A vehicle at the very end of the last block is still on it.
        let block = (block as u32).min(self.grid.blocks(axis) - 1);
        self.grid
            .road_index(axis, street.round() as u32, block, direction)
    }

    /// What the base station knows of each road: the age of the freshest vehicle that drives on it, the largest age if
    /// there is none. `None` for vehicles that are not on the scenario's grid.
    pub fn road_ages(&self, environment: &Environment<'_>, world: usize) -> Option<RoadAges> {
        let mobility = environment.mobility(world);
        let mut ages = vec![self.error.max_age; self.grid.roads()];
        for (vehicle, place) in environment.places(world) {
            let Some(Road::Street(heading)) = mobility.road(*vehicle) else {
                return None;
            };
            if let Some(road) = self.road(heading, place) {
                ages[road] = ages[road].min(f64::from(environment.age(world, *vehicle).slots()));
            }
        }
        Some(ages)
    }

    /// Traffic with each of these ages on all roads alike. No route changes then.
    ///
    /// # Errors
    /// If an age leaves no capacity.
    pub fn uniform(&self, ages_ms: &[f64]) -> Result<Vec<TrafficState>> {
        let state = |&age: &f64| self.planner.uniform(age, &self.error);
        ages_ms.iter().map(state).collect()
    }

    /// Traffic with every world's own age on each road.
    ///
    /// # Errors
    /// If an equilibrium cannot be found.
    pub fn per_road(&self, worlds: &[RoadAges]) -> Result<Vec<Staleness>> {
        let outcomes = worlds
            .par_iter()
            .map(|ages| self.planner.staleness(ages, &self.error));
        outcomes.collect()
    }

    /// Plans with every world's road ages, and with the policy's mean age on every road.
    ///
    /// # Errors
    /// If an equilibrium cannot be found.
    pub fn summary(&self, mean_age_ms: f64, worlds: &[RoadAges]) -> Result<TrafficSummary> {
        let outcomes = self.per_road(worlds)?;
        Ok(TrafficSummary {
            uniform: mean_state(self.uniform(&[mean_age_ms])?.into_iter()),
            stale: mean_state(outcomes.iter().map(|outcome| outcome.stale)),
            informed: mean_state(outcomes.iter().map(|outcome| outcome.informed)),
        })
    }
}

/// The roads between a scenario's crossings, with the paper's capacity and trips.
pub fn road_grid(scenario: &Scenario) -> Grid {
    let (mobility, traffic) = (&scenario.mobility, &scenario.traffic);
    Grid {
        columns: mobility.blocks_x + 1,
        rows: mobility.blocks_y + 1,
        block_length_x: mobility.block_x_m,
        block_length_y: mobility.block_y_m,
        free_flow_time_x: traffic.free_flow_time_x_s,
        free_flow_time_y: traffic.free_flow_time_y_s,
        capacity: traffic.capacity_veh_per_h,
        b: traffic.bpr_factor,
        power: traffic.bpr_power,
        volume_per_pair: traffic.trips_per_pair_veh_per_h,
    }
}

/// How plans are found: on one thread, because worlds already keep all cores busy.
fn planning_options(demand: &Demand) -> Options {
    Options {
        gap: if demand.pairs() > MANY_PAIRS {
            RELATIVE_GAP_OF_MANY
        } else {
            RELATIVE_GAP
        },
        threads: 1,
        ..Options::default()
    }
}

fn mean_state(states: impl Iterator<Item = TrafficState> + Clone) -> TrafficState {
    let count = states.clone().count() as f64;
    let mean = |value: fn(TrafficState) -> f64| states.clone().map(value).sum::<f64>() / count;
    TrafficState {
        mean_volume_over_capacity: mean(|state| state.mean_volume_over_capacity),
        max_volume_over_capacity: mean(|state| state.max_volume_over_capacity),
        mean_link_time: mean(|state| state.mean_link_time),
        mean_trip_time: mean(|state| state.mean_trip_time),
    }
}
