//! The ticks of the slot clock: SysTick, which the core has and an emulator too. It fires whatever the modem does.

use super::clocks::Clocks;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};

/// What SysTick can count.
const MAX_RELOAD: u32 = 0x00ff_ffff;

/// The timer.
pub struct SlotTimer {
    timer: SYST,
    steps_per_microsecond: u32,
    /// A tick that nobody has taken yet.
    ticked: bool,
    /// Steps that passed in ticks, whole ones and those that a restart cut off.
    passed: u32,
}

impl SlotTimer {
    /// Starts ticking.
    pub fn start(mut timer: SYST, clocks: Clocks, tick_microseconds: u32) -> Self {
        timer.set_clock_source(SystClkSource::Core);
        timer.enable_interrupt();
        let mut timer = Self {
            timer,
            steps_per_microsecond: clocks.core_hz() / 1_000_000,
            ticked: false,
            passed: 0,
        };
        timer.restart(tick_microseconds);
        timer.timer.enable_counter();
        timer
    }

    /// Begins a tick of this length now, and forgets the one before.
    pub fn restart(&mut self, tick_microseconds: u32) {
        // It may be over while another interrupt is served, and would count as one of the new length.
        if SCB::is_pendst_pending() {
            self.tick();
            SCB::clear_pendst();
        }
        self.ticked = false;
        let cut_off = SYST::get_reload().saturating_sub(SYST::get_current());
        self.passed = self.passed.saturating_add(cut_off);
        let steps = tick_microseconds.saturating_mul(self.steps_per_microsecond);
        self.timer.set_reload(steps.saturating_sub(1).min(MAX_RELOAD));
        self.timer.clear_current();
    }

    /// A tick is over; for the interrupt.
    pub fn tick(&mut self) {
        self.ticked = true;
        self.passed = self.passed.saturating_add(SYST::get_reload());
    }

    /// Whether a tick was over since the last call.
    pub fn take(&mut self) -> bool {
        core::mem::take(&mut self.ticked)
    }

    /// Whether it ran for a tick since this was true last. Restarts cannot hold that off, however often they come.
    pub fn has_run(&mut self) -> bool {
        let has_run = self.passed >= SYST::get_reload();
        if has_run {
            self.passed = 0;
        }
        has_run
    }
}
