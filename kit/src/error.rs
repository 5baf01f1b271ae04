//! Errors a person can act on: where, what was found, what was expected.

use std::path::{Path, PathBuf};

/// Most characters of what an input says that errors repeat (chosen: enough to find it).
const LONGEST_SAID: usize = 400;

/// Most characters of a path: it may come from an input, and systems know no longer ones than a few thousand (chosen).
const LONGEST_PATH: usize = 1_000;

/// Most characters of what was expected, which may be a list of names (chosen).
const LONGEST_EXPECTED: usize = 1_000;

/// Why a command could not do its work. Every one ends the program with exit code 2.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Input that does not make sense.
    #[error(
        "{}: found {}, expected {}",
        shortened(place, LONGEST_SAID),
        shortened(found, LONGEST_SAID),
        shortened(expected, LONGEST_EXPECTED)
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
    #[error("{}: {source}", shortened(&path.display().to_string(), LONGEST_PATH))]
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

/// One line of at most so many characters: the beginning and the end of a longer one.
fn shortened(text: &str, longest: usize) -> String {
    let line = one_line(text);
    let count = line.chars().count();
    if count <= longest {
        return line;
    }
    let half = longest / 2;
    let beginning: String = line.chars().take(half).collect();
    let end: String = line.chars().skip(count - half).collect();
    format!("{beginning} ... {end}")
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line_that_people_read() {
        let short = Error::input("file:3", "two\nlines", "one").to_string();
        assert_eq!(short, "file:3: found two\\nlines, expected one");
        let long = Error::input("f", format!("({})", "\u{1}x".repeat(10_000)), "y".repeat(1_000)).to_string();
        assert!(long.len() < 2_000 && !long.contains('\u{1}'));
        assert!(long.starts_with("f: found (\\u{1}x") && long.contains("x\\u{1}x), expected yyy"));
        assert!(long.contains(" ... "));
        let path = "folder/".repeat(1_000);
        let file = Error::file(Path::new(&path), std::io::ErrorKind::NotFound.into()).to_string();
        assert!(
            file.len() < 1_100 && file.ends_with("older/: entity not found"),
            "{file}"
        );
    }
}
