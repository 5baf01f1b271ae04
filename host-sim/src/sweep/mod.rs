//! Parameter sweeps: a [`Grid`] of points, computed in shards, kept in a [`Store`], merged into one table.
//!
//! A point is one run of one of the [`commands`]. It is stored in a file of its own, which appears whole or not at all, so
//! a sweep may be split into any number of shards, killed and repeated: what is there is skipped, and [`merged`] bytes
//! depend on the grid alone.

pub mod axis;
pub mod commands;
pub mod figure;
pub mod grid;
pub mod merged;
pub mod outcome;
pub mod settings;
pub mod store;

pub use grid::{Grid, Point};
pub use outcome::Outcome;
pub use settings::Settings;
pub use store::{Kept, Store};
