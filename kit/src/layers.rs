//! Values of a configuration, one layer over the other: a preset, a file that may change some of its keys, then single
//! `KEY=VALUE` settings.

use crate::error::{Error, Result};
use crate::files::Text;
use crate::keys::{Key, Kind, check, listed, nearest, value};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Most parts of a key (chosen: those that exist have three).
const MOST_PARTS: usize = 16;

/// The layers so far, and which file set a key.
#[derive(Clone, Debug)]
pub struct Layers<'k> {
    keys: &'k [Key],
    /// The command that lists all keys, for errors.
    explain: &'static str,
    values: Table,
    files: BTreeMap<String, PathBuf>,
}

impl<'k> Layers<'k> {
    /// No value yet. `explain` is the command that lists all keys.
    pub fn new(keys: &'k [Key], explain: &'static str) -> Self {
        Self {
            keys,
            explain,
            values: Table::new(),
            files: BTreeMap::new(),
        }
    }

    /// Lays a TOML file, then `KEY=VALUE` settings such as `radio.max_power_dbm=23` over the values.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be read, [`Error::Input`] names the file and line, the key or the setting.
    pub fn lay_over(&mut self, file: Option<&Path>, settings: &[String]) -> Result<()> {
        if let Some(path) = file {
            let Text { name, text } = Text::read(path)?;
            self.lay(parse(&name, &text)?, file)?;
        }
        settings
            .iter()
            .try_for_each(|setting| self.lay(parse_setting(setting)?, None))
    }

    /// Lays values over those so far; `file` is where they stand.
    ///
    /// # Errors
    /// [`Error::Input`] names an unknown key, or one with a value of another kind.
    pub fn lay(&mut self, layer: Table, file: Option<&Path>) -> Result<()> {
        let mut laid = Vec::new();
        lay(&mut self.values, self.keys, layer, "", &mut laid).map_err(|(key, found, expected)| {
            let place = match file {
                Some(path) => format!("{}: key {key}", path.display()),
                None => format!("--set {key}"),
            };
            let expected = expected.unwrap_or_else(|| {
                let known = listed(self.keys);
                let nearest = nearest(&key, known.iter().map(|(name, _)| name.as_str()));
                format!("{nearest}, or another key of `{}`", self.explain)
            });
            Error::input(place, found, expected)
        })?;
        for key in laid {
            match file {
                Some(path) => drop(self.files.insert(key, path.to_owned())),
                None => drop(self.files.remove(&key)),
            }
        }
        Ok(())
    }

    /// All values.
    pub const fn values(&self) -> &Table {
        &self.values
    }

    /// Checks each value against its key's range, and gives them as their type.
    ///
    /// # Errors
    /// [`Error::Input`] names the key, and the file that set it.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T> {
        check(self.keys, &self.values).map_err(|error| self.located(error))?;
        let typed = Value::Table(self.values.clone()).try_into();
        // Kinds and ranges are right, so this is a preset without one of its keys.
        typed.map_err(|error: toml::de::Error| Error::input("preset", error.message(), "every key"))
    }

    /// An error about a key, with the file that set it.
    pub fn located(&self, error: Error) -> Error {
        match error {
            Error::Input {
                place,
                found,
                expected,
            } => match self.files.get(place.split('[').next().unwrap_or_default()) {
                Some(path) => Error::input(format!("{}: key {place}", path.display()), found, expected),
                None => Error::input(place, found, expected),
            },
            other => other,
        }
    }
}

/// A key, what was found there, and what was expected; nothing where the key is unknown.
type Misfit = (String, String, Option<String>);

/// Lays a section over another, and lists the keys that it sets.
fn lay(
    base: &mut Table,
    keys: &[Key],
    layer: Table,
    prefix: &str,
    laid: &mut Vec<String>,
) -> std::result::Result<(), Misfit> {
    for (name, value) in layer {
        let whole = format!("{prefix}{name}");
        let Some(key) = keys.iter().find(|key| key.name == name) else {
            return Err((whole_key(whole, &value), "an unknown key".to_owned(), None));
        };
        match (key.kind, value) {
            (Kind::Section(keys), Value::Table(layer)) => {
                let section = base.entry(name).or_insert_with(|| Value::Table(Table::new()));
                if let Value::Table(section) = section {
                    lay(section, keys, layer, &format!("{whole}."), laid)?;
                }
            }
            (Kind::Section(_), value) => {
                let expected = format!("a key below it, such as [{whole}]");
                return Err((whole, value.to_string(), Some(expected)));
            }
            (kind, value) if kind.fits(&value) => {
                let _replaced = base.insert(name, value);
                laid.push(whole);
            }
            (kind, value) => return Err((whole, value.to_string(), Some(kind.described().to_owned()))),
        }
    }
    Ok(())
}

