//! Tables with a header line, whose columns come in any order: every error names file, line and column.

use crate::report::{ImportReport, NoteKind};
use kit::error::{Error, Result};
use kit::files::Text;
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::HashSet;
use std::path::Path;
use std::str::FromStr;

/// A table whose columns are found by name.
pub(crate) struct CsvTable {
    name: String,
    columns: Vec<String>,
    /// Which columns somebody asked for.
    asked: RefCell<Vec<bool>>,
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
    /// A table with all its rows.
    pub(crate) fn parse(text: &Text) -> Result<Self> {
        let (mut table, mut reader) = Self::head(text)?;
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|failure| broken(&text.name, &failure))?;
            rows.push((line(&record), record));
        }
        table.rows = rows;
        Ok(table)
    }

    /// A table without rows, and the reader that gives them one by one to [`each_row`](Self::each_row).
    pub(crate) fn head(Text { name, text }: &Text) -> Result<(Self, csv::Reader<&[u8]>)> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
        let columns: Vec<String> = reader
            .headers()
            .map_err(|failure| broken(name, &failure))?
            .iter()
            .map(str::to_owned)
            .collect();
        if let [only] = &columns[..]
            && only.contains([';', '\t'])
        {
            let expected = "columns with commas between them";
            return Err(Error::input(format!("{name}:1"), format!("`{only}`"), expected));
        }
        let mut seen = HashSet::new();
        for column in &columns {
            if !seen.insert(column) {
                let found = format!("a second column `{column}`");
                return Err(Error::input(format!("{name}:1"), found, "each column once"));
            }
        }
        let table = Self {
            name: name.to_owned(),
            asked: RefCell::new(vec![false; columns.len()]),
            columns,
            rows: Vec::new(),
        };
        Ok((table, reader))
    }

    /// Visits the rows of a table that is too long to be kept, and counts them.
    pub(crate) fn each_row(
        &self,
        mut reader: csv::Reader<&[u8]>,
        mut visit: impl FnMut(Row<'_>) -> Result<()>,
    ) -> Result<usize> {
        let mut record = csv::StringRecord::new();
        let mut count = 0;
        while reader
            .read_record(&mut record)
            .map_err(|failure| broken(&self.name, &failure))?
        {
            visit(Row {
                table: self,
                line: line(&record),
                fields: &record,
            })?;
            count += 1;
        }
        Ok(count)
    }

    /// Index of a column that must be there.
    pub(crate) fn column(&self, column: &str) -> Result<usize> {
        self.optional_column(column).ok_or_else(|| {
            let found = format!("no column `{column}`");
            Error::input(format!("{}:1", self.name), found, "it in the first line")
        })
    }

    /// Index of a column that may be missing. One that differs in upper and lower case alone is taken where none is the same.
    pub(crate) fn optional_column(&self, column: &str) -> Option<usize> {
        let same = self.columns.iter().position(|known| known == column);
        let found = same.or_else(|| {
            self.columns
                .iter()
                .position(|known| known.eq_ignore_ascii_case(column))
        })?;
        self.asked.borrow_mut()[found] = true;
        Some(found)
    }

    /// Index of the first of several columns that is there.
    pub(crate) fn any_column(&self, columns: &[&str]) -> Option<usize> {
        columns.iter().find_map(|column| self.optional_column(column))
    }

    /// What errors call the table.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Names of the columns.
    pub(crate) fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Names of the columns that nobody asked for.
    pub(crate) fn unread(&self) -> impl Iterator<Item = &str> {
        let asked = self.asked.borrow().clone();
        let columns = self.columns.iter().zip(asked);
        columns
            .filter(|(name, asked)| !asked && !name.is_empty())
            .map(|(name, _)| name.as_str())
    }

    /// Says which columns were read, and which were not.
    pub(crate) fn report(&self, report: &mut ImportReport) {
        self.report_rows(self.rows.len(), report);
    }

    /// The same of a table whose so many rows were visited.
    pub(crate) fn report_rows(&self, rows: usize, report: &mut ImportReport) {
        let asked = self.asked.borrow();
        let names = |wanted: bool| {
            let columns = self.columns.iter().zip(asked.iter());
            let names = columns.filter(|(name, asked)| **asked == wanted && !name.is_empty());
            let names: Vec<&str> = names.map(|(name, _)| name.as_str()).collect();
            names.join(", ")
        };
        let file = file_name(&self.name);
        report.count(NoteKind::Read, &file, format!("rows of {}", names(true)), rows);
        let unused = names(false);
        if !unused.is_empty() {
            report.say(NoteKind::Unused, &file, format!("columns {unused}"));
        }
    }

    pub(crate) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, fields)| Row {
            table: self,
            line: *line,
            fields,
        })
    }
}

/// The line that a record begins on.
fn line(record: &csv::StringRecord) -> u64 {
    record.position().map_or(1, csv::Position::line)
}

/// A row that is none.
fn broken(name: &str, failure: &csv::Error) -> Error {
    let line = failure.position().map_or(1, csv::Position::line);
    let found = match failure.kind() {
        csv::ErrorKind::UnequalLengths { len, .. } => format!("{len} columns"),
        _ => failure.to_string(),
    };
    let expected = "as many columns as the first line has";
    Error::input(format!("{name}:{line}"), found, expected)
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

    /// A field that names something: a whole number that tables wrote with decimals, such as `1.0`, is `1`.
    pub(crate) fn id(&self, column: Option<usize>) -> &'t str {
        id(self.text(column))
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

/// A name as files mean it: `1.0` is `1`.
pub(crate) fn id(text: &str) -> &str {
    match text.split_once('.') {
        Some((whole, zeros))
            if !whole.is_empty()
                && whole.bytes().all(|byte| byte.is_ascii_digit())
                && zeros.bytes().all(|byte| byte == b'0') =>
        {
            whole
        }
        _ => text,
    }
}

/// The last part of a path, for reports.
pub(crate) fn file_name(path: &str) -> Cow<'_, str> {
    Path::new(path)
        .file_name()
        .map_or(Cow::Borrowed(path), |name| name.to_string_lossy())
}
