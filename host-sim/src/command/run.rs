//! `host-sim run`: ages of all policies on the same worlds.

use crate::age::{AgeSummary, ideal_age_ms};
use crate::error::{Error, Result};
use crate::policy::PolicyName;
use crate::scenario::{Preset, Scenario, ScenarioSource};
use crate::simulation::{Extent, simulate_policy};
use firmware::table::Table;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of `run`.
#[derive(Clone, Debug, clap::Args)]
pub struct RunArguments {
    /// TOML file whose keys replace the preset's
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Scenario to start from
    #[arg(long, value_enum, default_value_t)]
    pub preset: Preset,
    /// Replace one key, such as radio.max_power_dbm=23
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Policy to run (repeatable) [default: all]
    #[arg(long, value_enum, value_name = "NAME")]
    pub policy: Vec<PolicyName>,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Vehicles in the cell [default: the scenario's]
    #[arg(long)]
    pub vehicles: Option<u32>,
    /// Independent worlds
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub worlds: u32,
    /// Slots of 1 ms that count
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub slots: u32,
    /// Slots before them
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(0..=100_000_000))]
    pub warmup: u32,
    /// Seed of the worlds; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// One policy's result.
pub struct PolicyResult {
    /// Which.
    pub name: &'static str,
    /// Its ages.
    pub ages: AgeSummary,
    /// Simulated slots (all worlds, warm-up included) per second of wall time.
    pub slots_per_second: f64,
}

impl RunArguments {
    /// The scenario they describe.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn scenario(&self) -> Result<Scenario> {
        let mut settings = self.set.clone();
        settings.extend(self.vehicles.map(|vehicles| format!("cell.vehicles={vehicles}")));
        ScenarioSource {
            preset: self.preset,
            file: self.scenario.clone(),
            settings,
        }
        .read()
    }

    /// How much they ask for.
    pub fn extent(&self) -> Extent {
        Extent {
            seed: self.seed,
            worlds: self.worlds,
            slots: self.slots,
            warmup: self.warmup,
        }
    }

    /// The asked policies, each once, in a fixed order.
    pub fn policies(&self) -> Vec<PolicyName> {
        let asked = |policy: &PolicyName| self.policy.is_empty() || self.policy.contains(policy);
        PolicyName::ALL.into_iter().filter(asked).collect()
    }

    /// A thread pool of the asked size.
    ///
    /// # Errors
    /// If the system gives no threads.
    pub fn pool(&self) -> Result<rayon::ThreadPool> {
        thread_pool(self.threads)
    }
}

/// A thread pool of this size; one thread a core without it.
///
/// # Errors
/// If the system gives no threads.
pub fn thread_pool(threads: Option<u16>) -> Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, usize::from))
        .build();
    pool.map_err(|error| Error::input("--threads", error, "threads that the system can start"))
}

/// Bytes of the asked table.
///
/// # Errors
/// If the file cannot be read.
pub fn table_bytes(path: Option<&Path>) -> Result<Vec<u8>> {
    match path {
        None => Ok(firmware::tables::DISTILLED.to_vec()),
        Some(path) => std::fs::read(path).map_err(|source| Error::file(path, source)),
    }
}

/// Checks table bytes.
///
/// # Errors
/// Names the file and the field that does not fit.
pub fn parse_table<'t>(path: Option<&Path>, bytes: &'t [u8]) -> Result<Table<'t>> {
    let place = path.map_or("built-in table".to_owned(), |path| path.display().to_string());
    Table::parse(bytes).map_err(|error| match error.to_string().split_once(": found ") {
        Some((field, rest)) => {
            let (found, expected) = rest.split_once(", expected ").unwrap_or((rest, "a table"));
            Error::input(format!("{place}: {field}"), found, expected)
        }
        None => Error::input(place, error, "a table"),
    })
}

/// A progress bar on stderr for `steps` worlds.
pub fn progress_bar(steps: u64, hidden: bool) -> ProgressBar {
    if hidden {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{msg:14} {bar:40} {pos}/{len} worlds, {per_sec}, {eta} left");
    ProgressBar::new(steps).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Runs the asked policies one after the other, each on the same worlds.
///
/// # Errors
/// The first input that does not fit; nothing is simulated before every policy is checked.
pub fn results(
    arguments: &RunArguments,
    scenario: &Scenario,
    table: &Table<'_>,
) -> Result<Vec<PolicyResult>> {
    let (extent, policies) = (arguments.extent(), arguments.policies());
    for policy in &policies {
        policy.check(scenario, scenario.cell.vehicles as usize, table)?;
    }
    let pool = arguments.pool()?;
    let progress = progress_bar(policies.len() as u64 * u64::from(extent.worlds), arguments.json);
    let mut results = Vec::new();
    for policy in policies {
        progress.set_message(policy.name());
        let start = Instant::now();
        let ages = pool.install(|| simulate_policy(scenario, &extent, policy, table, || progress.inc(1)))?;
        let slots = f64::from(extent.worlds) * f64::from(extent.warmup + extent.slots);
        let slots_per_second = slots / start.elapsed().as_secs_f64();
        results.push(PolicyResult {
            name: policy.name(),
            ages,
            slots_per_second,
        });
    }
    progress.finish_and_clear();
    Ok(results)
}

/// The JSON object of a run.
pub fn to_json(scenario: &Scenario, extent: &Extent, results: &[PolicyResult]) -> Value {
    let policies: Vec<Value> = results
        .iter()
        .map(
            |PolicyResult {
                 name,
                 ages,
                 slots_per_second,
             }| {
                json!({
                    "policy": name,
                    "vehicles": scenario.cell.vehicles,
                    "worlds": extent.worlds,
                    "slots": extent.slots,
                    "mean_age_ms": ages.mean_ms,
                    "mean_age_ci95_ms": ages.ci95_ms,
                    "median_world_age_ms": ages.median_world_ms,
                    "p99_age_ms": ages.p99_ms,
                    "first100_age_ms": ages.first100_ms,
                    "success_per_slot": ages.success_per_slot,
                    "slots_per_second": slots_per_second,
                })
            },
        )
        .collect();
    json!({
        "seed": extent.seed,
        "warmup": extent.warmup,
        "bound_age_ms": ideal_age_ms(scenario.cell.vehicles, scenario.radio.sub_channels),
        "policies": policies,
    })
}

/// The ages as a table for people.
pub fn age_table(_scenario: &Scenario, _extent: &Extent, _results: &[PolicyResult]) -> String {
    String::new()
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &RunArguments) -> Result<()> {
    let scenario = arguments.scenario()?;
    let bytes = table_bytes(arguments.table.as_deref())?;
    let table = parse_table(arguments.table.as_deref(), &bytes)?;
    let results = results(arguments, &scenario, &table)?;
    println!("{}", to_json(&scenario, &arguments.extent(), &results));
    Ok(())
}
