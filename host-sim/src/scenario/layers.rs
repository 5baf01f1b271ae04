//! Preset, file and settings, one laid over the other.

use super::{Key, Scenario, nearest_key};
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A scenario that comes with the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Preset {
    /// The paper's Table I.
    #[default]
    Paper,
    /// The cell of the authors' companion code: half the grid, base station in its corner.
    Companion,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Companion];

    /// The file of the preset: `paper.toml` has every key, the others those that differ from it.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Paper => include_str!("../../presets/paper.toml"),
            Self::Companion => include_str!("../../presets/companion.toml"),
        }
    }

    /// Every key with the preset's value.
    pub fn values(self) -> Table {
        let mut values = Self::Paper.text().parse().unwrap_or_default();
        let layer = self.text().parse().unwrap_or_default();
        let overlaid = overlay(&mut values, layer, "", None, nearest);
        debug_assert!(overlaid.is_ok(), "{overlaid:?}");
        values
    }
}

/// Where a scenario comes from.
#[derive(Clone, Debug, Default)]
pub struct ScenarioSource {
    /// The lowest layer.
    pub preset: Preset,
    /// A TOML file whose keys replace the preset's.
    pub file: Option<PathBuf>,
    /// `KEY=VALUE` settings, such as `radio.max_power_dbm=23`, which replace both.
    pub settings: Vec<String>,
}

impl ScenarioSource {
    /// Reads and checks the scenario.
    ///
    /// # Errors
    /// [`Error::Input`] names the file and line, the key or the setting.
    pub fn read(&self) -> Result<Scenario> {
        let mut table = self.preset.values();
        lay_over(&mut table, self.file.as_deref(), &self.settings, nearest)?;
        let scenario: Scenario = table.clone().try_into().map_err(|error: toml::de::Error| {
            let place = self
                .file
                .as_deref()
                .map_or("--set".to_owned(), |path| path.display().to_string());
            Error::input(place, error.message(), "the type that the key has in the preset")
        })?;
        scenario.check(&table).map_err(|error| self.with_origin(error))?;
        Ok(scenario)
    }

    /// Says where a key that is out of range was set.
    fn with_origin(&self, error: Error) -> Error {
        let Error::Input {
            place,
            found,
            expected,
        } = error
        else {
            return error;
        };
        let in_file = || {
            let text = std::fs::read_to_string(self.file.as_ref()?).ok()?;
            let (section, key) = place.split_once('.')?;
            text.parse::<Table>().ok()?.get(section)?.get(key).map(drop)
        };
        let place = match &self.file {
            _ if self.settings.iter().any(|setting| sets(setting, &place)) => place,
            Some(path) if in_file().is_some() => format!("{}: key {place}", path.display()),
            _ => place,
        };
        Error::Input {
            place,
            found,
            expected,
        }
    }
}

/// What to expect instead of an unknown key; it gets the key, and the keys that its table has.
pub type Suggest = fn(&str, &Table) -> String;

/// The nearest key of a scenario.
fn nearest(key: &str, _known: &Table) -> String {
    format!("{}, or another key of `host-sim explain`", nearest_key(key))
}

/// All keys of the table.
pub fn siblings(key: &str, known: &Table) -> String {
    let prefix = key.rfind('.').map_or("", |dot| &key[..=dot]);
    let known: Vec<_> = known.keys().map(|name| format!("{prefix}{name}")).collect();
    format!("one of {}", known.join(", "))
}

/// Lays a file, then `KEY=VALUE` settings over a table that has every key with a value of its type.
///
/// # Errors
/// [`Error::Input`] names the file and line, the key or the setting.
pub fn lay_over(base: &mut Table, file: Option<&Path>, settings: &[String], suggest: Suggest) -> Result<()> {
    if let Some(path) = file {
        let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
        let layer = parse(&path.display().to_string(), &text)?;
        overlay(base, layer, "", Some(path), suggest)?;
    }
    settings
        .iter()
        .try_for_each(|setting| overlay(base, parse_setting(setting)?, "", None, suggest))
}

/// TOML text as a table.
///
/// # Errors
/// [`Error::Input`] names the place and the line.
pub fn parse(place: &str, text: &str) -> Result<Table> {
    text.parse().map_err(|error: toml::de::Error| {
        let line = error
            .span()
            .map_or(1, |span| text[..span.start].lines().count().max(1));
        Error::input(format!("{place}:{line}"), error.message(), "TOML")
    })
}

/// `a.b=value` as a nested table; a value that is no TOML is text.
fn parse_setting(setting: &str) -> Result<Table> {
    let (key, value) = setting
        .split_once('=')
        .ok_or_else(|| Error::input("--set", format!("\"{setting}\""), "KEY=VALUE"))?;
    let value = format!("value = {value}")
        .parse::<Table>()
        .ok()
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()));
    let mut parts = key.trim().rsplit('.');
    let mut table = Table::new();
    let _ = table.insert(parts.next().unwrap_or_default().to_owned(), value);
    for part in parts {
        let mut outer = Table::new();
        let _ = outer.insert(part.to_owned(), Value::Table(table));
        table = outer;
    }
    Ok(table)
}

