//! `trainer eval`: a table, or all forms of a run's actors, on held-out worlds.

use crate::evaluate::{Setting, exploring, float, quantised};
use crate::run_folder::{RunFolder, RunIdentity};
use crate::trained_actors::TrainedActors;
use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::command::options::{parse_table, progress_bar, thread_pool};
use host_sim::command::run::{PreparedRun, RunOptions};
use host_sim::policy::{KINDS, actor, central};
use host_sim::report::{PolicyResult, ages};
use host_sim::scenario::Preset;
use kit::error::{Error, Result};
use kit::say;
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Options of `eval`.
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("policy", |policy| policy.help("Policy to run beside a run's actors (repeatable) [default: central with --run, else all]")))]
pub struct EvalArguments {
    /// Folder of a training run: evaluates its actors in int8 (actor), in float (float), and exploring as in training
    /// (exploring); in the scenario of the run unless --set changes it; beside the central scheduler unless --policy is given
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
    let mut options = arguments.options.clone();
    options.check_typed()?;
    let pool = thread_pool(options.threads)?;
    let Some(folder) = &arguments.run else {
        let prepared = options.prepare()?;
        let results = pool.install(|| prepared.results(options.json))?;
        report(&prepared, &results, None, None, options.json);
        return Ok(());
    };
    let trained = pool.install(|| TrainedActors::read(&RunFolder::new(folder)))?;
    if let Some(identity) = &trained.identity {
        options = in_scenario_of(identity, options)?;
    }
    let asked = std::mem::replace(&mut options.policy, vec![&central::KIND]);
    let mut prepared = options.prepare()?;
    check_radio(&prepared, trained.setting)?;
    if !asked.is_empty() {
        // The actor is the run's own, which comes anyway.
        let beside = |kind: &&_| asked.contains(kind) && **kind != actor::KIND;
        prepared.policies = KINDS.iter().copied().filter(beside).collect();
    }
    let (mut results, agreement) = pool.install(|| trained_results(&prepared, &trained, options.json))?;
    results.extend(pool.install(|| prepared.results(options.json))?);
    let obstacle = trained.obstacle.as_ref();
    report(&prepared, &results, agreement, obstacle, options.json);
    Ok(())
}

/// The options with the run's scenario below the user's settings.
fn in_scenario_of(identity: &RunIdentity, mut options: RunOptions) -> Result<RunOptions> {
    let scenario = &mut options.scenario;
    if let Some(file) = &scenario.scenario {
        return Err(Error::input(
            "--scenario",
            file.display(),
            "none with --run, whose scenario is taken; --set changes it",
        ));
    }
    if scenario.preset != Preset::default() {
        let found = format!("{:?}", scenario.preset);
        return Err(Error::input(
            "--preset",
            found,
            "none with --run, whose scenario is taken; --set changes it",
        ));
    }
    let table = toml::Table::try_from(&identity.configuration.scenario)
        .map_err(|error| Error::input("scenario", error, "one that TOML can hold"))?;
    let mut settings = Vec::new();
    for (section, keys) in &table {
        for (key, value) in keys.as_table().into_iter().flatten() {
            settings.push(format!("{section}.{key}={value}"));
        }
    }
    settings.append(&mut scenario.set);
    scenario.set = settings;
    Ok(options)
}

/// Measured gains are relative to full power, and the joiner levels to the required SINR: actors live in the scenario that
/// they were made for.
fn check_radio(prepared: &PreparedRun, known: Setting) -> Result<()> {
    let radio = &prepared.scenario.radio;
    let asked = Setting::of_scenario(&prepared.scenario);
    if asked.power_plan.max_power != known.power_plan.max_power {
        let expected = format!("{} dBm as in training", known.power_plan.max_power.value());
        return Err(Error::input("radio.max_power_dbm", radio.max_power_dbm, expected));
    }
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

/// All forms of the actors, and how far the int8 form decides like the float form.
fn trained_results(
    prepared: &PreparedRun,
    trained: &TrainedActors,
    hide_progress: bool,
) -> Result<(Vec<PolicyResult>, Option<f64>)> {
    let simulation = prepared.simulation();
    let tables: Result<Vec<Table<'_>>> = trained
        .tables
        .iter()
        .map(|bytes| parse_table(None, bytes))
        .collect();
    let (tables, actors, setting) = (tables?, &trained.actors, trained.setting);
    let extent = prepared.extent;
    let slots = f64::from(extent.worlds) * f64::from(extent.slots_per_world());
    let result = |name, ages: AgeSummary, start: Instant| PolicyResult {
        name,
        ages,
        traffic: None,
        slots_per_second: slots / start.elapsed().as_secs_f64(),
    };
    let forms = 2 + u64::from(!tables.is_empty());
    let template = "{msg:14} {bar:40} {pos}/{len} worlds, {elapsed}, {eta} left";
    let progress = progress_bar(forms * u64::from(extent.worlds), template, hide_progress);
    progress.enable_steady_tick(Duration::from_secs(1));
    let ended = || progress.inc(1);
    let mut results = Vec::new();
    if !tables.is_empty() {
        progress.set_message("actor");
        let start = Instant::now();
        results.push(result("actor", quantised(&simulation, &tables, ended)?, start));
    }
    progress.set_message("float");
    let start = Instant::now();
    let (ages, agreement) = float(&simulation, actors, setting, &tables, ended)?;
    results.push(result("float", ages, start));
    progress.set_message("exploring");
    let start = Instant::now();
    let ages = exploring(&simulation, actors, setting, ended)?;
    results.push(result("exploring", ages, start));
    progress.finish_and_clear();
    Ok((results, agreement))
}

fn report(
    prepared: &PreparedRun,
    results: &[PolicyResult],
    agreement: Option<f64>,
    obstacle: Option<&Error>,
    json: bool,
) {
    let mut object = prepared.to_json(results);
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
        let bound = prepared.simulation().bound_age_ms();
        say!("{}", ages::table(results, &prepared.description(), bound));
    }
    if let Some(float) = mean("float") {
        object["float_mean_age_ms"] = json!(float);
        object["age_lost_ms"] = json!(lost);
        object["agreement"] = json!(agreement);
        object["no_table_because"] = json!(obstacle.map(Error::to_string));
        if !json {
            match (lost.zip(agreement), obstacle) {
                (Some((lost, agreement)), _) => say!(
                    "Actor: int8 as deployed. Float: greedy too; int8 loses {lost:.3} ms, and {:.3} % of decisions agree.",
                    100.0 * agreement
                ),
                (None, Some(obstacle)) => say!("No int8 form: {obstacle}. Float: greedy."),
                (None, None) => say!("Float: greedy."),
            }
            say!("Exploring: as in training, drawn or with noise.");
        }
    }
    if json {
        say!("{object}");
    }
}
