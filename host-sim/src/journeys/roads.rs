//! Roads as traffic models need them: lengths, speeds, lanes, and where they lead.

use super::OnRoad;
use kit::error::{Error, Result};

/// Length of road that a standing vehicle takes, in m: 5 m and a gap of 2.5 m (SUMO's default passenger car).
pub const SPACING_M: f64 = 7.5;

/// What one lane of a planning network's road carries, in vehicles an hour (chosen: a customary saturation flow).
pub const LANE_CAPACITY_VEH_PER_H: f64 = 1800.0;

/// One direction of a road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Road {
    /// Node at its beginning, from 0.
    pub from: u32,
    /// Node at its end, from 0.
    pub to: u32,
    /// Length in m.
    pub length_m: f64,
    /// Speed of a vehicle alone, in m/s.
    pub free_speed_m_per_s: f64,
    /// Lanes.
    pub lanes: u32,
    /// Vehicles an hour that can leave it.
    pub capacity_veh_per_h: f64,
    /// Both directions between two nodes are one block, which incidents hit; what joins two nodes of one place is none.
    pub block: Option<u32>,
}

impl Road {
    /// Time from end to end of a vehicle alone, in s.
    pub fn free_time_s(&self) -> f64 {
        self.length_m / self.free_speed_m_per_s
    }

    /// Time between two vehicles of a lane behind one another beyond that for their spacing, in s: with it a lane of the
    /// triangular fundamental diagram carries its capacity at free speed (Newell 1993).
    pub fn reaction_time_s(&self) -> f64 {
        3600.0 * f64::from(self.lanes) / self.capacity_veh_per_h - SPACING_M / self.free_speed_m_per_s
    }

    /// Speed in m/s at which so large a share of the capacity is left, above 0 and up to 1, on the same diagram.
    pub fn crawl_speed_m_per_s(&self, capacity_left: f64) -> f64 {
        let headway_s = 3600.0 * f64::from(self.lanes) / (capacity_left * self.capacity_veh_per_h);
        (SPACING_M / (headway_s - self.reaction_time_s())).min(self.free_speed_m_per_s)
    }
}

/// The roads of a network, in its order of links.
#[derive(Clone, Debug)]
pub struct RoadMap {
    roads: Vec<Road>,
    /// Of every node, in m.
    places_m: Vec<(f64, f64)>,
    block_count: u32,
    /// By node: the roads that leave it.
    outgoing: Vec<Vec<u32>>,
}

impl RoadMap {
    /// Roads between places in m.
    ///
    /// # Errors
    /// [`Error::Input`] for a road without length, speed or capacity, or between unknown nodes, named by its number from 1.
    pub fn new(roads: Vec<Road>, places_m: Vec<(f64, f64)>) -> Result<Self> {
        let mut outgoing = vec![Vec::new(); places_m.len()];
        for (index, road) in roads.iter().enumerate() {
            let place = |what: &str| format!("road {}: {what}", index + 1);
            for (what, value) in [
                ("length", road.length_m),
                ("free speed", road.free_speed_m_per_s),
                ("capacity", road.capacity_veh_per_h),
                ("lanes", f64::from(road.lanes)),
            ] {
                if !(value.is_finite() && value > 0.0) {
                    return Err(Error::input(place(what), value, "a positive number"));
                }
            }
            if road.from.max(road.to) as usize >= places_m.len() {
                let expected = format!("below {}, the number of nodes", places_m.len());
                return Err(Error::input(place("node"), road.from.max(road.to), expected));
            }
            outgoing[road.from as usize].push(index as u32);
        }
        let block_count = roads.iter().filter_map(|road| road.block).max();
        let block_count = block_count.map_or(0, |last| last + 1);
        Ok(Self {
            roads,
            places_m,
            block_count,
            outgoing,
        })
    }

    /// The roads.
    pub fn roads(&self) -> &[Road] {
        &self.roads
    }

    /// Places of the nodes in m.
    pub fn places_m(&self) -> &[(f64, f64)] {
        &self.places_m
    }

    /// Where a vehicle is, in m.
    pub fn place_m(&self, vehicle: &OnRoad) -> (f64, f64) {
        let road = &self.roads[vehicle.road as usize];
        let from = self.places_m[road.from as usize];
        let (x, y) = self.direction(vehicle.road);
        (from.0 + x * vehicle.along_m, from.1 + y * vehicle.along_m)
    }

    /// The direction of a road, of length 1, or 0 where it begins where it ends.
    pub fn direction(&self, road: u32) -> (f64, f64) {
        let Road { from, to, .. } = self.roads[road as usize];
        let (from, to) = (self.places_m[from as usize], self.places_m[to as usize]);
        let (x, y) = (to.0 - from.0, to.1 - from.1);
        let length = libm::hypot(x, y).max(f64::MIN_POSITIVE);
        (x / length, y / length)
    }

    /// How many blocks there are.
    pub fn block_count(&self) -> u32 {
        self.block_count
    }

    /// The roads that leave a node.
    pub fn outgoing(&self, node: u32) -> &[u32] {
        &self.outgoing[node as usize]
    }
}
