//! What is kept of a point: nothing that depends on the machine or on how long it took.

use crate::experiment::{Experiment, PolicyResult};
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Changes whenever the same input gives other results, so that old ones are not mixed with new ones.
pub const VERSION: u32 = 3;

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
    pub bound_age_ms: f64,
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
    pub transmissions_per_vehicle_slot: f64,
    pub energy_mj_per_vehicle_slot: f64,
    /// `None` with a trace, like all that follows.
    pub uniform_mean_v_over_c: Option<f64>,
    pub uniform_mean_link_time_s: Option<f64>,
    pub per_road_mean_v_over_c: Option<f64>,
    pub per_road_mean_trip_time_s: Option<f64>,
    pub informed_mean_trip_time_s: Option<f64>,
}

/// A column of outcomes: its name and its value.
pub type Field<T> = (&'static str, fn(&Outcome) -> T);

impl Outcome {
    /// How much was simulated.
    pub const EXTENT: [Field<u64>; 4] = [
        ("vehicles", |outcome| outcome.vehicles),
        ("worlds", |outcome| outcome.worlds),
        ("slots", |outcome| outcome.slots),
        ("warmup", |outcome| outcome.warmup),
    ];

    /// What came out; a new column goes to the end.
    pub const NUMBERS: [Field<Option<f64>>; 19] = [
        ("bound_age_ms", |outcome| Some(outcome.bound_age_ms)),
        ("mean_age_ms", |outcome| Some(outcome.mean_age_ms)),
        ("mean_age_ci95_ms", |outcome| outcome.mean_age_ci95_ms),
        ("median_world_age_ms", |outcome| Some(outcome.median_world_age_ms)),
        ("p99_age_ms", |outcome| Some(outcome.p99_age_ms)),
        ("first100_age_ms", |outcome| Some(outcome.first100_age_ms)),
        ("success_per_slot", |outcome| Some(outcome.success_per_slot)),
        ("uniform_mean_v_over_c", |outcome| outcome.uniform_mean_v_over_c),
        ("uniform_mean_link_time_s", |outcome| {
            outcome.uniform_mean_link_time_s
        }),
        ("per_road_mean_v_over_c", |outcome| outcome.per_road_mean_v_over_c),
        ("per_road_mean_trip_time_s", |outcome| {
            outcome.per_road_mean_trip_time_s
        }),
        ("informed_mean_trip_time_s", |outcome| {
            outcome.informed_mean_trip_time_s
        }),
        ("peak_age_ms", |outcome| outcome.peak_age_ms),
        ("age_above_10_ms", |outcome| Some(outcome.age_above_10_ms)),
        ("age_above_20_ms", |outcome| Some(outcome.age_above_20_ms)),
        ("age_above_50_ms", |outcome| Some(outcome.age_above_50_ms)),
        ("worst_vehicles_ms", |outcome| Some(outcome.worst_vehicles_ms)),
        ("transmissions_per_vehicle_slot", |outcome| {
            Some(outcome.transmissions_per_vehicle_slot)
        }),
        ("energy_mj_per_vehicle_slot", |outcome| {
            Some(outcome.energy_mj_per_vehicle_slot)
        }),
    ];

    /// Simulates a point, which has one policy, on the current rayon pool.
    ///
    /// # Errors
    /// As [`Experiment::results`].
    pub fn compute(experiment: &Experiment) -> Result<Self> {
        let results = experiment.results(|_| ())?;
        let [PolicyResult { ages, traffic, .. }] = results.as_slice() else {
            let found = format!("{} policies", results.len());
            return Err(Error::input("point of a sweep", found, "one"));
        };
        Ok(Self {
            vehicles: experiment.source.vehicles(&experiment.scenario) as u64,
            worlds: experiment.extent.worlds.into(),
            slots: experiment.extent.slots.into(),
            warmup: experiment.extent.warmup.into(),
            bound_age_ms: experiment.simulation().bound_age_ms(),
            mean_age_ms: ages.mean_ms,
            mean_age_ci95_ms: ages.ci95_ms,
            median_world_age_ms: ages.median_world_ms,
            p99_age_ms: ages.p99_ms,
            first100_age_ms: ages.first100_ms,
            success_per_slot: ages.success_per_slot,
            peak_age_ms: ages.peak_ms,
            age_above_10_ms: ages.share_above(10),
            age_above_20_ms: ages.share_above(20),
            age_above_50_ms: ages.share_above(50),
            worst_vehicles_ms: ages.worst_vehicles_ms,
            transmissions_per_vehicle_slot: ages.transmissions_per_vehicle_slot,
            energy_mj_per_vehicle_slot: ages.energy_mj_per_vehicle_slot,
            uniform_mean_v_over_c: traffic.as_ref().map(|t| t.uniform.mean_volume_over_capacity),
            uniform_mean_link_time_s: traffic.as_ref().map(|t| t.uniform.mean_link_time),
            per_road_mean_v_over_c: traffic.as_ref().map(|t| t.stale.mean_volume_over_capacity),
            per_road_mean_trip_time_s: traffic.as_ref().map(|t| t.stale.mean_trip_time),
            informed_mean_trip_time_s: traffic.as_ref().map(|t| t.informed.mean_trip_time),
        })
    }
}
