//! Ages of policies: the table, the data and the figures.

use super::cell::Cell;
use super::chart::{Axis, Bar, BarChart, LineChart, Point, Reference, Series};
use super::csv::Csv;
use super::text_table::{Column, TextTable};
use crate::age::AgeSummary;
use crate::experiment::PolicyResult;
use kit::error::Result;
use kit::files::NamedText;

const INTERVALS: &str = "Intervals: 95 %, over worlds.";

/// The table of ages.
pub fn table(results: &[PolicyResult], description: &str, bound_ms: f64) -> TextTable<8> {
    let columns = [
        Column::text("policy"),
        Column::number("mean age", "ms", 3),
        Column::number("+-95 %", "ms", 3),
        Column::number("median world", "ms", 3),
        Column::number("99 % within", "ms", 0),
        Column::number("first 100", "ms", 1),
        Column::number("successes", "1/slot", 3),
        Column::number("over bound", "x", 3),
    ];
    let mut table = TextTable::new("Age of information", columns);
    for result in results {
        let [name, mean, interval, median, p99, first, successes] = cells(result);
        let over_bound = (result.ages.mean_ms / bound_ms).into();
        table.row([name, mean, interval, median, p99, first, successes, over_bound]);
    }
    table.row([
        "(bound)".into(),
        bound_ms.into(),
        Cell::Missing,
        Cell::Missing,
        Cell::Missing,
        Cell::Missing,
        Cell::Missing,
        1.0.into(),
    ]);
    table.note(&format!("{description}."));
    table.note("99 % within: the age that at most 1 of 100 vehicle-slots exceeds.");
    table.note("First 100: mean age in the first 100 slots of a world, in which the vehicles begin unknown, at 100 ms.");
    table.note("Central sees every gain and age; the bound is its age on a channel that never fades.");
    table
}

/// The table of what the field measures beside the mean: peaks, violations, the worst vehicles, and what freshness costs.
pub fn measures(results: &[PolicyResult]) -> TextTable<8> {
    let columns = [
        Column::text("policy"),
        Column::number("peak age", "ms", 3),
        Column::number("> 10 ms", "%", 3),
        Column::number("> 20 ms", "%", 3),
        Column::number("> 50 ms", "%", 3),
        Column::number("worst 5 %", "ms", 3),
        Column::number("sent", "1/slot", 4),
        Column::number("energy", "mJ/slot", 4),
    ];
    let mut table = TextTable::new("What the field also measures", columns);
    for PolicyResult { name, ages, .. } in results {
        let above = |age_ms| Cell::from(100.0 * ages.share_above(age_ms));
        table.row([
            (*name).into(),
            ages.peak_ms.into(),
            above(10),
            above(20),
            above(50),
            ages.worst_vehicles_ms.into(),
            ages.transmissions_per_vehicle_slot.into(),
            ages.energy_mj_per_vehicle_slot.into(),
        ]);
    }
    table.note("Peak age: mean of the ages that receptions end, each just before, at most 100 ms. Who is never received adds none.");
    table.note("> x ms: how often a vehicle's information is older. Worst 5 %: the mean age that one vehicle in 20 exceeds.");
    table.note("Sent, energy: transmissions, received or not, and what they radiate, a vehicle and slot.");
    table
}

/// A policy's row: name, mean age with its interval, median world, 99th percentile, first 100 slots, successes.
fn cells(result: &PolicyResult) -> [Cell; 7] {
    let ages = &result.ages;
    [
        result.name.into(),
        ages.mean_ms.into(),
        ages.ci95_ms.into(),
        ages.median_world_ms.into(),
        ages.p99_ms.into(),
        ages.first100_ms.into(),
        ages.success_per_slot.into(),
    ]
}

/// Figures and data.
///
/// # Errors
/// If a figure cannot show its values.
pub fn files(results: &[PolicyResult], description: &str, bound_ms: f64) -> Result<Vec<NamedText>> {
    let note = format!("{description}. {INTERVALS}");
    let bound = Reference {
        name: "bound".to_owned(),
        value: bound_ms,
    };
    let bars = results.iter().map(|PolicyResult { name, ages, .. }| Bar {
        name: (*name).to_owned(),
        value: ages.mean_ms,
        interval: ages
            .ci95_ms
            // No age is below 1 ms, wherever the interval of a few worlds ends.
            .map(|half| ((ages.mean_ms - half).max(1.0), ages.mean_ms + half)),
        emphasised: *name == "actor",
    });
    let mean_age = BarChart {
        title: "Mean age of information by policy".to_owned(),
        note: note.clone(),
        axis: Axis::logarithmic("mean age (ms)"),
        decimals: 2,
        bars: bars.collect(),
        reference: Some(bound.clone()),
    };
    let start = LineChart {
        title: "Cold start: mean age after each slot, all vehicles from 100 ms".to_owned(),
        note: description.to_owned(),
        horizontal: Axis::linear("slot (ms)"),
        vertical: Axis::logarithmic("mean age (ms)"),
        series: series(results, |ages| ages.start_ms.clone()),
        references: vec![bound],
    };
    let distribution = LineChart {
        title: "How often information is older".to_owned(),
        note: description.to_owned(),
        horizontal: Axis::linear("age (ms)"),
        vertical: Axis::logarithmic("fraction of vehicle-slots with an older report (1)"),
        series: series(results, |ages| exceedance(&ages.distribution)),
        references: Vec::new(),
    };
    Ok(vec![
        ("mean_age.svg".to_owned(), mean_age.to_svg()?),
        ("mean_age.csv".to_owned(), mean_age_csv(results)),
        ("cold_start.svg".to_owned(), start.to_svg()?),
        (
            "cold_start.csv".to_owned(),
            long_csv(["policy", "slot", "mean_age_ms"], &start.series),
        ),
        ("age_distribution.svg".to_owned(), distribution.to_svg()?),
        (
            "age_distribution.csv".to_owned(),
            long_csv(["policy", "age_ms", "fraction_above"], &distribution.series),
        ),
    ])
}

/// One series a policy, of its positive values over 1, 2, 3 and so on.
fn series(results: &[PolicyResult], values: fn(&AgeSummary) -> Vec<f64>) -> Vec<Series> {
    let of = |result: &PolicyResult| {
        let points = (1_u32..).zip(values(&result.ages)).filter(|&(_, y)| y > 0.0);
        Series {
            name: result.name.to_owned(),
            points: points
                .map(|(x, y)| Point {
                    x: f64::from(x),
                    y,
                    band: None,
                })
                .collect(),
        }
    };
    results.iter().map(of).collect()
}

/// Fraction above each age from 1 on.
fn exceedance(distribution: &[f64]) -> Vec<f64> {
    let mut above = 1.0;
    distribution
        .iter()
        .skip(1)
        .map(|fraction| {
            above -= fraction;
            // Below one vehicle-slot in a thousand millions it is the rounding of the sum.
            if above < 1e-9 { 0.0 } else { above }
        })
        .collect()
}

fn mean_age_csv(results: &[PolicyResult]) -> String {
    let mut csv = Csv::new([
        "policy",
        "mean_age_ms",
        "mean_age_ci95_ms",
        "median_world_age_ms",
        "p99_age_ms",
        "first100_age_ms",
        "success_per_slot",
    ]);
    for result in results {
        csv.row(cells(result));
    }
    csv.into_text()
}

/// One row a point.
pub fn long_csv(header: [&str; 3], series: &[Series]) -> String {
    let mut csv = Csv::new(header);
    for series in series {
        for point in &series.points {
            csv.row([series.name.as_str().into(), point.x.into(), point.y.into()]);
        }
    }
    csv.into_text()
}
