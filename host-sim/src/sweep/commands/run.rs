//! Points that are one `host-sim run` of one policy.

use super::{Column, Command, Measure, Task, column};
use crate::experiment::ExperimentSource;
use crate::policy::KINDS;
use crate::report::chart::Scale;
use crate::sweep::Settings;
use crate::sweep::axis::{BUILT_IN_TABLE, Kind, POLICY, SEED, VEHICLES};
use kit::error::Result;

/// `host-sim run`.
pub static COMMAND: Command = Command {
    name: "run",
    meaning: "Ages of one policy, and what they do to travel times",
    takes_scenario: true,
    keys: &[
        ("mobility", Kind::Mobility),
        ("table", Kind::File(Some(BUILT_IN_TABLE))),
        ("worlds", Kind::Integer),
        ("slots", Kind::Integer),
        ("warmup", Kind::Integer),
        (VEHICLES, Kind::Integer),
        (POLICY, Kind::Text),
        (SEED, Kind::Integer),
    ],
    policies: KINDS,
    counts: &[
        column("vehicles", "/policies/0/vehicles"),
        column("worlds", "/policies/0/worlds"),
        column("slots", "/policies/0/slots"),
        column("warmup", "/warmup"),
    ],
    numbers: NUMBERS,
    measures: &[
        Measure {
            title: "Mean age of information",
            file: "mean_age",
            mean: "mean_age_ms",
            ci95: Some("mean_age_ci95_ms"),
            ..AGE
        },
        Measure {
            title: "Uncapped mean age of information",
            file: "uncapped_mean_age",
            mean: "uncapped_mean_age_ms",
            ci95: Some("uncapped_mean_age_ci95_ms"),
            ..AGE
        },
    ],
    extent: "{worlds} worlds x {slots} slots after {warmup}",
    prepare,
};

/// What ages have in common.
const AGE: Measure = Measure {
    title: "",
    file: "",
    axis: "mean age (ms)",
    scale: Scale::Logarithmic,
    least: 1.0,
    mean: "",
    ci95: None,
};

const NUMBERS: &[Column] = &[
    // Missing where worlds have different vehicles.
    column("bound_age_ms", "/bound_age_ms"),
    column("mean_age_ms", "/policies/0/mean_age_ms"),
    column("mean_age_ci95_ms", "/policies/0/mean_age_ci95_ms"),
    column("median_world_age_ms", "/policies/0/median_world_age_ms"),
    column("p99_age_ms", "/policies/0/p99_age_ms"),
    column("first100_age_ms", "/policies/0/first100_age_ms"),
    column("success_per_slot", "/policies/0/success_per_slot"),
    // Missing with a trace, like all traffic.
    column(
        "uniform_mean_v_over_c",
        "/policies/0/traffic/uniform_mean_v_over_c",
    ),
    column(
        "uniform_mean_link_time_s",
        "/policies/0/traffic/uniform_mean_link_time_s",
    ),
    column(
        "per_road_mean_v_over_c",
        "/policies/0/traffic/per_road_mean_v_over_c",
    ),
    column(
        "per_road_mean_trip_time_s",
        "/policies/0/traffic/per_road_mean_trip_time_s",
    ),
    column(
        "informed_mean_trip_time_s",
        "/policies/0/traffic/informed_mean_trip_time_s",
    ),
    // Missing where nobody was received.
    column("peak_age_ms", "/policies/0/peak_age_ms"),
    column("age_above_10_ms", "/policies/0/age_above_10_ms"),
    column("age_above_20_ms", "/policies/0/age_above_20_ms"),
    column("age_above_50_ms", "/policies/0/age_above_50_ms"),
    column("worst_vehicles_ms", "/policies/0/worst_vehicles_ms"),
    column(
        "transmissions_per_vehicle_slot",
        "/policies/0/transmissions_per_vehicle_slot",
    ),
    column(
        "energy_mj_per_vehicle_slot",
        "/policies/0/energy_mj_per_vehicle_slot",
    ),
    column("uncapped_mean_age_ms", "/policies/0/uncapped_mean_age_ms"),
    column(
        "uncapped_mean_age_ci95_ms",
        "/policies/0/uncapped_mean_age_ci95_ms",
    ),
    column(
        "uncapped_worst_vehicles_ms",
        "/policies/0/uncapped_worst_vehicles_ms",
    ),
];

fn prepare(settings: &Settings<'_>) -> Result<Task> {
    let default = ExperimentSource::default();
    let source = ExperimentSource {
        scenario: settings.scenario()?,
        vehicles: settings.whole(VEHICLES)?,
        mobility: settings.mobility("mobility").unwrap_or(default.mobility),
        policies: settings.choice(POLICY)?.into_iter().collect(),
        table: settings.file("table"),
        worlds: settings.whole("worlds")?,
        slots: settings.whole("slots")?,
        warmup: settings.whole("warmup")?.unwrap_or(default.warmup),
        seed: settings.seed(),
    };
    let experiment = source.read()?;
    Ok(Box::new(move || {
        let results = experiment.results(|_| ())?;
        Ok(experiment.to_json(&results))
    }))
}
