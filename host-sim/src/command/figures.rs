//! `host-sim figures`: the paper's figures with their data. Path planning sweeps delta m itself, once along all ages and once
//! at the ages that the policies reach; learning is drawn from runs that come with the program.

use crate::command::options::{ScenarioArguments, progress_bar, within};
use crate::experiment::{Experiment, ExperimentSource, SLOTS, WORLDS};
use crate::report::measured_traffic::{self, MeasuredAges};
use crate::report::{learning, traffic};
use crate::threads::thread_pool;
use crate::traffic::{RoadAges, TrafficModel};
use kit::error::{Error, Result};
use kit::files;
use kit::{say, tell};
use serde_json::json;
use std::path::PathBuf;

/// Options of `figures`.
#[derive(Clone, Debug, clap::Args)]
pub struct FigureArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Independent worlds in which the policies' ages are measured
    #[arg(long, default_value_t = 32, value_parser = within(WORLDS))]
    pub worlds: u32,
    /// Slots of 1 ms that count in each, after a quarter as many that do not
    #[arg(long, default_value_t = 2000, value_parser = within(SLOTS))]
    pub slots: u32,
    /// Folder for figures (SVG) and data (CSV)
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
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

impl FigureArguments {
    fn source(&self) -> ExperimentSource {
        ExperimentSource {
            scenario: self.scenario.source(),
            table: self.table.clone(),
            worlds: Some(self.worlds),
            slots: Some(self.slots),
            warmup: self.slots / 4,
            seed: self.seed,
            ..ExperimentSource::default()
        }
    }
}

/// Simulates, draws and writes.
///
/// # Errors
/// What is wrong with the scenario, or the file that cannot be written.
pub fn run(arguments: &FigureArguments) -> Result<()> {
    let experiment = arguments.source().read()?;
    files::check_folder(&arguments.out)?;
    let mut set = traffic::paper_figures(&experiment.scenario)?;
    let measured = thread_pool(arguments.threads)?.install(|| -> Result<_> {
        let ages = measure(&experiment, arguments.json)?;
        measured_traffic::figures(&experiment.scenario, &ages, &experiment.description())
    })?;
    set.extend(measured);
    set.extend(learning::paper_figures()?);
    files::write_set(&arguments.out, &set)?;
    let files: Vec<String> = set
        .iter()
        .map(|(name, _)| arguments.out.join(name).display().to_string())
        .collect();
    if arguments.json {
        say!("{}", json!({ "files": files }));
    } else {
        tell!("Written: {}.", files.join(", "));
    }
    Ok(())
}

/// The ages that every policy reaches on the same worlds.
fn measure(experiment: &Experiment, hide_progress: bool) -> Result<Vec<MeasuredAges>> {
    let table = experiment.table.parse()?;
    let model = TrafficModel::new(&experiment.scenario)?;
    let worlds = experiment.policies.len() as u64 * u64::from(experiment.extent.worlds);
    let progress = progress_bar(
        worlds,
        "ages {bar:40} {pos}/{len} worlds, {left} left",
        hide_progress,
    );
    let mut measured = Vec::new();
    for &policy in &experiment.policies {
        let (ages, roads) = experiment
            .simulation()
            .run_policy(policy, &table, |environment, world| {
                progress.inc(1);
                model.road_ages(environment, world)
            })?;
        let roads: Option<Vec<RoadAges>> = roads.into_iter().collect();
        measured.push(MeasuredAges {
            policy: policy.name,
            ages,
            roads: roads.ok_or_else(|| Error::input("mobility", "vehicles on no road", "the grid"))?,
        });
    }
    progress.finish_and_clear();
    Ok(measured)
}
