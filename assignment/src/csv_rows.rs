//! Rows of the CSV files that this module writes itself: a fixed header, then plain fields.

use kit::error::{Error, Result};

/// Every row that is not empty, with its place for errors: `name:line`.
///
/// # Errors
/// [`Error::Input`] for another header.
pub fn csv_rows<'t>(
    name: &str,
    text: &'t str,
    header: &str,
) -> Result<impl Iterator<Item = (String, &'t str)>> {
    let mut lines = (1..).zip(text.lines().map(str::trim));
    let found = lines.next().map_or("", |(_, line)| line);
    if found != header {
        return Err(Error::input(
            format!("{name}:1"),
            format!("`{found}`"),
            format!("`{header}`"),
        ));
    }
    let rows = lines.filter(|(_, line)| !line.is_empty());
    Ok(rows.map(move |(number, line)| (format!("{name}:{number}"), line)))
}
