//! Rows of the CSV files that this module writes itself: a fixed header, then plain fields.

use kit::error::{Error, Result};
use kit::files::Text;

/// The fields of every row that is not empty, with its place for errors: `name:line`.
///
/// # Errors
/// [`Error::Input`] for another header; a row's own for another number of fields.
pub fn csv_rows<'t, const FIELDS: usize>(
    Text { name, text }: &'t Text,
    header: &'static str,
) -> Result<impl Iterator<Item = Result<(String, [&'t str; FIELDS])>>> {
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
    Ok(rows.map(move |(number, line)| {
        let place = format!("{name}:{number}");
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        match fields.try_into() {
            Ok(fields) => Ok((place, fields)),
            Err(fields) => {
                let found = format!("{} columns", Vec::<&str>::len(&fields));
                Err(Error::input(place, found, format!("{FIELDS}: {header}")))
            }
        }
    }))
}
