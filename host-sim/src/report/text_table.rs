//! Tables for people: aligned plain text on a terminal.

use super::cell::Cell;
use std::fmt;

/// What stands for a missing value.
const MISSING: &str = "-";

/// Spaces between two columns.
const GAP: &str = "  ";

/// A column's head, and how its values are written.
#[derive(Debug, Clone)]
pub struct Column {
    name: String,
    unit: String,
    /// `None` is a column of text, aligned left.
    decimals: Option<usize>,
}

impl Column {
    /// A column of names, aligned left.
    pub fn text(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            unit: String::new(),
            decimals: None,
        }
    }

    /// A column of numbers, aligned right, all with the same number of decimals. An empty unit is a pure number.
    pub fn number(name: &str, unit: &str, decimals: usize) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            decimals: Some(decimals),
        }
    }

    /// A cell as this column writes it. Whole numbers have no decimals, in whatever column they stand.
    fn written(&self, cell: &Cell) -> String {
        match cell {
            Cell::Text(text) => text.clone(),
            Cell::Count(count) => count.to_string(),
            Cell::Integer(integer) => integer.to_string(),
            Cell::Number(number) => match self.decimals {
                Some(decimals) => format!("{number:.decimals$}"),
                None => number.to_string(),
            },
            Cell::Missing => MISSING.to_owned(),
        }
    }

    fn padded(&self, text: &str, width: usize) -> String {
        match self.decimals {
            Some(_) => format!("{text:>width$}"),
            None => format!("{text:<width$}"),
        }
    }
}

/// A table of `COLUMNS` columns; its [`Display`](fmt::Display) is the text, which ends in a line break.
///
/// Widths are counted in characters: right for the Latin and Greek letters, digits and signs used here, not for
/// scripts whose characters are two cells wide.
#[derive(Debug, Clone)]
pub struct TextTable<const COLUMNS: usize> {
    title: String,
    columns: [Column; COLUMNS],
    rows: Vec<[String; COLUMNS]>,
    notes: Vec<String>,
}

impl<const COLUMNS: usize> TextTable<COLUMNS> {
    /// A table without rows. An empty title takes no line.
    pub fn new(title: &str, columns: [Column; COLUMNS]) -> Self {
        Self {
            title: title.to_owned(),
            columns,
            rows: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Appends a row.
    pub fn row(&mut self, cells: [Cell; COLUMNS]) {
        let row = std::array::from_fn(|index| self.columns[index].written(&cells[index]));
        self.rows.push(row);
    }

    /// Appends a line below the table, such as how many worlds and slots stand behind it.
    pub fn note(&mut self, line: &str) {
        self.notes.push(line.to_owned());
    }
}

impl<const COLUMNS: usize> fmt::Display for TextTable<COLUMNS> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: [String; COLUMNS] = std::array::from_fn(|index| self.columns[index].name.clone());
        let units: [String; COLUMNS] = std::array::from_fn(|index| self.columns[index].unit.clone());
        let with_units = units.iter().any(|unit| !unit.is_empty());
        let widths: [usize; COLUMNS] = std::array::from_fn(|index| {
            let cells = self
                .rows
                .iter()
                .chain([&names, &units])
                .map(|row| row[index].chars().count());
            cells.max().unwrap_or(0)
        });
        if !self.title.is_empty() {
            writeln!(formatter, "{}", self.title)?;
        }
        let mut line = |cells: &[String; COLUMNS]| {
            let padded: [String; COLUMNS] =
                std::array::from_fn(|index| self.columns[index].padded(&cells[index], widths[index]));
            writeln!(formatter, "{}", padded.join(GAP).trim_end())
        };
        line(&names)?;
        if with_units {
            line(&units)?;
        }
        line(&widths.map(|width| "-".repeat(width)))?;
        for row in &self.rows {
            line(row)?;
        }
        for note in &self.notes {
            writeln!(formatter, "{note}")?;
        }
        Ok(())
    }
}
