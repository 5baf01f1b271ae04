//! What people and scripts read: tables, figures, files.

pub mod ages;
pub mod cell;
pub mod cell_figures;
pub mod chart;
pub mod columns;
pub mod csv;
pub mod html;
pub mod learning;
pub mod measured_traffic;
pub mod pages;
pub mod parquet;
pub mod text_table;
pub mod traffic;
