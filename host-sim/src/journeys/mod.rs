//! An hour on the roads: vehicles depart, queue, report what they meet, are advised, and arrive.
//!
//! Times are seconds here; slots stay in the cell. Who moves the vehicles is a [`TrafficModel`]: the built-in queues, or SUMO.

pub mod delays;
pub mod guidance;
pub mod hour;
pub mod incidents;
pub mod knowledge;
pub mod queues;
pub mod radio_seconds;
pub mod roads;
#[cfg(feature = "program")]
pub mod sumo;
pub mod town;
pub mod trips;

use kit::error::Result;

/// A vehicle on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnRoad {
    /// Its index, as it departed.
    pub vehicle: u32,
    /// The road that it drives or stands on.
    pub road: u32,
    /// Way from the road's beginning in m.
    pub along_m: f64,
}

/// A vehicle at the end of its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Its index, as it departed.
    pub vehicle: u32,
    /// When it left its last road, in s.
    pub time_s: f64,
}

/// What moves vehicles along the roads of a [`roads::RoadMap`], with its [`incidents::Incidents`].
pub trait TrafficModel {
    /// A vehicle wants to set out now along these roads, at least one, each beginning where the one before ends. It enters the
    /// first as soon as there is room.
    ///
    /// # Errors
    /// If an outside program does not answer as it should.
    fn depart(&mut self, vehicle: u32, route: &[u32]) -> Result<()>;

    /// Moves on to `time_s`, never back, and appends who arrives until then, by time.
    ///
    /// # Errors
    /// If an outside program does not answer as it should.
    fn advance(&mut self, time_s: f64, arrived: &mut Vec<Arrival>) -> Result<()>;

    /// Everybody who has entered a road and not arrived, by ascending vehicle.
    ///
    /// # Errors
    /// If an outside program does not answer as it should.
    fn on_roads(&mut self, vehicles: &mut Vec<OnRoad>) -> Result<()>;

    /// From the end of its present road on, a vehicle that is on a road drives these roads; none, and it arrives there.
    ///
    /// # Errors
    /// If an outside program does not answer as it should.
    fn take_route(&mut self, vehicle: u32, onward: &[u32]) -> Result<()>;

    /// How often a vehicle stood at the head of its queue for so long that it was let through ([`STUCK_S`]).
    fn let_through(&self) -> u64;
}

/// Time in s after which a vehicle that cannot go on is let through although the road before it is full, so that no circle
/// of queues stands for ever (SUMO's default `time-to-teleport`).
pub const STUCK_S: f64 = 300.0;
