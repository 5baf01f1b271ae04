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
        for (index, cell) in cells.iter().enumerate() {
            if index > 0 {
                self.text.push(',');
            }
            match cell {
                Cell::Text(text) => self.push_escaped(text),
                Cell::Count(count) => self.text += &count.to_string(),
                Cell::Number(number) => self.text += &number.to_string(),
                Cell::Missing => {}
            }
        }
        self.text.push('\n');
    }

    /// The whole text, ready for [`write_whole`](super::files::write_whole).
    pub fn into_text(self) -> String {
        self.text
    }

    fn push_escaped(&mut self, text: &str) {
        let bare = !text.contains([',', '"', '\n', '\r']) && text.trim() == text;
        if bare {
            self.text += text;
        } else {
            self.text.push('"');
            self.text += &text.replace('"', "\"\"");
            self.text.push('"');
        }
    }
}
