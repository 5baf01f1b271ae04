//! When a slot is over although the modem said nothing. It owns no timer: the board calls it at every tick.
//!
//! A frame for a new slot sets the phase: the next is expected one slot later. If it has not come [`GRACE_QUARTERS`] later
//! still, its slot is decided as missed, and from there one slot after the other, for as long as the modem is silent. Ticks
//! are a quarter of a slot or a fraction of it. A new slot or slot length starts the tick anew, so frames that keep coming
//! faster than ticks hold them off; a modem that does so is not silent.
//!
//! Before the first frame there is no slot index, so nothing is decided.

use crate::units::SlotIndex;

/// Quarters of a slot.
const QUARTERS: u32 = 4;
/// How much later than expected a frame may be, in quarters of a slot (chosen). A frame of 16 sub-channels and its answer take 0.55 ms on the
/// line, so of a 1 ms slot 0.45 ms are left: 0.25 for the delay, and 0.2, 33,600 cycles at 168 MHz, for the decision.
pub const GRACE_QUARTERS: u32 = 1;
/// The longest tick in microseconds (chosen): SysTick counts 99 ms at most at 168 MHz, and ticks feed the watchdog.
pub const MAX_TICK_MICROSECONDS: u32 = 50_000;

/// How long a slot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SlotLength {
    microseconds: u32,
}

impl SlotLength {
    /// The product's slot of 1 ms.
    pub const DEFAULT: Self = Self { microseconds: 1_000 };
    /// The shortest in microseconds: in less, frame, decision and answer do not fit.
    pub const MIN_MICROSECONDS: u32 = 1_000;
    /// The longest in microseconds. A modem that is itself simulated or stepped by hand asks for it, so that the unit waits for
    /// a machine that is late.
    pub const MAX_MICROSECONDS: u32 = 60_000_000;

    /// A length, or `None` outside the range.
    pub const fn new(microseconds: u32) -> Option<Self> {
        if microseconds >= Self::MIN_MICROSECONDS && microseconds <= Self::MAX_MICROSECONDS {
            Some(Self { microseconds })
        } else {
            None
        }
    }

    /// The length.
    pub const fn microseconds(self) -> u32 {
        self.microseconds
    }

    /// Ticks in a quarter.
    const fn ticks_per_quarter(self) -> u32 {
        (self.microseconds / QUARTERS).div_ceil(MAX_TICK_MICROSECONDS)
    }
}

/// The clock of one unit.
#[derive(Clone, Debug)]
pub struct SlotClock {
    length: SlotLength,
    /// Ticks in a quarter of it.
    quarter: u32,
    /// The newest slot that the modem named.
    heard: Option<SlotIndex>,
    /// Ticks since the phase was set, less one slot for every slot that was due.
    ticks: u32,
}

impl Default for SlotClock {
    fn default() -> Self {
        Self {
            length: SlotLength::DEFAULT,
            quarter: SlotLength::DEFAULT.ticks_per_quarter(),
            heard: None,
            ticks: 0,
        }
    }
}

impl SlotClock {
    /// Sets the slot's length and starts the phase anew.
    pub const fn set_length(&mut self, length: SlotLength) {
        self.length = length;
        self.quarter = length.ticks_per_quarter();
        self.ticks = 0;
    }

    /// The slot's length.
    pub const fn length(&self) -> SlotLength {
        self.length
    }

    /// What the board's timer must tick at, in microseconds.
    pub const fn tick_microseconds(&self) -> u32 {
        match (self.length.microseconds / QUARTERS).checked_div(self.quarter) {
            Some(microseconds) => microseconds,
            None => MAX_TICK_MICROSECONDS,
        }
    }

    /// A frame names a slot. Says whether it set the phase, so that the board starts its timer anew.
    ///
    /// Only a slot newer than all before does, even if it comes too late to be decided; a duplicate or an old one must not
    /// put the deadline off. An index that jumps back by more than `restart` slots is a modem that restarted.
    pub fn hear(&mut self, slot: SlotIndex, restart: u32) -> bool {
        if let Some(heard) = self.heard
            && heard.since(slot) <= restart
        {
            return false;
        }
        self.heard = Some(slot);
        self.ticks = 0;
        true
    }

    /// One tick passes. Says whether a slot is over.
    pub fn tick(&mut self) -> bool {
        if self.heard.is_none() {
            return false;
        }
        let quarter = self.quarter;
        let slot = quarter.saturating_mul(QUARTERS);
        self.ticks = self.ticks.saturating_add(1);
        let due = self.ticks >= slot.saturating_add(quarter.saturating_mul(GRACE_QUARTERS));
        if due {
            self.ticks = self.ticks.saturating_sub(slot);
        }
        due
    }
}
