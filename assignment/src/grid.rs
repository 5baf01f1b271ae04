//! The urban grid: two-way streets along both axes, an intersection wherever two cross.
//!
//! Its default is three blocks by three: streets along y stand at x = 0, 250, 500 and 750 m, streets along x at
//! y = 0, 433, 866 and 1299 m (3GPP TR 36.885 A.1.2), 24 stretches of two-way street or 48 one-way roads. Every
//! intersection sends one vehicle per hour to every other one.
//!
//! # Order of roads
//! First all roads along x, street by street with ascending y; within a street block by block with ascending x; within a
//! block the forward direction (ascending coordinate) and then the backward one. Then all roads along y likewise. That is
//! the order of the network's links, and of every flow, cost, age and capacity vector. Intersections are numbered from 1,
//! row by row: `row * columns + column + 1`.

use crate::demand::{Demand, Trip};
use crate::link::{CostWeights, Link, NodeNumbering};
use crate::network::Network;
use crate::volume_delay::{BPR_B, BPR_POWER};
use kit::error::{Error, Result};

/// Most streets along either axis (chosen: a million intersections).
const STREET_LIMIT: u32 = 1000;

/// The axis that a street runs along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// y is constant.
    X,
    /// x is constant.
    Y,
}

/// The way that traffic goes on a road.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Towards larger coordinates.
    Forward,
    /// Towards smaller coordinates.
    Backward,
}

/// One direction of one block of one street.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Road {
    /// The axis that it runs along.
    pub axis: Axis,
    /// Which of the streets along this axis, from 0, by ascending coordinate.
    pub street: u32,
    /// Which of the street's blocks, from 0, by ascending coordinate.
    pub block: u32,
    /// The way that traffic goes.
    pub direction: Direction,
}

/// Size, times and demand of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Streets along y: intersections in a row.
    pub columns: u32,
    /// Streets along x: rows of intersections.
    pub rows: u32,
    /// Length of a block along x, in metres.
    pub block_length_x: f64,
    /// Length of a block along y, in metres.
    pub block_length_y: f64,
    /// Free-flow time of a block along x, in seconds.
    pub free_flow_time_x: f64,
    /// Free-flow time of a block along y, in seconds.
    pub free_flow_time_y: f64,
    /// Capacity of every road, in vehicles per hour.
    pub capacity: f64,
    /// BPR's B.
    pub b: f64,
    /// BPR's power.
    pub power: f64,
    /// Vehicles per hour from every intersection to every other one.
    pub volume_per_pair: f64,
}

impl Default for Grid {
    /// 4 by 4 intersections, blocks of 250 m in 18 s by 433 m in 31 s, 30 vehicles per hour, BPR 0.15 and 4, one
    /// vehicle per hour and pair.
    fn default() -> Self {
        Self {
            columns: 4,
            rows: 4,
            block_length_x: 250.0,
            block_length_y: 433.0,
            free_flow_time_x: 18.0,
            free_flow_time_y: 31.0,
            capacity: 30.0,
            b: BPR_B,
            power: BPR_POWER,
            volume_per_pair: 1.0,
        }
    }
}

impl Grid {
    /// Number of one-way roads: 48 by default.
    pub fn roads(&self) -> usize {
        self.roads_along(Axis::X) + self.roads_along(Axis::Y)
    }

    /// Streets along an axis.
    pub fn streets(&self, axis: Axis) -> u32 {
        match axis {
            Axis::X => self.rows,
            Axis::Y => self.columns,
        }
    }

    /// Blocks of each street along an axis.
    pub fn blocks(&self, axis: Axis) -> u32 {
        match axis {
            Axis::X => self.columns.saturating_sub(1),
            Axis::Y => self.rows.saturating_sub(1),
        }
    }

    fn roads_along(&self, axis: Axis) -> usize {
        2 * self.streets(axis) as usize * self.blocks(axis) as usize
    }

    /// Index of a road, from 0; none if the grid has no such street or block.
    pub fn road_index(&self, axis: Axis, street: u32, block: u32, direction: Direction) -> Option<usize> {
        if street >= self.streets(axis) || block >= self.blocks(axis) {
            return None;
        }
        let before = match axis {
            Axis::X => 0,
            Axis::Y => self.roads_along(Axis::X),
        };
        let stretch = street as usize * self.blocks(axis) as usize + block as usize;
        Some(before + 2 * stretch + usize::from(direction == Direction::Backward))
    }

