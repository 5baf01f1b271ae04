//! Mean age against one axis of a grid, the paper's that saturates at 100 ms and the one that does not: a line for each
//! combination of the other axes, pooled over seeds.

use super::axis::{Kind, SEED, text};
use super::merged::Merged;
use super::{Grid, Outcome};
use crate::report::chart::{Axis, LineChart, Point as Mark, Series};
use crate::report::table::{Column, Table};
use kit::error::{Error, Result};
use kit::files::NamedText;
use std::collections::BTreeMap;
use toml::Value;

/// Most lines of a figure (chosen).
const MOST_LINES: usize = 20;

/// The name of the only line.
const ALL: &str = "all";

/// A mean age of outcomes.
struct Measure {
    /// What titles call it.
    title: &'static str,
    /// What files and columns call it.
    file: &'static str,
    mean_ms: fn(&Outcome) -> f64,
    /// Half the width of its 95 % interval.
    ci95_ms: fn(&Outcome) -> Option<f64>,
}

/// The paper's first.
const MEASURES: [Measure; 2] = [
    Measure {
        title: "Mean age of information",
        file: "mean_age",
        mean_ms: |outcome| outcome.mean_age_ms,
        ci95_ms: |outcome| outcome.mean_age_ci95_ms,
    },
    Measure {
        title: "Uncapped mean age of information",
        file: "uncapped_mean_age",
        mean_ms: |outcome| outcome.uncapped_mean_age_ms,
        ci95_ms: |outcome| outcome.uncapped_mean_age_ci95_ms,
    },
];

/// Outcomes of several seeds at one place of a line.
struct Pool<'m> {
    series: usize,
    x: f64,
    outcomes: Vec<&'m Outcome>,
}

impl Pool<'_> {
    /// The mean over seeds; all have the same number of worlds.
    fn mean_ms(&self, measure: &Measure) -> f64 {
        let sum: f64 = self
            .outcomes
            .iter()
            .map(|outcome| (measure.mean_ms)(outcome))
            .sum();
        sum / self.outcomes.len() as f64
    }

    /// Half the width of the mean's 95 % interval: seeds are independent, so the squares of their intervals add up. Each
    /// has the wider quantile of its own worlds, which errs on the wide side.
    fn ci95_ms(&self, measure: &Measure) -> Option<f64> {
        let mut squares = 0.0;
        for outcome in &self.outcomes {
            let half = (measure.ci95_ms)(outcome)?;
            squares += half * half;
        }
        Some(libm::sqrt(squares) / self.outcomes.len() as f64)
    }

    fn mark(&self, measure: &Measure) -> Mark {
        let mean = self.mean_ms(measure);
        Mark {
            x: self.x,
            y: mean,
            // No age is below 1 ms, wherever the interval of a few worlds ends.
            band: self
                .ci95_ms(measure)
                .map(|half| ((mean - half).max(1.0), mean + half)),
        }
    }
}

