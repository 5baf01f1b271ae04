//! The lines around a [`Session`] on a chip with Embassy. Serial line and time are whatever the chip's HAL gives: its interrupt-driven
//! UARTs implement the traits of `embedded-io-async`, and its time driver stands behind `embassy-time`.
#![no_std]

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Ticker};
use embedded_io_async::{Read, Write};
use firmware::link::encode;
use firmware::session::{Request, Session};

/// Decides slots for ever: bytes from the modem and ticks of the slot clock in, answers out.
///
/// `from_modem` must keep bytes that come while nobody reads, at least a frame's, and lose none when a read is dropped before
/// it is done: buffered UARTs do both.
pub async fn run(session: &mut Session<'_>, mut from_modem: impl Read, mut to_modem: impl Write) -> ! {
    let mut ticks = ticker(session.clock().tick_microseconds());
    let mut bytes = [0; 32];
    loop {
        // Bytes before ticks, as `select` looks at its first future first: a frame that is complete is not overdue.
        match select(from_modem.read(&mut bytes), ticks.next()).await {
            Either::First(received) => {
                // A byte that the line lost costs its frame, whose checksum then fails.
                let mut bytes = bytes.get(..received.unwrap_or(0)).unwrap_or_default();
                while !bytes.is_empty() {
                    let request = session.take(&mut bytes);
                    if let Some(period) = session.timer_restart() {
                        ticks = ticker(period);
                    }
                    answer(request, &mut to_modem).await;
                }
            }
            Either::Second(()) => answer(session.tick(), &mut to_modem).await,
        }
    }
}

fn ticker(microseconds: u32) -> Ticker {
    Ticker::every(Duration::from_micros(u64::from(microseconds)))
}

async fn answer(request: Option<Request>, to_modem: &mut impl Write) {
    // An update's step stays unanswered: this unit has no flash to keep tables in.
    if let Some(Request::Answer(message)) = request
        && let Ok(frame) = encode(&message)
    {
        // An answer that does not go out is a silent slot, and the modem sees it.
        let _ = to_modem.write_all(&frame).await;
    }
}
