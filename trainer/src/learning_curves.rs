//! How reward and age went over the episodes of a study's runs, thinned for a figure.

use crate::interquartile::mean_of_the_middle;
use crate::laboratory::learner::name;
use crate::study::{Plan, StudyRun};
use host_sim::report::learning::{CurvePoint, curves_csv};
use kit::error::{Error, Result};

/// Points of a curve at most: each is the mean over as many episodes as it takes (chosen).
const POINTS: usize = 100;

/// The curves of all cases, as the text of the file that `host-sim figures` draws.
///
/// # Errors
/// If a run's metrics cannot be read, or two runs of a case have different lengths.
pub fn learning_curves(plan: &Plan, runs: &[StudyRun]) -> Result<String> {
    let mut points = Vec::new();
    for (index, case) in plan.case.iter().enumerate() {
        let read: Result<Vec<[Vec<f64>; 2]>> = runs
            .iter()
            .filter(|run| run.case == index)
            .map(|run| read_metrics(&run.folder.join("metrics.csv")))
            .collect();
        let read = read?;
        let episodes = read.iter().map(|run| run[0].len()).min().unwrap_or(0);
        let width = episodes.div_ceil(POINTS).max(1);
        for start in (0..episodes).step_by(width) {
            let end = (start + width).min(episodes);
            let of = |column: usize| -> [f64; 3] {
                let means = read.iter().map(|run| mean(&run[column][start..end]));
                let mut means: Vec<f64> = means.collect();
                let middle = mean_of_the_middle(&mut means);
                [middle, means[0], means[means.len() - 1]]
            };
            points.push(CurvePoint {
                case: case.name.clone(),
                episode: end as u64,
                reward: of(0),
                age_ms: of(1),
            });
        }
    }
    curves_csv(&points)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Reward and age of every episode.
fn read_metrics(path: &std::path::Path) -> Result<[Vec<f64>; 2]> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let column = |name: &str| {
        let index = header.iter().position(|column| *column == name);
        index.ok_or_else(|| Error::input(path.display(), format!("no column {name}"), "one"))
    };
    let columns = [column(name::REWARD)?, column(name::AGE)?];
    let mut values = [Vec::new(), Vec::new()];
    for (index, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        for (values, &column) in values.iter_mut().zip(&columns) {
            let field = fields.get(column).copied().unwrap_or_default();
            let value = field.parse().map_err(|_| {
                Error::input(
                    format!("{}:{}", path.display(), index + 2),
                    format!("\"{field}\""),
                    "a number",
                )
            })?;
            values.push(value);
        }
    }
    Ok(values)
}
