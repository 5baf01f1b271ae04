//! The image for the STM32F405: everything that touches a register, and the loop around [`firmware::unit::Unit`].
//!
//! It is part of the binary, not of the library: the library then stays free of target-only code, and another board is
//! another `board` module with the same few lines of loop.
//!
//! Nothing here panics. A unit that cannot start sends nothing, which the modem takes for silence.

mod clocks;
mod device_id;
mod panic;
mod serial;

use clocks::Clocks;
use cortex_m::asm;
use firmware::link::{ModemFrame, Receiver, UnitFrame, encode};
use firmware::tables::DISTILLED;
use firmware::telemetry::Telemetry;
use firmware::unit::{Unit, back_off};
use rand_pcg::Pcg32;
use serial::Serial;
use stm32f4::stm32f405::Peripherals;

/// Slots between two telemetry records: one second.
#[cfg(feature = "defmt")]
const TELEMETRY_SLOTS: u32 = 1000;

#[cortex_m_rt::entry]
fn main() -> ! {
    // Neither can be taken already at reset; a unit for which they are stays silent.
    if let Some(peripherals) = Peripherals::take()
        && let Some(unit) = unit(device_id::read(&peripherals.RCC))
    {
        let clocks = Clocks::start(&peripherals.RCC, &peripherals.FLASH);
        #[cfg(feature = "defmt")]
        defmt::info!(
            "core clock {=u32} Hz, serial line {=u32} baud",
            clocks.core_hz(),
            serial::actual_baud(clocks)
        );
        let serial = Serial::start(peripherals.USART1, &peripherals.GPIOA, &peripherals.RCC, clocks);
        run(unit, serial)
    }
    loop {
        asm::wfi();
    }
}

/// The unit, over the built-in table. Static, so that the image's RAM shows in the ELF and not only on the stack.
fn unit(device: [u32; 3]) -> Option<&'static mut Unit<'static, Pcg32>> {
    // The optimiser must not read the table at build time: what counts is what the flash holds when the unit starts.
    let table = core::hint::black_box(DISTILLED);
    cortex_m::singleton!(: Unit<'static, Pcg32> = Unit::new(table, back_off(device)))
}

/// One answer for every slot. The modem's frames are the clock: a slot without a frame is a slot without a
/// transmission.
fn run(unit: &mut Unit<'static, Pcg32>, mut serial: Serial) -> ! {
    let mut receiver = Receiver::default();
    let mut telemetry = Telemetry::default();
    loop {
        let Some(byte) = serial.read() else {
            serial.wait();
            continue;
        };
        let event = match receiver.push::<ModemFrame>(byte) {
            None => continue,
            Some(frame) => frame.ok().and_then(|frame| frame.event().ok()),
        };
        let Some(event) = event else {
            telemetry.dropped_frames = telemetry.dropped_frames.saturating_add(1);
            continue;
        };
        let Some(report) = unit.slot(&event) else { continue };
        if let Ok(frame) = encode(&UnitFrame::from(&report)) {
            serial.write(&frame);
        }
        telemetry.count(&report);
        log(&telemetry, report.slot.0);
    }
}

#[cfg(not(feature = "defmt"))]
const fn log(_: &Telemetry, _: u32) {}

#[cfg(feature = "defmt")]
fn log(telemetry: &Telemetry, slot: u32) {
    timestamp::SLOT.store(slot, core::sync::atomic::Ordering::Relaxed);
    if telemetry.slots.is_multiple_of(TELEMETRY_SLOTS) {
        defmt::info!(
            "slots {=u32}, transmissions {=u32}, degraded {=u32}, dropped frames {=u32}, mean power {=f32} mW",
            telemetry.slots,
            telemetry.transmissions,
            telemetry.degraded,
            telemetry.dropped_frames,
            telemetry.mean_power_mw()
        );
    }
}

/// Log records carry the last decided slot: the modem's time, which its own log has too.
#[cfg(feature = "defmt")]
mod timestamp {
    use core::sync::atomic::{AtomicU32, Ordering};
    use defmt_rtt as _;

    pub static SLOT: AtomicU32 = AtomicU32::new(0);

    defmt::timestamp!("slot {=u32}", SLOT.load(Ordering::Relaxed));
}
