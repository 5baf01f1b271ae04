//! Embassy's time from a periodic interrupt: four of its ticks are a slot.

use core::cell::RefCell;
use core::task::Waker;
use critical_section::Mutex;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

/// How often [`tick`] must be called: a quarter of a slot is what the slot clock asks for.
pub const TICK_HZ: u32 = 4_000;

const _: () = assert!(TICK_HZ as u64 == embassy_time_driver::TICK_HZ);

struct Clock(Mutex<RefCell<(u64, Queue)>>);

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock(Mutex::new(RefCell::new((0, Queue::new())))));

impl Driver for Clock {
    fn now(&self) -> u64 {
        critical_section::with(|section| self.0.borrow_ref(section).0)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            let (now, queue) = &mut *self.0.borrow_ref_mut(section);
            if queue.schedule_wake(at, waker) {
                let _ = queue.next_expiration(*now);
            }
        });
    }
}

/// Lets a tick pass. The board's timer interrupt calls it.
pub fn tick() {
    critical_section::with(|section| {
        let (now, queue) = &mut *CLOCK.0.borrow_ref_mut(section);
        *now += 1;
        let _ = queue.next_expiration(*now);
    });
}
