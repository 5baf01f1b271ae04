//! Firmware in the loop: images in QEMU act as vehicles of the simulated cell.
//!
//! * [`emulator`]: one image in QEMU, with the modem's end of its serial line. The tests use it, too.
//! * [`fleet`]: the slots of a cell whose first vehicles are emulated.

pub mod emulator;
pub mod fleet;
