//! How many vehicles a sub-channel carries, by policy: the table, the data and the figures.

use super::chart::{Axis, Bar, BarChart, LineChart, Point, Reference, Series};
use super::table::{Column, Table};
use crate::experiment::Experiment;
use crate::load::{AGES_MS, BOUND, Carried, Climb, Rung};
use crate::policy::actor;
use kit::error::Result;
use kit::files::NamedText;
use serde_json::{Value, json};

/// What was simulated, without the number of vehicles.
fn description(experiment: &Experiment) -> String {
    let extent = &experiment.extent;
    let sub_channels = match experiment.scenario.radio.sub_channels {
        1 => "1 sub-channel".to_owned(),
        several => format!("{several} sub-channels"),
    };
    format!(
        "{sub_channels}, {} worlds, {} or more slots, seed {}",
        extent.worlds, extent.slots, extent.seed
    )
}

/// The table of carried vehicles, with intervals. `most` vehicles in the cell were tried.
///
/// # Errors
/// Never: its columns have a row for each policy.
pub fn table(experiment: &Experiment, climbs: &[Climb], most: u32) -> Result<Table> {
    let sub_channels = experiment.scenario.radio.sub_channels;
    let mut columns = vec![Column::text(
        "policy",
        climbs.iter().map(|climb| climb.policy.to_owned()),
    )];
    for age_ms in AGES_MS {
        let number = |name: &str, value: fn(Carried) -> Option<f64>| {
            let values = climbs
                .iter()
                .map(|climb| value(climb.carried(age_ms, sub_channels)));
            Column::number(&format!("{name}_{age_ms}_ms"), values)
        };
        columns.push(number("vehicles_at", |carried| carried.vehicles).shown(
            &format!("at {age_ms} ms"),
            "vehicles",
            1,
        ));
        let ends = [
            number("fewest_at", |carried| carried.interval?[0]).shown("95 %:", "from", 1),
            number("most_at", |carried| carried.interval?[1]).shown("", "to", 1),
        ];
        columns.extend(ends);
    }
    let mut table = Table::new(columns)?.titled("Vehicles that a sub-channel carries at a mean age");
    table.note(&format!("{}.", description(experiment)));
    table.note("Uncapped mean ages; on straight lines between loads that were simulated. 95 %: where the mean's interval over worlds ends.");
    table.note(&format!(
        "-: more than {:.0}, the most that were tried, and no interval for the bound.",
        f64::from(most) / f64::from(sub_channels)
    ));
    Ok(table)
}

/// The JSON object: by policy what is carried at each age, and the ages at each load.
pub fn to_json(experiment: &Experiment, climbs: &[Climb]) -> Value {
    let sub_channels = experiment.scenario.radio.sub_channels;
    let carried = |climb: &Climb, age_ms: f64| {
        let Carried { vehicles, interval } = climb.carried(age_ms, sub_channels);
        json!({ "age_ms": age_ms, "vehicles_per_sub_channel": vehicles, "ci95": interval })
    };
    let load = |rung: &Rung| {
        json!({
            "vehicles": rung.vehicles,
            "vehicles_per_sub_channel": f64::from(rung.vehicles) / f64::from(sub_channels),
            "uncapped_mean_age_ms": rung.mean_ms,
            "uncapped_mean_age_ci95_ms": rung.ci95_ms,
        })
    };
    let policies: Vec<Value> = climbs
        .iter()
        .map(|climb| {
            json!({
                "policy": climb.policy,
                "carried": AGES_MS.map(|age_ms| carried(climb, age_ms)),
                "loads": climb.rungs.iter().map(load).collect::<Vec<_>>(),
            })
        })
        .collect();
    json!({
        "seed": experiment.extent.seed,
        "worlds": experiment.extent.worlds,
        "scenario": experiment.scenario,
        "policies": policies,
    })
}

/// The figures: by age what is carried, and ages against loads; and their data.
///
/// # Errors
/// If a figure cannot show its values.
pub fn files(experiment: &Experiment, climbs: &[Climb], carried: &Table) -> Result<Vec<NamedText>> {
    let note = format!(
        "{}. Intervals and bands: 95 %, over worlds.",
        description(experiment)
    );
    let sub_channels = experiment.scenario.radio.sub_channels;
    let mut set = Vec::new();
    for age_ms in AGES_MS {
        let chart = carried_chart(age_ms, sub_channels, climbs, &note);
        if !chart.bars.is_empty() {
            set.push((format!("carried_at_{age_ms}_ms.svg"), chart.to_svg()?));
        }
    }
    let load = |rung: &Rung| f64::from(rung.vehicles) / f64::from(sub_channels);
    let mark = |rung: &Rung| Point {
        x: load(rung),
        y: rung.mean_ms,
        // No age is below 1 ms, wherever the interval of a few worlds ends.
        band: rung
            .ci95_ms
            .map(|half| ((rung.mean_ms - half).max(1.0), rung.mean_ms + half)),
    };
    let series = climbs.iter().map(|climb| Series {
        name: climb.policy.to_owned(),
        points: climb.rungs.iter().map(mark).collect(),
    });
    let chart = LineChart {
        title: "Mean age of information against load".to_owned(),
        note,
        horizontal: Axis::logarithmic("vehicles a sub-channel"),
        vertical: Axis::logarithmic("uncapped mean age (ms)"),
        series: series.collect(),
        references: Vec::new(),
    };
    let points = || {
        let climbs = climbs.iter();
        climbs.flat_map(|climb| climb.rungs.iter().map(|rung| (climb.policy, rung)))
    };
    let ages = Table::new(vec![
        Column::text("policy", points().map(|(policy, _)| policy.to_owned())),
        Column::unsigned("vehicles", points().map(|(_, rung)| u64::from(rung.vehicles))),
        Column::number("vehicles_per_sub_channel", points().map(|(_, rung)| load(rung))),
        Column::number("uncapped_mean_age_ms", points().map(|(_, rung)| rung.mean_ms)),
        Column::number(
            "uncapped_mean_age_ci95_ms",
            points().map(|(_, rung)| rung.ci95_ms),
        ),
    ])?;
    set.extend([
        ("ages_by_load.svg".to_owned(), chart.to_svg()?),
        ("carried.csv".to_owned(), carried.to_csv()),
        ("ages_by_load.csv".to_owned(), ages.to_csv()),
    ]);
    Ok(set)
}

/// What is carried at an age, by those who carry fewer than were tried.
fn carried_chart(age_ms: f64, sub_channels: u32, climbs: &[Climb], note: &str) -> BarChart {
    let of = |climb: &Climb| climb.carried(age_ms, sub_channels);
    let (bounds, policies): (Vec<&Climb>, Vec<&Climb>) =
        climbs.iter().partition(|climb| climb.policy == BOUND);
    let bars = policies.into_iter().filter_map(|climb| {
        let carried = of(climb);
        Some(Bar {
            name: climb.policy.to_owned(),
            value: carried.vehicles?,
            interval: carried.interval.and_then(|[fewest, most]| fewest.zip(most)),
            emphasised: climb.policy == actor::KIND.name,
        })
    });
    let bound = bounds.first().and_then(|climb| of(climb).vehicles);
    BarChart {
        title: format!("Vehicles that a sub-channel carries at a mean age of {age_ms} ms"),
        note: note.to_owned(),
        axis: Axis::linear("vehicles a sub-channel"),
        decimals: 1,
        bars: bars.collect(),
        reference: bound.map(|value| Reference {
            name: "bound".to_owned(),
            value,
        }),
    }
}