/// The figures as SVG, and their points as CSV, by file name.
///
/// # Errors
/// If the grid has no such axis of numbers, or nothing can be drawn.
pub fn mean_age(grid: &Grid, merged: &Merged, key: &str) -> Result<Vec<NamedText>> {
    let numeric = |index: &usize| matches!(grid.axes()[*index].kind, Kind::Integer | Kind::Number);
    let find = |key: &str| grid.axes().iter().position(|axis| axis.key == key);
    let axis = find(key).filter(numeric).ok_or_else(|| {
        let names = grid.axes().iter().enumerate().filter(|(index, _)| numeric(index));
        let names: Vec<&str> = names.map(|(_, axis)| axis.key.as_str()).collect();
        Error::input(
            "--figure",
            format!("\"{key}\""),
            format!("one of {}", names.join(", ")),
        )
    })?;
    // Other axes tell lines apart, unless they move with this one or with the seed.
    let seed = find(SEED).unwrap_or(axis);
    let others: Vec<usize> = (0..grid.axes().len())
        .filter(|&other| grid.axes()[other].values.len() > 1)
        .filter(|&other| !grid.together(other, axis) && !grid.together(other, seed))
        .collect();
    let mut names: Vec<String> = Vec::new();
    let mut places: BTreeMap<(usize, usize), Vec<&Outcome>> = BTreeMap::new();
    for (point, outcome) in &merged.present {
        let values: Vec<String> = others
            .iter()
            .map(|&other| text(grid.value(point, other)))
            .collect();
        let name = if values.is_empty() {
            ALL.to_owned()
        } else {
            values.join(", ")
        };
        let series = names.iter().position(|known| *known == name).unwrap_or_else(|| {
            names.push(name);
            names.len() - 1
        });
        if names.len() > MOST_LINES {
            let found = format!("more than {MOST_LINES} lines");
            return Err(Error::input("--figure", found, "fewer axes with several values"));
        }
        places
            .entry((series, point.value_index(axis)))
            .or_default()
            .push(outcome);
    }
    let mut pools: Vec<Pool<'_>> = places
        .into_iter()
        .map(|((series, value), outcomes)| {
            let x = match &grid.axes()[axis].values[value] {
                Value::Integer(integer) => *integer as f64,
                other => other.as_float().unwrap_or(f64::NAN),
            };
            Pool { series, x, outcomes }
        })
        .collect();
    pools.sort_by(|a, b| a.series.cmp(&b.series).then(a.x.total_cmp(&b.x)));
    let series = |measure: &Measure| {
        let lines = pools.chunk_by(|a, b| a.series == b.series).map(|pools| Series {
            name: names[pools[0].series].clone(),
            points: pools.iter().map(|pool| pool.mark(measure)).collect(),
        });
        lines.collect()
    };
    let mut files = Vec::new();
    let mut columns = vec![
        Column::text("series", pools.iter().map(|pool| names[pool.series].clone())),
        Column::number(key, pools.iter().map(|pool| pool.x)),
    ];
    for measure in &MEASURES {
        let Measure { title, file, .. } = measure;
        let chart = LineChart {
            title: format!("{title} against {key}"),
            note: note(grid, merged),
            horizontal: Axis::linear(key),
            vertical: Axis::logarithmic("mean age (ms)"),
            series: series(measure),
            references: Vec::new(),
        };
        files.push((format!("{file}_by_{key}.svg"), chart.to_svg()?));
        let means = pools.iter().map(|pool| pool.mean_ms(measure));
        columns.push(Column::number(&format!("{file}_ms"), means));
        let halves = pools.iter().map(|pool| pool.ci95_ms(measure));
        columns.push(Column::number(&format!("{file}_ci95_ms"), halves));
    }
    columns.push(Column::unsigned(
        "runs",
        pools.iter().map(|pool| pool.outcomes.len() as u64),
    ));
    files.push((format!("mean_age_by_{key}.csv"), Table::new(columns)?.to_csv()));
    Ok(files)
}

/// How much was simulated, and with what seeds.
fn note(grid: &Grid, merged: &Merged) -> String {
    let range = |value: fn(&Outcome) -> u64| {
        let values = || merged.present.iter().map(|(_, outcome)| value(outcome));
        match (values().min(), values().max()) {
            (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
            (Some(least), _) => least.to_string(),
            _ => "no".to_owned(),
        }
    };
    let seeds = grid.axes().iter().find(|axis| axis.key == SEED);
    let seeds: Vec<Value> = seeds.map_or(Vec::new(), |axis| axis.values.clone());
    let seeds = match seeds.as_slice() {
        [one] => format!("seed {}", text(one)),
        many => format!("each of {} seeds", many.len()),
    };
    format!(
        "{} worlds x {} slots after {}, {seeds}. Bands: 95 %, over worlds.",
        range(|outcome| outcome.worlds),
        range(|outcome| outcome.slots),
        range(|outcome| outcome.warmup),
    )
}
