//! The cell around the firmware: base station, radio channel, age of information and traffic assignment.
//!
//! One slot: [`mobility`] -> [`channel`] -> measurement -> [`policy`] (the firmware's units among them) -> decision ->
//! [`radio`] -> [`age`]; [`environment`] holds the loop, for many worlds side by side ([`lanes`]), and [`simulation`] runs it. What ages mean for the road:
//! [`capacity`], [`traffic`] and [`assignment`]. Every random number comes from a keyed [`stream`], so a seed gives the same bytes on any machine and for any
//! number of threads. [`pack`] orders a network's integers for the firmware's kernel, and
//! [`deadline`] says what that takes on the chip.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over the lanes of several rows become vector instructions as they stand"
)]

pub mod age;
pub mod assignment;
pub mod base_station;
pub mod capacity;
pub mod cell;
pub mod channel;
pub mod closed_loop;
pub mod command;
pub mod deadline;
pub mod decisions;
pub mod environment;
pub mod error;
pub mod hil;
pub mod lanes;
pub mod mobility;
pub mod pack;
pub mod policy;
pub mod radio;
pub mod report;
pub mod revision;
pub mod scenario;
pub mod simulation;
pub mod stream;
pub mod traffic;
