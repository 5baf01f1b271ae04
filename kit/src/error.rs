//! Errors a person can act on: where, what was found, what was expected.

use std::path::{Path, PathBuf};

/// Why a command could not do its work. Every one ends the program with exit code 2.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input that does not make sense.
    #[error(
        "{}: found {}, expected {}",
        one_line(place),
        one_line(found),
        one_line(expected)
    )]
    Input {
        /// File and line, or the name of a key or option.
        place: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// A file that cannot be read or written.
    #[error("{}: {source}", one_line(&path.display().to_string()))]
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

impl Error {
    /// Input that does not make sense.
    pub fn input(place: impl ToString, found: impl ToString, expected: impl ToString) -> Self {
        Self::Input {
            place: place.to_string(),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }

    /// The same, with what holds its place named before it. A file's path is whole already.
    pub fn within(self, outer: impl std::fmt::Display) -> Self {
        match self {
            Self::Input {
                place,
                found,
                expected,
            } => Self::input(format!("{outer}: {place}"), found, expected),
            file @ Self::File { .. } => file,
        }
    }

    /// A file that cannot be read or written.
    pub fn file(path: &Path, source: std::io::Error) -> Self {
        Self::File {
            path: path.to_owned(),
            source,
        }
    }
}

/// Text without line breaks or other control characters but tabs, so that an error stays one line.
fn one_line(text: &str) -> String {
    let mut line = String::new();
    for character in text.chars() {
        if character.is_control() && character != '\t' {
            line.extend(character.escape_default());
        } else {
            line.push(character);
        }
    }
    line
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
