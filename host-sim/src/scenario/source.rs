//! Where a scenario comes from.

use super::Scenario;
use kit::choice::Choice as _;
use kit::error::Result;
use kit::keys::{listed, nearest};
use kit::layers::{Layers, sets};
use std::path::PathBuf;
use toml::{Table, Value};

kit::choices! {
    /// A scenario that comes with the program.
    pub enum Preset {
        /// The paper's Table I.
        Paper = "paper",
        /// The cell of the authors' companion code: half the grid, base station in its corner.
        Companion = "companion",
        /// Fading that follows speed, 30 % of vehicles standing, late and lost feedback.
        Street = "street",
        /// 5.9 GHz and 23 dBm, as certified units have: a link budget that a cell's edge feels.
        Edge = "edge",
    }
}

impl Default for Preset {
    fn default() -> Self {
        Self::ALL[0]
    }
}

/// The command that lists all keys.
pub const EXPLAIN: &str = "host-sim explain";

impl Preset {
    /// Its file: `paper.toml` has every key, the others those that differ from it.
    const fn text(self) -> &'static str {
        match self {
            Self::Paper => include_str!("../../presets/paper.toml"),
            Self::Companion => include_str!("../../presets/companion.toml"),
            Self::Street => include_str!("../../presets/street.toml"),
            Self::Edge => include_str!("../../presets/edge.toml"),
        }
    }

    /// Every key with the preset's value.
    pub fn values(self) -> Table {
        self.layers().values().clone()
    }

    fn layers(self) -> Layers<'static> {
        let mut layers = Layers::new(Scenario::KEYS, EXPLAIN);
        for preset in [Self::Paper, self] {
            let laid = layers.lay(preset.text().parse().unwrap_or_default(), None);
            debug_assert!(laid.is_ok(), "{laid:?}");
        }
        layers
    }
}

/// Where a scenario comes from.
#[derive(Clone, Debug, Default)]
pub struct ScenarioSource {
    /// The lowest layer.
    pub preset: Preset,
    /// A TOML file whose keys replace the preset's.
    pub file: Option<PathBuf>,
    /// Values by section and key, which replace both.
    pub values: Table,
    /// `KEY=VALUE` settings, such as `radio.max_power_dbm=23`, which replace all of them.
    pub settings: Vec<String>,
}

impl ScenarioSource {
    /// Gives a key, such as `radio.max_power_dbm`, one of the [values](Self::values).
    pub fn set(&mut self, key: &str, value: impl Into<Value>) {
        let (section, name) = key.split_once('.').unwrap_or(("", key));
        let section = self.values.entry(section).or_insert_with(|| Table::new().into());
        if let Value::Table(section) = section {
            let _replaced = section.insert(name.to_owned(), value.into());
        }
    }

    /// Whether a value or a setting of its own, not the preset or the file, gives a key.
    pub fn sets_alone(&self, key: &str) -> bool {
        let (section, name) = key.split_once('.').unwrap_or(("", key));
        let values = self.values.get(section).and_then(Value::as_table);
        values.is_some_and(|values| values.contains_key(name))
            || self.settings.iter().any(|setting| sets(setting, key))
    }

    /// Reads and checks the scenario.
    ///
    /// # Errors
    /// [`kit::error::Error::Input`] names the file and line, the key or the setting.
    pub fn read(&self) -> Result<Scenario> {
        let mut layers = self.preset.layers();
        layers.lay_over(self.file.as_deref(), &[])?;
        layers.lay(self.values.clone(), None)?;
        layers.lay_over(None, &self.settings)?;
        let scenario: Scenario = layers.read()?;
        scenario.check().map_err(|error| layers.located(error))?;
        Ok(scenario)
    }
}

