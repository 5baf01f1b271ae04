//! Preset, file and settings, one laid over the other.

use super::{Key, Scenario, nearest_key};
use kit::error::{Error, Result};
use serde::de::DeserializeOwned;
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
        let checked = |values: Table| {
            let scenario: Scenario = typed("", values.clone().into())?;
            scenario.check(&values)?;
            Ok(scenario)
        };
        checked(table).map_err(|error| self.with_origin(error))
    }

    /// Says where a key whose value does not fit was set.
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

/// What to expect instead of an unknown key; it gets the key, the section that lacks it as `section.`, and all known keys
/// and sections.
pub type Suggest = fn(&str, &str, &[String]) -> String;

/// The nearest key of a scenario.
fn nearest(key: &str, _section: &str, _known: &[String]) -> String {
    format!("{}, or another key of `host-sim explain`", nearest_key(key))
}

/// A key's section as `section.`, and its name.
fn parts(key: &str) -> (&str, &str) {
    key.split_at(key.rfind('.').map_or(0, |dot| dot + 1))
}

/// The keys of the same name in other sections; where there are none, all keys of its own.
pub fn siblings(key: &str, section: &str, known: &[String]) -> String {
    let known = || known.iter().map(String::as_str);
    let elsewhere: Vec<_> = known().filter(|known| parts(known).1 == parts(key).1).collect();
    if elsewhere.is_empty() {
        let beside: Vec<_> = known().filter(|known| parts(known).0 == section).collect();
        return format!("one of {}", beside.join(", "));
    }
    elsewhere.join(" or ")
}

/// Names of all sections and keys of a table.
fn names(table: &Table, prefix: &str, into: &mut Vec<String>) {
    for (name, value) in table {
        let key = format!("{prefix}{name}");
        if let Value::Table(section) = value {
            names(section, &format!("{key}."), into);
        }
        into.push(key);
    }
}

/// Values with all their keys as the type that they describe.
///
/// # Errors
/// [`Error::Input`] names the key below `section`, what stands there and what is expected.
pub fn typed<T: DeserializeOwned>(section: &str, values: Value) -> Result<T> {
    values.try_into().map_err(|error: toml::de::Error| {
        // The key is in the last line of the error's text, and nowhere else.
        let text = error.to_string();
        let key = text
            .trim_end()
            .rsplit_once("\nin `")
            .map(|(_, key)| key.trim_end_matches('`'));
        let place: Vec<&str> = [section]
            .into_iter()
            .chain(key)
            .filter(|part| !part.is_empty())
            .collect();
        let (found, expected) = error
            .message()
            .split_once(", expected ")
            .unwrap_or((error.message(), "the keys and types of the preset"));
        Error::input(place.join("."), found, expected)
    })
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
    let mut known = Vec::new();
    names(base, prefix, &mut known);
    overlay_section(base, layer, prefix, file, &|key, section| {
        suggest(key, section, &known)
    })
}

fn overlay_section(
    base: &mut Table,
    layer: Table,
    prefix: &str,
    file: Option<&Path>,
    suggest: &dyn Fn(&str, &str) -> String,
) -> Result<()> {
    let place = |key: &str| match file {
        Some(path) => format!("{}: key {key}", path.display()),
        None => format!("--set {key}"),
    };
    for (name, value) in layer {
        let key = format!("{prefix}{name}");
        if !base.contains_key(&name) {
            let key = whole_key(key, &value);
            return Err(Error::input(place(&key), "an unknown key", suggest(&key, prefix)));
        }
        match (base.get_mut(&name), value) {
            (Some(Value::Table(inner)), Value::Table(layer)) => {
                overlay_section(inner, layer, &format!("{key}."), file, suggest)?
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

/// The key with those below it, as far as each stands alone there: all that a setting names.
fn whole_key(key: String, value: &Value) -> String {
    let below = value.as_table().filter(|table| table.len() == 1);
    match below.and_then(|table| table.iter().next()) {
        Some((name, value)) => whole_key(format!("{key}.{name}"), value),
        None => key,
    }
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
            message("scenario.cell.vehicles=3"),
            "--set scenario.cell.vehicles: found an unknown key, expected cell.vehicles, or another key of `host-sim explain`"
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

    #[test]
    fn unknown_keys_find_their_name_in_other_sections() {
        let message = |setting: &str| {
            let mut table = parse(
                "",
                "name = 1\n[learner]\nrate = 1\nloss = \"l\"\n[scene.cell]\nvehicles = 3\nrate = 2",
            )
            .unwrap();
            lay_over(&mut table, None, &[setting.to_owned()], siblings)
                .unwrap_err()
                .to_string()
        };
        for (setting, expected) in [
            ("cell.vehicles=5", "scene.cell.vehicles"),
            ("learner.vehicles=5", "scene.cell.vehicles"),
            ("rate=5", "learner.rate or scene.cell.rate"),
            ("cell={vehicles=5, rate=2}", "scene.cell"),
            ("learner.lss=5", "one of learner.loss, learner.rate"),
            ("scene.cells.none=5", "one of scene.cell"),
            ("cells.none=5", "one of learner, name, scene"),
        ] {
            let key = setting.split('=').next().unwrap();
            assert_eq!(
                message(setting),
                format!("--set {key}: found an unknown key, expected {expected}")
            );
        }
    }

    #[test]
    fn values_that_fit_no_type_are_named_by_their_key() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(rename_all = "kebab-case")]
        enum Loss {
            Squared,
            Huber,
        }
        let message = |text: &str| {
            let values = Value::Table(parse("", text).unwrap());
            typed::<std::collections::BTreeMap<String, Loss>>("learner", values)
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            message("loss = \"squared\"\nother = \"cubed\""),
            "learner.other: found unknown variant `cubed`, expected `squared` or `huber`"
        );
        assert!(message("loss = 3").starts_with("learner.loss: found "));
    }
}
