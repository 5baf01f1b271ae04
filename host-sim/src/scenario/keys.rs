//! What a key of a scenario means, its unit and its range: one place for checks, explanations and schemas.

use super::Preset;
use kit::error::{Error, Result};
use toml::{Table, Value};

/// A key of a scenario.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// `section.key`.
    pub name: &'static str,
    /// Unit of its value; empty for a plain number.
    pub unit: &'static str,
    /// Least value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
}

/// Least value of a quantity that must not be zero, so that dividing by it stays finite.
const TINY: f64 = 1e-6;
/// Largest value of a quantity that has no natural one.
const LARGE: f64 = 1e6;
/// Largest distance of the base station from the grid's corner.
const FAR_M: f64 = 1e8;

/// Every key, in the order of the presets. Levels and powers stay within what units express, -128 to 128 dB.
pub const KEYS: &[Key] = &[
    key("cell.vehicles", "vehicles", 1.0, 10_000.0),
    key("cell.replacement_probability", "1/slot", 0.0, 0.5),
    key("cell.base_station_x_m", "m", -FAR_M, FAR_M),
    key("cell.base_station_y_m", "m", -FAR_M, FAR_M),
    key("cell.base_station_height_m", "m", 0.0, LARGE),
    key("cell.vehicle_height_m", "m", 0.0, LARGE),
    key("radio.carrier_ghz", "GHz", TINY, LARGE),
    key("radio.sub_channels", "sub-channels", 1.0, 200.0),
    key("radio.bandwidth_khz", "kHz", TINY, LARGE),
    // Below 1, two vehicles could succeed on one sub-channel at once.
    key("radio.min_spectral_efficiency", "bit/s/Hz", 1.0, 20.0),
    key("radio.max_power_dbm", "dBm", -100.0, 100.0),
    key("radio.noise_power_dbm", "dBm", -250.0, 100.0),
    key("radio.vehicle_antenna_gain_dbi", "dBi", -100.0, 100.0),
    key("radio.base_station_antenna_gain_dbi", "dBi", -100.0, 100.0),
    key("radio.base_station_noise_figure_db", "dB", 0.0, 100.0),
    key("radio.vehicle_noise_figure_db", "dB", 0.0, 100.0),
    key("radio.path_loss_intercept_db", "dB", 0.0, 500.0),
    key("radio.path_loss_slope_db", "dB", 0.0, 100.0),
    key("radio.shadowing_deviation_db", "dB", 0.0, 100.0),
    key("radio.shadowing_decorrelation_m", "m", TINY, LARGE),
    key("radio.slow_update_slots", "slots", 1.0, 100_000.0),
    key("mobility.blocks_x", "blocks", 1.0, 100.0),
    key("mobility.blocks_y", "blocks", 1.0, 100.0),
    key("mobility.block_x_m", "m", TINY, LARGE),
    key("mobility.block_y_m", "m", TINY, LARGE),
    key("mobility.lanes_per_direction", "lanes", 1.0, 8.0),
    key("mobility.lane_width_m", "m", TINY, LARGE),
    key("mobility.min_speed_m_per_s", "m/s", 0.0, 100.0),
    key("mobility.max_speed_m_per_s", "m/s", 0.0, 100.0),
    key("mobility.turn_probability", "", 0.0, 1.0),
    key("age.time_constraint_slots", "slots", 100.0, 100.0),
    key("broadcast.joiner_load", "transmissions/slot", TINY, LARGE),
    key("broadcast.joiner_count_delay_slots", "slots", 0.0, 10_000.0),
    key("broadcast.shrink_delay_slots", "slots", 0.0, 10_000.0),
    key("baselines.aloha_load", "transmissions/slot", 0.0, LARGE),
    key("baselines.age_threshold_load", "slots", 0.0, LARGE),
    key("baselines.age_threshold_probability", "", 0.0, 1.0),
    key("traffic.free_flow_time_x_s", "s", TINY, LARGE),
    key("traffic.free_flow_time_y_s", "s", TINY, LARGE),
    key("traffic.capacity_veh_per_h", "veh/h", TINY, LARGE),
    key("traffic.trips_per_pair_veh_per_h", "veh/h", 0.0, LARGE),
    key("traffic.bpr_factor", "", 0.0, LARGE),
    key("traffic.bpr_power", "", 0.0, 100.0),
    key("traffic.max_capacity_error_veh_per_h", "veh/h", 0.0, LARGE),
    key("planning.period_slots", "slots", 1.0, 100_000_000.0),
    key("planning.incident_interval_s", "s", TINY, LARGE),
    key("planning.incident_duration_s", "s", TINY, LARGE),
    key("planning.incident_capacity_loss", "", 0.0, 0.99),
];

