//! `trainer eval`: a table, or all forms of a run's actors, on held-out worlds.

use crate::command::cells::{self, InCell};
use crate::evaluate::{Setting, exploring, float, quantised};
use crate::forms::check_sub_channels;
use crate::laboratory::actors::ActorForm;
use crate::run_folder::{RunFolder, RunIdentity};
use crate::trained_actors::TrainedActors;
use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::command::options::progress_bar;
use host_sim::command::run::{self, RunOptions, results_with_progress};
use host_sim::experiment::{Experiment, ExperimentSource, PolicyResult};
use host_sim::policy::{KINDS, actor, central};
use host_sim::report::ages;
use host_sim::scenario::Preset;
use host_sim::thread_pool;
use host_sim::weight_table::WeightTable;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::{say, tell};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Options of `eval`.
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("policy", |policy| policy.help("Policy to run beside a run's actors (repeatable) [default: central with --run, else all]")))]
pub struct EvalArguments {
    /// Folder of a training run: evaluates its actors in int8 (actor), in float (float), and exploring as in training
    /// (exploring); in the scenario of the run unless --set changes it; beside the central scheduler unless --policy is given.
    /// A run of a mixture: in each of its cells, beside clock, assigned, central and the shipped table
    #[arg(long, value_name = "DIR", conflicts_with = "table")]
    pub run: Option<PathBuf>,
    /// Worlds, policies and output.
    #[command(flatten)]
    pub options: RunOptions,
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &EvalArguments) -> Result<()> {
    let options = &arguments.options;
    options.check_typed()?;
    let pool = thread_pool(options.threads)?;
    let mut source = options.source();
    let Some(folder) = &arguments.run else {
        let experiment = source.read()?;
        let results = pool.install(|| results_with_progress(&experiment, options.json))?;
        report(options, &experiment, &results, None, None)?;
        return Ok(());
    };
    let trained = pool.install(|| TrainedActors::read(&RunFolder::new(folder)))?;
    if let Some(identity) = &trained.identity {
        take_scenario_of(identity, options, &mut source)?;
        let mixture = &identity.configuration.mixture;
        if !mixture.is_empty() {
            let each = || cells::in_each(mixture, &trained, &source, Forms::All, options.json);
            return report_cells(options, &pool.install(each)?);
        }
    }
    let asked = std::mem::replace(&mut source.policies, vec![&central::KIND]);
    let mut experiment = source.read()?;
    check_radio(&experiment, trained.actors.form, trained.setting)?;
    if !asked.is_empty() {
        // The actor is the run's own, which comes anyway.
        let beside = |kind: &&_| asked.contains(kind) && **kind != actor::KIND;
        experiment.policies = KINDS.iter().copied().filter(beside).collect();
    }
    let own = || trained_results(&experiment, &trained, Forms::All, options.json);
    let (mut results, agreement) = pool.install(own)?;
    results.extend(pool.install(|| results_with_progress(&experiment, options.json))?);
    let obstacle = trained.obstacle.as_ref();
    report(options, &experiment, &results, agreement, obstacle)
}

fn report_cells(options: &RunOptions, cells: &[InCell]) -> Result<()> {
    if !options.json {
        say!("{}", cells::table(cells)?);
        return Ok(());
    }
    let each = cells.iter().map(|cell| cell.to_json(true, options.timing));
    let each: Vec<Value> = each.collect::<Result<_>>()?;
    say!("{}", json!({ "cells": each }));
    Ok(())
}

/// Puts the run's scenario below the user's settings.
fn take_scenario_of(
    identity: &RunIdentity,
    options: &RunOptions,
    source: &mut ExperimentSource,
) -> Result<()> {
    let expected = "none with --run, whose scenario is taken; --set changes it";
    let scenario = &options.scenario;
    if let Some(file) = &scenario.scenario {
        return Err(Error::input("--scenario", file.display(), expected));
    }
    if scenario.preset != Preset::default() {
        return Err(Error::input("--preset", scenario.preset.name(), expected));
    }
    source.scenario.values = toml::Table::try_from(&identity.configuration.scenario)
        .map_err(|error| Error::input("scenario", error, "one that TOML can hold"))?;
    Ok(())
}

