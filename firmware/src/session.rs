//! Everything between the modem's bytes and the answers: bytes and ticks in, answers out. The image runs this, and so do
//! the tests; a board adds a serial line, a timer and a flash.

use crate::health::Health;
use crate::link::{
    Counters, Frame, ModemFrame, PROTOCOL, Receiver, UnitFrame, UnitMessage, UpdateFrame, measurement,
};
use crate::lots::Identity;
use crate::slot_clock::{SlotClock, SlotLength};
use crate::table::{Table, TableError};
use crate::telemetry::Telemetry;
use crate::unit::{Event, MAX_MISSED, Report, State, Unit};
use crate::units::SlotIndex;

/// What a byte or a tick asks of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Send this: a slot's decision, or what was asked for.
    Answer(UnitMessage),
    /// Hand this step to the table store and send its answer when it has one.
    Update(UpdateFrame),
    /// Send a [`StatusFrame`](crate::link::StatusFrame) with these counters, and what else the board knows.
    Status(Counters),
}

/// A unit with its line, its clock and its counters.
#[derive(Clone, Debug)]
pub struct Session<'t> {
    receiver: Receiver,
    unit: Unit<'t>,
    clock: SlotClock,
    telemetry: Telemetry,
    health: Health,
    doubted: Option<SlotIndex>,
    in_emulator: bool,
    timer_restarts: bool,
}

impl<'t> Session<'t> {
    /// A session before its first frame.
    pub fn new(unit: Unit<'t>) -> Self {
        Self {
            receiver: Receiver::new(),
            unit,
            clock: SlotClock::default(),
            telemetry: Telemetry::default(),
            health: Health::of(0),
            doubted: None,
            in_emulator: false,
            timer_restarts: false,
        }
    }

    /// Lets the modem set the slot's length ([`ModemFrame::SlotLength`]): for emulators alone, whose modem steps as slowly as its machine.
    /// On silicon a frame could so stop the clock that decides for a silent modem.
    // In place: a session that is handed on by value lies twice on the stack.
    pub const fn set_in_emulator(&mut self, in_emulator: bool) {
        self.in_emulator = in_emulator;
    }

    /// Takes one byte from the modem.
    pub fn byte(&mut self, byte: u8) -> Option<Request> {
        self.take(&mut &[byte][..])
    }

    /// Takes bytes from the modem off the front of `bytes`: up to the end of a frame, or all of them. For a line that brings many at once, until
    /// none is left; what the frame asks for, and [`Session::timer_restart`], come before the next.
    pub fn take(&mut self, bytes: &mut &[u8]) -> Option<Request> {
        if let Ok(fields) = self.receiver.take(bytes)? {
            match measurement(fields) {
                // The frame of nearly every slot, in place.
                Some(Ok(measurement)) => return self.event(&Event::Measured(measurement)),
                Some(Err(_)) => {}
                None => {
                    if let Some(request) = ModemFrame::read(fields).and_then(|frame| self.frame(&frame)) {
                        return request;
                    }
                }
            }
        }
        self.telemetry.dropped_frames = self.telemetry.dropped_frames.saturating_add(1);
        self.health.dropped = self.health.dropped.saturating_add(1);
        None
    }

    /// One tick of the slot clock passes.
    pub fn tick(&mut self) -> Option<Request> {
        if !self.clock.tick() {
            return None;
        }
        // The clock runs from the first frame with a slot on, and a unit decides every such slot.
        let slot = self.unit.last_slot().map(SlotIndex::next)?;
        self.telemetry.overdue = self.telemetry.overdue.saturating_add(1);
        self.decide(&Event::Missed(slot))
    }

    /// If the timer must start a new tick now: how long its ticks are, in microseconds.
    pub fn timer_restart(&mut self) -> Option<u32> {
        core::mem::take(&mut self.timer_restarts).then(|| self.clock.tick_microseconds())
    }

    /// Runs the table in `bytes` from the next slot on: see [`Unit::replace_table`].
    pub fn replace_table(&mut self, bytes: &'t [u8]) {
        self.run_table(Table::parse(bytes));
    }

    /// Runs a table from the next slot on: see [`Unit::run_table`].
    pub fn run_table(&mut self, table: Result<Table<'t>, TableError>) {
        self.unit.run_table(table);
        self.health = Health::of(0);
    }

    /// How the unit did with its table, each time that a window is full: for
    /// [`TableStore::judge`](crate::table_store::TableStore::judge).
    pub fn full_window(&mut self) -> Option<Health> {
        if !self.health.is_full() {
            return None;
        }
        // The checksum only now: a session that looks at its unit when it is made lies on the stack as a whole.
        let checksum = self.unit.table().map_or(0, Table::checksum);
        let health = core::mem::replace(&mut self.health, Health::of(0));
        Some(Health { checksum, ..health })
    }

    /// The unit.
    pub const fn unit(&self) -> &Unit<'t> {
        &self.unit
    }

    /// The clock.
    pub const fn clock(&self) -> &SlotClock {
        &self.clock
    }

    /// The counters.
    pub const fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    /// `None` if the frame asks for what cannot be.
    fn frame(&mut self, frame: &ModemFrame) -> Option<Option<Request>> {
        match *frame {
            ModemFrame::Hello => Some(Some(Request::Answer(UnitMessage::Hello { protocol: PROTOCOL }))),
            ModemFrame::SlotLength { microseconds } => {
                if !self.in_emulator {
                    return None;
                }
                self.clock.set_length(SlotLength::new(microseconds)?);
                self.timer_restarts = true;
                Some(None)
            }
            ModemFrame::Identity { number } => {
                self.unit.set_identity(Identity(number));
                Some(None)
            }
            ModemFrame::Update(step) => Some(Some(Request::Update(step))),
            ModemFrame::Status => Some(Some(Request::Status(self.telemetry.counters()))),
            ModemFrame::Missed { slot } => Some(self.event(&Event::Missed(SlotIndex(slot)))),
            // Read in place.
            ModemFrame::Measurement(_) => None,
        }
    }

    fn event(&mut self, event: &Event) -> Option<Request> {
        if !self.believes(event.slot()) {
            self.telemetry.doubted_frames = self.telemetry.doubted_frames.saturating_add(1);
            return None;
        }
        if self.clock.hear(event.slot(), u32::from(MAX_MISSED)) {
            self.timer_restarts = true;
        }
        self.decide(event)
    }

    /// Whether a frame's slot is believed. One that neither follows the last slot nor is an old one is a jump, and a jump is believed when
    /// the next frame follows it: the checksum is no signature, and one forged frame far ahead would have all real ones dropped as old.
    fn believes(&mut self, slot: SlotIndex) -> bool {
        let Some(last) = self.unit.last_slot() else {
            return true;
        };
        let follows = |previous: SlotIndex| slot.since(previous) == 1;
        if last.since(slot) <= u32::from(MAX_MISSED) {
            return true;
        }
        let believed = follows(last) || self.doubted.is_some_and(follows);
        self.doubted = (!believed).then_some(slot);
        believed
    }

    fn decide(&mut self, event: &Event) -> Option<Request> {
        let report: Report = self.unit.slot(event)?;
        self.telemetry.count(&report);
        if let (Event::Measured(measurement), State::Nominal) = (event, report.state) {
            self.health.count(measurement, &report);
        }
        Some(Request::Answer(UnitMessage::Decision(UnitFrame::from(&report))))
    }
}
