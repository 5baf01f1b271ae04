//! Weight tables that are kept: their bytes, checked once, and what errors call them.

use firmware::table::Table;
use kit::error::{Error, Result};
use std::path::Path;

/// The bytes of a table, and its name: usually that of its file.
#[derive(Clone, Debug)]
pub struct WeightTable {
    name: String,
    bytes: Vec<u8>,
}

impl WeightTable {
    /// Checks bytes and keeps them.
    ///
    /// # Errors
    /// [`Error::Input`] names the table and the field that does not fit.
    pub fn new(name: impl ToString, bytes: Vec<u8>) -> Result<Self> {
        let table = Self {
            name: name.to_string(),
            bytes,
        };
        drop(table.parse()?);
        Ok(table)
    }

    /// The table in a file.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be read, and as [`WeightTable::new`].
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
        Self::new(path.display(), bytes)
    }

    /// The table in a file, or without one the table that is built into the firmware.
    ///
    /// # Errors
    /// As [`WeightTable::read`].
    pub fn read_or_built_in(path: Option<&Path>) -> Result<Self> {
        path.map_or_else(
            || Self::new("built-in table", firmware::tables::DISTILLED.to_vec()),
            Self::read,
        )
    }

    /// The table in place.
    ///
    /// # Errors
    /// Never, since the bytes were checked.
    pub fn parse(&self) -> Result<Table<'_>> {
        Table::parse(&self.bytes).map_err(|error| {
            Error::input(error.field_name(), error.found(), error.expected()).within(&self.name)
        })
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What errors call it.
    pub fn name(&self) -> &str {
        &self.name
    }
}
