//! One value of a table, before it is written for people or for scripts.

/// A value in a row of a [`TextTable`](super::text_table::TextTable) or a [`Csv`](super::csv::Csv).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Cell {
    /// A name.
    Text(String),
    /// A count.
    Count(u64),
    /// A whole number that may be below zero.
    Integer(i64),
    /// A measured or computed number.
    Number(f64),
    /// A value that does not exist, which is not the same as zero.
    Missing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<u32> for Cell {
    fn from(count: u32) -> Self {
        Self::Count(u64::from(count))
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        Self::Count(count)
    }
}

impl From<i64> for Cell {
    fn from(integer: i64) -> Self {
        Self::Integer(integer)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        // No supported platform has a usize wider than 64 bits.
        Self::Count(count as u64)
    }
}

impl<T: Into<Self>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}
