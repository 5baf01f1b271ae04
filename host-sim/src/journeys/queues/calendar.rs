//! What happens next.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// A lane of a road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LaneOf {
    /// The road.
    pub road: u32,
    /// Its lane, from 0.
    pub lane: usize,
}

/// What may happen.
#[derive(Clone, Copy, Debug)]
pub enum What {
    /// The first vehicle of a lane may leave it.
    Exit(LaneOf),
    /// A road may take somebody.
    Admission(u32),
    /// A vehicle at the end of a lane has waited long enough.
    Stuck {
        /// Where it stood.
        at: LaneOf,
        /// Who.
        vehicle: u32,
    },
}

/// Events to come, by time; those of the same instant in the order in which they were made.
#[derive(Debug, Default)]
pub struct Calendar {
    events: BinaryHeap<Reverse<Event>>,
    next_number: u64,
}

impl Calendar {
    /// Notes something for a time in s.
    pub fn schedule(&mut self, time_s: f64, what: What) {
        let number = self.next_number;
        self.next_number += 1;
        self.events.push(Reverse(Event { time_s, number, what }));
    }

    /// Takes out the next event that is due until a time in s.
    pub fn next_until(&mut self, time_s: f64) -> Option<(f64, What)> {
        let Reverse(first) = self.events.peek()?;
        if first.time_s > time_s {
            return None;
        }
        self.events.pop().map(|Reverse(event)| (event.time_s, event.what))
    }
}

#[derive(Clone, Copy, Debug)]
struct Event {
    time_s: f64,
    number: u64,
    what: What,
}

impl PartialEq for Event {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_time = self.time_s.total_cmp(&other.time_s);
        by_time.then(self.number.cmp(&other.number))
    }
}
