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
//! | 3 | `line` (USART1) | bytes between the line and two queues; wakes `decide` when a frame is complete |
//! | 2 | `tick` (SysTick) | counts a tick, whatever the modem does |
//! | 1 | `decide` (EXTI0, pended by the others) | frames and overdue slots to decisions; feeds the watchdog |
//! | 0 | `idle` | table updates, trials, the running table's checksum: flash and signatures; sleep |
//!
//! `decide` preempts an update, so slots are decided while a signature is checked; the exception is a sector's erase
//! ([`flash`]).
//!
//! Nothing on the way from a frame to its answer can panic; the program `no-panic-proof` is the linker's proof.

mod clocks;
mod device_id;
mod exchange;
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
    ClockSource, Counters, ResetCause, StatusFrame, UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table::{Table, TableError};
use firmware::table_store::{Key, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use flash::Flash;
use heapless::spsc::{Consumer, Producer};
use images::Images;
use serial::{Received, Serial, ToSend};
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

/// What there is to do below all decisions.
pub struct Work {
    /// It stays while it is worked on, which makes the unit busy.
    job: Option<Job>,
    /// How the unit did with its table.
    window: Option<Health>,
    /// A slot was decided: time to read on in the running table.
    decided: bool,
}

/// What came of it.
#[derive(Default)]
pub struct Outcome {
    message: Option<UnitMessage>,
    /// What runs from now on.
    table: Option<Result<Table<'static>, TableError>>,
}

impl Outcome {
    const fn is_there(&self) -> bool {
        self.message.is_some() || self.table.is_some()
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
    use stm32f4::stm32f405::Interrupt;

    #[shared]
    struct Shared {
        work: Work,
        outcome: Outcome,
    }

    #[local]
    struct Local {
        serial: Serial,
        received: Consumer<'static, u8>,
        to_send: Producer<'static, u8>,
        session: &'static mut Session<'static>,
        slot_timer: SlotTimer,
        stopwatch: Stopwatch,
        watchdog: Watchdog,
        store: TableStore<Flash>,
        images: Images,
        start: Start,
    }

    #[init(local = [bytes_in: Received = Received::new(), bytes_out: ToSend = ToSend::new()])]
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
        let (into_received, received) = cx.local.bytes_in.split();
        let (to_send, from_to_send) = cx.local.bytes_out.split();
        let serial = Serial::start(
            device.USART1,
            into_received,
            from_to_send,
            &device.GPIOA,
            &device.RCC,
            clocks,
        );
        (
            Shared {
                work: Work {
                    job: None,
                    window: None,
                    decided: false,
                },
                outcome: Outcome::default(),
            },
            Local {
                serial,
                received,
                to_send,
                session,
                slot_timer,
                stopwatch,
                watchdog,
                store,
                images: Images::boot(),
                start: Start {
                    reset,
                    clock: clocks.0,
                },
            },
        )
    }

    #[task(binds = USART1, priority = 3, local = [serial])]
    fn line(cx: line::Context) {
        if cx.local.serial.service() {
            rtic::pend(Interrupt::EXTI0);
        }
    }

    #[task(binds = SysTick, priority = 2)]
    fn tick(_: tick::Context) {
        slot_timer::tick();
        rtic::pend(Interrupt::EXTI0);
    }

    #[task(
        binds = EXTI0, priority = 1,
        local = [received, to_send, session, slot_timer, stopwatch, watchdog],
        shared = [work, outcome],
    )]
    fn decide(mut cx: decide::Context) {
        let (session, slot_timer, stopwatch) = (cx.local.session, cx.local.slot_timer, cx.local.stopwatch);
        let (received, to_send) = (cx.local.received, cx.local.to_send);
        let mut send = |message: &UnitMessage| {
            if let Ok(frame) = encode(message) {
                serial::queue(to_send, &frame);
                rtic::pend(Interrupt::USART1);
            }
        };

        let mut decided = false;
        // Looked at before it is taken: a whole table would be moved in every round.
        if cx.shared.outcome.lock(|outcome| outcome.is_there()) {
            let Outcome { message, table } = cx.shared.outcome.lock(core::mem::take);
            if let Some(table) = table {
                session.run_table(table);
            }
            if let Some(message) = message {
                send(&message);
            }
        }
        // Bytes before ticks: a frame that is complete is not overdue.
        while let Some(byte) = received.dequeue() {
            let start = stopwatch.now();
            let request = session.byte(byte);
            if let Some(tick_microseconds) = session.timer_restart() {
                slot_timer.restart(tick_microseconds);
            }
            match request {
                None => {}
                Some(Request::Answer(message)) => {
                    decided = true;
                    send(&message);
                    stopwatch.answered(start);
                    log::decided(
                        session.telemetry(),
                        session.unit().last_slot().map_or(0, |slot| slot.0),
                    );
                }
                Some(Request::Update(step)) => {
                    let busy = cx.shared.work.lock(|work| {
                        let busy = work.job.is_some();
                        work.job.get_or_insert(Job::Update(step));
                        busy
                    });
                    if busy {
                        send(&UnitMessage::Update(UpdateAnswer::Busy));
                    }
                }
                // A busy unit does not answer, and is asked again.
                Some(Request::Status(counters)) => cx.shared.work.lock(|work| {
                    work.job.get_or_insert(Job::Status(counters));
                }),
            }
        }
        let ticks = slot_timer.take();
        for _ in 0..ticks {
            if let Some(Request::Answer(message)) = session.tick() {
                decided = true;
                send(&message);
                log::decided(
                    session.telemetry(),
                    session.unit().last_slot().map_or(0, |slot| slot.0),
                );
            }
        }
        if decided {
            cx.shared.work.lock(|work| work.decided = true);
            if let Some(window) = session.full_window() {
                cx.shared.work.lock(|work| work.window = Some(window));
            }
        }
        if slot_timer.has_run() || decided {
            cx.local.watchdog.feed();
        }
    }

    #[idle(local = [store, images, start], shared = [work, outcome])]
    fn idle(mut cx: idle::Context) -> ! {
        let (store, images, start) = (cx.local.store, cx.local.images, cx.local.start);
        loop {
            let (job, window, decided) = cx.shared.work.lock(|work| {
                let decided = core::mem::take(&mut work.decided);
                (work.job, work.window.take(), decided)
            });
            if job.is_none() && window.is_none() && !decided {
                // A task between the test and the instruction would be slept through. With interrupts off it stays pending, and
                // that ends WFI (ARMv7-M Architecture Reference Manual, "Wait For Interrupt").
                cortex_m::interrupt::free(|_| {
                    let idle = cx.shared.work.lock(|work| work.job.is_none() && !work.decided);
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
            cx.shared
                .outcome
                .lock(|outcome| *outcome = Outcome { message, table });
            if job.is_some() {
                cx.shared.work.lock(|work| work.job = None);
            }
            rtic::pend(Interrupt::EXTI0);
        }
    }
}
