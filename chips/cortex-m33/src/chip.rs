//! The registers of Arm's AN505 (application note AN505, table 4-2) with its CMSDK UART (Arm DDI 0479, chapter 4.3), in the secure world.

use board::{clock, line};
use cortex_m::Peripherals;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
// Its panic handler.
use semihosting as _;

const CORE_HZ: u32 = 20_000_000;
const BAUD: u32 = 1_000_000;

const UART: usize = 0x5020_0000;
const DATA: *mut u32 = UART as *mut u32;
const STATE: *mut u32 = (UART + 0x04) as *mut u32;
const CONTROL: *mut u32 = (UART + 0x08) as *mut u32;
const INTERRUPT: *mut u32 = (UART + 0x0c) as *mut u32;
const BAUD_DIVIDER: *mut u32 = (UART + 0x10) as *mut u32;

const SENDER_FULL: u32 = 1 << 0;
const RECEIVER_FULL: u32 = 1 << 1;
/// Sender, receiver and the receiver's interrupt.
const ENABLED: u32 = 1 << 0 | 1 << 1 | 1 << 3;
const ON_RECEIVED: u32 = 1 << 1;

#[derive(Clone, Copy)]
struct UartReceives;

// SAFETY: interrupt 32 is UART0's receiver (table 4-4), and no other type stands for it.
unsafe impl InterruptNumber for UartReceives {
    fn number(self) -> u16 {
        32
    }
}

/// The chip's own number: an FPGA has none.
pub fn number() -> [u32; 3] {
    [0; 3]
}

/// Starts the serial line and the slot clock's timer.
pub fn start() {
    // SAFETY: registers of a peripheral that nobody else uses; the interrupt's handler is below and complete.
    unsafe {
        BAUD_DIVIDER.write_volatile(CORE_HZ / BAUD);
        CONTROL.write_volatile(ENABLED);
        NVIC::unmask(UartReceives);
    }
    if let Some(core) = Peripherals::take() {
        let mut timer = core.SYST;
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(CORE_HZ / clock::TICK_HZ - 1);
        timer.clear_current();
        timer.enable_interrupt();
        timer.enable_counter();
    }
}

/// Sends a byte, when the line can take it.
pub fn send(byte: u8) {
    // SAFETY: as in `start`; only the line's sender calls this.
    unsafe {
        while STATE.read_volatile() & SENDER_FULL != 0 {}
        DATA.write_volatile(u32::from(byte));
    }
}

#[exception]
fn SysTick() {
    clock::tick();
}

/// Without a table of the chip's interrupts all of them come here; the line's is the only one that is on.
#[exception]
unsafe fn DefaultHandler(_: i16) {
    // SAFETY: the handler is the only one who reads the receiver.
    unsafe {
        INTERRUPT.write_volatile(ON_RECEIVED);
        while STATE.read_volatile() & RECEIVER_FULL != 0 {
            line::received(DATA.read_volatile() as u8);
        }
    }
}
