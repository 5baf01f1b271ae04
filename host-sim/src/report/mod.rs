//! What people and scripts read: tables, figures, files.

pub mod ages;
pub mod cell;
pub mod chart;
pub mod csv;
pub mod files;
pub mod output;
pub mod text_table;
pub mod traffic;
