//! What a grid's command measures against one axis: a line for each combination of the other axes, pooled over seeds.

use super::axis::{Kind, SEED, text};
use super::commands::Measure;
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

/// Outcomes of several seeds at one place of a line.
struct Pool<'m> {
    series: usize,
    x: f64,
    outcomes: Vec<&'m Outcome>,
}

impl Pool<'_> {
    /// The mean over seeds, all of which have the same number of worlds; `None` if one has no such number.
    fn mean(&self, measure: &Measure) -> Option<f64> {
        let mut sum = 0.0;
        for outcome in &self.outcomes {
            sum += outcome.number(measure.mean)?;
        }
        Some(sum / self.outcomes.len() as f64)
    }

    /// Half the width of the mean's 95 % interval: seeds are independent, so the squares of their intervals add up. Each
    /// has the wider quantile of its own worlds, which errs on the wide side.
    fn ci95(&self, measure: &Measure) -> Option<f64> {
        let column = measure.ci95?;
        let mut squares = 0.0;
        for outcome in &self.outcomes {
            let half = outcome.number(column)?;
            squares += half * half;
        }
        Some(libm::sqrt(squares) / self.outcomes.len() as f64)
    }

    fn mark(&self, measure: &Measure) -> Option<Mark> {
        let mean = self.mean(measure)?;
        let ends = |half: f64| ((mean - half).max(measure.least), mean + half);
        Some(Mark {
            x: self.x,
            y: mean,
            band: self.ci95(measure).map(ends),
        })
    }
}

/// The figures as SVG, and their points as CSV, by file name.
///
/// # Errors
/// If the grid has no such axis of numbers, or nothing can be drawn.
pub fn files(grid: &Grid, merged: &Merged, key: &str) -> Result<Vec<NamedText>> {
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
            .map(|&other| label(&grid.axes()[other].key, grid.value(point, other)))
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
    let series = |measure: &Measure| -> Vec<Series> {
        let lines = pools.chunk_by(|a, b| a.series == b.series).map(|pools| Series {
            name: names[pools[0].series].clone(),
            points: pools.iter().filter_map(|pool| pool.mark(measure)).collect(),
        });
        lines.filter(|line| !line.points.is_empty()).collect()
    };
    let mut files = Vec::new();
    let mut columns = vec![
        Column::text("series", pools.iter().map(|pool| names[pool.series].clone())),
        Column::number(key, pools.iter().map(|pool| pool.x)),
    ];
    // A measure that no point has, such as the loss to a delay without one, is not drawn.
    let measures = grid.command().measures.iter();
    let measured: Vec<(&Measure, Vec<Series>)> = measures
        .map(|measure| (measure, series(measure)))
        .filter(|(_, series)| !series.is_empty())
        .collect();
    let Some((first, _)) = measured.first() else {
        return Err(Error::input("--figure", "nothing to draw", "at least one point"));
    };
    for (measure, series) in &measured {
        let chart = LineChart {
            title: format!("{} against {key}", measure.title),
            note: note(grid, merged),
            horizontal: Axis::linear(key),
            vertical: Axis {
                label: measure.axis.to_owned(),
                scale: measure.scale,
            },
            series: series.clone(),
            references: Vec::new(),
        };
        files.push((format!("{}_by_{key}.svg", measure.file), chart.to_svg()?));
        let means = pools.iter().map(|pool| pool.mean(measure));
        columns.push(Column::number(measure.mean, means));
        if let Some(ci95) = measure.ci95 {
            columns.push(Column::number(ci95, pools.iter().map(|pool| pool.ci95(measure))));
        }
    }
    columns.push(Column::unsigned(
        "runs",
        pools.iter().map(|pool| pool.outcomes.len() as u64),
    ));
    files.push((
        format!("{}_by_{key}.csv", first.file),
        Table::new(columns)?.to_csv(),
    ));
    Ok(files)
}

/// A value in the legend: numbers need their key's name, words speak for themselves.
fn label(key: &str, value: &Value) -> String {
    match value {
        Value::String(word) => word.clone(),
        other => format!("{} {}", key.rsplit('.').next().unwrap_or(key), text(other)),
    }
}

/// How much was computed, and with what seeds.
fn note(grid: &Grid, merged: &Merged) -> String {
    let command = grid.command();
    let mut note = command.extent.to_owned();
    for column in command.counts {
        let counts = || {
            merged
                .present
                .iter()
                .filter_map(|(_, outcome)| outcome.count(column.name))
        };
        let range = match (counts().min(), counts().max()) {
            (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
            (Some(least), _) => least.to_string(),
            _ => "no".to_owned(),
        };
        note = note.replace(&format!("{{{}}}", column.name), &range);
    }
    if let Some(seeds) = grid.axes().iter().find(|axis| axis.key == SEED) {
        note += &match seeds.values.as_slice() {
            [one] => format!(", seed {}", text(one)),
            many => format!(", each of {} seeds", many.len()),
        };
        note += ". Bands: 95 %, over worlds";
    }
    note + "."
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_legend_says_what_a_number_means() {
        assert_eq!(
            label("planning.connected_share", &Value::Float(0.5)),
            "connected_share 0.5"
        );
        assert_eq!(label("policy", &Value::String("actor".to_owned())), "actor");
    }
}
