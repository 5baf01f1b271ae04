//! The independent watchdog: restarts the chip when the unit hangs.
//!
//! It runs on an oscillator of its own and cannot be stopped. It is fed by a finished round of the decision task that decided a slot, or in
//! which the slot clock ran for a tick, so neither an idle modem nor one that sends faster than ticks starves it. While a debugger
//! holds the core it stands still.

use stm32f4::stm32f405::{DBGMCU, IWDG};

/// 32 kHz / 32: the oscillator is between 17 and 47 kHz (data sheet, table 41).
const STEPS_PER_SECOND: u16 = 1_000;
/// 2 s nominal, 1.4 to 3.8 in fact (chosen): the longest that a healthy unit does not tick is a sector's erase, 0.5 s, during
/// which the core cannot fetch, and at 16 MHz two signatures at boot. An image that takes images erases larger sectors, for 2 s at
/// most (data sheet, table 39), and has 3.2 s nominal, 2.2 to 6 in fact.
const TIMEOUT: u16 = if crate::IS_RENEWABLE {
    STEPS_PER_SECOND / 5 * 16
} else {
    2 * STEPS_PER_SECOND
};

/// Reads before a register counts as written: it takes five periods of the oscillator, 0.3 ms, and a read takes four cycles
/// at least. It must end: an emulator without a watchdog gives up here.
const POLLS: u32 = 20_000;

/// The running watchdog.
pub struct Watchdog(IWDG);

impl Watchdog {
    /// Starts it. From here on the chip restarts unless it is fed.
    pub fn start(watchdog: IWDG) -> Self {
        // The keys of RM0090 section 21.4.1: start, then allow writing.
        Self::command(&watchdog, 0xcccc);
        Self::command(&watchdog, 0x5555);
        watchdog.pr().write(|w| w.pr().divide_by32());
        watchdog.rlr().write(|w| w.rl().set(TIMEOUT));
        let _ = (0..POLLS).any(|_| watchdog.sr().read().bits() == 0);
        let watchdog = Self(watchdog);
        watchdog.feed();
        watchdog
    }

    /// Stops it whenever a debugger halts the core (RM0090 section 38.16.4): a breakpoint would otherwise end in a restart.
    pub fn freeze_under_debugger(debug: &DBGMCU) {
        debug.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
    }

    /// Puts the restart off.
    pub fn feed(&self) {
        Self::command(&self.0, 0xaaaa);
    }

    fn command(watchdog: &IWDG, key: u16) {
        // SAFETY: the key register takes any value, and knows three.
        #[allow(
            unsafe_code,
            reason = "the register description lacks the start key as a value"
        )]
        watchdog.kr().write(|w| unsafe { w.key().bits(key) });
    }
}
