//! The image for the STM32F405: everything that touches a register, and the tasks around [`firmware::session::Session`].
//!
//! It is part of the binary, not of the library: the library then stays free of target-only code, and another board is
//! another `board` module with the same few tasks.
//!
//! # Tasks
//! [RTIC](https://rtic.rs) gives each interrupt a task with a priority, and its compile-time analysis the locks: no deadlock, no
//! priority inversion, one stack. All tasks are interrupts; none needs an executor.
//!
//! | priority | task | what it does |
//! |---|---|---|
//! | 1 | `line` (USART1) | the line fell idle: frames to decisions |
//! | 1 | `tick` (SysTick) | a tick is over, whatever the modem does: overdue slots to decisions, and frames behind which no line is idle |
//! | 0 | `idle` | table updates, trials, the running table's checksum: flash and signatures; sleep |
//!
//! The first two do not preempt each other, so nothing between the line and a decision is locked or queued.
//! They preempt an update, so slots are decided while a signature is checked; the exception is a sector's erase
//! ([`flash`]).
//!
//! Nothing on the way from a frame to its answer can panic; the program `no-panic-proof` is the linker's proof.

mod boot_state;
mod clocks;
mod device_id;
mod flash;
mod flash_controller;
mod image_flash;
mod images;
mod log;
mod panic;
mod reset;
mod serial;
mod slot_timer;
mod stack;
mod stopwatch;
mod watchdog;

