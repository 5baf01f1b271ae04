//! The registers of a SiFive FE310 (SiFive FE310-G002 Manual 1.5: chapters 9 CLINT, 10 PLIC, 18 UART).

use board::{clock, line};
use riscv::interrupt::Interrupt;
use riscv::register::{mie, mstatus};
use riscv_rt::core_interrupt;
// Its panic handler.
use semihosting as _;

/// What the timer counts in the emulator; the chip's own counts 32,768 Hz, and a board would take a PWM for quarters of slots.
const TIMER_HZ: u32 = 10_000_000;
const CORE_HZ: u32 = 16_000_000;
const BAUD: u32 = 1_000_000;

const TIMER_COMPARE: *mut u64 = 0x0200_4000 as *mut u64;
const TIMER: *const u64 = 0x0200_bff8 as *const u64;

/// The line's number at the PLIC.
const UART_INTERRUPT: u32 = 3;
const PRIORITY: *mut u32 = (0x0c00_0000 + 4 * UART_INTERRUPT as usize) as *mut u32;
const ENABLE: *mut u32 = 0x0c00_2000 as *mut u32;
const THRESHOLD: *mut u32 = 0x0c20_0000 as *mut u32;
const CLAIM: *mut u32 = 0x0c20_0004 as *mut u32;

const UART: usize = 0x1001_3000;
const SEND: *mut u32 = UART as *mut u32;
const RECEIVE: *const u32 = (UART + 0x04) as *const u32;
const SENDER: *mut u32 = (UART + 0x08) as *mut u32;
const RECEIVER: *mut u32 = (UART + 0x0c) as *mut u32;
const INTERRUPTS: *mut u32 = (UART + 0x10) as *mut u32;
const DIVIDER: *mut u32 = (UART + 0x18) as *mut u32;

const ON: u32 = 1;
/// Of what is read from both data registers.
const FULL_OR_EMPTY: u32 = 1 << 31;
const ON_RECEIVED: u32 = 1 << 1;

/// The chip's own number: it has none.
pub fn number() -> [u32; 3] {
    [0; 3]
}

/// Starts the serial line and the slot clock's timer.
pub fn start() {
    // SAFETY: registers of peripherals that nobody else uses; the interrupts' handlers are below and complete.
    unsafe {
        PRIORITY.write_volatile(1);
        THRESHOLD.write_volatile(0);
        ENABLE.write_volatile(1 << UART_INTERRUPT);
        DIVIDER.write_volatile(CORE_HZ / BAUD - 1);
        SENDER.write_volatile(ON);
        RECEIVER.write_volatile(ON);
        INTERRUPTS.write_volatile(ON_RECEIVED);
        TIMER_COMPARE.write_volatile(TIMER.read_volatile() + period());
        mie::set_mext();
        mie::set_mtimer();
        mstatus::set_mie();
    }
}

fn period() -> u64 {
    u64::from(TIMER_HZ / clock::TICK_HZ)
}

/// Sends a byte, when the line can take it.
pub fn send(byte: u8) {
    // SAFETY: as in `start`; only the line's sender calls this.
    unsafe {
        while SEND.read_volatile() & FULL_OR_EMPTY != 0 {}
        SEND.write_volatile(u32::from(byte));
    }
}

#[core_interrupt(Interrupt::MachineTimer)]
fn slot_clock() {
    // SAFETY: the handler is the only one who moves the comparison once it runs.
    unsafe { TIMER_COMPARE.write_volatile(TIMER_COMPARE.read_volatile() + period()) };
    clock::tick();
}

#[core_interrupt(Interrupt::MachineExternal)]
fn receive() {
    // SAFETY: the handler is the only one who claims interrupts and reads the receiver.
    unsafe {
        let claimed = CLAIM.read_volatile();
        loop {
            let received = RECEIVE.read_volatile();
            if received & FULL_OR_EMPTY != 0 {
                break;
            }
            line::received(received as u8);
        }
        CLAIM.write_volatile(claimed);
    }
}
