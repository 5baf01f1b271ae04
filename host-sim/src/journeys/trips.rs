//! Who travels when, from where to where, and on which way if nobody advises.

use crate::stream::{Role, WorldKey};
use assignment::PathFlow;

/// A vehicle's trip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trip {
    /// When it sets out, in s; it enters the road at the next whole second.
    pub departs_s: f64,
    /// The usual way, as an index into the paths of the equilibrium.
    pub path: u32,
    /// It is connected where the share of connected vehicles is larger than this.
    connects_above: f32,
    /// It follows advice where the share of those who do is larger than this.
    obeys_above: f32,
}

impl Trip {
    /// Whether it reports, if so large a share of vehicles does.
    pub fn connected(&self, share: f64) -> bool {
        f64::from(self.connects_above) < share
    }

    /// Whether it follows advice, if so large a share of vehicles does.
    pub fn obeys(&self, share: f64) -> bool {
        f64::from(self.obeys_above) < share
    }
}

/// The trips of one world, by departure: as many as the paths carry in `horizon_s`, at uniform times, each on a path drawn in
/// proportion to its flow, which is in vehicles an hour.
pub fn draw(paths: &[PathFlow], horizon_s: f64, key: &WorldKey) -> Vec<Trip> {
    let mut stream = key.stream(Role::Trips, 0);
    let mut cumulative = Vec::with_capacity(paths.len());
    let mut total = 0.0;
    for path in paths {
        total += path.volume;
        cumulative.push(total);
    }
    let count = (total * horizon_s / 3600.0).round() as usize;
    let last = paths.len().saturating_sub(1);
    let mut trips: Vec<Trip> = (0..count)
        .map(|_| {
            let drawn = stream.uniform_between(0.0, total);
            let path = cumulative.partition_point(|&volume| volume <= drawn).min(last);
            Trip {
                departs_s: stream.uniform_between(0.0, horizon_s),
                path: path as u32,
                connects_above: stream.uniform(),
                obeys_above: stream.uniform(),
            }
        })
        .collect();
    trips.sort_by(|a, b| a.departs_s.total_cmp(&b.departs_s));
    trips
}
