//! A unit on a RISC-V: a SiFive FE310, as QEMU's `sifive_e` has it. The program uses RV32IMC alone, without atomic operations.
#![no_std]
#![no_main]

mod chip;

use board::line::{FromModem, ToModem};
use embassy_executor::Spawner;
use firmware::lots::Identity;
use firmware::session::Session;
use firmware::tables::DISTILLED;
use firmware::unit::Unit;

#[embassy_executor::main]
async fn main(_spawner: Spawner) -> ! {
    // A task lives in a static place, and its session with it.
    let mut session = Session::new(Unit::new(DISTILLED, Identity::of_device(chip::number())));
    // QEMU, whose modem says how long a slot is; without this line the program is for a chip.
    session.set_in_emulator(true);
    chip::start();
    unit::run(&mut session, FromModem, ToModem(chip::send)).await
}
