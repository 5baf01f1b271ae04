//! Tables for scripts, column by column, each of one type: the source of a CSV text and of a [`parquet`](super::parquet)
//! file with the same rows.

use super::cell::Cell;
use super::csv::push_row;
use kit::error::{Error, Result};

/// The values of a column, one a row; `None` is a missing one, which is not the same as zero.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Values {
    /// UTF-8 text.
    Text(Vec<Option<String>>),
    /// Counts and indices.
    Unsigned(Vec<Option<u64>>),
    /// Integers below zero too.
    Signed(Vec<Option<i64>>),
    /// Measured or computed numbers.
    Number(Vec<Option<f64>>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Unsigned(values) => values.len(),
            Self::Signed(values) => values.len(),
            Self::Number(values) => values.len(),
        }
    }

    fn cell(&self, row: usize) -> Cell {
        match self {
            Self::Text(values) => values[row].clone().into(),
            Self::Unsigned(values) => values[row].into(),
            Self::Signed(values) => values[row].into(),
            Self::Number(values) => values[row].into(),
        }
    }
}

/// A named column of one type. Its name carries its unit: `mean_age_ms`.
///
/// Values are given as they are, or as options where some are missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub(super) name: String,
    pub(super) values: Values,
}

impl Column {
    /// A column of text.
    pub fn text(name: &str, values: impl IntoIterator<Item = impl Into<Option<String>>>) -> Self {
        Self::new(name, Values::Text(collect(values)))
    }

    /// A column of counts or indices.
    pub fn unsigned(name: &str, values: impl IntoIterator<Item = impl Into<Option<u64>>>) -> Self {
        Self::new(name, Values::Unsigned(collect(values)))
    }

    /// A column of integers that may be below zero.
    pub fn signed(name: &str, values: impl IntoIterator<Item = impl Into<Option<i64>>>) -> Self {
        Self::new(name, Values::Signed(collect(values)))
    }

    /// A column of measured or computed numbers.
    pub fn number(name: &str, values: impl IntoIterator<Item = impl Into<Option<f64>>>) -> Self {
        Self::new(name, Values::Number(collect(values)))
    }

    fn new(name: &str, values: Values) -> Self {
        Self {
            name: name.to_owned(),
            values,
        }
    }
}

fn collect<T>(values: impl IntoIterator<Item = impl Into<Option<T>>>) -> Vec<Option<T>> {
    values.into_iter().map(Into::into).collect()
}

/// A table of typed columns, all of one length.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    columns: Vec<Column>,
    rows: usize,
}

impl Columns {
    /// A table.
    ///
    /// # Errors
    /// [`Error::Input`] names the column that is not as long as the first, or whose name comes twice.
    pub fn new(columns: Vec<Column>) -> Result<Self> {
        let rows = columns.first().map_or(0, |column| column.values.len());
        for (index, column) in columns.iter().enumerate() {
            let place = || format!("column {}", column.name);
            if column.values.len() != rows {
                let found = format!("{} values", column.values.len());
                return Err(Error::input(place(), found, rows));
            }
            if columns[..index].iter().any(|other| other.name == column.name) {
                return Err(Error::input(place(), "its name twice", "once"));
            }
        }
        Ok(Self { columns, rows })
    }

    /// The columns, in their order.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Values of each column.
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// The table as CSV text, written as [`Csv`](super::csv::Csv) writes it.
    pub fn to_csv(&self) -> String {
        let mut text = String::new();
        push_row(
            &mut text,
            self.columns.iter().map(|column| column.name.as_str().into()),
        );
        for row in 0..self.rows {
            push_row(
                &mut text,
                self.columns.iter().map(|column| column.values.cell(row)),
            );
        }
        text
    }
}
