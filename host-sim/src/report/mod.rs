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

use crate::age::AgeSummary;
use crate::traffic::TrafficSummary;

/// One policy's result.
pub struct PolicyResult {
    /// Which.
    pub name: &'static str,
    /// Its ages.
    pub ages: AgeSummary,
    /// What they do to the road; `None` with a trace.
    pub traffic: Option<TrafficSummary>,
    /// Simulated slots (all worlds, warm-up included) per second of wall time.
    pub slots_per_second: f64,
}