use firmware::health::Health;
use firmware::link::{
    ClockSource, Counters, ResetCause, StatusFrame, UnitMessage, UpdateAnswer, UpdateFrame,
};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table::{Table, TableError};
use firmware::table_store::{Key, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use flash::Flash;
use images::Images;
use rtic::Mutex;
use serial::{RECEIVED, Received, Serial, ToSend};
use slot_timer::SlotTimer;
use stopwatch::Stopwatch;
use watchdog::Watchdog;

/// What the modem asked for that takes its time.
#[derive(Clone, Copy)]
pub enum Job {
    /// A step of an update.
    Update(UpdateFrame),
    /// How the unit is.
    Status(Counters),
}

/// What passes between the slots and what is done below them.
pub struct Handover {
    /// What there is to do. It stays while it is worked on, which makes the unit busy.
    job: Option<Job>,
    /// How the unit did with its table.
    window: Option<Health>,
    /// A slot was decided: time to read on in the running table.
    decided: bool,
    /// Something came of it.
    is_done: bool,
    /// What to send.
    message: Option<UnitMessage>,
    /// What runs from now on.
    table: Option<Result<Table<'static>, TableError>>,
}

/// Everything between the line and a decision.
pub struct Slots {
    serial: Serial,
    session: &'static mut Session<'static>,
    slot_timer: SlotTimer,
    stopwatch: Stopwatch,
    watchdog: Watchdog,
}

impl Slots {
    /// The line fell idle, or the work below is done.
    fn line(&mut self, handover: &mut impl Mutex<T = Handover>) {
        self.serial.interrupt();
        if handover.lock(|handover| core::mem::take(&mut handover.is_done)) {
            self.take_outcome(handover);
        }
        if self.take_all(handover) {
            self.slot_decided(handover);
        }
        if self.slot_timer.has_run() {
            self.watchdog.feed();
        }
    }

    /// A tick is over. Most find nothing to do, and take no more than that.
    fn tick(&mut self, handover: &mut impl Mutex<T = Handover>) {
        self.slot_timer.tick();
        // Bytes before ticks: a frame that is complete is not overdue. If it begins a slot, so does a new tick.
        let mut decided = self.serial.has_received() && self.take_all(handover);
        if self.slot_timer.take()
            && let Some(Request::Answer(message)) = self.session.tick()
        {
            decided = true;
            self.answer(&message);
        }
        if decided {
            self.slot_decided(handover);
        }
        if self.slot_timer.has_run() {
            self.watchdog.feed();
        }
    }

    #[inline(never)]
    fn slot_decided(&mut self, handover: &mut impl Mutex<T = Handover>) {
        self.watchdog.feed();
        let window = self.session.full_window();
        handover.lock(|handover| {
            handover.decided = true;
            if window.is_some() {
                handover.window = window;
            }
        });
    }

    /// All bytes that came to decisions; whether there was one.
    #[inline(never)]
    fn take_all(&mut self, handover: &mut impl Mutex<T = Handover>) -> bool {
        let mut decided = false;
        while self.serial.has_received() {
            let bytes = self.serial.received();
            decided |= self.take(bytes, handover);
        }
        decided
    }

    /// Takes over what was done below.
    #[inline(never)]
    fn take_outcome(&mut self, handover: &mut impl Mutex<T = Handover>) {
        let (message, table) = handover.lock(|handover| (handover.message.take(), handover.table.take()));
        if let Some(table) = table {
            self.session.run_table(table);
        }
        if let Some(message) = message {
            self.serial.send(&message);
        }
    }

    /// These bytes to decisions; whether there was one.
    fn take(&mut self, mut bytes: &[u8], handover: &mut impl Mutex<T = Handover>) -> bool {
        let start = self.stopwatch.now();
        let mut decided = false;
        while !bytes.is_empty() {
            let request = self.session.take(&mut bytes);
            if let Some(tick_microseconds) = self.session.timer_restart() {
                self.slot_timer.restart(tick_microseconds);
            }
            match request {
                None => {}
                Some(Request::Answer(message)) => {
                    self.answer(&message);
                    if let UnitMessage::Decision(_) = message {
                        decided = true;
                        self.stopwatch.answered(start);
                    }
                }
                Some(Request::Update(step)) => {
                    let busy = handover.lock(|handover| {
                        let busy = handover.job.is_some();
                        handover.job.get_or_insert(Job::Update(step));
                        busy
                    });
                    if busy {
                        self.serial.send(&UnitMessage::Update(UpdateAnswer::Busy));
                    }
                }
                // A busy unit does not answer, and is asked again.
                Some(Request::Status(counters)) => handover.lock(|handover| {
                    handover.job.get_or_insert(Job::Status(counters));
                }),
            }
        }
        decided
    }

    #[inline(never)]
    fn answer(&mut self, message: &UnitMessage) {
        self.serial.send(message);
        log::decided(
            self.session.telemetry(),
            self.session.unit().last_slot().map_or(0, |slot| slot.0),
        );
    }
}

/// What is known from the start on.
pub struct Start {
    reset: ResetCause,
    clock: ClockSource,
}

/// Says in the image which key it trusts.
#[used]
static TABLE_KEY_KIND: &str = Key::KIND;

/// The running table, parsed: the store's, or the built-in one. A stored one that does not parse any more is given up.
#[inline(never)]
fn running_table(store: &mut TableStore<Flash>) -> Result<Table<'static>, TableError> {
    loop {
        let stored = store.running();
        let bytes = match stored {
            Some(stored) => stored.table(Flash::running(stored.slot)),
            // The optimiser must not read the table at build time: what counts is what the flash holds when the unit starts.
            None => core::hint::black_box(DISTILLED),
        };
        let table = Table::parse(bytes);
        if table.is_ok() || stored.is_none() {
            return table;
        }
        store.drop_running();
    }
}

