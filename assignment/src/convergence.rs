//! The convergence record as a file.

use crate::IterationRecord;
use std::fmt::Write as _;

/// First line of a convergence file.
pub const HEADER: &str = "iteration,relative_gap,objective,seconds";

/// One row per iteration, numbers with all their digits. All but the seconds are the same on every run.
pub fn format_convergence(records: &[IterationRecord]) -> String {
    let mut text = format!("{HEADER}\n");
    for record in records {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{}",
            record.iteration, record.relative_gap, record.objective, record.seconds
        );
    }
    text
}
