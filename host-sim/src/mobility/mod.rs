//! Where vehicles are: on the urban grid for ever, or in a recorded trace for as long as it shows them.

pub mod floating_car_data;
mod urban_grid;

use crate::scenario::Scenario;
use crate::stream::{Role, WorldKey};
pub use urban_grid::{Heading, UrbanGrid};

/// A vehicle's place, in metres from the grid's south-west corner.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Eastwards.
    pub x_m: f64,
    /// Northwards.
    pub y_m: f64,
    /// Way driven since the last update, which decorrelates its shadowing.
    pub moved_m: f64,
}

/// Vehicles and their places. A vehicle keeps its index for good; not every vehicle is always present.
pub enum Mobility<'s> {
    /// The urban grid of 3GPP TR 36.885 A.1.2.
    Grid(UrbanGrid<'s>),
}

impl<'s> Mobility<'s> {
    /// Vehicles at their starting places.
    pub fn new(scenario: &'s Scenario, key: &WorldKey) -> Self {
        Self::Grid(UrbanGrid::new(
            &scenario.mobility,
            scenario.cell.vehicles,
            key.stream(Role::Mobility, 0),
        ))
    }

    /// How many vehicles ever appear.
    pub fn vehicles(&self) -> usize {
        match self {
            Self::Grid(grid) => grid.vehicles(),
        }
    }

    /// Moves on to `slots` after the start and hands over every present vehicle with its place.
    pub fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) {
        match self {
            Self::Grid(grid) => grid.advance(slots, places),
        }
    }
}
