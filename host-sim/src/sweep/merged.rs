//! All results of a grid as one table, in the grid's order.

use super::axis::{Kind, POLICY, SEED, text};
use super::{Grid, Kept, Outcome, Point, Store};
use crate::report::table::{Column, Table};
use kit::error::{Error, Result};
use toml::Value;

/// What lies in the folders of a grid.
pub struct Merged {
    /// Points with their outcomes, in the grid's order.
    pub present: Vec<(Point, Outcome)>,
    /// Indices of the points without.
    pub missing: Vec<usize>,
    /// Files that are no results.
    pub damaged: Vec<Error>,
}

impl Merged {
    /// Reads every result. A point may lie in several folders if its outcomes agree.
    ///
    /// # Errors
    /// A file that cannot be read, or a point with two outcomes.
    pub fn read(grid: &Grid, stores: &[Store]) -> Result<Self> {
        let mut merged = Self {
            present: Vec::new(),
            missing: Vec::new(),
            damaged: Vec::new(),
        };
        for index in 0..grid.points() {
            let mut found: Option<(&Store, Outcome)> = None;
            for store in stores {
                let outcome = match store.kept(index)? {
                    Kept::Outcome(outcome) => outcome,
                    Kept::Nothing => continue,
                    Kept::Damaged(error) => {
                        merged.damaged.push(error);
                        continue;
                    }
                };
                match &found {
                    Some((first, other)) if *other != outcome => {
                        let place = store.point_path(index);
                        let expected = format!("the one of {}", first.point_path(index).display());
                        return Err(Error::input(place.display(), "another outcome", expected));
                    }
                    Some(_) => {}
                    None => found = Some((store, outcome)),
                }
            }
            match found {
                Some((_, outcome)) => merged.present.push((grid.point(index), outcome)),
                None => merged.missing.push(index),
            }
        }
        Ok(merged)
    }

    /// One row a point that is present: its index, the grid's settings, policy and seed, how much was computed, what came
    /// out.
    ///
    /// # Errors
    /// Never, for keys of a checked grid.
    pub fn table(&self, grid: &Grid) -> Result<Table> {
        let present = || self.present.iter();
        let mut columns = vec![Column::unsigned(
            "point",
            present().map(|(point, _)| point.index as u64),
        )];
        let command = grid.command();
        let counted = |key: &str| command.counts.iter().any(|column| column.name == key);
        let mut last = Vec::new();
        for (index, axis) in grid.axes().iter().enumerate() {
            let values = present().map(|(point, _)| grid.value(point, index));
            let column = match axis.kind {
                Kind::Integer => Column::unsigned(
                    &axis.key,
                    values.map(|value| value.as_integer().map(i64::cast_unsigned)),
                ),
                Kind::Number => Column::number(&axis.key, values.map(Value::as_float)),
                Kind::Flag | Kind::Text | Kind::File(_) | Kind::Mobility | Kind::Network(_) => {
                    Column::text(&axis.key, values.map(text))
                }
            };
            if axis.key == POLICY || axis.key == SEED {
                last.push(column);
            } else if !counted(&axis.key) {
                columns.push(column);
            }
        }
        columns.extend(last);
        let outcomes = || present().map(|(_, outcome)| outcome);
        for column in command.counts {
            let counts = outcomes().map(|outcome| outcome.count(column.name));
            columns.push(Column::unsigned(column.name, counts));
        }
        for column in command.numbers {
            let numbers = outcomes().map(|outcome| outcome.number(column.name));
            columns.push(Column::number(column.name, numbers));
        }
        Table::new(columns)
    }
}

/// Indices for people: `3, 17 to 20`, and how many more.
pub fn listed(indices: &[usize]) -> String {
    /// Ranges that are written out (chosen).
    const SHOWN: usize = 10;
    let ranges: Vec<&[usize]> = indices.chunk_by(|one, next| one + 1 == *next).collect();
    let mut parts: Vec<String> = ranges
        .iter()
        .take(SHOWN)
        .map(|range| match range {
            [first, .., last] => format!("{first} to {last}"),
            one => one.iter().map(usize::to_string).collect(),
        })
        .collect();
    if ranges.len() > SHOWN {
        let more: usize = ranges[SHOWN..].iter().map(|range| range.len()).sum();
        parts.push(format!("and {more} more"));
    }
    parts.join(", ")
}