/// Whether a `KEY=VALUE` setting gives this key of a scenario a value.
pub(crate) fn sets(setting: &str, key: &str) -> bool {
    let layer = parse_setting(setting).unwrap_or_default();
    Key::find(key).is_some_and(|key| key.value(&layer).is_some())
}

/// Replaces values of `base` by those of `layer`. Every key must exist in `base`, and a table must stay a table.
///
/// # Errors
/// [`Error::Input`] names the key, and the file if there is one.
pub fn overlay(
    base: &mut Table,
    layer: Table,
    prefix: &str,
    file: Option<&Path>,
    suggest: Suggest,
) -> Result<()> {
    let place = |key: &str| match file {
        Some(path) => format!("{}: key {key}", path.display()),
        None => format!("--set {key}"),
    };
    for (name, value) in layer {
        let key = format!("{prefix}{name}");
        if !base.contains_key(&name) {
            return Err(Error::input(place(&key), "an unknown key", suggest(&key, base)));
        }
        match (base.get_mut(&name), value) {
            (Some(Value::Table(inner)), Value::Table(layer)) => {
                overlay(inner, layer, &format!("{key}."), file, suggest)?
            }
            (Some(Value::Table(_)), other) => {
                return Err(Error::input(
                    place(&key),
                    other,
                    format!("a key below it, such as [{key}]"),
                ));
            }
            (Some(slot), value) => {
                let (fits, expected) = match (&*slot, &value) {
                    (Value::Float(_), value) => (value.is_float() || value.is_integer(), "a number"),
                    (Value::Integer(_), Value::Integer(value)) => (
                        u32::try_from(*value).is_ok(),
                        "a whole number from 0 to 4294967295",
                    ),
                    (Value::Integer(_), _) => (false, "a whole number from 0 to 4294967295"),
                    (Value::String(_), value) => (value.is_str(), "text"),
                    (Value::Boolean(_), value) => (value.is_bool(), "true or false"),
                    (Value::Array(_), value) => (value.is_array(), "a list such as [64, 64]"),
                    (slot, value) => (slot.same_type(value), slot.type_str()),
                };
                if !fits {
                    return Err(Error::input(place(&key), value, expected));
                }
                *slot = value;
            }
            (None, _) => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(settings: &[&str]) -> Result<Scenario> {
        let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
        ScenarioSource {
            settings,
            ..ScenarioSource::default()
        }
        .read()
    }

    #[test]
    fn presets_are_complete_and_valid() {
        let paper = read(&[]).unwrap();
        assert_eq!(paper.cell.vehicles, 20);
        assert_eq!(paper.radio.min_rate_kbit_per_s(), 540.0);
        assert_eq!(paper.radio.required_sinr(), 7.0);
        assert_eq!(paper.radio.budget_db(), 150.0);
        let companion = ScenarioSource {
            preset: Preset::Companion,
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        assert_eq!(companion.mobility.block_x_m * 2.0, paper.mobility.block_x_m);
    }

    #[test]
    fn settings_replace_values() {
        let scenario = read(&["cell.vehicles=7", "radio.max_power_dbm=23"]).unwrap();
        assert_eq!((scenario.cell.vehicles, scenario.radio.max_power_dbm), (7, 23.0));
    }

    #[test]
    fn bad_settings_name_key_and_expectation() {
        let message = |setting: &str| read(&[setting]).unwrap_err().to_string();
        assert_eq!(
            message("radio.sub_chanels=3"),
            "--set radio.sub_chanels: found an unknown key, expected radio.sub_channels, or another key of `host-sim explain`"
        );
        assert_eq!(
            message("cell.vehicles"),
            "--set: found \"cell.vehicles\", expected KEY=VALUE"
        );
        assert_eq!(
            message("cell.vehicles=-3"),
            "--set cell.vehicles: found -3, expected a whole number from 0 to 4294967295"
        );
        assert_eq!(
            message("cell.vehicles=0"),
            "cell.vehicles: found 0, expected 1 to 10000 vehicles"
        );
        assert_eq!(
            message("radio.bandwidth_khz=nan"),
            "radio.bandwidth_khz: found NaN, expected 1e-6 to 1e6 kHz"
        );
        assert_eq!(
            message("radio.max_power_dbm=inf"),
            "radio.max_power_dbm: found inf, expected -100 to 100 dBm"
        );
        assert_eq!(
            message("radio.sub_channels=201"),
            "radio.sub_channels: found 201, expected 1 to 200 sub-channels"
        );
        assert_eq!(
            message("radio=4"),
            "--set radio: found 4, expected a key below it, such as [radio]"
        );
        assert_eq!(
            message("cell.vehicles=many"),
            "--set cell.vehicles: found \"many\", expected a whole number from 0 to 4294967295"
        );
    }
}
