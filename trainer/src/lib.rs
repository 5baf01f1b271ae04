//! Learns actor networks around the simulator's cell and the firmware's encoding, quantises them and exports weight tables.
//!
//! [`distil`] imitates the AoI clock in a small [`network`]; [`quantise`] turns it into the firmware's integers and says
//! what that changed; [`export`] writes tables and files; [`evaluate`] compares float and int8 on held-out worlds.

pub mod actor_file;
pub mod actor_table;
pub mod command;
pub mod configuration;
pub mod distil;
pub mod evaluate;
pub mod evolution;
pub mod export;
pub mod forms;
pub mod game;
pub mod laboratory;
pub mod learning_curves;
pub mod maddpg;
pub mod network;
pub mod onnx;
pub mod ppo;
pub mod provenance;
pub mod quantise;
pub mod run_folder;
pub mod study;
pub mod trained_actors;
