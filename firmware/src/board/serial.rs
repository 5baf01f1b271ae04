//! The serial line to the modem: USART1 on PA9 (out) and PA10 (in), 8N1.
//!
//! DMA moves the bytes (RM0090 chapter 10: DMA2, channel 4 of stream 2 in and of stream 7 out), so that a slot has one interrupt of the line: it falls
//! idle behind a frame. QEMU's machine has no DMA; in an emulator the interrupt comes for each byte and moves it.

use super::clocks::Clocks;
use core::sync::atomic::{AtomicU8, Ordering, compiler_fence};
use firmware::link::{ClockSource, MAX_FRAME, UnitMessage, encode_into};
use stm32f4::stm32f405::{DMA2, GPIOA, RCC, USART1, dma2};

/// Bits per second (chosen: both clocks divide into it). A slot's frame and its answer (15 bytes) then take 0.29 ms of a 1 ms
/// slot for 3 sub-channels (43 bytes), 0.39 for 8 (63) and 0.55 for 16 (95), one after the other and at 10 bits on the line for a
/// byte. At 921,600 they would take 0.63, 0.85 and 1.19.
const BAUD: u32 = 2_000_000;

/// Room for what comes, in a ring: 1.3 ms of a full line. It is looked at whenever the line falls idle, and at every tick, four times in a slot.
/// While the core stands still, as in a sector's erase, the line may write over what nobody has read: frames without their checksums.
pub type Received = [AtomicU8; RECEIVED];
/// Its bytes.
pub const RECEIVED: usize = 256;
/// Room for a decision, an update's answer and one more; there are never more on their way in a slot.
pub type ToSend = [u8; 3 * MAX_FRAME];

/// Streams of DMA2.
const IN: usize = 2;
const OUT: usize = 7;
/// Their channel.
const CHANNEL: u8 = 4;
/// Reads of a flag for which an emulator's sender is waited for; it is there at the first.
const POLLS: u32 = 1_000;

/// The line.
pub struct Serial {
    usart: USART1,
    /// There is none in an emulator.
    dma: Option<DMA2>,
    received: &'static Received,
    taken: usize,
    to_send: &'static mut ToSend,
    /// What of it is under way or out, and all of it.
    begun: usize,
    end: usize,
}

impl Serial {
    /// Sets up pins and peripherals.
    pub fn start(
        usart: USART1,
        dma: DMA2,
        received: &'static Received,
        to_send: &'static mut ToSend,
        pins: &GPIOA,
        rcc: &RCC,
        clocks: Clocks,
    ) -> Self {
        rcc.ahb1enr()
            .modify(|_, w| w.gpioaen().set_bit().dma2en().set_bit());
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
        let dma = (clocks.0 != ClockSource::Emulated).then_some(dma);
        if let Some(dma) = &dma {
            let stream = dma.st(IN);
            connect(stream, &usart);
            point(stream, received.as_ptr().cast());
            stream.ndtr().write(|w| w.ndt().set(RECEIVED as u16));
            stream
                .cr()
                .write(|w| w.chsel().set(CHANNEL).minc().incremented().circ().enabled());
            // What the stream is told must stand before it is on (RM0090 section 10.3.17).
            stream.cr().modify(|_, w| w.en().enabled());
            connect(dma.st(OUT), &usart);
            dma.st(OUT).cr().write(|w| {
                w.chsel()
                    .set(CHANNEL)
                    .minc()
                    .incremented()
                    .dir()
                    .memory_to_peripheral()
            });
            usart.cr3().write(|w| w.dmar().set_bit().dmat().set_bit());
        }
        usart.cr1().write(|w| {
            w.over8().bit(eight);
            w.idleie().bit(dma.is_some()).rxneie().bit(dma.is_none());
            w.ue().set_bit().te().set_bit().re().set_bit()
        });
        Self {
            usart,
            dma,
            received,
            taken: 0,
            to_send,
            begun: 0,
            end: 0,
        }
    }

    /// For the line's interrupt: it fell idle, or is free for what waits.
    pub fn interrupt(&mut self) {
        if self.dma.is_some() {
            // Reading status, then data, clears what is said of the line (RM0090 section 30.6.1). A byte in between goes to the DMA, which is faster.
            let _ = self.usart.sr().read();
            let _ = self.usart.dr().read();
            if self.begun < self.end {
                self.transmit();
            }
        }
    }

