//! The registers of an nRF51822 (Nordic, nRF51 Series Reference Manual 3.0.1, chapters 6 and 29).

use board::{clock, line};
use cortex_m::Peripherals;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
// Its panic handler.
use semihosting as _;

const CORE_HZ: u32 = 16_000_000;

/// FICR.DEVICEID, two words.
const DEVICE_ID: *const [u32; 2] = 0x1000_0060 as *const _;

const UART: usize = 0x4000_2000;
const START_RECEIVING: *mut u32 = UART as *mut u32;
const START_SENDING: *mut u32 = (UART + 0x008) as *mut u32;
const RECEIVED: *mut u32 = (UART + 0x108) as *mut u32;
const SENT: *mut u32 = (UART + 0x11c) as *mut u32;
const ENABLE_INTERRUPT: *mut u32 = (UART + 0x304) as *mut u32;
const ENABLE: *mut u32 = (UART + 0x500) as *mut u32;
const RECEIVE: *const u32 = (UART + 0x518) as *const u32;
const SEND: *mut u32 = (UART + 0x51c) as *mut u32;
const BAUD_RATE: *mut u32 = (UART + 0x524) as *mut u32;

const ENABLED: u32 = 4;
/// Bit of the received event among the interrupts.
const ON_RECEIVED: u32 = 1 << 2;
/// 1,000,000 baud, the most: a frame of 40 bytes takes 0.4 ms.
const MEGABAUD: u32 = 0x1000_0000;

#[derive(Clone, Copy)]
struct Uart;

// SAFETY: interrupt 2 is UART0's (chapter 6), and no other type stands for it.
unsafe impl InterruptNumber for Uart {
    fn number(self) -> u16 {
        2
    }
}

/// The chip's own number.
pub fn number() -> [u32; 3] {
    // SAFETY: two words of read-only memory.
    let [low, high] = unsafe { DEVICE_ID.read_volatile() };
    [low, high, 0]
}

/// Starts the serial line and the slot clock's timer.
pub fn start() {
    // SAFETY: registers of a peripheral that nobody else uses; the interrupt's handler is below and complete.
    unsafe {
        BAUD_RATE.write_volatile(MEGABAUD);
        ENABLE.write_volatile(ENABLED);
        ENABLE_INTERRUPT.write_volatile(ON_RECEIVED);
        START_RECEIVING.write_volatile(1);
        START_SENDING.write_volatile(1);
        NVIC::unmask(Uart);
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

/// Sends a byte, and waits until it is out.
pub fn send(byte: u8) {
    // SAFETY: as in `start`; only the line's sender calls this.
    unsafe {
        SENT.write_volatile(0);
        SEND.write_volatile(u32::from(byte));
        while SENT.read_volatile() == 0 {}
    }
}

#[exception]
fn SysTick() {
    clock::tick();
}

/// Without a table of the chip's interrupts all of them come here; the line's is the only one that is on.
#[exception]
unsafe fn DefaultHandler(_: i16) {
    // SAFETY: the handler is the only one who touches the receiver's registers.
    unsafe {
        while RECEIVED.read_volatile() != 0 {
            RECEIVED.write_volatile(0);
            line::received(RECEIVE.read_volatile() as u8);
        }
    }
}
