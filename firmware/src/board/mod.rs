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
//! | 0 | `idle` | table updates: flash and signatures; sleep |
//!
//! `decide` preempts an update, so slots are decided while a signature is checked; the exception is a sector's erase
//! ([`flash`]).
//!
//! Nothing on the way from a frame to its answer can panic; the feature `no-panic-proof` makes the linker prove it.

mod clocks;
mod device_id;
mod flash;
mod log;
mod panic;
mod serial;
mod slot_timer;
mod stopwatch;
mod watchdog;

use firmware::link::{UnitMessage, UpdateAnswer, UpdateFrame, encode};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table_store::{Key, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use flash::Flash;
use heapless::spsc::{Consumer, Producer};
use serial::{Received, Serial, ToSend};
use slot_timer::SlotTimer;
use stopwatch::Stopwatch;
use watchdog::Watchdog;

/// What an update's step came to.
pub struct Reply {
    answer: UpdateAnswer,
    /// The table that runs from now on.
    table: Option<&'static [u8]>,
}

/// Says in the image which key it trusts.
#[used]
static TABLE_KEY_KIND: &str = Key::KIND;

/// The running table: the store's, or the built-in one.
fn running_table(store: &TableStore<Flash>) -> &'static [u8] {
    match store.active() {
        Some(active) => active.table(Flash::running(active.slot)),
        // The optimiser must not read the table at build time: what counts is what the flash holds when the unit starts.
        None => core::hint::black_box(DISTILLED),
    }
}

/// The session over a table, in a static place. A function of its own, because the 4 KiB of stack on which the session is built
/// must not lie under the signature checks of the store; `None` if it was called before.
#[inline(never)]
#[allow(
    clippy::mut_from_ref,
    reason = "the session is borrowed from a place that is handed out once, not from the table"
)]
fn session(table: &'static [u8], identity: [u32; 3]) -> Option<&'static mut Session<'static>> {
    // The table comes when the session is in its place, so that no second copy of it lies on the stack.
    let session = cortex_m::singleton!(: Session<'static> = Session::new(Unit::without_table(Identity::of_device(identity))))?;
    session.replace_table(table);
    Some(session)
}

#[allow(unsafe_code, reason = "RTIC's own; its analysis stands for its safety")]
#[rtic::app(device = stm32f4::stm32f405, peripherals = true)]
mod app {
    use super::*;
    use stm32f4::stm32f405::Interrupt;

    #[shared]
    struct Shared {
        update: Option<UpdateFrame>,
        reply: Option<Reply>,
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
    }

    #[init(local = [bytes_in: Received = Received::new(), bytes_out: ToSend = ToSend::new()])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let device = cx.device;
        let watchdog = Watchdog::start(device.IWDG);
        let identity = device_id::read(&device.RCC);
        let clocks = clocks::Clocks::start(&device.RCC, &device.FLASH);
        #[cfg(feature = "defmt")]
        defmt::info!(
            "core clock {=u32} Hz, serial line {=u32} baud, {=str}",
            clocks.core_hz(),
            serial::actual_baud(clocks),
            TABLE_KEY_KIND,
        );
        let store = TableStore::boot(Flash::new(device.FLASH), Key::BUILT_IN);
        let Some(session) = session(running_table(&store), identity) else {
            // Reset comes once. The watchdog makes another.
            loop {
                cortex_m::asm::wfi();
            }
        };
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
                update: None,
                reply: None,
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
        shared = [update, reply],
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

        if let Some(reply) = cx.shared.reply.lock(Option::take) {
            if let Some(table) = reply.table {
                session.replace_table(table);
            }
            send(&UnitMessage::Update(reply.answer));
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
                    send(&message);
                    stopwatch.answered(start);
                    log::decided(
                        session.telemetry(),
                        session.unit().last_slot().map_or(0, |slot| slot.0),
                    );
                }
                Some(Request::Update(step)) => {
                    let busy = cx.shared.update.lock(|update| {
                        let busy = update.is_some();
                        update.get_or_insert(step);
                        busy
                    });
                    if busy {
                        send(&UnitMessage::Update(UpdateAnswer::Busy));
                    }
                }
            }
        }
        let ticks = slot_timer.take();
        for _ in 0..ticks {
            if let Some(Request::Answer(message)) = session.tick() {
                send(&message);
                log::decided(
                    session.telemetry(),
                    session.unit().last_slot().map_or(0, |slot| slot.0),
                );
            }
        }
        if ticks > 0 {
            cx.local.watchdog.feed();
        }
    }

    #[idle(local = [store], shared = [update, reply])]
    fn idle(mut cx: idle::Context) -> ! {
        let store = cx.local.store;
        loop {
            // It stays in its place while it is worked on, which makes the unit busy.
            let Some(step) = cx.shared.update.lock(|update| *update) else {
                // A task between the test and the instruction would be slept through. With interrupts off it stays pending, and
                // that ends WFI (ARMv7-M Architecture Reference Manual, "Wait For Interrupt").
                cortex_m::interrupt::free(|_| {
                    if cx.shared.update.lock(|update| update.is_none()) {
                        cortex_m::asm::wfi();
                    }
                });
                continue;
            };
            let answer = store.step(&step);
            let activated = matches!(answer, UpdateAnswer::Activated { .. });
            let table = activated.then(|| running_table(store));
            cx.shared
                .reply
                .lock(|reply| *reply = Some(Reply { answer, table }));
            cx.shared.update.lock(|update| *update = None);
            rtic::pend(Interrupt::EXTI0);
        }
    }
}