/// The session, in a static place. A function of its own, because the 4 KiB of stack on which the session is built
/// must not lie under the signature checks of the store; `None` if it was called before.
#[inline(never)]
#[allow(
    clippy::mut_from_ref,
    reason = "the session is borrowed from a place that is handed out once"
)]
fn session(identity: [u32; 3], clock: ClockSource) -> Option<&'static mut Session<'static>> {
    let session = cortex_m::singleton!(: Session<'static> = Session::new(Unit::without_table(Identity::of_device(identity))))?;
    session.set_in_emulator(clock == ClockSource::Emulated);
    Some(session)
}

#[allow(unsafe_code, reason = "RTIC's own; its analysis stands for its safety")]
#[rtic::app(device = stm32f4::stm32f405, peripherals = true)]
mod app {
    use super::*;
    use core::sync::atomic::AtomicU8;
    use stm32f4::stm32f405::Interrupt;

    #[shared]
    struct Shared {
        #[lock_free]
        slots: Slots,
        handover: Handover,
    }

    #[local]
    struct Local {
        store: TableStore<Flash>,
        images: Images,
        start: Start,
    }

    #[init(local = [received: Received = [const { AtomicU8::new(0) }; RECEIVED], to_send: ToSend = [0; _]])]
    fn init(cx: init::Context) -> (Shared, Local) {
        stack::clear();
        let device = cx.device;
        let watchdog = Watchdog::start(device.IWDG);
        let identity = device_id::read(&device.RCC);
        let reset = reset::cause(&device.RCC);
        let clocks = clocks::Clocks::start(&device.RCC, &device.FLASH);
        if clocks.0 != ClockSource::Emulated {
            Watchdog::freeze_under_debugger(&device.DBGMCU);
        }
        #[cfg(feature = "defmt")]
        defmt::info!(
            "core clock {=u32} Hz, serial line {=u32} baud, {=str}",
            clocks.core_hz(),
            serial::actual_baud(clocks),
            TABLE_KEY_KIND,
        );
        let mut store = TableStore::boot(Flash::new(device.FLASH), Key::BUILT_IN, DISTILLED);
        let Some(session) = session(identity, clocks.0) else {
            // Reset comes once. The watchdog makes another.
            loop {
                cortex_m::asm::wfi();
            }
        };
        session.run_table(running_table(&mut store));
        let stopwatch = Stopwatch::start(device.TIM2, &device.RCC, clocks);
        let slot_timer = SlotTimer::start(cx.core.SYST, clocks, session.clock().tick_microseconds());
        let serial = Serial::start(
            device.USART1,
            device.DMA2,
            cx.local.received,
            cx.local.to_send,
            &device.GPIOA,
            &device.RCC,
            clocks,
        );
        (
            Shared {
                slots: Slots {
                    serial,
                    session,
                    slot_timer,
                    stopwatch,
                    watchdog,
                },
                handover: Handover {
                    job: None,
                    window: None,
                    decided: false,
                    is_done: false,
                    message: None,
                    table: None,
                },
            },
            Local {
                store,
                images: Images::boot(),
                start: Start {
                    reset,
                    clock: clocks.0,
                },
            },
        )
    }

    #[task(binds = USART1, priority = 1, shared = [slots, handover])]
    fn line(mut cx: line::Context) {
        cx.shared.slots.line(&mut cx.shared.handover);
    }

    #[task(binds = SysTick, priority = 1, shared = [slots, handover])]
    fn tick(mut cx: tick::Context) {
        cx.shared.slots.tick(&mut cx.shared.handover);
    }

    #[idle(local = [store, images, start], shared = [handover])]
    fn idle(mut cx: idle::Context) -> ! {
        let (store, images, start) = (cx.local.store, cx.local.images, cx.local.start);
        loop {
            let (job, window, decided) = cx.shared.handover.lock(|handover| {
                let decided = core::mem::take(&mut handover.decided);
                (handover.job, handover.window.take(), decided)
            });
            if job.is_none() && window.is_none() && !decided {
                // A task between the test and the instruction would be slept through. With interrupts off it stays pending, and
                // that ends WFI (ARMv7-M Architecture Reference Manual, "Wait For Interrupt").
                cortex_m::interrupt::free(|_| {
                    let idle = cx
                        .shared
                        .handover
                        .lock(|handover| handover.job.is_none() && !handover.decided);
                    if idle {
                        cortex_m::asm::wfi();
                    }
                });
                continue;
            }
            let before = store.running();
            if let Some(window) = window {
                let _ = store.judge(&window);
                images.prove();
            }
            let message = job.map(|job| match job {
                Job::Update(step) => UnitMessage::Update(images.step(store, &step)),
                Job::Status(counters) => UnitMessage::Status(StatusFrame {
                    table: store.status(),
                    counters,
                    reset: start.reset,
                    clock: start.clock,
                    stack_bytes: stack::most(),
                    image: images.status(),
                }),
            });
            let damaged = decided && store.check_running();
            let table = (damaged || store.running() != before).then(|| running_table(store));
            if message.is_none() && table.is_none() {
                continue;
            }
            cx.shared.handover.lock(|handover| {
                handover.message = message;
                handover.table = table;
                handover.is_done = true;
                if job.is_some() {
                    handover.job = None;
                }
            });
            rtic::pend(Interrupt::USART1);
        }
    }
}
