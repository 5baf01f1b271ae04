//! Tables for scripts: comma-separated values.

use super::cell::Cell;

/// A table as CSV text of `COLUMNS` columns.
///
/// Numbers are written in Rust's shortest form that reads back as the same bits, whatever the platform or locale; a
/// missing value is an empty field. Lines end in `\n`. A number that is not finite is written `NaN`, `inf` or `-inf`.
///
/// # Source
/// Quoting follows RFC 4180, section 2, items 5 to 7; its CRLF line ends are not taken over.
#[derive(Debug, Clone)]
pub struct Csv<const COLUMNS: usize> {
    text: String,
}

impl<const COLUMNS: usize> Csv<COLUMNS> {
    /// A table without rows. A column's name carries its unit: `mean_age_ms`.
    pub fn new(header: [&str; COLUMNS]) -> Self {
        let mut table = Self { text: String::new() };
        table.row(header.map(Cell::from));
        table
    }

    /// Appends a row.
    pub fn row(&mut self, cells: [Cell; COLUMNS]) {
        push_row(&mut self.text, cells);
    }

    /// The whole text, ready for [`write_whole`](kit::files::write_whole).
    pub fn into_text(self) -> String {
        self.text
    }
}

/// Appends a row of any number of cells.
pub(super) fn push_row(text: &mut String, cells: impl IntoIterator<Item = Cell>) {
    for (index, cell) in cells.into_iter().enumerate() {
        if index > 0 {
            text.push(',');
        }
        match cell {
            Cell::Text(value) => push_escaped(text, &value),
            Cell::Count(count) => *text += &count.to_string(),
            Cell::Integer(integer) => *text += &integer.to_string(),
            Cell::Number(number) => *text += &number.to_string(),
            Cell::Missing => {}
        }
    }
    text.push('\n');
}

fn push_escaped(text: &mut String, value: &str) {
    let bare = !value.contains([',', '"', '\n', '\r']) && value.trim() == value;
    if bare {
        *text += value;
    } else {
        text.push('"');
        *text += &value.replace('"', "\"\"");
        text.push('"');
    }
}