/// The key with those below it, as far as each stands alone there: all that a setting names.
fn whole_key(key: String, value: &Value) -> String {
    let below = value.as_table().filter(|table| table.len() == 1);
    match below.and_then(|table| table.iter().next()) {
        Some((name, value)) => whole_key(format!("{key}.{name}"), value),
        None => key,
    }
}

/// TOML text as a table.
///
/// # Errors
/// [`Error::Input`] names the place and the line.
pub fn parse(place: &str, text: &str) -> Result<Table> {
    parse_as(place, text, "TOML")
}

/// A TOML text as a type; `expected` says what it must be.
///
/// # Errors
/// [`Error::Input`] at `place` and the line.
pub fn parse_as<T: DeserializeOwned>(place: &str, text: &str, expected: &str) -> Result<T> {
    toml::from_str(text).map_err(|error: toml::de::Error| {
        let before = error.span().map_or(0, |span| span.start);
        let line = 1 + text[..before].matches('\n').count();
        // What a field may be stands in several lines, or behind a comma.
        let found = error.message().lines().next().unwrap_or_default();
        Error::input(format!("{place}:{line}"), found, expected)
    })
}

/// Whether a `KEY=VALUE` setting gives this key a value.
pub fn sets(setting: &str, key: &str) -> bool {
    parse_setting(setting).is_ok_and(|layer| value(&layer, key).is_some())
}

