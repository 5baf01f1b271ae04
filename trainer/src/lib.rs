//! Learns actor networks around the simulator's cell and the firmware's encoding, quantises them and exports weight tables.
//!
//! [`distil`] imitates the ring clock in a small [`network`]; [`quantise`] turns it into the firmware's integers and says
//! what that changed; [`export`] writes tables and files; [`evaluate`] compares float and int8 on held-out worlds.

pub mod actor_file;
pub mod actor_table;
pub mod algorithm;
#[cfg(feature = "program")]
pub mod command;
pub mod configuration;
pub mod distil;
pub mod evaluate;
pub mod evolution;
pub mod export;
pub mod first_networks;
pub mod forms;
pub mod game;
#[cfg(feature = "program")]
pub mod interquartile;
pub mod laboratory;
#[cfg(feature = "program")]
pub mod learning_curves;
pub mod maddpg;
pub mod mixture;
pub mod network;
pub mod onnx;
pub mod ppo;
pub mod provenance;
pub mod quantise;
pub mod run_folder;
#[cfg(feature = "program")]
pub mod signing;
#[cfg(feature = "program")]
pub mod study;
pub mod trained_actors;
#[cfg(feature = "program")]
pub mod training;
pub mod vdn;

pub use configuration::{Algorithm, Configuration, ConfigurationSource, Preset};
pub use evaluate::{Comparison, compare};
pub use kit::error::{Error, Result};
pub use laboratory::actors::Actors;
pub use laboratory::learner::Learner;
pub use network::Network;
pub use run_folder::RunFolder;
