//! What the library promises, checked against real numbers and independent formulas: one module for each part.
//!
//! With the feature `defmt` the same tests run with live logging into a counting stub.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

mod actor;
mod clock;
mod decision;
mod description;
mod flash;
mod form;
mod golden;
mod image_store;
mod link;
#[cfg(feature = "defmt")]
mod logging;
mod lots;
mod noise;
mod observation;
mod readings;
mod ring;
mod session;
mod signing;
mod table;
mod table_builder;
mod table_store;
mod telemetry;
mod tracker;
mod trial;
mod unit;

#[cfg(feature = "defmt")]
#[path = "../src/host_logger.rs"]
mod host_logger;
