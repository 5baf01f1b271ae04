//! The cell around the firmware: base station, radio channel, age of information and traffic assignment.

pub mod assignment;
pub mod capacity;
pub mod command;
pub mod error;
pub mod mobility;
pub mod report;
