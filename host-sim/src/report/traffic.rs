//! What ages do to the road: the table, the data, and the paper's two path-planning figures.

use super::ages::long_csv;
use super::cell::Cell;
use super::chart::{Axis, LineChart, Point, Reference, Series};
use super::csv::Csv;
use super::text_table::{Column, TextTable};
use crate::experiment::PolicyResult;
use crate::scenario::Scenario;
use crate::traffic::{TrafficModel, TrafficSummary};
use firmware::units::Age;
use kit::error::Result;
use kit::files::NamedText;

/// The values of delta m that the paper's figures compare, as sixths of the capacity: 10, 15, 20 and 25 of 30 vehicles per
/// hour. The paper shows four and does not say which; these are chosen so that two pass a volume over capacity of 1.
pub(super) const CAPACITY_ERROR_SIXTHS: [f64; 4] = [2.0, 3.0, 4.0, 5.0];

/// The table of traffic.
pub fn table(results: &[PolicyResult], scenario: &Scenario) -> TextTable<7> {
    let columns = [
        Column::text("policy"),
        Column::number("mean age", "ms", 2),
        Column::number("uniform V/C", "", 4),
        Column::number("link time", "uniform, s", 3),
        Column::number("per-road V/C", "", 3),
        Column::number("trip time", "per road, s", 2),
        Column::number("if informed", "per road, s", 2),
    ];
    let mut table = TextTable::new("What the age does to traffic", columns);
    for (result, traffic) in with_traffic(results) {
        table.row(cells(result, traffic));
    }
    let error = scenario.traffic.max_capacity_error_veh_per_h;
    table.note(&format!(
        "Capacity error {error} veh/h at the largest age of {} ms.",
        Age::MAX.slots()
    ));
    table.note(
        "Uniform: every road has the policy's mean age, as in the paper's figures; no route changes then.",
    );
    table.note(
        "Per road: the age of the freshest vehicle on it at the end of each world; 100 ms where none drives.",
    );
    table.note("Most roads are empty under every policy, which is why V/C is high. `host-sim loop` shows what staleness costs a trip.");
    table
}

fn with_traffic(results: &[PolicyResult]) -> impl Iterator<Item = (&PolicyResult, &TrafficSummary)> {
    results
        .iter()
        .filter_map(|result| Some((result, result.traffic.as_ref()?)))
}

/// A policy's row: name, mean age, then volume over capacity and times with uniform and with per-road ages.
fn cells(result: &PolicyResult, traffic: &TrafficSummary) -> [Cell; 7] {
    [
        result.name.into(),
        result.ages.mean_ms.into(),
        traffic.uniform.mean_volume_over_capacity.into(),
        traffic.uniform.mean_link_time.into(),
        traffic.stale.mean_volume_over_capacity.into(),
        traffic.stale.mean_trip_time.into(),
        traffic.informed.mean_trip_time.into(),
    ]
}

/// The table as data.
pub fn csv(results: &[PolicyResult]) -> NamedText {
    let mut csv = Csv::new([
        "policy",
        "mean_age_ms",
        "uniform_mean_v_over_c",
        "uniform_mean_link_time_s",
        "per_road_mean_v_over_c",
        "per_road_mean_trip_time_s",
        "informed_mean_trip_time_s",
    ]);
    for (result, traffic) in with_traffic(results) {
        csv.row(cells(result, traffic));
    }
    ("traffic.csv".to_owned(), csv.into_text())
}

/// The paper's figures of volume over capacity and of travel time against age, as SVG and CSV. Every road has the same
/// age.
///
/// # Errors
/// If the scenario's grid has no equilibrium.
pub fn paper_figures(scenario: &Scenario) -> Result<Vec<NamedText>> {
    let mut ratios = Vec::new();
    let mut times = Vec::new();
    for sixths in CAPACITY_ERROR_SIXTHS {
        let mut scenario = scenario.clone();
        let error = scenario.traffic.capacity_veh_per_h * sixths / 6.0;
        scenario.traffic.max_capacity_error_veh_per_h = error;
        let model = TrafficModel::new(&scenario)?;
        let ages: Vec<f64> = (0..=50).map(|step| 2.0 * f64::from(step)).collect();
        let states = model.uniform(&ages)?;
        let name = format!("delta m = {error} veh/h");
        let points = |value: fn(&crate::capacity::TrafficState) -> f64| -> Vec<Point> {
            ages.iter()
                .zip(&states)
                .map(|(&x, state)| Point {
                    x,
                    y: value(state),
                    band: None,
                })
                .collect()
        };
        ratios.push(Series {
            name: name.clone(),
            points: points(|state| state.mean_volume_over_capacity),
        });
        times.push(Series {
            name,
            points: points(|state| state.mean_link_time),
        });
    }
    let note =
        "Every road has the same age, as in the paper; delta m is the capacity lost at 100 ms.".to_owned();
    let ratio = LineChart {
        title: "Mean volume over capacity of roads against age of information".to_owned(),
        note: note.clone(),
        horizontal: Axis::linear("mean age of information (ms)"),
        vertical: Axis::linear("mean V/C (1)"),
        series: ratios,
        references: vec![Reference {
            name: "capacity".to_owned(),
            value: 1.0,
        }],
    };
    let time = LineChart {
        title: "Mean travel time of roads against age of information".to_owned(),
        note,
        horizontal: Axis::linear("mean age of information (ms)"),
        vertical: Axis::logarithmic("mean travel time of a road (s)"),
        series: times,
        references: Vec::new(),
    };
    Ok(vec![
        ("volume_over_capacity.svg".to_owned(), ratio.to_svg()?),
        (
            "volume_over_capacity.csv".to_owned(),
            long_csv(["delta_m", "age_ms", "mean_v_over_c"], &ratio.series),
        ),
        ("travel_time.svg".to_owned(), time.to_svg()?),
        (
            "travel_time.csv".to_owned(),
            long_csv(["delta_m", "age_ms", "mean_link_time_s"], &time.series),
        ),
    ])
}
