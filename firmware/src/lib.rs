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
//! * [`table_store`]: tables over the air: two flash slots, signatures, versions.
//! * [`session`]: all of these behind bytes and ticks; what the image runs.
//! * [`telemetry`]: counters for people; never part of a decision.
//!
//! The library is `no_std`, allocates nothing and cannot panic on any validated input. It knows no base station, no
//! reward, no channel model and no other vehicle. The simulator and the trainer call exactly this code; for rows of worlds the
//! simulator has a network of its own, and calls the rest lane by lane.
//!
//! # Features
//! * `defmt`: logging through [defmt](https://defmt.ferrous-systems.com) (off by default). The image logs over RTT; a host
//!   program that enables it must define a `#[defmt::global_logger]`.
//! * `semihosting`: the image logs over semihosting, for an emulator.
//! * `no-panic-proof`: the image links only if nothing in it can panic. It accepts no table over the air.
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
