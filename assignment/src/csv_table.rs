//! Tables with a header line, whose columns come in any order: every error names file, line and column.

use kit::error::{Error, Result};
use kit::files::Text;
use std::str::FromStr;

/// A table whose columns are found by name.
pub(crate) struct CsvTable {
    name: String,
    columns: Vec<String>,
    /// Fields of each row, and the line that it begins on.
    rows: Vec<(u64, csv::StringRecord)>,
}

/// One row of a table.
#[derive(Clone, Copy)]
pub(crate) struct Row<'t> {
    table: &'t CsvTable,
    line: u64,
    fields: &'t csv::StringRecord,
}

impl CsvTable {
    pub(crate) fn parse(Text { name, text }: &Text) -> Result<Self> {
        let broken = |failure: csv::Error| {
            let line = failure.position().map_or(1, csv::Position::line);
            let found = match failure.kind() {
                csv::ErrorKind::UnequalLengths { len, .. } => format!("{len} columns"),
                _ => failure.to_string(),
            };
            Error::input(
                format!("{name}:{line}"),
                found,
                "as many columns as the first line has",
            )
        };
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
        let columns: Vec<String> = reader
            .headers()
            .map_err(broken)?
            .iter()
            .map(str::to_owned)
            .collect();
        for (index, column) in columns.iter().enumerate() {
            if columns[..index].contains(column) {
                let found = format!("a second column `{column}`");
                return Err(Error::input(format!("{name}:1"), found, "each column once"));
            }
        }
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(broken)?;
            let line = record.position().map_or(1, csv::Position::line);
            rows.push((line, record));
        }
        Ok(Self {
            name: name.to_owned(),
            columns,
            rows,
        })
    }

    /// Index of a column that must be there.
    pub(crate) fn column(&self, column: &str) -> Result<usize> {
        self.optional_column(column).ok_or_else(|| {
            let found = format!("no column `{column}`");
            Error::input(format!("{}:1", self.name), found, "it in the first line")
        })
    }

    /// Index of a column that may be missing.
    pub(crate) fn optional_column(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|known| known == column)
    }

    pub(crate) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, fields)| Row {
            table: self,
            line: *line,
            fields,
        })
    }
}

impl<'t> Row<'t> {
    /// `FILE:LINE`.
    pub(crate) fn place(&self) -> String {
        format!("{}:{}", self.table.name, self.line)
    }

    /// The field of a column; empty if the column is missing.
    pub(crate) fn text(&self, column: Option<usize>) -> &'t str {
        column.and_then(|column| self.fields.get(column)).unwrap_or("")
    }

    /// An error about a field.
    pub(crate) fn refuse(&self, column: usize, expected: &str) -> Error {
        let name = self.table.columns.get(column).map_or("", String::as_str);
        let found = format!("`{}`", self.text(Some(column)));
        Error::input(format!("{}: {name}", self.place()), found, expected)
    }

    /// A field that must be there.
    pub(crate) fn value<T: FromStr>(&self, column: usize, expected: &str) -> Result<T> {
        let text = self.text(Some(column));
        text.parse().map_err(|_| self.refuse(column, expected))
    }

    /// A finite number, not negative.
    pub(crate) fn amount(&self, column: usize) -> Result<f64> {
        let expected = "a finite number, not negative";
        let number: f64 = self.value(column, expected)?;
        if number.is_finite() && number >= 0.0 {
            return Ok(number);
        }
        Err(self.refuse(column, expected))
    }

    /// A finite number, not negative; none where the column or the field is empty.
    pub(crate) fn optional_amount(&self, column: Option<usize>) -> Result<Option<f64>> {
        match column {
            Some(column) if !self.text(Some(column)).is_empty() => self.amount(column).map(Some),
            _ => Ok(None),
        }
    }
}
