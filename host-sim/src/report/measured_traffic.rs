//! The paper's path-planning figures with the ages that real policies reach: every road with a policy's mean age beside
//! every road with the age of its own freshest vehicle.

use super::chart::{Axis, LineChart, Point, Reference, Series, side_by_side};
use super::table::{Column, Table};
use super::traffic::CAPACITY_ERROR_SIXTHS;
use crate::age::AgeSummary;
use crate::capacity::TrafficState;
use crate::scenario::Scenario;
use crate::traffic::{RoadAges, TrafficModel};
use kit::error::Result;
use kit::files::NamedText;

/// The ages that one policy reached.
pub struct MeasuredAges {
    /// Name of the policy.
    pub policy: &'static str,
    /// Of its vehicles.
    pub ages: AgeSummary,
    /// Of the roads, at the end of every world.
    pub roads: Vec<RoadAges>,
}

/// A mean with half the width of its 95 % interval.
#[derive(Clone, Copy)]
struct Estimate {
    mean: f64,
    half: f64,
}

/// What one policy's ages do at one delta m.
struct Measurement {
    policy: &'static str,
    age: Estimate,
    delta_m: f64,
    /// Volume over capacity, then travel time of a road in s.
    uniform: [Estimate; 2],
    per_road: [Estimate; 2],
}

/// Two figures, volume over capacity and travel time against mean age, each with both modes side by side, and their data.
/// `description` says what was simulated.
///
/// # Errors
/// If the scenario's grid has no equilibrium.
pub fn figures(scenario: &Scenario, measured: &[MeasuredAges], description: &str) -> Result<Vec<NamedText>> {
    let mut by_delta = Vec::new();
    for sixths in CAPACITY_ERROR_SIXTHS {
        let mut scenario = scenario.clone();
        scenario.traffic.max_capacity_error_veh_per_h = scenario.traffic.capacity_veh_per_h * sixths / 6.0;
        let model = TrafficModel::new(&scenario)?;
        let delta_m = scenario.traffic.max_capacity_error_veh_per_h;
        let mut row = measured
            .iter()
            .map(|measured| measure(&model, delta_m, measured))
            .collect::<Result<Vec<Measurement>>>()?;
        row.sort_by(|a, b| a.age.mean.total_cmp(&b.age.mean));
        by_delta.push(row);
    }
    let ratio = both_modes(
        &by_delta,
        0,
        "Mean volume over capacity of roads",
        Axis::linear("mean V/C (1)"),
        Some(1.0),
        description,
    )?;
    let time = both_modes(
        &by_delta,
        1,
        "Mean travel time of roads",
        Axis::logarithmic("mean travel time of a road (s)"),
        None,
        description,
    )?;
    Ok(vec![
        ("measured_volume_over_capacity.svg".to_owned(), ratio),
        ("measured_travel_time.svg".to_owned(), time),
        ("measured_traffic.csv".to_owned(), csv(&by_delta)?),
    ])
}

fn measure(model: &TrafficModel, delta_m: f64, measured: &MeasuredAges) -> Result<Measurement> {
    let values = |state: &TrafficState| [state.mean_volume_over_capacity, state.mean_link_time];
    let half = measured.ages.ci95_ms.unwrap_or(0.0);
    let mean = measured.ages.mean_ms;
    // What the interval of the age becomes: both curves rise with age.
    let states = model.uniform(&[mean, (mean - half).max(0.0)])?;
    let (middle, low) = (values(&states[0]), values(&states[1]));
    let outcomes = model.per_road(&measured.roads)?;
    let per_road = |index: usize| {
        let by_world: Vec<f64> = outcomes
            .iter()
            .map(|outcome| values(&outcome.stale)[index])
            .collect();
        let (mean, half) = AgeSummary::mean_and_interval(&by_world);
        Estimate {
            mean,
            half: half.unwrap_or(0.0),
        }
    };
    let uniform = |index: usize| Estimate {
        mean: middle[index],
        half: middle[index] - low[index],
    };
    Ok(Measurement {
        policy: measured.policy,
        age: Estimate { mean, half },
        delta_m,
        uniform: [uniform(0), uniform(1)],
        per_road: [per_road(0), per_road(1)],
    })
}

/// One quantity in both modes.
fn both_modes(
    by_delta: &[Vec<Measurement>],
    quantity: usize,
    title: &str,
    vertical: Axis,
    reference: Option<f64>,
    description: &str,
) -> Result<String> {
    let policies: Vec<String> = by_delta.first().map_or_else(Vec::new, |row| {
        let names = row.iter().map(|m| format!("{} {:.1}", m.policy, m.age.mean));
        names.collect()
    });
    let chart = |mode: &str, note: String, value: fn(&Measurement) -> &[Estimate; 2]| LineChart {
        title: format!("{title}, {mode}"),
        note,
        horizontal: Axis::linear("measured mean age of information (ms)"),
        vertical: vertical.clone(),
        series: by_delta
            .iter()
            .map(|row| series(row, |measurement| value(measurement)[quantity]))
            .collect(),
        references: reference
            .map(|value| Reference {
                name: "capacity".to_owned(),
                value,
            })
            .into_iter()
            .collect(),
    };
    let uniform = chart(
        "all roads alike",
        format!("{description}. Points, in ms: {}.", policies.join(", ")),
        |measurement| &measurement.uniform,
    );
    let per_road = chart(
        "each road by itself",
        "A road is as old as its freshest vehicle at the end of a world, 100 ms where none drives. 95 % intervals over worlds."
            .to_owned(),
        |measurement| &measurement.per_road,
    );
    Ok(side_by_side(&[uniform.to_svg()?, per_road.to_svg()?]))
}

/// One delta m against age.
fn series(row: &[Measurement], value: impl Fn(&Measurement) -> Estimate) -> Series {
    let delta_m = row.first().map_or(0.0, |measurement| measurement.delta_m);
    Series {
        name: format!("delta m = {delta_m} veh/h"),
        points: row
            .iter()
            .map(|measurement| {
                let Estimate { mean, half } = value(measurement);
                Point {
                    x: measurement.age.mean,
                    y: mean,
                    band: Some((mean - half, mean + half)),
                }
            })
            .collect(),
    }
}

fn csv(by_delta: &[Vec<Measurement>]) -> Result<String> {
    let rows = || by_delta.iter().flatten();
    let number = |name, value: fn(&Measurement) -> f64| Column::number(name, rows().map(value));
    let table = Table::new(vec![
        Column::text("policy", rows().map(|row| row.policy.to_owned())),
        number("delta_m", |row| row.delta_m),
        number("mean_age_ms", |row| row.age.mean),
        number("mean_age_ci95_ms", |row| row.age.half),
        number("uniform_mean_v_over_c", |row| row.uniform[0].mean),
        number("uniform_mean_link_time_s", |row| row.uniform[1].mean),
        number("per_road_mean_v_over_c", |row| row.per_road[0].mean),
        number("per_road_mean_v_over_c_ci95", |row| row.per_road[0].half),
        number("per_road_mean_link_time_s", |row| row.per_road[1].mean),
        number("per_road_mean_link_time_ci95_s", |row| row.per_road[1].half),
    ])?;
    Ok(table.to_csv())
}