/// `a.b=value` as a nested table; a value that is no TOML is text.
fn parse_setting(setting: &str) -> Result<Table> {
    let (key, value) = setting
        .split_once('=')
        .ok_or_else(|| Error::input("--set", format!("\"{setting}\""), "KEY=VALUE"))?;
    let parts = key.split('.').count();
    if parts > MOST_PARTS {
        let found = format!("a key of {parts} parts");
        return Err(Error::input("--set", found, format!("at most {MOST_PARTS}")));
    }
    let value = format!("value = {value}")
        .parse::<Table>()
        .ok()
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()));
    let nested = key.trim().rsplit('.').fold(value, |inner, part| {
        Value::Table(Table::from_iter([(part.to_owned(), inner)]))
    });
    match nested {
        Value::Table(table) => Ok(table),
        _ => Ok(Table::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::choices! {
        /// How to lose.
        enum Loss {
            /// The square.
            Squared = "squared",
            /// The square up to 1, then linear.
            Huber = "huber",
        }
    }
    crate::keys! {
        /// Everything.
        struct Whole {
            /// How to learn.
            learner: Learner,
            /// Where.
            scene: Scene,
        }
        /// How to learn.
        struct Learner {
            /// Learning rate.
            #[key(range = 0.0..=1.0, source = "chosen")]
            rate: f32,
            /// Which loss.
            #[key(source = "chosen")]
            loss: Loss,
            /// Widths of layers.
            #[key(range = 1.0..=8.0, longest = 3, unit = "widths", source = "chosen")]
            widths: Vec<usize>,
            /// Rates at both ends.
            #[key(range = 0.0..=1.0, source = "chosen")]
            ends: [f32; 2],
            /// Whether to begin at all.
            #[key(source = "chosen")]
            begins: Option<bool>,
        }
        /// Where.
        struct Scene {
            /// The cells, each with its own values.
            #[key(longest = 4, source = "chosen")]
            cells: Vec<Cell>,
        }
        /// One cell.
        struct Cell {
            /// Rate of reports.
            #[key(range = 1.0..=9.0, unit = "1/s", source = "chosen")]
            frequency: u32,
        }
    }

    #[test]
    fn a_key_without_end_is_refused() {
        let endless = format!("{}a=1", "a.".repeat(60_000));
        let message = parse_setting(&endless).unwrap_err().to_string();
        assert_eq!(message, "--set: found a key of 60001 parts, expected at most 16");
    }

    const PRESET: &str = "learner = { rate = 0.5, loss = \"huber\", widths = [8], ends = [0, 1] }
        scene.cells = [{ frequency = 3 }, { frequency = 4 }]";

    fn read(file: Option<&Path>, setting: &str) -> Result<Whole> {
        let mut layers = Layers::new(Whole::KEYS, "host-sim explain");
        layers.lay(parse("preset", PRESET)?, None)?;
        layers.lay_over(file, &[setting.to_owned()])?;
        layers.read()
    }

    #[test]
    fn values_of_every_kind_are_read() {
        let whole = read(None, "learner.begins=true").unwrap();
        assert_eq!((whole.learner.begins, whole.learner.rate), (Some(true), 0.5));
        assert_eq!(
            (whole.learner.loss, whole.learner.ends),
            (Loss::Huber, [0.0, 1.0])
        );
        assert_eq!(whole.scene.cells[1].frequency, 4);
        assert_eq!(read(None, "learner.loss=squared").unwrap().learner.begins, None);
    }

    #[test]
    fn values_that_do_not_fit_are_named_by_their_key() {
        for (setting, expected) in [
            (
                "learner.loss=cubed",
                "learner.loss: found \"cubed\", expected \"squared\", \"huber\"",
            ),
            ("learner.loss=3", "--set learner.loss: found 3, expected text"),
            (
                "learner.widths=3",
                "--set learner.widths: found 3, expected a list such as [64, 64]",
            ),
            (
                "learner.widths=[9]",
                "learner.widths: found [9], expected at most 3 widths from 1 to 8",
            ),
            (
                "learner.widths=[2.0]",
                "learner.widths: found [2.0], expected at most 3 widths from 1 to 8",
            ),
            (
                "learner.widths=[1, 1, 1, 1]",
                "learner.widths: found [1, 1, 1, 1], expected at most 3 widths from 1 to 8",
            ),
            (
                "learner.ends=[1]",
                "learner.ends: found [1], expected 2 numbers from 0 to 1",
            ),
            (
                "learner.begins=2",
                "--set learner.begins: found 2, expected true or false",
            ),
            (
                "scene.cells=[{ frequency = 10 }]",
                "scene.cells[0].frequency: found 10, expected 1 to 9 1/s",
            ),
            (
                "scene.cells=[{ frequency = 1 }, { requency = 1 }]",
                "scene.cells[1].requency: found an unknown key, expected one of frequency",
            ),
            (
                "scene.cells=[7]",
                "scene.cells[0]: found 7, expected keys below it",
            ),
            (
                "scene.cells=[{}, {}, {}, {}, {}]",
                "scene.cells: found [{}, {}, {}, {}, {}], expected at most 4 times keys below it",
            ),
        ] {
            assert_eq!(read(None, setting).unwrap_err().to_string(), expected);
        }
    }

    #[test]
    fn an_error_says_which_file_set_the_value_that_counts() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine.toml");
        std::fs::write(&file, "learner = { rate = 2, widths = [9] }").unwrap();
        let message = |setting| {
            read(Some(&file), setting)
                .unwrap_err()
                .to_string()
                .replace(&file.display().to_string(), "FILE")
        };
        assert_eq!(
            message("learner.widths=[1]"),
            "FILE: key learner.rate: found 2, expected 0 to 1"
        );
        assert_eq!(
            message("learner.rate=3"),
            "learner.rate: found 3, expected 0 to 1"
        );
        assert_eq!(
            message("learner.rate=1"),
            "FILE: key learner.widths: found [9], expected at most 3 widths from 1 to 8"
        );
    }

    #[test]
    fn unknown_keys_find_their_name_in_other_sections() {
        for (setting, nearest) in [
            ("learner.lss=5", "learner.loss"),
            ("scene.loss=5", "learner.loss"),
            ("rate=5", "learner.rate"),
            ("scene.learner.rate=5", "learner.rate"),
            ("learnr={loss=5}", "learner.loss"),
        ] {
            let message = read(None, setting).unwrap_err().to_string();
            let expected =
                format!("found an unknown key, expected {nearest}, or another key of `host-sim explain`");
            assert!(message.ends_with(&expected), "{message}");
        }
    }

    #[test]
    fn settings_are_known_by_the_key_that_they_set() {
        assert!(sets("cell.vehicles=3", "cell.vehicles") && sets("cell={vehicles=3}", "cell.vehicles"));
        assert!(!sets("cell.vehicles=3", "cell.lanes") && !sets("cell.vehicles", "cell.vehicles"));
    }
}
