//! The serial line to the modem: USART1 on PA9 (out) and PA10 (in), 8N1, interrupt-driven both ways.
//!
//! The interrupt alone touches the peripheral; the main loop sees two queues. So neither ever waits for the other.

use super::clocks::Clocks;
use core::cell::RefCell;
use cortex_m::asm;
use cortex_m::peripheral::NVIC;
use critical_section::Mutex;
use firmware::link::MAX_FRAME;
use heapless::Deque;
use stm32f4::stm32f405::{GPIOA, Interrupt, RCC, USART1, interrupt};

/// Bits per second (chosen): the longest frame in (39 bytes) and the longest out (17) then take 0.61 ms of a 1 ms slot even
/// one after the other, at 10 bits on the line for a byte. 460,800 would take 1.22 ms.
const BAUD: u32 = 921_600;

/// Bytes that may arrive while the main loop decides: 2.7 ms of a full line.
const RECEIVE_QUEUE: usize = 256;
/// Room for two frames; there is never more than one answer on its way in a slot.
const SEND_QUEUE: usize = 2 * MAX_FRAME;

/// What the interrupt and the main loop share.
struct Port {
    usart: Option<USART1>,
    received: Deque<u8, RECEIVE_QUEUE>,
    to_send: Deque<u8, SEND_QUEUE>,
}

static PORT: Mutex<RefCell<Port>> = Mutex::new(RefCell::new(Port {
    usart: None,
    received: Deque::new(),
    to_send: Deque::new(),
}));

/// Runs `access` with the port and interrupts off. The port is free then, since nothing holds it longer than one critical
/// section; the fallback is there so that not even a mistake panics.
fn with_port<T>(fallback: T, access: impl FnOnce(&mut Port) -> T) -> T {
    critical_section::with(|token| match PORT.borrow(token).try_borrow_mut() {
        Ok(mut port) => access(&mut port),
        Err(_) => fallback,
    })
}

/// The main loop's end of the line.
pub struct Serial(());

impl Serial {
    /// Sets up pins, peripheral and interrupt.
    pub fn start(usart: USART1, pins: &GPIOA, rcc: &RCC, clocks: Clocks) -> Self {
        rcc.ahb1enr().modify(|_, w| w.gpioaen().set_bit());
        rcc.apb2enr().modify(|_, w| w.usart1en().set_bit());
        // A peripheral takes two cycles to answer after its clock is on (errata sheet ES0182); reading the register back
        // waits as long.
        let _ = rcc.apb2enr().read();
        // The levels are set before the pins change over, so the line never idles low.
        pins.pupdr()
            .modify(|_, w| w.pupdr9().pull_up().pupdr10().pull_up());
        pins.ospeedr()
            .modify(|_, w| w.ospeedr9().very_high_speed().ospeedr10().very_high_speed());
        pins.afrh().modify(|_, w| w.afrh9().af7().afrh10().af7());
        pins.moder()
            .modify(|_, w| w.moder9().alternate().moder10().alternate());

        let divider = divider(clocks);
        usart.brr().write(|w| {
            w.div_mantissa()
                .set((divider >> 4) as u16)
                .div_fraction()
                .set((divider & 0xf) as u8)
        });
        usart
            .cr1()
            .write(|w| w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit());
        with_port((), |port| port.usart = Some(usart));
        // SAFETY: unmasking can break a critical section built on masks; this program's are built on PRIMASK alone.
        #[allow(unsafe_code, reason = "cortex-m marks unmasking unsafe")]
        unsafe {
            NVIC::unmask(Interrupt::USART1);
        }
        Self(())
    }

    /// The next byte from the modem, if one has arrived.
    pub fn read(&mut self) -> Option<u8> {
        with_port(None, |port| port.received.pop_front())
    }

    /// Queues a whole frame, or nothing of it if it does not fit: half a frame would only cost the modem a checksum.
    pub fn write(&mut self, frame: &[u8]) {
        with_port((), |port| {
            if frame.len() <= port.to_send.capacity().saturating_sub(port.to_send.len()) {
                // Not `extend`, which panics when full.
                for &byte in frame {
                    let _ = port.to_send.push_back(byte);
                }
            }
        });
        NVIC::pend(Interrupt::USART1);
    }

    /// Sleeps until there may be something to read.
    pub fn wait(&mut self) {
        // A byte between the test and the instruction would be slept through. With interrupts off it stays pending, and a
        // pending interrupt ends WFI whether or not it may run (ARMv7-M Architecture Reference Manual, "Wait For Interrupt").
        with_port((), |port| {
            if port.received.is_empty() {
                asm::wfi();
            }
        });
    }
}

impl Port {
    fn service(&mut self) {
        let Some(usart) = &self.usart else { return };
        let status = usart.sr().read();
        // Reading status, then data, clears every receive flag, an overrun's too. Damaged bytes go on like all others: the
        // frame's checksum is stricter than parity or framing.
        if status.rxne().bit_is_set() || status.ore().bit_is_set() {
            let byte = usart.dr().read().dr().bits() as u8;
            // A full queue loses the byte, and with it one frame, by its checksum.
            let _ = self.received.push_back(byte);
        }
        // At most two bytes fit the transmitter at a time. Where it takes them at once, as in an emulator, the queue's length
        // bounds the loop.
        while usart.sr().read().txe().bit_is_set()
            && let Some(byte) = self.to_send.pop_front()
        {
            usart.dr().write(|w| w.dr().set(u16::from(byte)));
        }
        let more = !self.to_send.is_empty();
        usart.cr1().modify(|_, w| w.txeie().bit(more));
    }
}

#[interrupt]
fn USART1() {
    with_port((), Port::service);
}

/// Peripheral clocks per bit, to the nearest: the baud rate register as a whole (RM0090 section 30.3.4, oversampling by
/// 16). 84 MHz gives 91 and 923,077 baud, 0.16 % off; 16 MHz gives 17 and 941,176, 2.1 % off, which with the internal
/// oscillator's 1 % is just inside the receiver's 3.3 % (section 30.3.5) if the modem's own clock is good.
const fn divider(clocks: Clocks) -> u32 {
    (clocks.apb2_hz() + BAUD / 2) / BAUD
}

/// The line's real rate.
#[cfg(feature = "defmt")]
pub const fn actual_baud(clocks: Clocks) -> u32 {
    clocks.apb2_hz() / divider(clocks)
}
