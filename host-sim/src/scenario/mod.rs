//! The paper's Table I as checked configuration.
//!
//! A scenario is a preset, then a file that may change some of its keys, then single `KEY=VALUE` settings. The presets
//! under `host-sim/presets/` say what each key means, its unit and its source.

pub mod layers;

use crate::error::{Error, Result};
use firmware::units::{Age, Level, SUB_CHANNELS};
use serde::{Deserialize, Serialize};

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
    /// Checks every value that has a range.
    ///
    /// # Errors
    /// The first key, as `section.key`, that is out of its range.
    pub fn check(&self) -> Result<()> {
        let Self {
            cell,
            radio,
            mobility,
            age,
            broadcast,
            baselines,
            traffic,
            planning,
        } = self;
        // Levels and powers must stay within what units express, -128 to 128 dB.
        for (key, value) in [
            ("radio.max_power_dbm", radio.max_power_dbm),
            ("radio.vehicle_antenna_gain_dbi", radio.vehicle_antenna_gain_dbi),
            (
                "radio.base_station_antenna_gain_dbi",
                radio.base_station_antenna_gain_dbi,
            ),
        ] {
            within(key, value, -100.0, 100.0, "-100 to 100")?;
        }
        within(
            "radio.noise_power_dbm",
            radio.noise_power_dbm,
            -250.0,
            100.0,
            "-250 to 100",
        )?;
        within(
            "radio.path_loss_intercept_db",
            radio.path_loss_intercept_db,
            0.0,
            500.0,
            "0 to 500",
        )?;
        for (key, value) in [
            ("cell.base_station_x_m", cell.base_station_x_m),
            ("cell.base_station_y_m", cell.base_station_y_m),
        ] {
            within(key, value, -1e8, 1e8, "a number of metres from -1e8 to 1e8")?;
        }
        for (key, value) in [
            (
                "radio.base_station_noise_figure_db",
                radio.base_station_noise_figure_db,
            ),
            ("radio.vehicle_noise_figure_db", radio.vehicle_noise_figure_db),
            ("radio.path_loss_slope_db", radio.path_loss_slope_db),
            ("radio.shadowing_deviation_db", radio.shadowing_deviation_db),
        ] {
            within(key, value, 0.0, 100.0, "0 to 100")?;
        }
        within("traffic.bpr_power", traffic.bpr_power, 0.0, 100.0, "0 to 100")?;
        let not_negative = [
            ("cell.base_station_height_m", cell.base_station_height_m),
            ("cell.vehicle_height_m", cell.vehicle_height_m),
            (
                "radio.base_station_noise_figure_db",
                radio.base_station_noise_figure_db,
            ),
            ("mobility.min_speed_m_per_s", mobility.min_speed_m_per_s),
            ("baselines.aloha_load", baselines.aloha_load),
            ("baselines.age_threshold_load", baselines.age_threshold_load),
            (
                "traffic.max_capacity_error_veh_per_h",
                traffic.max_capacity_error_veh_per_h,
            ),
        ];
        for (key, value) in not_negative {
            within(key, value, 0.0, 1e6, "a number from 0 to 1e6")?;
        }
        let positive = [
            ("radio.carrier_ghz", radio.carrier_ghz),
            ("radio.bandwidth_khz", radio.bandwidth_khz),
            ("broadcast.joiner_load", broadcast.joiner_load),
            ("radio.shadowing_decorrelation_m", radio.shadowing_decorrelation_m),
            ("mobility.block_x_m", mobility.block_x_m),
            ("mobility.block_y_m", mobility.block_y_m),
            ("mobility.lane_width_m", mobility.lane_width_m),
            ("traffic.free_flow_time_x_s", traffic.free_flow_time_x_s),
            ("traffic.free_flow_time_y_s", traffic.free_flow_time_y_s),
            ("traffic.capacity_veh_per_h", traffic.capacity_veh_per_h),
            ("planning.incident_interval_s", planning.incident_interval_s),
            ("planning.incident_duration_s", planning.incident_duration_s),
        ];
        for (key, value) in positive {
            within(key, value, 1e-6, 1e6, "a number from 1e-6 to 1e6")?;
        }
        within(
            "radio.min_spectral_efficiency",
            radio.min_spectral_efficiency,
            1.0,
            20.0,
            "1 to 20 bit/s/Hz (below 1, two vehicles could succeed on one sub-channel at once)",
        )?;
        for (key, value) in [
            ("mobility.turn_probability", mobility.turn_probability),
            (
                "baselines.age_threshold_probability",
                baselines.age_threshold_probability,
            ),
        ] {
            within(key, value, 0.0, 1.0, "a probability from 0 to 1")?;
        }
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
            100.0,
            "at least mobility.min_speed_m_per_s and at most 100",
        )?;
        within(
            "traffic.max_capacity_error_veh_per_h",
            traffic.max_capacity_error_veh_per_h,
            0.0,
            traffic.capacity_veh_per_h.next_down(),
            "from 0 to less than traffic.capacity_veh_per_h",
        )?;
        within(
            "planning.incident_capacity_loss",
            planning.incident_capacity_loss,
            0.0,
            0.99,
            "a fraction from 0 to 0.99",
        )?;
        integer_within("planning.period_slots", planning.period_slots, 1, 100_000_000)?;
        integer_within("cell.vehicles", cell.vehicles, 1, 10_000)?;
        integer_within(
            "radio.sub_channels",
            radio.sub_channels,
            SUB_CHANNELS as u32,
            SUB_CHANNELS as u32,
        )?;
        integer_within("radio.slow_update_slots", radio.slow_update_slots, 1, 100_000)?;
        integer_within("mobility.blocks_x", mobility.blocks_x, 1, 100)?;
        integer_within("mobility.blocks_y", mobility.blocks_y, 1, 100)?;
        integer_within("mobility.lanes_per_direction", mobility.lanes_per_direction, 1, 8)?;
        let limit = u32::from(Age::MAX.slots());
        integer_within(
            "age.time_constraint_slots",
            age.time_constraint_slots,
            limit,
            limit,
        )?;
        integer_within(
            "broadcast.joiner_count_delay_slots",
            broadcast.joiner_count_delay_slots,
            0,
            10_000,
        )?;
        integer_within(
            "broadcast.shrink_delay_slots",
            broadcast.shrink_delay_slots,
            0,
            10_000,
        )?;
        Ok(())
    }
}

fn within(key: &str, found: f64, least: f64, most: f64, expected: &str) -> Result<()> {
    if (least..=most).contains(&found) {
        Ok(())
    } else {
        Err(Error::input(key, found, expected))
    }
}

fn integer_within(key: &str, found: u32, least: u32, most: u32) -> Result<()> {
    if (least..=most).contains(&found) {
        Ok(())
    } else if least == most {
        Err(Error::input(key, found, least))
    } else {
        Err(Error::input(key, found, format!("{least} to {most}")))
    }
}
