//! Everything between the modem's bytes and the answers: bytes and ticks in, answers out. The image runs this, and so do
//! the tests; a board adds a serial line, a timer and a flash.

use crate::link::{ModemFrame, Receiver, UnitFrame, UnitMessage, UpdateFrame};
use crate::lots::Identity;
use crate::slot_clock::{SlotClock, SlotLength};
use crate::telemetry::Telemetry;
use crate::unit::{Event, MAX_MISSED, Report, Unit};
use crate::units::SlotIndex;

/// What a byte or a tick asks of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Send this slot's decision.
    Answer(UnitMessage),
    /// Hand this step to the table store and send its answer when it has one.
    Update(UpdateFrame),
}

/// A unit with its line, its clock and its counters.
#[derive(Clone, Debug)]
pub struct Session<'t> {
    receiver: Receiver,
    unit: Unit<'t>,
    clock: SlotClock,
    telemetry: Telemetry,
    timer_restarts: bool,
}

impl<'t> Session<'t> {
    /// A session before its first frame.
    pub fn new(unit: Unit<'t>) -> Self {
        Self {
            receiver: Receiver::default(),
            unit,
            clock: SlotClock::default(),
            telemetry: Telemetry::default(),
            timer_restarts: false,
        }
    }

    /// Takes one byte from the modem.
    pub fn byte(&mut self, byte: u8) -> Option<Request> {
        let frame = self.receiver.push::<ModemFrame>(byte)?;
        match frame.ok().and_then(|frame| self.frame(&frame)) {
            Some(request) => request,
            None => {
                self.telemetry.dropped_frames = self.telemetry.dropped_frames.saturating_add(1);
                None
            }
        }
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

    /// Runs another table from the next slot on: see [`Unit::replace_table`].
    pub fn replace_table(&mut self, bytes: &'t [u8]) {
        self.unit.replace_table(bytes);
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
            ModemFrame::SlotLength { microseconds } => {
                self.clock.set_length(SlotLength::new(microseconds)?);
                self.timer_restarts = true;
                Some(None)
            }
            ModemFrame::Identity { number } => {
                self.unit.set_identity(Identity(number));
                Some(None)
            }
            ModemFrame::Update(step) => Some(Some(Request::Update(step))),
            ModemFrame::Measurement(_) | ModemFrame::Missed { .. } => {
                let event = frame.event()?.ok()?;
                if self.clock.hear(event.slot(), u32::from(MAX_MISSED)) {
                    self.timer_restarts = true;
                }
                Some(self.decide(&event))
            }
        }
    }

    fn decide(&mut self, event: &Event) -> Option<Request> {
        let report: Report = self.unit.slot(event)?;
        self.telemetry.count(&report);
        Some(Request::Answer(UnitMessage::Decision(UnitFrame::from(&report))))
    }
}
