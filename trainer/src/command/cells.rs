//! A run that learned in a mixture, on held-out worlds of each of its cells, beside rules and the shipped table.

use crate::command::compare::{Difference, difference};
use crate::command::eval::{Forms, check_radio, trained_results};
use crate::evaluate::quantised;
use crate::mixture::MixedCell;
use crate::trained_actors::TrainedActors;
use host_sim::command::run::{json, results_with_progress};
use host_sim::experiment::{Experiment, ExperimentSource, PolicyResult};
use host_sim::policy::{KINDS, Kind, actor, assigned, central, clock};
use host_sim::report::table::{Column, Table};
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};
use serde_json::{Value, json};

/// What stands beside a run's actors where nothing else is asked for.
const RULES: [&Kind; 3] = [&clock::KIND, &assigned::KIND, &central::KIND];

/// What came out in one cell: first the run's own forms, then the rules, then the shipped table.
pub struct InCell {
    name: String,
    experiment: Experiment,
    results: Vec<PolicyResult>,
    /// Of int8 and float.
    agreement: Option<f64>,
}

/// Evaluates forms of a run's actors in each of these cells, with the rules that `source` asks for, or the usual ones.
///
/// # Errors
/// The first input that does not fit.
pub fn in_each(
    cells: &[MixedCell],
    trained: &TrainedActors,
    source: &ExperimentSource,
    forms: Forms,
    hide_progress: bool,
) -> Result<Vec<InCell>> {
    let asked = |kind: &&&'static Kind| match source.policies.as_slice() {
        [] => RULES.contains(kind),
        // The actor is the run's own, which comes anyway.
        asked => asked.contains(kind) && **kind != &actor::KIND,
    };
    let rules: Vec<&'static Kind> = KINDS.iter().filter(asked).copied().collect();
    let each = cells.iter().map(|cell| {
        let mut source = source.clone();
        source.policies = vec![&central::KIND];
        source.scenario.values = toml::Table::try_from(&cell.scenario)
            .map_err(|error| Error::input("scenario", error, "one that TOML can hold"))?;
        let in_cell = |error: Error| error.within(format!("cell {}", cell.name));
        let mut experiment = source.read().map_err(in_cell)?;
        check_radio(&experiment, trained.actors.form, trained.setting).map_err(in_cell)?;
        experiment.policies.clone_from(&rules);
        let (mut results, agreement) = trained_results(&experiment, trained, forms, hide_progress)?;
        results.extend(results_with_progress(&experiment, hide_progress)?);
        results.extend(shipped(&experiment)?);
        Ok(InCell {
            name: cell.name.clone(),
            experiment,
            results,
            agreement,
        })
    });
    each.collect()
}

/// The shipped table's result, where it serves the cell.
fn shipped(experiment: &Experiment) -> Result<Option<PolicyResult>> {
    let table = WeightTable::read_or_built_in(None)?;
    let table = table.parse()?;
    let vehicles = experiment.source.most_vehicles(&experiment.scenario);
    if actor::KIND.check(&experiment.scenario, vehicles, &table).is_err() {
        return Ok(None);
    }
    let ages = quantised(&experiment.simulation(), &[table], || ())?;
    Ok(Some(PolicyResult {
        name: "shipped",
        ages,
        traffic: None,
        slots_per_second: f64::NAN,
    }))
}

impl InCell {
    /// What the run deploys: int8, or float where no table holds it.
    fn judged(&self) -> &PolicyResult {
        &self.results[0]
    }

    /// How much older its ages are than each policy's, on the same worlds.
    fn differences(&self) -> Result<Vec<Difference>> {
        let each = self.results.iter();
        each.map(|other| difference(&self.judged().ages, &other.ages))
            .collect()
    }

    /// As JSON; `whole` with all that a run of the simulator says.
    ///
    /// # Errors
    /// Never: all results are of the same worlds.
    pub fn to_json(&self, whole: bool, timing: bool) -> Result<Value> {
        let differences = self.results.iter().zip(self.differences()?);
        let differences: Vec<Value> = differences
            .map(|(result, less)| {
                json!({
                    "policy": result.name,
                    "mean_age_ms": result.ages.mean_ms,
                    "difference_ms": less.mean_ms,
                    "difference_ci95_ms": less.ci95_ms,
                })
            })
            .collect();
        let mut object = match whole {
            true => json(&self.experiment, &self.results, timing),
            false => json!({}),
        };
        object["cell"] = json!(self.name);
        object["agreement"] = json!(self.agreement);
        object["differences"] = json!(differences);
        Ok(object)
    }
}

/// One table of all cells.
///
/// # Errors
/// Never: its columns have a row for each policy in each cell.
pub fn table(cells: &[InCell]) -> Result<Table> {
    let rows = || {
        let each = |cell: &'_ InCell| cell.results.len();
        cells
            .iter()
            .flat_map(move |cell| (0..each(cell)).map(move |row| (cell, &cell.results[row])))
    };
    let differences: Result<Vec<Vec<Difference>>> = cells.iter().map(InCell::differences).collect();
    let differences: Vec<Difference> = differences?.into_iter().flatten().collect();
    let mut table = Table::new(vec![
        Column::text("cell", rows().map(|(cell, _)| cell.name.clone())),
        Column::text("policy", rows().map(|(_, result)| result.name.to_owned())),
        Column::number("mean_age_ms", rows().map(|(_, result)| result.ages.mean_ms))
            .shown("mean age", "ms", 3),
        Column::number("mean_age_ci95_ms", rows().map(|(_, result)| result.ages.ci95_ms))
            .shown("+-95 %", "ms", 3),
        Column::number(
            "worst_vehicles_ms",
            rows().map(|(_, result)| result.ages.worst_vehicles_ms),
        )
        .shown("worst 5 %", "ms", 3),
        Column::number(
            "difference_ms",
            differences.iter().map(|difference| difference.mean_ms),
        )
        .shown("actor less it", "ms", 4),
        Column::number(
            "difference_ci95_ms",
            differences.iter().map(|difference| difference.ci95_ms),
        )
        .shown("+-95 %", "ms", 4),
    ])?
    .titled("Age of information in each cell of the mixture");
    for (index, cell) in cells.iter().enumerate() {
        let description = cell.experiment.description();
        let same = |other: &InCell| other.experiment.description() == description;
        match cells.iter().position(same) {
            _ if !cells.iter().all(same) => table.note(&format!("{}: {description}.", cell.name)),
            Some(first) if first == index => table.note(&format!("{description}.")),
            _ => {}
        }
    }
    table.note(
        "Actor: the run's table, int8 as deployed. Shipped: the table that is built into the firmware.",
    );
    table.note("Actor less it: the mean over worlds of what the first row of a cell has less another, on the same worlds.");
    Ok(table)
}