const fn key(name: &'static str, unit: &'static str, least: f64, most: f64) -> Key {
    Key {
        name,
        unit,
        least,
        most,
    }
}

impl Key {
    /// The key of this name.
    pub fn find(name: &str) -> Option<&'static Self> {
        KEYS.iter().find(|key| key.name == name)
    }

    /// Section and name in it.
    pub fn parts(&self) -> (&'static str, &'static str) {
        self.name.split_once('.').unwrap_or(("", self.name))
    }

    /// The value in a scenario's table.
    pub fn value<'v>(&self, scenario: &'v Table) -> Option<&'v Value> {
        let (section, name) = self.parts();
        scenario.get(section)?.get(name)
    }

    /// Whether the value is a whole number.
    pub fn is_whole(&self) -> bool {
        self.value(&Preset::Paper.values()).is_some_and(Value::is_integer)
    }

    /// What it means and where it comes from: the comment behind it in the preset `paper.toml`.
    pub fn meaning_and_source(&self) -> (&'static str, &'static str) {
        comment(self.name).rsplit_once("; ").unwrap_or_default()
    }

    /// Its range with the unit, such as `0 to 100 dB`.
    pub fn range(&self) -> String {
        let Self { least, most, .. } = *self;
        let number = |value: f64| match value.abs() {
            0.0 | 1e-3..1e6 => value.to_string(),
            _ => format!("{value:e}"),
        };
        let range = if least == most {
            number(least)
        } else {
            format!("{} to {}", number(least), number(most))
        };
        format!("{range} {}", self.unit).trim_end().to_owned()
    }

    /// Checks the value in a scenario's table.
    ///
    /// # Errors
    /// The key, its value and its range.
    pub(super) fn check(&self, scenario: &Table) -> Result<()> {
        let value = self.value(scenario);
        let number =
            value.and_then(|value| value.as_float().or(value.as_integer().map(|whole| whole as f64)));
        match number {
            Some(number) if (self.least..=self.most).contains(&number) => Ok(()),
            Some(number) => Err(Error::input(self.name, number, self.range())),
            None => Err(Error::input(self.name, "no number", self.range())),
        }
    }
}

/// What a section holds: the comment behind its head in the preset `paper.toml`.
pub fn section_meaning(section: &str) -> &'static str {
    comment(section)
}

/// The scenario's key whose name is most like this one.
pub fn nearest_key(name: &str) -> &'static str {
    nearest(name, KEYS.iter().map(|key| key.name))
}

/// Which of the known keys is most like a name. One with the wrong section, or with none, is still recognised.
pub fn nearest<'k>(name: &str, known: impl IntoIterator<Item = &'k str>) -> &'k str {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let likeness =
        |key: &str| strsim::jaro_winkler(key, name).max(strsim::jaro_winkler(&last(key), &last(name)));
    let nearest = known
        .into_iter()
        .max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    nearest.unwrap_or_default()
}

/// The comment behind a key or section in the preset `paper.toml`.
fn comment(name: &str) -> &'static str {
    let mut section = "";
    for line in Preset::Paper.text().lines() {
        let (code, comment) = line.split_once('#').unwrap_or((line, ""));
        let found = if let Some(head) = code.trim().strip_prefix('[') {
            section = head.trim_end_matches(']');
            section == name
        } else {
            let key = code.split('=').next().unwrap_or_default().trim();
            name.strip_prefix(section).and_then(|rest| rest.strip_prefix('.')) == Some(key)
        };
        if found {
            return comment.trim();
        }
    }
    ""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_of_the_preset_has_a_range_a_meaning_and_a_source() {
        let preset = Preset::Paper.values();
        let sections = preset
            .iter()
            .filter_map(|(section, keys)| Some((section, keys.as_table()?)));
        let mut names: Vec<String> = sections
            .flat_map(|(section, keys)| keys.keys().map(move |key| format!("{section}.{key}")))
            .collect();
        names.sort();
        let mut known: Vec<&str> = KEYS.iter().map(|key| key.name).collect();
        known.sort_unstable();
        assert_eq!(names, known);
        for key in KEYS {
            let (meaning, source) = key.meaning_and_source();
            assert!(!meaning.is_empty() && !source.is_empty(), "{}", key.name);
            assert!(!section_meaning(key.parts().0).is_empty(), "{}", key.name);
        }
    }

    #[test]
    fn misspelt_keys_find_their_neighbour() {
        assert_eq!(nearest_key("radio.sub_chanels"), "radio.sub_channels");
        assert_eq!(nearest_key("max_power"), "radio.max_power_dbm");
        assert_eq!(nearest_key("cell.max_power_dbm"), "radio.max_power_dbm");
        assert_eq!(nearest_key("vehicles"), "cell.vehicles");
    }
}
