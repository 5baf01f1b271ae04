//! SUMO floating-car data: where recorded vehicles are in every slot.
//!
//! A [`Trace`] is read once and sampled through a [`Cursor`]. The rules of time and presence:
//!
//! * Slot 0 is the trace's first time step; one slot is 1 ms.
//! * A vehicle is present from its first to its last record, both included. Between two neighbouring time steps that
//!   both hold it, its position and speed are interpolated linearly.
//! * A vehicle that a time step leaves out has left at its record before that step, and re-enters, as the same
//!   vehicle, at its next record.
//!
//! # Source
//! SUMO's FCD output, <https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html>, written without `--fcd-output.geo`
//! (coordinates in metres) and without `--human-readable-time`.

mod builder;
#[cfg(feature = "program")]
mod reader;

pub use builder::TraceBuilder;
use serde::{Deserialize, Serialize};

/// Where a vehicle is, and how fast it moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// East, m, in the trace's own coordinates.
    pub x_m: f64,
    /// North, m, in the trace's own coordinates.
    pub y_m: f64,
    /// Speed, m/s, never negative.
    pub speed_m_per_s: f64,
}

impl Position {
    /// The point at `fraction` of the way from `self` to `next`; never outside the two, whatever the rounding.
    pub(super) fn towards(self, next: Self, fraction: f64) -> Self {
        let between =
            |from: f64, to: f64| ((1.0 - fraction) * from + fraction * to).clamp(from.min(to), from.max(to));
        Self {
            x_m: between(self.x_m, next.x_m),
            y_m: between(self.y_m, next.y_m),
            speed_m_per_s: between(self.speed_m_per_s, next.speed_m_per_s),
        }
    }
}

/// One vehicle in one time step.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Record {
    vehicle: usize,
    position: Position,
}

/// One time step: its slot and its records, in ascending order of vehicle.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Step {
    slot: u32,
    records: Vec<Record>,
}

/// The recorded movement of many vehicles. It holds at least one time step and one vehicle.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Trace {
    vehicle_ids: Vec<String>,
    /// In strictly ascending order of slot; the first has slot 0.
    steps: Vec<Step>,
}

impl Trace {
    /// Slots from the first time step to the last; that last slot itself can still be sampled.
    pub fn duration_slots(&self) -> u32 {
        self.steps.last().map_or(0, |step| step.slot)
    }

    /// How many time steps were recorded.
    pub fn step_count(&self) -> usize {
        self.steps.len()
    }

    /// Every vehicle's name, in order of first appearance. A vehicle's index counts along this list.
    pub fn vehicle_ids(&self) -> &[String] {
        &self.vehicle_ids
    }

    /// The largest number of vehicles present at once, and the first slot at which so many are.
    pub fn max_simultaneous(&self) -> (usize, u32) {
        // Presence between two steps is a subset of presence at either, so looking at the steps is enough.
        self.steps.iter().fold((0, 0), |most, step| {
            if step.records.len() > most.0 {
                (step.records.len(), step.slot)
            } else {
                most
            }
        })
    }

    /// Who is where at `slot`, in ascending order of vehicle index. Nobody, after the last time step.
    ///
    /// It looks the slot up anew; to sample slot after slot, keep a [`Trace::cursor`].
    pub fn positions_at(&self, slot: u32) -> Positions<'_> {
        self.cursor().advance_to(slot)
    }

    /// A cursor at slot 0.
    pub fn cursor(&self) -> Cursor<'_> {
        Cursor { trace: self, step: 0 }
    }
}

/// Samples a trace at ascending slots without searching or allocating.
#[derive(Debug, Clone)]
pub struct Cursor<'trace> {
    trace: &'trace Trace,
    /// Index of the last step not after the last sampled slot.
    step: usize,
}

impl<'trace> Cursor<'trace> {
    /// How many steps ahead are looked at one by one before a binary search takes over.
    const NEAR_STEPS: usize = 8;

    /// Who is where at `slot`, as [`Trace::positions_at`]. Going back is allowed; it costs a binary search.
    pub fn advance_to(&mut self, slot: u32) -> Positions<'trace> {
        let steps = &self.trace.steps;
        let is_due = |index: usize| steps.get(index).is_some_and(|step| step.slot <= slot);
        let near_end = self.step + Self::NEAR_STEPS;
        if is_due(self.step) {
            while self.step < near_end && is_due(self.step + 1) {
                self.step += 1;
            }
        }
        if !is_due(self.step) || is_due(self.step + 1) {
            self.step = steps.partition_point(|step| step.slot <= slot).saturating_sub(1);
        }
        Positions::between(steps.get(self.step), steps.get(self.step + 1), slot)
    }
}

/// The vehicles present at one slot: pairs of vehicle index and position, in ascending order of index.
#[derive(Debug, Clone)]
pub struct Positions<'trace> {
    current: &'trace [Record],
    next: &'trace [Record],
    /// Where the slot lies between the two steps, in (0, 1); `None` exactly on the first.
    fraction: Option<f64>,
}

impl<'trace> Positions<'trace> {
    /// The positions at `slot`, which is not before `current` and before `next`.
    fn between(current: Option<&'trace Step>, next: Option<&'trace Step>, slot: u32) -> Self {
        match (current, next) {
            (Some(current), _) if current.slot == slot => Self {
                current: &current.records,
                next: &[],
                fraction: None,
            },
            (Some(current), Some(next)) => Self {
                current: &current.records,
                next: &next.records,
                fraction: Some(f64::from(slot - current.slot) / f64::from(next.slot - current.slot)),
            },
            _ => Self {
                current: &[],
                next: &[],
                fraction: None,
            },
        }
    }
}

impl Iterator for Positions<'_> {
    type Item = (usize, Position);

    fn next(&mut self) -> Option<Self::Item> {
        while let Some((record, later)) = self.current.split_first() {
            self.current = later;
            let Some(fraction) = self.fraction else {
                return Some((record.vehicle, record.position));
            };
            while let Some((candidate, others)) = self.next.split_first()
                && candidate.vehicle <= record.vehicle
            {
                self.next = others;
                if candidate.vehicle == record.vehicle {
                    return Some((
                        record.vehicle,
                        record.position.towards(candidate.position, fraction),
                    ));
                }
            }
        }
        None
    }
}
