//! The per-slot state machine: one event in, one decision out. It owns no clock and no port.
//!
//! # States
//! Every slot is decided in one of three [`State`]s, which the event and the unit's memory give alone:
//!
//! | | usable table, something known | usable table, nothing known | no usable table |
//! |---|---|---|---|
//! | measured | nominal | nominal | silent (no table) |
//! | missed, fewer than [`MAX_MISSED`] in a row | degraded | silent (no measurement) | silent (no table) |
//! | missed, [`MAX_MISSED`] in a row or more | silent (no measurement) | silent (no measurement) | silent (no table) |
//!
//! What moves a unit between them:
//!
//! * **Missing**: one missed slot degrades, [`MAX_MISSED`] in a row silence. Slots that the index leaps over count as missed.
//! * **Returning modem**: a single measurement makes any unit with a table nominal at once; after a silence the tracked level
//!   starts anew.
//! * **Late, duplicated, reordered**: an event for a slot that was decided, or up to [`MAX_MISSED`] slots older, changes
//!   nothing and gets no decision. A vehicle never sends twice in a slot.
//! * **Restarted modem**: an index that jumps back further starts a new count.
//! * **Wrapping index**: differences alone count, so the wrap is a slot like any other.
//! * **Silent cell**: a unit that is not received for long loses a turn that it found, and contends anew; its place, if it was handed
//!   out, it keeps.
//! * **Corrupt frames, floods**: end in [`crate::link::Receiver`]; none becomes an event. Their slots are missing ones.
//! * **Failing table**: silence from the first slot on, until [`Unit::replace_table`] brings a good one.
//!
//! In every state the decision is legal: silent, or one of the cell's sub-channels with at most the power that the base station broadcast.

use crate::actor;
use crate::clock;
use crate::decision::{Action, Decision};
use crate::fmt::{log_info, log_warning};
use crate::lots::Identity;
use crate::measurement::{Broadcast, Measurement, Place, age_at};
use crate::network::{ReadError, Scratch};
use crate::observation::Observation;
use crate::ring::Open;
use crate::table::{Table, TableError};
use crate::tracker::LevelTracker;
use crate::units::{Level, SlotIndex};

/// Slots without a measurement after which a unit stays silent: by then a vehicle has moved by more than a metre, and its broadcast
/// may be out of date (chosen: the paper's time constraint).
pub const MAX_MISSED: u8 = 100;

/// What a slot brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The modem measured.
    Measured(Measurement),
    /// The modem could not measure in this slot.
    Missed(SlotIndex),
}

impl Event {
    /// The slot.
    pub const fn slot(&self) -> SlotIndex {
        match self {
            Self::Measured(measurement) => measurement.slot(),
            Self::Missed(slot) => *slot,
        }
    }
}

/// How well the unit works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// The actor decides on a measurement.
    Nominal,
    /// The measurement is missing: the unit keeps its turn by the clock's rule.
    Degraded,
    /// The unit sends nothing.
    Silent(Silence),
}

/// Why a unit sends nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Silence {
    /// It has no usable table.
    NoTable,
    /// It knows too little: no measurement yet, or none for [`MAX_MISSED`] slots.
    NoMeasurement,
}

/// One slot's outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// The decided slot.
    pub slot: SlotIndex,
    /// What to send.
    pub decision: Decision,
    /// On what grounds.
    pub state: State,
}

/// A vehicle's unit. All its randomness are the lots of its [`Identity`].
///
/// ```
/// use firmware::decision::Decision;
/// use firmware::tables::DISTILLED;
/// use firmware::lots::Identity;
/// use firmware::unit::{Event, Unit};
/// use firmware::units::SlotIndex;
///
/// let mut unit = Unit::new(DISTILLED, Identity::of_device([1, 2, 3]));
/// // The modem measured nothing yet: a unit that knows nothing stays silent.
/// let report = unit.slot(&Event::Missed(SlotIndex(7)));
/// assert!(report.is_some_and(|report| report.decision == Decision::Silent));
/// // Every slot is decided once.
/// assert_eq!(unit.slot(&Event::Missed(SlotIndex(7))), None);
/// ```
#[derive(Clone, Debug)]
pub struct Unit<'t> {
    table: Result<Table<'t>, TableError>,
    scratch: Scratch,
    identity: Identity,
    tracker: LevelTracker,
    known: Option<Known>,
    missed: u8,
    slot: Option<SlotIndex>,
}

/// What the last measurement said that outlives its slot.
#[derive(Clone, Copy, Debug)]
struct Known {
    last_acknowledged: Option<SlotIndex>,
    place: Option<Place>,
    broadcast: Broadcast,
}

impl<'t> Unit<'t> {
    /// A unit that runs the table in `bytes`, which begin at a word ([`Aligned`](crate::table::Aligned)). It takes 4.4 KB, most of them
    /// activations: keep it in a static place. With a damaged, foreign or unaligned table it stays silent until it gets another one, and
    /// says why ([`Unit::table`]).
    pub fn new(bytes: &'t [u8], identity: Identity) -> Self {
        let mut unit = Self::without_table(identity);
        unit.replace_table(bytes);
        unit
    }

