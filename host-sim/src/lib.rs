//! The cell around the firmware: base station, radio channel, age of information and traffic assignment.
//!
//! One slot: [`mobility`] -> [`channel`] -> measurement -> [`policy`] (the firmware's units among them) -> decision ->
//! [`radio`] -> [`age`]; [`environment`] holds the loop, for many worlds side by side ([`lanes`]), and [`simulation`]
//! runs it. What ages mean for the road: [`capacity`], [`traffic`] and the crate [`assignment`]; [`closed_loop`] plans on the
//! [`roads`] that vehicles report. Every random number comes from a keyed [`stream`], so a seed gives the same bytes on
//! any machine and for any number of threads. [`pack`] orders a network's integers for the firmware's kernel, and
//! [`deadline`] says what that takes on the chip.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over the lanes of several rows become vector instructions as they stand"
)]

pub mod age;
pub mod base_station;
pub mod capacity;
pub mod channel;
pub mod churn;
pub mod closed_loop;
#[cfg(not(target_family = "wasm"))]
pub mod command;
#[cfg(not(target_family = "wasm"))]
pub mod deadline;
pub mod decisions;
pub mod environment;
#[cfg(not(target_family = "wasm"))]
pub mod hil;
pub mod lanes;
pub mod mobility;
pub mod pack;
pub mod policy;
pub mod presence;
pub mod radio;
#[cfg(not(target_family = "wasm"))]
pub mod report;
pub mod revision;
pub mod roads;
pub mod scenario;
pub mod senses;
pub mod simulation;
pub mod stream;
#[cfg(not(target_family = "wasm"))]
pub mod sweep;
pub mod traffic;
pub mod truth;
