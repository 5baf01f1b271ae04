//! What stands between people and every program of the product: errors that they can act on, choices that they make by
//! name, configurations whose keys explain themselves, files that appear whole or not at all, and lines on standard output.
//!
//! It knows no cell, no road and no network.

pub mod choice;
pub mod error;
pub mod files;
pub mod keys;
pub mod layers;
pub mod output;
pub mod text;
