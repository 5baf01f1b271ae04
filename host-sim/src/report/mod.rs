//! What people and scripts read: tables, figures, files.

pub mod ages;
pub mod answers;
pub mod carried;
pub mod cell_figures;
pub mod chart;
pub mod decision_map;
pub mod html;
pub mod learning;
pub mod measured_traffic;
pub mod pages;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod table;
pub mod terminal;
pub mod traffic;
