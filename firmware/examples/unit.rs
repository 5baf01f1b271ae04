//! A unit on a host: frames from standard input, answers to standard output, so that a modem can be written before there is a board.
//!
//! ```console
//! $ cargo build -p firmware --example unit
//! $ python3 python/examples/modem.py talk --slots 100 -- target/debug/examples/unit
//! ```

use firmware::link::encode;
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use std::io::{Read, Write, stdin, stdout};

fn main() -> std::io::Result<()> {
    let mut session = Session::new(Unit::new(DISTILLED, Identity(0)));
    session.set_in_emulator(true);
    let mut to_modem = stdout();
    // No timer: every slot waits for its frame.
    for byte in stdin().lock().bytes() {
        if let Some(Request::Answer(message)) = session.byte(byte?)
            && let Ok(frame) = encode(&message)
        {
            to_modem.write_all(&frame)?;
            to_modem.flush()?;
        }
    }
    Ok(())
}
