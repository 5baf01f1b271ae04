//! A serial line whose interrupt receives and whose sender waits for the register: a frame of 14 bytes is soon out.

use core::convert::Infallible;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_io_async::{ErrorType, Read, Write};

/// Holds what comes during the longest decision, as at least one frame must fit (chosen).
const CAPACITY: usize = 256;

static RECEIVED: Pipe<CriticalSectionRawMutex, CAPACITY> = Pipe::new();

/// Takes a byte from the line. The board's interrupt calls it. Where there is no room the byte is lost, and with it its frame.
pub fn received(byte: u8) {
    let _ = RECEIVED.try_write(&[byte]);
}

/// The bytes that the interrupt received.
#[derive(Debug)]
pub struct FromModem;

impl ErrorType for FromModem {
    type Error = Infallible;
}

impl Read for FromModem {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        Ok(RECEIVED.read(bytes).await)
    }
}

/// The line's sender: a function that writes one byte when the line can take it.
#[derive(Debug)]
pub struct ToModem(pub fn(u8));

impl ErrorType for ToModem {
    type Error = Infallible;
}

impl Write for ToModem {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        bytes.iter().for_each(|&byte| (self.0)(byte));
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
