//! Ages of policies: the table, the data and the figures.

use super::chart::{Axis, Bar, BarChart, LineChart, Reference, Series};
use super::table::{Column, Table};
use crate::age::AgeSummary;
use crate::experiment::PolicyResult;
use kit::error::Result;
use kit::files::NamedText;

const INTERVALS: &str = "Intervals: 95 %, over worlds.";

/// What is known of the policies' ages, and of the bound, if it is given, but for its mean nothing.
fn columns(results: &[PolicyResult], bound_ms: Option<f64>) -> Vec<Column> {
    let names = results.iter().map(|result| result.name);
    let names = names.chain(bound_ms.map(|_| "(bound)")).map(str::to_owned);
    let means = results.iter().map(|result| result.ages.mean_ms).chain(bound_ms);
    let others = |name, value: fn(&AgeSummary) -> Option<f64>| {
        let values = results.iter().map(|result| value(&result.ages));
        Column::number(name, values.chain(bound_ms.map(|_| None)))
    };
    vec![
        Column::text("policy", names),
        Column::number("mean_age_ms", means).shown("mean age", "ms", 3),
        others("mean_age_ci95_ms", |ages| ages.ci95_ms).shown("+-95 %", "ms", 3),
        others("median_world_age_ms", |ages| Some(ages.median_world_ms))
            .shown("median world", "ms", 3)
            .aside(),
        others("p99_age_ms", |ages| Some(ages.p99_ms)).shown("99 % within", "ms", 0),
        others("first100_age_ms", |ages| Some(ages.first100_ms)).shown("first 100", "ms", 1),
        others("success_per_slot", |ages| Some(ages.success_per_slot))
            .shown("successes", "1/slot", 3)
            .aside(),
    ]
}

/// The table of ages; without a bound where worlds differ in their vehicles.
///
/// # Errors
/// Never: its columns have a row for each policy and one for the bound.
pub fn table(results: &[PolicyResult], description: &str, bound_ms: Option<f64>) -> Result<Table> {
    let mut columns = columns(results, bound_ms);
    if let Some(bound_ms) = bound_ms {
        let over_bound = results.iter().map(|result| result.ages.mean_ms / bound_ms);
        columns.push(Column::number("over_bound", over_bound.chain([1.0])).shown("over bound", "x", 3));
    }
    let mut table = Table::new(columns)?.titled("Age of information");
    table.note(&format!("{description}."));
    table.note("99 % within: the age that at most 1 of 100 vehicle-slots exceeds.");
    table.note("First 100: mean age in the first 100 slots of a world, in which the vehicles begin unknown, at 100 ms.");
    table.note("Central sees every gain and age; the bound is its age on a channel that never fades.");
    Ok(table)
}

/// The table of what the field measures beside the mean: peaks, violations, the worst vehicles, and what freshness costs.
///
/// # Errors
/// Never: its columns have a row for each policy.
pub fn measures(results: &[PolicyResult]) -> Result<Table> {
    let number = |name, value: fn(&AgeSummary) -> Option<f64>, unit, decimals| {
        Column::number(name, results.iter().map(|result| value(&result.ages))).shown(name, unit, decimals)
    };
    let mut table = Table::new(vec![
        Column::text("policy", results.iter().map(|result| result.name.to_owned())),
        number("uncapped", |ages| Some(ages.uncapped_mean_ms), "ms", 3),
        number("peak age", |ages| ages.peak_ms, "ms", 3),
        number("> 10 ms", |ages| Some(100.0 * ages.share_above(10)), "%", 3),
        number("> 20 ms", |ages| Some(100.0 * ages.share_above(20)), "%", 3).aside(),
        number("> 50 ms", |ages| Some(100.0 * ages.share_above(50)), "%", 3),
        number("worst 5 %", |ages| Some(ages.worst_vehicles_ms), "ms", 3),
        number(
            "sent",
            |ages| Some(ages.transmissions_per_vehicle_slot),
            "1/slot",
            4,
        ),
        number(
            "energy",
            |ages| Some(ages.energy_mj_per_vehicle_slot),
            "mJ/slot",
            4,
        ),
    ])?
    .titled("What the field also measures");
    table.note("Uncapped: the mean of ages that do not saturate at 100 ms, as the paper's do.");
    table.note(
        "Peak age: mean of the ages that receptions end, each just before. Who is never received adds none.",
    );
    table.note("> x ms: how often a vehicle's information is older. Worst 5 %: the mean age that one vehicle in 20 exceeds.");
    table.note("Sent, energy: transmissions, received or not, and what they radiate, a vehicle and slot.");
    Ok(table)
}

/// Figures and data.
///
/// # Errors
/// If a figure cannot show its values.
pub fn files(results: &[PolicyResult], description: &str, bound_ms: Option<f64>) -> Result<Vec<NamedText>> {
    let note = format!("{description}. {INTERVALS}");
    let bound = bound_ms.map(|value| Reference {
        name: "bound".to_owned(),
        value,
    });
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
        reference: bound.clone(),
    };
    let start = LineChart {
        title: "Cold start: mean age after each slot, all vehicles from 100 ms".to_owned(),
        note: description.to_owned(),
        horizontal: Axis::linear("slot (ms)"),
        vertical: Axis::logarithmic("mean age (ms)"),
        series: series(results, |ages| ages.start_ms.clone()),
        references: bound.into_iter().collect(),
    };
    let distribution = LineChart {
        title: "How often information is older".to_owned(),
        note: description.to_owned(),
        horizontal: Axis::linear("age (ms)"),
        vertical: Axis::logarithmic("fraction of vehicle-slots with an older report (1)"),
        series: series(results, |ages| exceedance(&ages.distribution)),
        references: Vec::new(),
    };
    let mut set = vec![
        ("mean_age.svg".to_owned(), mean_age.to_svg()?),
        (
            "mean_age.csv".to_owned(),
            Table::new(columns(results, None))?.to_csv(),
        ),
    ];
    set.extend(start.files("cold_start", ["policy", "slot", "mean_age_ms"])?);
    // Where no information was ever older than a slot there is nothing to draw.
    if distribution.series.iter().any(|series| !series.points.is_empty()) {
        set.extend(distribution.files("age_distribution", ["policy", "age_ms", "fraction_above"])?);
    }
    Ok(set)
}

/// One series a policy, of its positive values over 1, 2, 3 and so on.
fn series(results: &[PolicyResult], values: fn(&AgeSummary) -> Vec<f64>) -> Vec<Series> {
    let of = |result: &PolicyResult| {
        let points = (1_u32..).zip(values(&result.ages)).filter(|&(_, y)| y > 0.0);
        Series {
            name: result.name.to_owned(),
            points: points.map(|(x, y)| (f64::from(x), y).into()).collect(),
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