    /// A unit that stays silent until it is given a table.
    pub const fn without_table(identity: Identity) -> Self {
        Self {
            table: Err(TableError::Read(ReadError::Truncated {
                found: 0,
                expected: 0,
            })),
            scratch: Scratch::new(),
            identity,
            tracker: LevelTracker::new(),
            known: None,
            missed: 0,
            slot: None,
        }
    }

    /// Runs the table in `bytes` from the next slot on: [`Unit::run_table`] of [`Table::parse`], which reads all of it.
    #[inline(never)]
    pub fn replace_table(&mut self, bytes: &'t [u8]) {
        self.run_table(Table::parse(bytes));
    }

    /// Runs a table from the next slot on. What the unit knows of its channel and its turn stays. None silences the unit, so callers
    /// keep the old one where they can. Whoever parses a table below all decisions keeps that out of the slot.
    pub fn run_table(&mut self, table: Result<Table<'t>, TableError>) {
        match &table {
            Ok(_table) => log_info!(
                "table of seed {} serves {} vehicles",
                _table.provenance().seed,
                _table.max_vehicles()
            ),
            Err(_error) => log_warning!("silent: {}", _error),
        }
        self.table = table;
    }

    /// Draws its lots under this identity from the next slot on.
    pub const fn set_identity(&mut self, identity: Identity) {
        self.identity = identity;
    }

    /// The last decided slot.
    pub const fn last_slot(&self) -> Option<SlotIndex> {
        self.slot
    }

    /// The table, or why there is none.
    pub fn table(&self) -> Result<&Table<'t>, TableError> {
        self.table.as_ref().map_err(|error| *error)
    }

    /// The level at which the unit expects to be received at full power on any sub-channel, or `None` before its first measurement.
    pub fn level(&self) -> Option<Level> {
        self.tracker.predicted()
    }

    /// Decides one slot. `None` if the slot was decided before: a duplicate or a late event must not make the vehicle send
    /// twice. A slot index that jumps back by more than [`MAX_MISSED`] is a modem that restarted, and is decided.
    pub fn slot(&mut self, event: &Event) -> Option<Report> {
        let slot = event.slot();
        if let Some(previous) = self.slot
            && previous.since(slot) <= u32::from(MAX_MISSED)
        {
            log_warning!("slot {} was decided before", slot.0);
            return None;
        }
        let elapsed = self.slot.map_or(1, |previous| slot.since(previous));
        self.slot = Some(slot);
        let (decision, state) = match event {
            Event::Measured(measurement) => self.measured(measurement, elapsed),
            Event::Missed(_) => self.missed(slot, elapsed),
        };
        Some(Report {
            slot,
            decision,
            state,
        })
    }

    fn measured(&mut self, measurement: &Measurement, elapsed: u32) -> (Decision, State) {
        self.pass(elapsed.saturating_sub(1));
        if self.missed >= MAX_MISSED {
            // A level from before the gap would take some 50 slots to forget.
            self.tracker = LevelTracker::default();
        }
        self.missed = 0;
        self.tracker.measure(measurement.gain());
        self.known = Some(Known {
            last_acknowledged: measurement.last_acknowledged(),
            place: measurement.place(),
            // What was open is no longer.
            broadcast: Broadcast {
                open: Open::default(),
                threshold: u32::MAX,
                ..*measurement.broadcast()
            },
        });
        match &self.table {
            Ok(table) => {
                let observation = Observation::new(measurement, self.identity);
                let decision = actor::decide(table, &mut self.scratch, &observation);
                (decision, State::Nominal)
            }
            Err(_) => (Decision::Silent, State::Silent(Silence::NoTable)),
        }
    }

    fn missed(&mut self, slot: SlotIndex, elapsed: u32) -> (Decision, State) {
        self.pass(elapsed);
        let Ok(table) = &self.table else {
            return (Decision::Silent, State::Silent(Silence::NoTable));
        };
        let (Some(known), Some(level)) = (self.known, self.tracker.predicted()) else {
            return (Decision::Silent, State::Silent(Silence::NoMeasurement));
        };
        if self.missed >= MAX_MISSED {
            return (Decision::Silent, State::Silent(Silence::NoMeasurement));
        }
        let age = age_at(slot, known.last_acknowledged);
        let observation =
            Observation::predicted(slot, level, age, known.place, &known.broadcast, self.identity);
        let decision = match clock::act(&observation, table.required_sinr()) {
            // Needs no power.
            Action::Silent => Decision::Silent,
            action => table.power_plan().decision(action, &observation),
        };
        (decision, State::Degraded)
    }

    /// Lets slots without a measurement pass.
    fn pass(&mut self, slots: u32) {
        // Past the limit the prediction is no longer used, so the loop is bounded.
        for _ in 0..slots.min(u32::from(MAX_MISSED)) {
            self.tracker.miss();
            self.missed = self.missed.saturating_add(1);
        }
    }
}
