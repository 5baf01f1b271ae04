//! `host-sim run`: ages of all policies on the same worlds, and what they do to the road.

use crate::command::options::{
    ScenarioArguments, TextArguments, check_table_is_used, choice, progress_bar, typed, within,
};
use crate::experiment::{Experiment, ExperimentSource, PolicyResult, SLOTS, WARMUP, WORLDS};
use crate::policy::Kind;
use crate::report::{ages, answers, cell_figures, pages, traffic};
use crate::threads::thread_pool;
use kit::error::Result;
use kit::files;
use kit::say;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Options of `run`.
#[derive(Clone, Debug, clap::Args)]
pub struct RunArguments {
    /// What to simulate.
    #[command(flatten)]
    pub options: RunOptions,
    /// Folder for figures and data [default: out]
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    pub out: Option<PathBuf>,
}

impl RunArguments {
    /// The folder for figures and data.
    pub fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new("out"))
    }
}

/// What to simulate.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct RunOptions {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Policy to run (repeatable) [default: all]
    #[arg(long, value_parser = choice::<&'static Kind>(), value_name = "NAME")]
    pub policy: Vec<&'static Kind>,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Vehicles in the cell [default: the scenario's]
    #[arg(long)]
    pub vehicles: Option<u32>,
    /// Independent worlds [default: 256; 8 with a trace or SUMO]
    #[arg(long, value_parser = within(WORLDS))]
    pub worlds: Option<u32>,
    /// Slots of 1 ms that count [default: 2000; to the end of a trace]
    #[arg(long, value_parser = within(SLOTS))]
    pub slots: Option<u32>,
    /// Slots before them
    #[arg(long, default_value_t = 500, value_parser = within(WARMUP))]
    pub warmup: u32,
    /// What moves the vehicles: the urban grid; a file of SUMO floating-car data (.xml, .xml.gz); or sumo: and a SUMO
    /// configuration, which every world runs live with a seed of its own, with at most --vehicles at once; sumo:FILE@600 begins
    /// 600 s after SUMO does. In their coordinates the base station stands at cell.base_station_x_m and _y_m
    #[arg(long, value_name = "grid|FILE|sumo:FILE", default_value = "grid")]
    pub mobility: String,
    /// Seed of the worlds; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// How tables are shown.
    #[command(flatten)]
    pub text: TextArguments,
    /// Print one JSON object and nothing else; write no files
    #[arg(long)]
    pub json: bool,
    /// Say in the JSON object how fast each policy ran; without it equal runs give equal bytes
    #[arg(long)]
    pub timing: bool,
}

impl RunOptions {
    /// Refuses what contradicts itself, or has no effect, as a person typed it. [`ExperimentSource::read`] does not: a point
    /// of a sweep has the whole grid's table.
    ///
    /// # Errors
    /// The first contradiction.
    pub fn check_typed(&self) -> Result<()> {
        if self.vehicles.is_some() {
            self.scenario.check_not_set("--vehicles", "cell.vehicles")?;
        }
        check_table_is_used(self.table.as_deref(), &self.policy)?;
        Ok(())
    }

    /// The experiment that the options describe.
    pub fn source(&self) -> ExperimentSource {
        ExperimentSource {
            scenario: self.scenario.source(),
            vehicles: self.vehicles,
            mobility: self.mobility.clone(),
            policies: self.policy.clone(),
            table: self.table.clone(),
            worlds: self.worlds,
            slots: self.slots,
            warmup: self.warmup,
            seed: self.seed,
        }
    }
}

/// The JSON object of a run; with `timing` it has each policy's `slots_per_second`.
pub fn json(experiment: &Experiment, results: &[PolicyResult], timing: bool) -> Value {
    let mut object = experiment.to_json(results);
    let policies = object["policies"].as_array_mut().filter(|_| timing);
    for (policy, result) in policies.into_iter().flatten().zip(results) {
        policy["slots_per_second"] = result.slots_per_second.into();
    }
    object
}

/// The results of an experiment, with a progress bar.
///
/// # Errors
/// As [`Experiment::results`].
pub fn results_with_progress(experiment: &Experiment, hide_progress: bool) -> Result<Vec<PolicyResult>> {
    let worlds = experiment.policies.len() as u64 * u64::from(experiment.extent.worlds);
    let template = "{msg:14} {bar:40} {pos}/{len} worlds, {left} left";
    let progress = progress_bar(worlds, template, hide_progress);
    let results = experiment.results(|policy| {
        progress.set_message(policy);
        progress.inc(1);
    })?;
    progress.finish_and_clear();
    Ok(results)
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit; nothing is written then.
pub fn run(arguments: &RunArguments) -> Result<()> {
    let (options, out) = (&arguments.options, arguments.out());
    options.check_typed()?;
    let experiment = options.source().read()?;
    if !options.json {
        files::check_folder(out)?;
    }
    let results =
        thread_pool(options.threads)?.install(|| results_with_progress(&experiment, options.json))?;
    let object = json(&experiment, &results, options.timing);
    if options.json {
        say!("{object}");
        return Ok(());
    }
    let (description, bound_ms) = (experiment.description(), experiment.simulation().bound_age_ms());
    let age_table = ages::table(&results, &description, bound_ms)?;
    let measures = ages::measures(&results)?;
    say!("{}", options.text.of(&age_table));
    say!("{}", options.text.of(&measures));
    let mut set = ages::files(&results, &description, bound_ms)?;
    let table = experiment.table.parse()?;
    set.extend(cell_figures::files(
        &experiment.simulation(),
        &experiment.policies,
        &table,
    )?);
    let has_traffic = results.iter().any(|result| result.traffic.is_some());
    let traffic_table = has_traffic.then(|| traffic::table(&results, &experiment.scenario));
    let traffic_table = traffic_table.transpose()?;
    if let Some(table) = &traffic_table {
        say!("{}", options.text.of(table));
        set.push(("traffic.csv".to_owned(), table.to_csv()));
        set.extend(traffic::paper_figures(&experiment.scenario)?);
    }
    set.push(("run.json".to_owned(), format!("{object:#}\n")));
    for answer in answers::of_run(&experiment, &results) {
        say!("{answer}\n");
    }
    let tables = [&age_table, &measures];
    let command = typed("run", &["--out"]);
    let page = pages::run(
        &experiment,
        &results,
        tables,
        traffic_table.as_ref(),
        &set,
        &command,
    )?;
    set.push(("report.html".to_owned(), page.render()));
    files::write_set(out, &set)?;
    say!("{}", files::written(out, "report.html", &set));
    Ok(())
}
