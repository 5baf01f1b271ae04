//! One lane of a road: a queue with room for so many vehicles and for the gaps that travel back through it.

use crate::journeys::roads::{Road, SPACING_M};
use std::collections::VecDeque;

/// A lane.
#[derive(Clone, Debug)]
pub struct Lane {
    /// Who is on it, the first to leave in front.
    vehicles: VecDeque<u32>,
    /// When gaps from its end arrive at its beginning; ascending.
    gaps_s: VecDeque<f64>,
    /// Room for vehicles and gaps, rounded up so that the lane can carry its capacity.
    storage: usize,
    /// Time that a gap travels.
    gap_delay_s: f64,
    next_exit_s: f64,
    next_entry_s: f64,
}

impl Lane {
    /// An empty lane of a road.
    pub fn new(road: &Road) -> Self {
        Self {
            vehicles: VecDeque::new(),
            gaps_s: VecDeque::new(),
            storage: libm::ceil(road.length_m / SPACING_M) as usize,
            gap_delay_s: (road.length_m * road.reaction_time_s() / SPACING_M).max(0.0),
            next_exit_s: 0.0,
            next_entry_s: 0.0,
        }
    }

    /// Who is on it, the first to leave in front.
    pub fn vehicles(&self) -> &VecDeque<u32> {
        &self.vehicles
    }

    /// The earliest time at which its first vehicle may leave, in s.
    pub fn next_exit_s(&self) -> f64 {
        self.next_exit_s
    }

    /// When it may take somebody, now or later, in s; `None` if that depends on somebody who has yet to leave.
    pub fn opens_s(&mut self, time_s: f64) -> Option<f64> {
        while self.gaps_s.front().is_some_and(|&gap_s| gap_s <= time_s) {
            self.gaps_s.pop_front();
        }
        let at_s = self.next_entry_s.max(time_s);
        let taken = self.vehicles.len() + self.gaps_s.len();
        if taken < self.storage {
            return Some(at_s);
        }
        // The gap after which there is room for one more.
        let gap_s = self.gaps_s.get(taken - self.storage)?;
        Some(at_s.max(*gap_s))
    }

    /// Takes a vehicle; the next one follows no sooner than `headway_s` later.
    pub fn take(&mut self, vehicle: u32, time_s: f64, headway_s: f64) {
        self.vehicles.push_back(vehicle);
        self.next_entry_s = time_s + headway_s;
    }

    /// Its first vehicle leaves; the next one follows no sooner than `headway_s` later.
    pub fn let_go(&mut self, time_s: f64, headway_s: f64) {
        if self.vehicles.pop_front().is_some() {
            self.gaps_s.push_back(time_s + self.gap_delay_s);
            self.next_exit_s = time_s + headway_s;
        }
    }

    /// Nobody leaves any more.
    #[cfg(test)]
    pub(super) fn close(&mut self) {
        self.next_exit_s = f64::INFINITY;
    }
}
