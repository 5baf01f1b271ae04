//! What a connected-vehicle unit runs in every 1 ms slot: from what it alone can sense, decide on which sub-channel and
//! with what power to send to the base station, or to stay silent.
//!
//! The path of one slot:
//!
//! ```text
//! link::Receiver -> Measurement -> Observation -> actor::Actor -> Action -> Decision -> link::encode
//!                   `----------------- unit::Unit keeps what outlives a slot ----------------'
//! ```
//!
//! * [`units`]: slot index, age, sub-channel, levels, power.
//! * [`ring`]: whose turn it is. [`lots`]: private randomness that replays.
//! * [`measurement`]: what the modem hands over in a slot, validated once.
//! * [`observation`]: a measurement as the actor's int8 input; the normalisation lives there. [`reciprocal`](mod@reciprocal): division
//!   without a divider.
//! * [`network`]: dense int8 layers with an exact integer specification. [`actor`]: a table's network, from observation to decision.
//! * [`decision`]: actions and choices as sub-channel and power; total.
//! * [`clock`]: the rule that networks imitate, and that a unit falls back on.
//! * [`form`]: what a table's network sees and what its outputs mean.
//! * [`table`]: the weight-table format, read in place. [`tables`]: the tables built into the image.
//! * [`mod@unit`]: the state machine over slots, with its fallback when a measurement is missing.
//! * [`link`]: frames between modem and unit.
//! * [`slot_clock`]: when a slot is over although the modem said nothing.
//! * [`table_store`]: tables over the air: two flash slots, signatures, versions, trials. [`health`]: how a unit does with its table.
//! * [`session`]: all of these behind bytes and ticks; what the image runs.
//! * [`telemetry`]: counters for people; never part of a decision.
//!
//! The library is `no_std`, allocates nothing and cannot panic on any validated input. It knows no base station, no
//! reward, no channel model and no other vehicle. The simulator and the trainer call exactly this code; for rows of worlds the
//! simulator has a network of its own, and calls the rest lane by lane.
//!
//! # On your chip
//! A board has a serial line to the modem, a periodic timer, and these few lines; `docs/any-chip.md` and the programs in `chips/` have them for
//! a Cortex-M0, a Cortex-M33 and a RISC-V.
//!
//! ```toml
//! [dependencies]
//! firmware = { path = "freshlane/firmware", default-features = false }
//! ```
//!
//! ```
//! use firmware::link::{ModemFrame, encode};
//! use firmware::lots::Identity;
//! use firmware::session::{Request, Session};
//! use firmware::tables::DISTILLED;
//! use firmware::unit::Unit;
//!
//! /// What a board gives.
//! trait Board {
//!     fn send(&mut self, bytes: &[u8]);
//!     fn start_timer(&mut self, period_microseconds: u32);
//! }
//!
//! /// Called after every byte and after every tick.
//! fn serve(session: &mut Session<'_>, request: Option<Request>, board: &mut impl Board) {
//!     if let Some(period) = session.timer_restart() {
//!         board.start_timer(period);
//!     }
//!     if let Some(Request::Answer(message)) = request
//!         && let Ok(frame) = encode(&message)
//!     {
//!         board.send(&frame);
//!     }
//! }
//!
//! # #[derive(Default)]
//! # struct Desk { sent: Vec<u8>, period: u32 }
//! # impl Board for Desk {
//! #     fn send(&mut self, bytes: &[u8]) { self.sent.extend(bytes) }
//! #     fn start_timer(&mut self, period_microseconds: u32) { self.period = period_microseconds }
//! # }
//! # let mut board = Desk::default();
//! // The number is the chip's own, and no two units of a cell share one. Keep the session in a static place: it takes some 4.5 KB.
//! let mut session = Session::new(Unit::new(DISTILLED, Identity::of_device([1, 2, 3])));
//! board.start_timer(session.clock().tick_microseconds());
//!
//! // The serial line's interrupt: here with a frame that says that the modem measured nothing in slot 7.
//! let frame = encode(&ModemFrame::Missed { slot: 7 }).unwrap();
//! for &byte in &frame {
//!     let request = session.byte(byte);
//!     serve(&mut session, request, &mut board);
//! }
//! # assert!(!board.sent.is_empty());
//! # board.sent.clear();
//!
//! // The timer's interrupt: four ticks a slot, and one more says that the next frame is overdue.
//! for _ in 0..5 {
//!     let request = session.tick();
//!     serve(&mut session, request, &mut board);
//! }
//! # assert!(!board.sent.is_empty() && board.period == 250);
//! ```
//!
//! [`session::Request::Update`] is a step of a table's update; [`table_store`] takes it where a board has two flash sectors to spare, and a
//! board without them leaves it unanswered.
//!
//! # Features
//! * `stm32f405` (on by default): the image for that chip, its dependencies and its memory map. Off, the library has portable
//!   dependencies alone: no runtime, no register definitions, no critical section, no argument for the linker.
//! * `defmt`: logging through [defmt](https://defmt.ferrous-systems.com). The image logs over RTT; whoever else enables it must define a
//!   `#[defmt::global_logger]`.
//! * `semihosting`: the image logs over semihosting, for an emulator.
//! * `no-panic-proof`: the program of this name links only if nothing in it can panic. It accepts no table over the air.
//! * `measure`: the program that counts the image's instructions in an emulator.
//!
//! # Processors
//! The library runs on anything that `no_std` runs on, without atomic operations, and decides alike everywhere, to the byte. Where there is the
//! DSP extension of ARMv7E-M or ARMv8-M, [`network::Network::infer`] runs an assembly kernel. ARMv7E-M always has it; for ARMv8-M the build's flags
//! say so (`-C target-cpu=cortex-m33`).
#![no_std]
#![deny(
    missing_docs,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::expect_used,
    clippy::unwrap_used,
    clippy::arithmetic_side_effects
)]

mod fmt;

pub mod actor;
pub mod clock;
pub mod decision;
pub mod form;
pub mod health;
pub mod image_store;
pub mod link;
pub mod lots;
pub mod measurement;
pub mod network;
pub mod observation;
pub mod reciprocal;
pub mod ring;
pub mod session;
pub mod slot_clock;
pub mod table;
pub mod table_store;
pub mod tables;
pub mod telemetry;
pub mod tracker;
pub mod unit;
pub mod units;
