//! How long reports take to the base station.

use super::OnRoad;

/// What lies between a vehicle's report and the base station.
pub trait Delays {
    /// When a report arrives that a vehicle has ready at `time_s`; `None` if it does not get through, and the next one has to
    /// do.
    fn arrival_s(&mut self, from: &OnRoad, time_s: f64) -> Option<f64>;
}

/// Every report takes the same time, in s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixed(pub f64);

impl Delays for Fixed {
    fn arrival_s(&mut self, _from: &OnRoad, time_s: f64) -> Option<f64> {
        Some(time_s + self.0)
    }
}
