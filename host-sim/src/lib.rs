//! The cell around the firmware: base station, radio channel, age of information and traffic assignment.
//!
//! ```
//! use host_sim::policy::clock;
//! use host_sim::{ExperimentSource, Result};
//!
//! fn main() -> Result<()> {
//!     let source = ExperimentSource {
//!         policies: vec![&clock::KIND],
//!         worlds: Some(4),
//!         slots: Some(200),
//!         ..ExperimentSource::default()
//!     };
//!     let results = source.read()?.results(|_| ())?;
//!     assert!(results[0].ages.mean_ms < 10.0);
//!     Ok(())
//! }
//! ```
//!
//! One slot: [`mobility`] -> [`channel`] -> measurement -> [`policy`] (the firmware's units among them) -> decision ->
//! [`radio`] -> [`age`]; [`environment`] holds the loop, for many worlds side by side ([`lanes`]), [`simulation`] runs it,
//! and an [`experiment`] compares policies in it. What ages mean for the road: [`capacity`], [`traffic`] and the crate
//! [`assignment`]; [`closed_loop`] says what trips lose because the base station learns of the roads late, with the hours of [`journeys`]. Every random number comes from a keyed
//! [`stream`], so a seed gives the same bytes on any machine and for any number of threads. [`pack`] orders a network's
//! integers for the firmware's kernel.
//!
//! The feature `program`, on by default, adds the command line with everything that only programs need: reports, sweeps, and the
//! files of other programs. On top of it, likewise by default, what brings large libraries for few commands: `chip` has the chip's
//! images in QEMU (`hil`, `deadline`), `parquet` and `omx` these files.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over the lanes of several rows become vector instructions as they stand"
)]

pub mod activity;
pub mod age;
#[cfg(feature = "program")]
pub mod assign;
pub mod base_station;
pub mod capacity;
pub mod channel;
#[cfg(feature = "program")]
mod child;
mod churn;
pub mod closed_loop;
#[cfg(feature = "program")]
pub mod command;
#[cfg(feature = "chip")]
pub mod deadline;
pub mod decisions;
#[cfg(feature = "program")]
pub mod difference;
pub mod environment;
pub mod experiment;
#[cfg(feature = "chip")]
pub mod hil;
#[cfg(feature = "chip")]
pub mod image;
pub mod imperfections;
pub mod journeys;
pub mod lanes;
pub mod load;
pub mod mobility;
pub mod neighbours;
pub mod pack;
pub mod policy;
pub mod presence;
pub mod radio;
#[cfg(feature = "program")]
pub mod report;
pub mod revision;
pub mod scenario;
pub mod senses;
#[cfg(feature = "program")]
pub mod shard;
pub mod simulation;
pub mod stream;
#[cfg(feature = "program")]
mod sweep;
mod threads;
pub mod traffic;
pub mod truth;
pub mod weight_table;

pub use environment::Environment;
pub use experiment::{Experiment, ExperimentSource, PolicyResult};
pub use kit::error::{Error, Result};
pub use mobility::MobilitySource;
pub use policy::{Decider, KINDS, Kind, Policy, Scheduler};
pub use scenario::{Preset, Scenario, ScenarioSource};
#[cfg(feature = "program")]
pub use shard::Shard;
pub use simulation::{Extent, Simulation};
pub use threads::thread_pool;
pub use weight_table::WeightTable;