/// The joiner levels are relative to the required SINR: actors live in scenarios of the one that they were made for, and of as many
/// sub-channels as they know.
pub(super) fn check_radio(experiment: &Experiment, form: ActorForm, known: Setting) -> Result<()> {
    let radio = &experiment.scenario.radio;
    let asked = Setting::of_scenario(&experiment.scenario);
    check_sub_channels(
        "radio.sub_channels",
        &experiment.scenario,
        form.observation,
        form.output,
    )?;
    if asked.required_sinr != known.required_sinr {
        let expected = format!(
            "a required SINR of {:.3} dB as in training",
            known.required_sinr.to_num::<f64>()
        );
        return Err(Error::input(
            "radio.min_spectral_efficiency",
            radio.min_spectral_efficiency,
            expected,
        ));
    }
    Ok(())
}

/// Which forms of a run's actors are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Forms {
    /// Int8, float and exploring.
    All,
    /// Int8 alone; float where no table holds the actors.
    Deployed,
}

/// Forms of the actors, the deployed one first, and how far the int8 form decides like the float form.
pub(super) fn trained_results(
    experiment: &Experiment,
    trained: &TrainedActors,
    forms: Forms,
    hide_progress: bool,
) -> Result<(Vec<PolicyResult>, Option<f64>)> {
    let simulation = experiment.simulation();
    let tables: Result<Vec<Table<'_>>> = trained.tables.iter().map(WeightTable::parse).collect();
    let (tables, actors, setting) = (tables?, &trained.actors, trained.setting);
    let extent = experiment.extent;
    let slots = f64::from(extent.worlds) * f64::from(extent.slots_per_world());
    let result = |name, ages: AgeSummary, start: Instant| PolicyResult {
        name,
        ages,
        traffic: None,
        slots_per_second: slots / start.elapsed().as_secs_f64(),
    };
    let deployed = forms == Forms::Deployed;
    let count = if deployed {
        1
    } else {
        2 + u64::from(!tables.is_empty())
    };
    let template = "{msg:14} {bar:40} {pos}/{len} worlds, {elapsed}, {left} left";
    let progress = progress_bar(count * u64::from(extent.worlds), template, hide_progress);
    progress.enable_steady_tick(Duration::from_secs(1));
    let ended = || progress.inc(1);
    let mut results = Vec::new();
    if !tables.is_empty() {
        progress.set_message("actor");
        let start = Instant::now();
        results.push(result("actor", quantised(&simulation, &tables, ended)?, start));
    }
    if deployed && !results.is_empty() {
        progress.finish_and_clear();
        return Ok((results, None));
    }
    progress.set_message("float");
    let start = Instant::now();
    let (ages, agreement) = float(&simulation, actors, setting, &tables, ended)?;
    results.push(result("float", ages, start));
    if deployed {
        progress.finish_and_clear();
        return Ok((results, agreement));
    }
    progress.set_message("exploring");
    let start = Instant::now();
    let ages = exploring(&simulation, actors, setting, ended)?;
    results.push(result("exploring", ages, start));
    progress.finish_and_clear();
    Ok((results, agreement))
}

fn report(
    options: &RunOptions,
    experiment: &Experiment,
    results: &[PolicyResult],
    agreement: Option<f64>,
    obstacle: Option<&Error>,
) -> Result<()> {
    let json = options.json;
    let mut object = run::json(experiment, results, options.timing);
    let mean = |name: &str| {
        results
            .iter()
            .find(|result| result.name == name)
            .map(|result| result.ages.mean_ms)
    };
    let lost = mean("actor")
        .zip(mean("float"))
        .map(|(actor, float)| actor - float);
    if !json {
        let bound = experiment.simulation().bound_age_ms();
        say!(
            "{}",
            options
                .text
                .of(&ages::table(results, &experiment.description(), bound)?)
        );
    }
    if let Some(float) = mean("float") {
        object["float_mean_age_ms"] = json!(float);
        object["age_lost_ms"] = json!(lost);
        object["agreement"] = json!(agreement);
        object["no_table_because"] = json!(obstacle.map(Error::to_string));
        if !json {
            match (lost.zip(agreement), obstacle) {
                (Some((lost, agreement)), _) => tell!(
                    "Actor: int8 as deployed. Float: greedy too; int8 loses {lost:.3} ms, and {:.3} % of decisions agree.",
                    100.0 * agreement
                ),
                (None, Some(obstacle)) => tell!("No int8 form: {obstacle}. Float: greedy."),
                (None, None) => say!("Float: greedy."),
            }
            say!("Exploring: as in training, drawn or with noise.");
        }
    }
    if json {
        say!("{object}");
    }
    Ok(())
}
