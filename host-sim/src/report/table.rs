//! Tables, column by column, each of one type: aligned text and [`html`](super::html) for people, CSV and
//! [`parquet`](super::parquet) for scripts.

use kit::error::{Error, Result};
use kit::text::{WIDTH, wrapped};
use std::fmt;

/// What people see for a missing value.
const MISSING: &str = "-";

/// Spaces between two columns.
const GAP: &str = "  ";

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

    /// A value that is not missing, in Rust's shortest form that reads back as the same bits, whatever the platform or locale.
    fn exact(&self, row: usize) -> Option<String> {
        match self {
            Self::Text(values) => values[row].clone(),
            Self::Unsigned(values) => values[row].map(|value| value.to_string()),
            Self::Signed(values) => values[row].map(|value| value.to_string()),
            Self::Number(values) => values[row].map(|value| value.to_string()),
        }
    }
}

/// Where people see a column; the data have it always.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seen {
    Always,
    /// On a terminal where there is room.
    WithRoom,
    Never,
}

/// A named column of one type. In files its name carries its unit: `mean_age_ms`.
///
/// Values are given as they are, or as options where some are missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub(super) name: String,
    pub(super) values: Values,
    head: String,
    unit: String,
    decimals: Option<usize>,
    seen: Seen,
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
            head: name.to_owned(),
            unit: String::new(),
            decimals: None,
            seen: Seen::Always,
        }
    }

    /// What people see: another name with the unit below it, empty for a pure number, and measured numbers with so many decimals.
    pub fn shown(self, head: &str, unit: &str, decimals: usize) -> Self {
        Self {
            head: head.to_owned(),
            unit: unit.to_owned(),
            decimals: Some(decimals),
            ..self
        }
    }

    /// In CSV and Parquet alone: nothing that people have to look at.
    pub fn unseen(self) -> Self {
        Self {
            seen: Seen::Never,
            ..self
        }
    }

    /// On a terminal only where there is room: what people can miss first.
    pub fn aside(self) -> Self {
        Self {
            seen: Seen::WithRoom,
            ..self
        }
    }

    /// The name that people see.
    pub fn head(&self) -> &str {
        &self.head
    }

    /// The unit that people see; may be empty.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// Whether it holds text, aligned left.
    pub const fn is_text(&self) -> bool {
        matches!(self.values, Values::Text(_))
    }

    /// A value as people see it.
    pub fn written(&self, row: usize) -> String {
        match (&self.values, self.decimals) {
            (Values::Number(values), Some(decimals)) => {
                values[row].map(|number| format!("{number:.decimals$}"))
            }
            (values, _) => values.exact(row),
        }
        .unwrap_or_else(|| MISSING.to_owned())
    }

    /// Its lines in a table for people, all of one width.
    fn lines(&self, with_units: bool) -> Vec<String> {
        let mut lines = vec![self.head.clone()];
        lines.extend(with_units.then(|| self.unit.clone()));
        let heads = lines.len();
        lines.extend((0..self.values.len()).map(|row| self.written(row)));
        let width = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
        lines.insert(heads, "-".repeat(width));
        for line in &mut lines {
            *line = if self.is_text() {
                format!("{line:<width$}")
            } else {
                format!("{line:>width$}")
            };
        }
        lines
    }
}

fn collect<T>(values: impl IntoIterator<Item = impl Into<Option<T>>>) -> Vec<Option<T>> {
    values.into_iter().map(Into::into).collect()
}

/// A table of typed columns, all of one length. Its [`Display`](fmt::Display) is the text for people, which ends in a line break: columns that
/// people can miss are left out where they do not fit a terminal. `{:#}` has them all.
///
/// Widths are counted in characters: right for the Latin and Greek letters, digits and signs used here, not for
/// scripts whose characters are two cells wide.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    title: String,
    columns: Vec<Column>,
    rows: usize,
    notes: Vec<String>,
}

impl Table {
    /// A table without title and notes.
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
        Ok(Self {
            title: String::new(),
            columns,
            rows,
            notes: Vec::new(),
        })
    }

    /// With a line above the table.
    pub fn titled(self, title: &str) -> Self {
        let title = title.to_owned();
        Self { title, ..self }
    }

    /// Appends a line below the table, such as how many worlds and slots stand behind it.
    pub fn note(&mut self, line: &str) {
        self.notes.push(line.to_owned());
    }

    /// The line above the table; may be empty.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The columns, in their order.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Those that people see.
    pub fn shown_columns(&self) -> Vec<&Column> {
        self.columns
            .iter()
            .filter(|column| column.seen != Seen::Never)
            .collect()
    }

    /// Values of each column.
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// The lines below the table.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The columns as CSV text. A missing value is an empty field; lines end in `\n`; a number that is not finite is `NaN`, `inf` or
    /// `-inf`.
    ///
    /// # Source
    /// Quoting follows RFC 4180, section 2, items 5 to 7; its CRLF line ends are not taken over.
    pub fn to_csv(&self) -> String {
        let line = |fields: Vec<String>| fields.join(",") + "\n";
        let header = self.columns.iter().map(|column| escaped(column.name.clone()));
        let rows = (0..self.rows).map(|row| {
            let fields = self.columns.iter();
            fields
                .map(|column| column.values.exact(row).map_or(String::new(), escaped))
                .collect()
        });
        std::iter::once(header.collect()).chain(rows).map(line).collect()
    }
}

fn escaped(field: String) -> String {
    if field.contains([',', '"', '\n', '\r']) || field.trim() != field {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field
    }
}

impl fmt::Display for Table {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.title.is_empty() {
            writeln!(formatter, "{}", wrapped(&self.title, ""))?;
        }
        let shown = self.shown_columns();
        let with_units = shown.iter().any(|column| !column.unit.is_empty());
        let mut columns: Vec<(&Column, Vec<String>)> = shown
            .iter()
            .map(|column| (*column, column.lines(with_units)))
            .collect();
        let width = |columns: &[(&Column, Vec<String>)]| -> usize {
            let widths = columns.iter().filter_map(|(_, lines)| lines.first());
            widths.map(|line| line.chars().count() + GAP.len()).sum()
        };
        let mut left_out = Vec::new();
        while !formatter.alternate() && width(&columns) > WIDTH + GAP.len() {
            let Some(last) = columns
                .iter()
                .rposition(|(column, _)| column.seen == Seen::WithRoom)
            else {
                break;
            };
            left_out.insert(0, columns.remove(last).0.head());
        }
        let columns: Vec<Vec<String>> = columns.into_iter().map(|(_, lines)| lines).collect();
        for line in 0..columns.first().map_or(0, Vec::len) {
            let cells: Vec<&str> = columns.iter().map(|column| column[line].as_str()).collect();
            writeln!(formatter, "{}", cells.join(GAP).trim_end())?;
        }
        for note in &self.notes {
            writeln!(formatter, "{}", wrapped(note, ""))?;
        }
        if !left_out.is_empty() {
            writeln!(
                formatter,
                "{}",
                wrapped(&format!("With --wide also: {}.", left_out.join(", ")), "")
            )?;
        }
        Ok(())
    }
}
