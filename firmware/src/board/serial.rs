//! The serial line to the modem: USART1 on PA9 (out) and PA10 (in), 8N1, interrupt-driven both ways.
//!
//! The interrupt alone touches the peripheral; it shares two queues with the decision task, each with one end for either, which needs no
//! lock. So neither ever waits for the other.

use super::clocks::Clocks;
use firmware::link::MAX_FRAME;
use heapless::spsc::{Consumer, Producer, Queue};
use stm32f4::stm32f405::{GPIOA, RCC, USART1};

/// Bits per second (chosen: both clocks divide into it). The longest frame in and the longest answer (18 bytes) then take 0.40 ms of a
/// 1 ms slot for 3 sub-channels (61 bytes), 0.55 for 8 (91) and 0.79 for 16 (139), one after the other and at 10 bits on the line for a
/// byte. At 921,600 they would take 0.86, 1.18 and 1.70.
const BAUD: u32 = 2_000_000;

/// Room for bytes that arrive while the unit decides: 1.3 ms of a full line.
pub type Received = Queue<u8, 256>;
/// Room for a decision, an update's answer and one more; there are never more on their way in a slot.
pub type ToSend = Queue<u8, { 3 * MAX_FRAME + 1 }>;

/// The interrupt's end of the line.
pub struct Serial {
    usart: USART1,
    received: Producer<'static, u8>,
    to_send: Consumer<'static, u8>,
    sends: bool,
}

impl Serial {
    /// Sets up pins and peripheral.
    pub fn start(
        usart: USART1,
        received: Producer<'static, u8>,
        to_send: Consumer<'static, u8>,
        pins: &GPIOA,
        rcc: &RCC,
        clocks: Clocks,
    ) -> Self {
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
        // 16 samples a bit, or 8 where there are no 16 clocks in one.
        let (bits, eight) = if divider < 16 { (3, true) } else { (4, false) };
        usart.brr().write(|w| {
            w.div_mantissa()
                .set((divider >> bits) as u16)
                .div_fraction()
                .set((divider & ((1 << bits) - 1)) as u8)
        });
        usart.cr1().write(|w| {
            w.over8().bit(eight);
            w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit()
        });
        Self {
            usart,
            received,
            to_send,
            sends: false,
        }
    }

    /// Moves bytes both ways. Whether the decision task has something to do: a frame is complete, or so much waits that it must be
    /// taken before it is too much. Waking it for every byte would cost as much as the decision.
    pub fn service(&mut self) -> bool {
        let usart = &self.usart;
        let status = usart.sr().read();
        let mut complete = false;
        // Reading status, then data, clears every receive flag, an overrun's too. Damaged bytes go on like all others: the
        // frame's checksum is stricter than parity or framing.
        if status.rxne().bit_is_set() || status.ore().bit_is_set() {
            let byte = usart.dr().read().dr().bits() as u8;
            // A full queue loses the byte, and with it one frame, by its checksum.
            let _ = self.received.enqueue(byte);
            complete = byte == 0 || self.received.len() >= MAX_FRAME;
        }
        // Most interrupts only receive.
        if self.sends || self.to_send.ready() {
            // At most two bytes fit the transmitter at a time. Where it takes them at once, as in an emulator, the queue's length
            // bounds the loop.
            while usart.sr().read().txe().bit_is_set()
                && let Some(byte) = self.to_send.dequeue()
            {
                usart.dr().write(|w| w.dr().set(u16::from(byte)));
            }
            self.sends = self.to_send.ready();
            usart.cr1().modify(|_, w| w.txeie().bit(self.sends));
        }
        complete
    }
}

/// Queues a whole frame, or nothing of it if it does not fit: half a frame would only cost the modem a checksum.
pub fn queue(to_send: &mut Producer<'static, u8>, frame: &[u8]) {
    if frame.len() <= to_send.capacity().saturating_sub(to_send.len()) {
        for &byte in frame {
            let _ = to_send.enqueue(byte);
        }
    }
}

/// Peripheral clocks per bit: the baud rate register as a whole (RM0090 section 30.3.4). 84 MHz gives 42 and 16 MHz 8, exactly. The receiver
/// takes 2.5 % (section 30.3.5); the internal oscillator is within 1 % at 25 degrees, and within -8 and +4.5 % from -40 to 105 (data sheet,
/// table 38), so without a crystal the line is sure at room temperature alone.
const fn divider(clocks: Clocks) -> u32 {
    (clocks.apb2_hz() + BAUD / 2) / BAUD
}

/// The line's real rate.
#[cfg(feature = "defmt")]
pub const fn actual_baud(clocks: Clocks) -> u32 {
    clocks.apb2_hz() / divider(clocks)
}
