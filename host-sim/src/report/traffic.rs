//! What ages do to the road: the table, the data, and the paper's two path-planning figures.

use super::chart::{Axis, LineChart, Point, Reference, Series};
use super::table::{Column, Table};
use crate::experiment::PolicyResult;
use crate::scenario::Scenario;
use crate::traffic::{TrafficModel, TrafficSummary};
use firmware::units::Age;
use kit::error::Result;
use kit::files::NamedText;

/// The values of delta m that the paper's figures compare, as sixths of the capacity: 10, 15, 20 and 25 of 30 vehicles per
/// hour. The paper shows four and does not say which; these are chosen so that two pass a volume over capacity of 1.
pub(super) const CAPACITY_ERROR_SIXTHS: [f64; 4] = [2.0, 3.0, 4.0, 5.0];

/// The table of traffic, also as data.
///
/// # Errors
/// Never: its columns have a row for each policy.
pub fn table(results: &[PolicyResult], scenario: &Scenario) -> Result<Table> {
    let number = |name, value: fn(&TrafficSummary) -> f64| {
        let traffic = results.iter().filter_map(|result| result.traffic.as_ref());
        Column::number(name, traffic.map(value))
    };
    let with_traffic = || results.iter().filter(|result| result.traffic.is_some());
    let mut table = Table::new(vec![
        Column::text("policy", with_traffic().map(|result| result.name.to_owned())),
        Column::number("mean_age_ms", with_traffic().map(|result| result.ages.mean_ms))
            .shown("mean age", "ms", 2),
        number("uniform_mean_v_over_c", |traffic| {
            traffic.uniform.mean_volume_over_capacity
        })
        .shown("uniform V/C", "", 4)
        .aside(),
        number("uniform_mean_link_time_s", |traffic| {
            traffic.uniform.mean_link_time
        })
        .shown("link time", "uniform, s", 3)
        .aside(),
        number("per_road_mean_v_over_c", |traffic| {
            traffic.stale.mean_volume_over_capacity
        })
        .shown("per-road V/C", "", 3),
        number("per_road_mean_trip_time_s", |traffic| {
            traffic.stale.mean_trip_time
        })
        .shown("trip time", "per road, s", 2),
        number("informed_mean_trip_time_s", |traffic| {
            traffic.informed.mean_trip_time
        })
        .shown("if informed", "per road, s", 2),
    ])?
    .titled("What the age does to traffic");
    let error = scenario.traffic.max_capacity_error_veh_per_h;
    table.note(&format!(
        "Capacity error {error} veh/h at the largest age of {} ms.",
        Age::TIME_CONSTRAINT.slots()
    ));
    table.note(
        "Uniform: every road has the policy's mean age, as in the paper's figures; no route changes then.",
    );
    table.note(
        "Per road: the age of the freshest vehicle on it at the end of each world; 100 ms where none drives.",
    );
    table.note("Most roads are empty under every policy, which is why V/C is high. `host-sim loop` shows what staleness costs a trip.");
    Ok(table)
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
            let states = ages.iter().zip(&states);
            states.map(|(&age, state)| (age, value(state)).into()).collect()
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
        "The paper's algebra: every road has the same age, delta m is the capacity lost at 100 ms, and no route is planned. What \
         planning on old knowledge costs a trip, `host-sim loop` finds."
            .to_owned();
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
        vertical: Axis::linear("mean travel time of a road (s)"),
        series: times,
        references: Vec::new(),
    };
    let mut set = Vec::from(ratio.files("volume_over_capacity", ["delta_m", "age_ms", "mean_v_over_c"])?);
    set.extend(time.files("travel_time", ["delta_m", "age_ms", "mean_link_time_s"])?);
    Ok(set)
}
