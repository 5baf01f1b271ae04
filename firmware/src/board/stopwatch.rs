//! How long the unit takes for an answer, from the last byte of a frame to the answer in the queue, other interrupts
//! included. TIM2 counts, which runs on the chip and in an emulator.

use super::clocks::Clocks;
use core::sync::atomic::{AtomicU32, Ordering};
use stm32f4::stm32f405::{RCC, TIM2};

/// What is left of a 1 ms slot when its frame, of 16 sub-channels, and its answer have taken 0.55 ms on the line ([`super::serial`]).
const DEADLINE_MICROSECONDS: u32 = 450;

/// The costs since the start, where a debugger finds them by name. In steps of TIM2.
#[repr(C)]
pub struct SlotCost {
    answers: AtomicU32,
    minimum: AtomicU32,
    maximum: AtomicU32,
    deadline_misses: AtomicU32,
}

/// See [`SlotCost`].
#[used]
pub static SLOT_COST: SlotCost = SlotCost {
    answers: AtomicU32::new(0),
    minimum: AtomicU32::new(u32::MAX),
    maximum: AtomicU32::new(0),
    deadline_misses: AtomicU32::new(0),
};

/// The running stopwatch.
pub struct Stopwatch {
    timer: TIM2,
    deadline: u32,
}

impl Stopwatch {
    /// Starts TIM2 on its full 32 bits.
    pub fn start(timer: TIM2, rcc: &RCC, clocks: Clocks) -> Self {
        rcc.apb1enr().modify(|_, w| w.tim2en().set_bit());
        // Two cycles until the peripheral answers: see the serial line's.
        let _ = rcc.apb1enr().read();
        timer.arr().write(|w| w.arr().set(u32::MAX));
        timer.cr1().write(|w| w.cen().set_bit());
        Self {
            timer,
            deadline: DEADLINE_MICROSECONDS.saturating_mul(clocks.timer_steps_per_microsecond()),
        }
    }

    /// The time now.
    pub fn now(&self) -> u32 {
        self.timer.cnt().read().bits()
    }

    /// Counts an answer that took from `start` until now.
    pub fn answered(&self, start: u32) {
        let steps = self.now().wrapping_sub(start);
        // One task writes, so load and store need not be one.
        let add = |counter: &AtomicU32, count: u32| {
            counter.store(
                counter.load(Ordering::Relaxed).wrapping_add(count),
                Ordering::Relaxed,
            );
        };
        add(&SLOT_COST.answers, 1);
        add(&SLOT_COST.deadline_misses, u32::from(steps > self.deadline));
        let (minimum, maximum) = (&SLOT_COST.minimum, &SLOT_COST.maximum);
        minimum.store(minimum.load(Ordering::Relaxed).min(steps), Ordering::Relaxed);
        maximum.store(maximum.load(Ordering::Relaxed).max(steps), Ordering::Relaxed);
    }
}
