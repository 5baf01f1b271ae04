//! What is kept of a point: nothing that depends on the machine or on how long it took.

use crate::experiment::Experiment;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Changes whenever the same input gives other results, so that old ones are not mixed with new ones.
pub const VERSION: u32 = 6;

/// A point's result. Ages in ms; the keys are those of `host-sim run --json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(
    missing_docs,
    reason = "`Experiment::to_json` and `age::AgeSummary` say what each is"
)]
pub struct Outcome {
    pub vehicles: u64,
    pub worlds: u64,
    pub slots: u64,
    pub warmup: u64,
    /// `None` where worlds have different vehicles.
    pub bound_age_ms: Option<f64>,
    pub mean_age_ms: f64,
    pub mean_age_ci95_ms: Option<f64>,
    pub median_world_age_ms: f64,
    pub p99_age_ms: f64,
    pub first100_age_ms: f64,
    pub success_per_slot: f64,
    /// `None` where nobody was received.
    pub peak_age_ms: Option<f64>,
    pub age_above_10_ms: f64,
    pub age_above_20_ms: f64,
    pub age_above_50_ms: f64,
    pub worst_vehicles_ms: f64,
    pub uncapped_mean_age_ms: f64,
    pub uncapped_mean_age_ci95_ms: Option<f64>,
    pub uncapped_worst_vehicles_ms: f64,
    pub transmissions_per_vehicle_slot: f64,
    pub energy_mj_per_vehicle_slot: f64,
    /// `None` with a trace, like all that follows.
    pub uniform_mean_v_over_c: Option<f64>,
    pub uniform_mean_link_time_s: Option<f64>,
    pub per_road_mean_v_over_c: Option<f64>,
    pub per_road_mean_trip_time_s: Option<f64>,
    pub informed_mean_trip_time_s: Option<f64>,
}

impl Outcome {
    /// Columns of how much was simulated.
    pub const EXTENT: [&str; 4] = ["vehicles", "worlds", "slots", "warmup"];

    /// Columns of what came out; a new one goes to the end.
    pub const NUMBERS: [&str; 22] = [
        "bound_age_ms",
        "mean_age_ms",
        "mean_age_ci95_ms",
        "median_world_age_ms",
        "p99_age_ms",
        "first100_age_ms",
        "success_per_slot",
        "uniform_mean_v_over_c",
        "uniform_mean_link_time_s",
        "per_road_mean_v_over_c",
        "per_road_mean_trip_time_s",
        "informed_mean_trip_time_s",
        "peak_age_ms",
        "age_above_10_ms",
        "age_above_20_ms",
        "age_above_50_ms",
        "worst_vehicles_ms",
        "transmissions_per_vehicle_slot",
        "energy_mj_per_vehicle_slot",
        "uncapped_mean_age_ms",
        "uncapped_mean_age_ci95_ms",
        "uncapped_worst_vehicles_ms",
    ];

    /// Simulates a point, which has one policy, on the current rayon pool.
    ///
    /// # Errors
    /// As [`Experiment::results`].
    pub fn compute(experiment: &Experiment) -> Result<Self> {
        let results = experiment.results(|_| ())?;
        if results.len() != 1 {
            let found = format!("{} policies", results.len());
            return Err(Error::input("point of a sweep", found, "one"));
        }
        let run = experiment.to_json(&results);
        let policy = &run["policies"][0];
        let parts = [policy, &policy["traffic"], &run];
        let columns = Self::EXTENT.iter().chain(&Self::NUMBERS).map(|&name| {
            let found = parts.iter().find_map(|part| part.get(name));
            (name.to_owned(), found.cloned().unwrap_or_default())
        });
        serde_json::from_value(Value::Object(columns.collect()))
            .map_err(|error| Error::input("point of a sweep", error, "the numbers of a run"))
    }
}
