//! Points that are one `host-sim loop` of one policy and one seed.

use super::{Column, Command, Measure, Task, column};
use crate::closed_loop::experiment::{LoopSource, POLICIES};
use crate::report::chart::Scale;
use crate::sweep::Settings;
use crate::sweep::axis::{BUILT_IN_TABLE, GRID, Kind, POLICY, SEED};
use kit::error::Result;

/// `host-sim loop`.
pub static COMMAND: Command = Command {
    name: "loop",
    meaning: "Hours from slot to street under one policy, and what trips lose to what",
    takes_scenario: true,
    keys: &[
        ("traffic", Kind::Text),
        ("net", Kind::Network(GRID)),
        ("trips", Kind::File(None)),
        ("nodes", Kind::File(None)),
        ("metres_per_unit", Kind::Number),
        ("seconds_per_unit", Kind::Number),
        ("toll_weight", Kind::Number),
        ("distance_weight", Kind::Number),
        ("table", Kind::File(Some(BUILT_IN_TABLE))),
        ("worlds", Kind::Integer),
        ("delay", Kind::Number),
        (POLICY, Kind::Text),
        (SEED, Kind::Integer),
    ],
    policies: &POLICIES,
    counts: &[
        column("worlds", "/worlds"),
        column("roads", "/roads"),
        column("base_stations", "/base_stations"),
        column("most_connected_in_cell", "/most_connected_in_cell"),
    ],
    numbers: NUMBERS,
    measures: &[
        Measure {
            title: "What a trip loses to what is not known",
            file: "trip_loss",
            axis: "trip time beyond all known at once (s)",
            mean: "regret_s_per_trip",
            ci95: Some("regret_ci95_s_per_trip"),
            ..LOSS
        },
        Measure {
            title: "What a trip loses to the radio",
            file: "radio_loss",
            axis: "trip time beyond reports at once (s)",
            mean: "trip_loss_radio_s",
            ci95: Some("trip_loss_radio_ci95_s"),
            ..LOSS
        },
        Measure {
            title: "What a trip loses to reports of one delay",
            file: "delay_loss",
            axis: "trip time beyond reports at once (s)",
            mean: "trip_loss_delay_s",
            ci95: Some("trip_loss_delay_ci95_s"),
            ..LOSS
        },
    ],
    extent: "{worlds} worlds of {roads} roads",
    prepare,
};

/// What losses have in common. They may lie below zero: who knows more does not always share the roads better.
const LOSS: Measure = Measure {
    title: "",
    file: "",
    axis: "",
    scale: Scale::Linear,
    least: f64::NEG_INFINITY,
    mean: "",
    ci95: None,
};

/// A point has one policy, which is the freshest of all in it: its loss to radio has that to the protocol in it.
const NUMBERS: &[Column] = &[
    column("vehicles", "/vehicles"),
    // Missing where nobody was ever connected, like all ages.
    column("connected_in_cell", "/connected_in_cell"),
    column("mean_age_ms", "/policies/0/mean_age_ms"),
    column("mean_age_ci95_ms", "/policies/0/mean_age_ci95_ms"),
    column("uncapped_mean_age_ms", "/policies/0/uncapped_mean_age_ms"),
    column("p99_age_ms", "/policies/0/p99_age_ms"),
    column("road_age_s", "/policies/0/road_age_s"),
    column("mean_travel_time_s", "/policies/0/mean_travel_time_s"),
    column("mean_travel_time_ci95_s", "/policies/0/mean_travel_time_ci95_s"),
    column("mean_v_over_c", "/policies/0/mean_v_over_c"),
    column("unfinished_share", "/policies/0/unfinished_share"),
    column("let_through_per_trip", "/policies/0/let_through_per_trip"),
    column("regret_s_per_trip", "/policies/0/regret_s_per_trip"),
    column("regret_ci95_s_per_trip", "/policies/0/regret_ci95_s_per_trip"),
    column("trip_loss_obedience_s", "/policies/0/trip_loss_s/obedience"),
    column(
        "trip_loss_obedience_ci95_s",
        "/policies/0/trip_loss_s/obedience_ci95",
    ),
    column("trip_loss_coverage_s", "/policies/0/trip_loss_s/coverage"),
    column(
        "trip_loss_coverage_ci95_s",
        "/policies/0/trip_loss_s/coverage_ci95",
    ),
    column("trip_loss_detection_s", "/policies/0/trip_loss_s/detection"),
    column(
        "trip_loss_detection_ci95_s",
        "/policies/0/trip_loss_s/detection_ci95",
    ),
    column("trip_loss_radio_s", "/policies/0/trip_loss_s/radio"),
    column("trip_loss_radio_ci95_s", "/policies/0/trip_loss_s/radio_ci95"),
    // Missing without a delay.
    column("delayed_mean_travel_time_s", "/delayed/0/mean_travel_time_s"),
    column("trip_loss_delay_s", "/delayed/0/trip_loss_s"),
    column("trip_loss_delay_ci95_s", "/delayed/0/trip_loss_ci95_s"),
    column("trip_loss_no_information_s", "/cases/no_information/trip_loss_s"),
    column(
        "trip_loss_no_information_ci95_s",
        "/cases/no_information/trip_loss_ci95_s",
    ),
    column(
        "all_known_mean_travel_time_s",
        "/cases/full_knowledge/mean_travel_time_s",
    ),
    column(
        "detected_mean_travel_time_s",
        "/cases/detected/mean_travel_time_s",
    ),
    column("detected_road_age_s", "/cases/detected/road_age_s"),
];

fn prepare(settings: &Settings<'_>) -> Result<Task> {
    let default = LoopSource::default();
    let source = LoopSource {
        scenario: settings.scenario()?,
        policies: settings.choice(POLICY)?.into_iter().collect(),
        table: settings.file("table"),
        worlds: settings.whole("worlds")?.unwrap_or(default.worlds),
        delays_s: Some(settings.number("delay").into_iter().collect()),
        traffic: settings.choice("traffic")?.unwrap_or(default.traffic),
        net: settings.file("net"),
        trips: settings.file("trips"),
        nodes: settings.file("nodes"),
        metres_per_unit: settings.number("metres_per_unit"),
        seconds_per_unit: settings.number("seconds_per_unit"),
        weights: settings.weights(),
        unreachable: default.unreachable,
        seed: settings.seed(),
    };
    let experiment = source.read()?;
    Ok(Box::new(move || {
        let town = experiment.town()?;
        let summary = experiment.summary(&town, |_| ())?;
        Ok(experiment.to_json(&town, &summary))
    }))
}
