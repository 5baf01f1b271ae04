//! What a reader assumed about its files: every assumption once, with how often it was made.

use kit::error::{Error, Result};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// What a note is about, in the order of reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NoteKind {
    /// Columns, elements or files that were read.
    Read,
    /// A unit, and why it was taken.
    Unit,
    /// A value that stands in no file.
    Default,
    /// What was seen and has no part in the assignment.
    Unused,
    /// What the numbers mean, for a look at whether they can be right.
    Plausible,
    /// What is likely to be wrong.
    Warning,
}

impl NoteKind {
    /// Its word in tables and JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Unit => "unit",
            Self::Default => "default",
            Self::Unused => "not used",
            Self::Plausible => "plausible",
            Self::Warning => "warning",
        }
    }
}

/// One assumption.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Note {
    /// What it is about.
    pub kind: NoteKind,
    /// File, or file and column.
    pub place: String,
    /// What was assumed.
    pub text: String,
}

/// All assumptions of an import, by kind, place and text.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ImportReport {
    notes: BTreeMap<Note, usize>,
}

impl ImportReport {
    /// Adds a note that counts nothing.
    pub fn say(&mut self, kind: NoteKind, place: impl ToString, text: impl ToString) {
        self.count(kind, place, text, 0);
    }

    /// Adds to how many rows, links or vehicles a note is about.
    pub fn count(&mut self, kind: NoteKind, place: impl ToString, text: impl ToString, times: usize) {
        let note = Note {
            kind,
            place: place.to_string(),
            text: text.to_string(),
        };
        *self.notes.entry(note).or_default() += times;
    }

    /// Every note, with how many rows, links or vehicles it is about; 0 where it counts nothing.
    pub fn notes(&self) -> impl Iterator<Item = (&Note, usize)> {
        self.notes.iter().map(|(note, times)| (note, *times))
    }

    /// The notes that are warnings.
    pub fn warnings(&self) -> impl Iterator<Item = (&Note, usize)> {
        self.notes().filter(|(note, _)| note.kind == NoteKind::Warning)
    }

    /// Says which range numbers lie in; warns if their median lies outside of the usual.
    pub fn range(&mut self, place: String, values: Vec<f64>, usual: Option<RangeInclusive<f64>>) {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let Some(median) = median(values) else {
            return;
        };
        let text = format!("{} to {}, median {}", short(least), short(most), short(median));
        match usual {
            Some(usual) if !usual.contains(&median) => {
                let text = format!(
                    "{text}: is a unit wrong? {} to {} is usual",
                    usual.start(),
                    usual.end()
                );
                self.say(NoteKind::Warning, place, text);
            }
            _ => self.say(NoteKind::Plausible, place, text),
        }
    }

    /// Takes all notes of another report.
    pub fn append(&mut self, other: Self) {
        for (note, times) in other.notes {
            *self.notes.entry(note).or_default() += times;
        }
    }

    /// Makes the first warning an error.
    ///
    /// # Errors
    /// [`Error::Input`] if there is a warning.
    pub fn refuse_warnings(&self) -> Result<()> {
        let Some((first, times)) = self.warnings().next() else {
            return Ok(());
        };
        let others = match self.warnings().count() {
            1 => String::new(),
            all => format!(" and {} more", all - 1),
        };
        let found = format!("the warning \"{}\"{others}", phrase(&first.text, times));
        Err(Error::input(&first.place, found, "none, as --strict asks"))
    }
}

/// A note's text with its count, such as `900 an hour and lane (12)`.
pub fn phrase(text: &str, times: usize) -> String {
    if times == 0 {
        text.to_owned()
    } else {
        format!("{text} ({times})")
    }
}

/// A number with about three digits.
pub fn short(value: f64) -> String {
    let decimals = match value.abs() {
        size if size >= 100.0 => 0,
        size if size >= 10.0 => 1,
        size if size >= 1.0 => 2,
        _ => 4,
    };
    format!("{value:.decimals$}")
}

/// The middle one of some numbers, the lower of two.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}