    /// The road with a given index; the inverse of [`road_index`](Self::road_index).
    pub fn road(&self, index: usize) -> Option<Road> {
        if index >= self.roads() {
            return None;
        }
        let along_x = self.roads_along(Axis::X);
        let (axis, index) = if index < along_x {
            (Axis::X, index)
        } else {
            (Axis::Y, index - along_x)
        };
        let direction = if index % 2 == 0 {
            Direction::Forward
        } else {
            Direction::Backward
        };
        let blocks = self.blocks(axis) as usize;
        Some(Road {
            axis,
            street: (index / 2 / blocks) as u32,
            block: (index / 2 % blocks) as u32,
            direction,
        })
    }

    /// Number of the intersection of the street along x in `row` and the street along y in `column`, both from 0.
    fn intersection(&self, column: u32, row: u32) -> u32 {
        row * self.columns + column + 1
    }

    /// The roads as links, every intersection a zone that can be passed.
    ///
    /// # Errors
    /// [`Error::Input`] for fewer than 2 or more than 1000 streets along an axis, or a time, capacity, B or power that is
    /// negative, not finite, or 0 where it cannot be.
    pub fn network(&self) -> Result<Network> {
        let intersections = self.check_size()?;
        let links = (0..self.roads()).filter_map(|index| self.road(index));
        let links = links.map(|road| self.link(road)).collect();
        let numbering = NodeNumbering {
            zones: intersections,
            nodes: intersections,
            first_thru_node: 1,
        };
        Network::new(numbering, links, CostWeights::default())
    }

    fn link(&self, road: Road) -> Link {
        let (from, to, length, free_flow_time) = match road.axis {
            Axis::X => (
                self.intersection(road.block, road.street),
                self.intersection(road.block + 1, road.street),
                self.block_length_x,
                self.free_flow_time_x,
            ),
            Axis::Y => (
                self.intersection(road.street, road.block),
                self.intersection(road.street, road.block + 1),
                self.block_length_y,
                self.free_flow_time_y,
            ),
        };
        let (init_node, term_node) = match road.direction {
            Direction::Forward => (from, to),
            Direction::Backward => (to, from),
        };
        Link {
            init_node,
            term_node,
            capacity: self.capacity,
            length,
            free_flow_time,
            b: self.b,
            power: self.power,
            toll: 0.0,
        }
    }

    /// Trips between every two intersections.
    ///
    /// # Errors
    /// [`Error::Input`] for a grid size that [`network`](Self::network) refuses, or a volume that is negative or not
    /// finite.
    pub fn demand(&self) -> Result<Demand> {
        let zones = self.check_size()?;
        let pairs = (1..=zones).flat_map(|origin| (1..=zones).map(move |destination| (origin, destination)));
        let trips: Vec<Trip> = pairs
            .filter(|(origin, destination)| origin != destination)
            .map(|(origin, destination)| Trip {
                origin,
                destination,
                volume: self.volume_per_pair,
            })
            .collect();
        Demand::new(zones, &trips)
    }

    /// Number of intersections of a grid of a sensible size.
    fn check_size(&self) -> Result<u32> {
        for (name, streets) in [("columns", self.columns), ("rows", self.rows)] {
            if !(2..=STREET_LIMIT).contains(&streets) {
                let expected = format!("2 to {STREET_LIMIT}");
                return Err(Error::input(format!("grid: {name}"), streets, expected));
            }
        }
        Ok(self.columns * self.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_road_has_one_index_and_links_follow_it() {
        let grid = Grid {
            columns: 5,
            rows: 3,
            ..Grid::default()
        };
        let network = grid.network().unwrap();
        assert_eq!(network.links().len(), grid.roads());
        for index in 0..grid.roads() {
            let road = grid.road(index).unwrap();
            let found = grid.road_index(road.axis, road.street, road.block, road.direction);
            assert_eq!(found, Some(index));
        }
        assert_eq!(grid.road(grid.roads()), None);
        assert_eq!(grid.road_index(Axis::X, 3, 0, Direction::Forward), None);
        assert_eq!(grid.road_index(Axis::Y, 0, 2, Direction::Forward), None);
        // The street at y = 866 m, from x = 500 m back to x = 250 m: intersection 13 to 12.
        let index = grid.road_index(Axis::X, 2, 1, Direction::Backward).unwrap();
        let link = &network.links()[index];
        assert_eq!((link.init_node, link.term_node), (13, 12));
    }
}
