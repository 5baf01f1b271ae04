//! The paper's Table I as checked configuration.
//!
//! A scenario is a preset, then a file that may change some of its keys, then single `KEY=VALUE` settings. The preset
//! `paper.toml` says what each key means and where it comes from, [`KEYS`] its unit and range.

mod keys;
pub mod layers;

use firmware::units::Level;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};

pub use keys::{KEYS, Key, nearest, nearest_key, section_meaning};
#[cfg(not(target_family = "wasm"))]
pub(crate) use layers::parse as parse_toml;
pub use layers::{Preset, ScenarioSource};

/// A checked scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct Scenario {
    pub cell: CellScenario,
    pub radio: RadioScenario,
    pub mobility: MobilityScenario,
    pub age: AgeScenario,
    pub broadcast: BroadcastScenario,
    pub baselines: BaselineScenario,
    pub traffic: TrafficScenario,
    pub planning: PlanningScenario,
}

/// Who is in the cell and where its antenna stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct CellScenario {
    pub vehicles: u32,
    pub replacement_probability: f64,
    pub base_station_x_m: f64,
    pub base_station_y_m: f64,
    pub base_station_height_m: f64,
    pub vehicle_height_m: f64,
}

/// Link budget and channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct RadioScenario {
    pub carrier_ghz: f64,
    pub sub_channels: u32,
    pub bandwidth_khz: f64,
    pub min_spectral_efficiency: f64,
    pub max_power_dbm: f64,
    pub noise_power_dbm: f64,
    pub vehicle_antenna_gain_dbi: f64,
    pub base_station_antenna_gain_dbi: f64,
    pub base_station_noise_figure_db: f64,
    pub vehicle_noise_figure_db: f64,
    pub path_loss_intercept_db: f64,
    pub path_loss_slope_db: f64,
    pub shadowing_deviation_db: f64,
    pub shadowing_decorrelation_m: f64,
    pub slow_update_slots: u32,
}

/// The urban grid and how vehicles drive on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct MobilityScenario {
    pub blocks_x: u32,
    pub blocks_y: u32,
    pub block_x_m: f64,
    pub block_y_m: f64,
    pub lanes_per_direction: u32,
    pub lane_width_m: f64,
    pub min_speed_m_per_s: f64,
    pub max_speed_m_per_s: f64,
    pub turn_probability: f64,
}

/// How ages count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct AgeScenario {
    pub time_constraint_slots: u32,
}

/// What the base station tells its vehicles, and how late.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct BroadcastScenario {
    pub joiner_load: f64,
    pub joiner_count_delay_slots: u32,
    pub shrink_delay_slots: u32,
}

/// Parameters of the simple policies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct BaselineScenario {
    pub aloha_load: f64,
    pub age_threshold_load: f64,
    pub age_threshold_probability: f64,
}

/// What age costs the road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct TrafficScenario {
    pub free_flow_time_x_s: f64,
    pub free_flow_time_y_s: f64,
    pub capacity_veh_per_h: f64,
    pub trips_per_pair_veh_per_h: f64,
    pub bpr_factor: f64,
    pub bpr_power: f64,
    pub max_capacity_error_veh_per_h: f64,
}

/// How often routes are planned, and what happens on the road meanwhile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct PlanningScenario {
    pub period_slots: u32,
    pub incident_interval_s: f64,
    pub incident_duration_s: f64,
    pub incident_capacity_loss: f64,
}

impl RadioScenario {
    /// Signal-to-interference-and-noise ratio from which a transmission carries C_min: 2^(C_min/W) - 1 (paper eq. 2).
    pub fn required_sinr(&self) -> f64 {
        libm::exp2(self.min_spectral_efficiency) - 1.0
    }

    /// [`RadioScenario::required_sinr`] as units know it, rounded up to their next step.
    pub fn required_level(&self) -> Level {
        Level::saturating_from_num(libm::ceil(2560.0 * libm::log10(self.required_sinr())) / 256.0)
    }

    /// C_min in kbit/s.
    pub fn min_rate_kbit_per_s(&self) -> f64 {
        self.min_spectral_efficiency * self.bandwidth_khz
    }

    /// Level over noise at the base station of a vehicle at full power, without path loss, in dB.
    pub fn budget_db(&self) -> f64 {
        self.max_power_dbm + self.vehicle_antenna_gain_dbi + self.base_station_antenna_gain_dbi
            - self.base_station_noise_figure_db
            - self.noise_power_dbm
    }
}

impl Scenario {
    /// Checks every value against its key's range, then what two keys say together.
    ///
    /// # Errors
    /// The first key, as `section.key`, that is out of its range.
    pub fn check(&self, values: &toml::Table) -> Result<()> {
        KEYS.iter().try_for_each(|key| key.check(values))?;
        let Self {
            mobility, traffic, ..
        } = self;
        let street_half_width = mobility.lane_width_m * f64::from(mobility.lanes_per_direction);
        within(
            "mobility.lane_width_m times lanes_per_direction",
            street_half_width,
            0.0,
            mobility.block_x_m.min(mobility.block_y_m) / 2.0,
            "at most half of block_x_m and of block_y_m",
        )?;
        within(
            "mobility.max_speed_m_per_s",
            mobility.max_speed_m_per_s,
            mobility.min_speed_m_per_s,
            f64::INFINITY,
            "at least mobility.min_speed_m_per_s",
        )?;
        within(
            "traffic.max_capacity_error_veh_per_h",
            traffic.max_capacity_error_veh_per_h,
            0.0,
            traffic.capacity_veh_per_h.next_down(),
            "less than traffic.capacity_veh_per_h",
        )
    }
}

fn within(key: &str, found: f64, least: f64, most: f64, expected: &str) -> Result<()> {
    if (least..=most).contains(&found) {
        Ok(())
    } else {
        Err(Error::input(key, found, expected))
    }
}
