//! The cell in the browser: [`host_sim`]'s environment and the firmware's actor, as a page drives and sees them.
//!
//! The page loads this crate as WebAssembly. It speaks through [`exports`]: text goes in and out through one buffer, everything
//! that is drawn is read where it lies in memory ([`session`] and [`town`] have the layouts). Nothing is simulated here: [`run`] lets a policy
//! decide and the environment step, as the command line does, so the numbers are the same to the last digit.
//!
//! An instance holds one world after the other, but what a world borrows is kept for as long as the instance lives; the page
//! takes a new instance for a new world.

pub mod exports;
pub mod run;
pub mod session;
pub mod town;

/// The sources that decide what the program does, as a checksum (`web/build.rs` computes it). The committed program carries that of
/// its own.
pub const SOURCES: &str = concat!("freshlane sources ", env!("FRESHLANE_SOURCES"));
