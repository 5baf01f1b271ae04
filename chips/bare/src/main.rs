//! Frames in, answers out on any processor: no executor, no driver, nothing of a chip but its memory map. The debugger's console is the line
//! to the modem (semihosting), so that this runs on any emulated machine; a program for the road has a serial line and a timer instead.
#![no_std]
#![no_main]

use core::hint::black_box;
use firmware::link::encode;
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use semihosting::io::{Read, Result, Write, stdin, stdout};
use semihosting::process::ExitCode;

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    match answer_all() {
        Ok(()) => ExitCode::SUCCESS.exit_process(),
        Err(_) => ExitCode::FAILURE.exit_process(),
    }
}

/// Answers until the line ends.
fn answer_all() -> Result<()> {
    let (mut from_modem, mut to_modem) = (stdin()?, stdout()?);
    // Hidden, so that the table is read when the unit starts and not when the program is built.
    let mut session = Session::new(Unit::new(black_box(DISTILLED), Identity(0)));
    session.set_in_emulator(true);
    let mut byte = [0];
    while from_modem.read(&mut byte)? == 1 {
        let [byte] = byte;
        if let Some(Request::Answer(message)) = session.byte(byte)
            && let Ok(frame) = encode(&message)
        {
            to_modem.write_all(&frame)?;
        }
    }
    Ok(())
}