/// The scenario's key whose name is most like this one.
pub fn nearest_key(name: &str) -> String {
    let known = listed(Scenario::KEYS);
    nearest(name, known.iter().map(|(name, _)| name.as_str())).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kit::keys::{Kind, value};

    fn read(settings: &[&str]) -> Result<Scenario> {
        let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
        ScenarioSource {
            settings,
            ..ScenarioSource::default()
        }
        .read()
    }

    fn message(setting: &str) -> String {
        read(&[setting]).unwrap_err().to_string()
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
    fn every_key_has_a_value_a_meaning_and_a_source() {
        let values = Preset::Paper.values();
        for (name, key) in listed(Scenario::KEYS) {
            assert!(value(&values, &name).is_some(), "{name}");
            assert!(!key.meaning.is_empty() && !key.source.is_empty(), "{name}");
        }
    }

    /// Both ends of a documented range are read, what lies beyond them is refused in the words of the range.
    #[test]
    fn documented_ranges_are_what_is_checked() {
        let numbers = |key: &kit::keys::Key| matches!(key.kind, Kind::Whole | Kind::Number);
        for (name, key) in listed(Scenario::KEYS).into_iter().filter(|(_, key)| numbers(key)) {
            let refusal = format!(", expected {}", key.range());
            let refused = |value: f64| {
                let error = read(&[&format!("{name}={value}")]).err();
                // An end may still contradict another key.
                error.is_some_and(|error| error.to_string().ends_with(&refusal))
            };
            let (below, above) = match key.kind {
                Kind::Whole => (key.least - 1.0, key.most + 1.0),
                _ => (key.least.next_down(), key.most.next_up()),
            };
            assert!(!refused(key.least) && !refused(key.most), "{name}");
            assert!(refused(below) && refused(above), "{name}");
        }
    }

    #[test]
    fn bad_settings_name_key_and_expectation() {
        for (setting, expected) in [
            (
                "radio.sub_chanels=3",
                "--set radio.sub_chanels: found an unknown key, expected radio.sub_channels, or another key of `host-sim explain`",
            ),
            (
                "scenario.cell.vehicles=3",
                "--set scenario.cell.vehicles: found an unknown key, expected cell.vehicles, or another key of `host-sim explain`",
            ),
            (
                "cell.vehicles",
                "--set: found \"cell.vehicles\", expected KEY=VALUE",
            ),
            (
                "cell.vehicles=-3",
                "cell.vehicles: found -3, expected 1 to 10000 vehicles",
            ),
            (
                "cell.vehicles=0",
                "cell.vehicles: found 0, expected 1 to 10000 vehicles",
            ),
            (
                "cell.vehicles=2.5",
                "--set cell.vehicles: found 2.5, expected a whole number",
            ),
            (
                "radio.bandwidth_khz=nan",
                "radio.bandwidth_khz: found NaN, expected 1e-6 to 1e6 kHz",
            ),
            (
                "radio.max_power_dbm=inf",
                "radio.max_power_dbm: found inf, expected -100 to 100 dBm",
            ),
            (
                "radio.sub_channels=201",
                "radio.sub_channels: found 201, expected 1 to 200 sub-channels",
            ),
            (
                "radio=4",
                "--set radio: found 4, expected a key below it, such as [radio]",
            ),
            (
                "cell.vehicles=many",
                "--set cell.vehicles: found \"many\", expected a whole number",
            ),
            (
                "mobility.max_speed_m_per_s=9",
                "mobility.max_speed_m_per_s: found 9, expected at least mobility.min_speed_m_per_s",
            ),
        ] {
            assert_eq!(message(setting), expected);
        }
        assert!(message("age.time_constraint_slots=100").contains("found an unknown key"));
    }

    #[test]
    fn misspelt_keys_find_their_neighbour() {
        for (name, neighbour) in [
            ("radio.sub_chanels", "radio.sub_channels"),
            ("max_power", "radio.max_power_dbm"),
            ("cell.max_power_dbm", "radio.max_power_dbm"),
            ("vehicles", "cell.vehicles"),
        ] {
            assert_eq!(nearest_key(name), neighbour);
        }
    }
}