    /// Whether bytes came that are not taken yet.
    pub fn has_received(&self) -> bool {
        match &self.dma {
            Some(dma) => written(dma) != self.taken,
            // An overrun's byte is one, too.
            None => {
                let status = self.usart.sr().read();
                status.rxne().bit_is_set() || status.ore().bit_is_set()
            }
        }
    }

    /// The next bytes that came, in one piece: all, or those to the ring's end. Damaged bytes go on like all others: the frame's checksum is
    /// stricter than parity or framing.
    pub fn received(&mut self) -> &'static [u8] {
        let start = self.taken;
        let end = match &self.dma {
            Some(dma) => {
                let written = written(dma);
                self.taken = if written < start { 0 } else { written };
                if written < start { RECEIVED } else { written }
            }
            None => {
                if let Some(place) = self.received.first() {
                    place.store(self.usart.dr().read().dr().bits() as u8, Ordering::Relaxed);
                }
                1
            }
        };
        compiler_fence(Ordering::Acquire);
        let bytes = self.received.get(start..end).unwrap_or_default();
        // SAFETY: the line writes behind these bytes, and comes to them again 1.3 ms from now, far longer than anybody reads them.
        #[allow(unsafe_code, reason = "a view of memory that a peripheral writes")]
        unsafe {
            core::slice::from_raw_parts(bytes.as_ptr().cast(), bytes.len())
        }
    }

    /// Sends a whole message, or nothing of it if it does not fit: half a frame would only cost the modem a checksum.
    pub fn send(&mut self, message: &UnitMessage) {
        let is_out = match &self.dma {
            Some(dma) => dma.st(OUT).cr().read().en().is_disabled(),
            None => true,
        };
        if is_out && self.begun == self.end {
            (self.begun, self.end) = (0, 0);
        }
        let room = self.to_send.get_mut(self.end..).unwrap_or_default();
        if let Ok(length) = encode_into(message, room) {
            self.end = self.end.saturating_add(length);
            self.transmit();
        }
    }

    /// Begins to send what waits, or has the line tell when it is free.
    fn transmit(&mut self) {
        let waiting = self.to_send.get(self.begun..self.end).unwrap_or_default();
        let usart = &self.usart;
        let Some(dma) = &self.dma else {
            for &byte in waiting {
                let _ = (0..POLLS).any(|_| usart.sr().read().txe().bit_is_set());
                usart.dr().write(|w| w.dr().set(u16::from(byte)));
            }
            self.begun = self.end;
            return;
        };
        let stream = dma.st(OUT);
        let is_busy = stream.cr().read().en().is_enabled();
        if is_busy != usart.cr1().read().tcie().bit_is_set() {
            usart.cr1().modify(|_, w| w.tcie().bit(is_busy));
        }
        if is_busy {
            return;
        }
        // Flags of the transmission before would end this one (RM0090 sections 10.3.17 and 30.3.13).
        // SAFETY: a zero clears its flag, and a one changes nothing.
        #[allow(unsafe_code, reason = "a write of fields would clear other flags, too")]
        usart.sr().write(|w| unsafe { w.bits(!TRANSMISSION_COMPLETE) });
        dma.hifcr().write(|w| {
            w.ctcif7().set_bit().chtif7().set_bit().cteif7().set_bit();
            w.cdmeif7().set_bit().cfeif7().set_bit()
        });
        point(stream, waiting.as_ptr());
        stream.ndtr().write(|w| w.ndt().set(waiting.len() as u16));
        compiler_fence(Ordering::Release);
        stream.cr().modify(|_, w| w.en().enabled());
        self.begun = self.end;
    }
}

/// Where in the ring the line writes next. The stream counts down, and begins anew.
fn written(dma: &DMA2) -> usize {
    RECEIVED.wrapping_sub(usize::from(dma.st(IN).ndtr().read().ndt().bits())) % RECEIVED
}

/// Has a stream move between memory and the line.
fn connect(stream: &dma2::ST, usart: &USART1) {
    // SAFETY: the data register's address, where the stream is to read or write.
    #[allow(unsafe_code, reason = "addresses are any words")]
    stream
        .par()
        .write(|w| unsafe { w.pa().bits(usart.dr().as_ptr() as u32) });
}

/// Where a stream's memory begins.
fn point(stream: &dma2::ST, memory: *const u8) {
    // SAFETY: memory for ever, of which callers say how much the stream may use.
    #[allow(unsafe_code, reason = "addresses are any words")]
    stream.m0ar().write(|w| unsafe { w.m0a().bits(memory as u32) });
}

/// Bit of the status register.
const TRANSMISSION_COMPLETE: u16 = 1 << 6;

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
