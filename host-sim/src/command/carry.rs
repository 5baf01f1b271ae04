//! `host-sim carry`: how many vehicles a sub-channel carries at the mean ages that services ask for.

use crate::command::options::{ScenarioArguments, TextArguments, choice, progress_bar, within};
use crate::experiment::{ExperimentSource, SLOTS, WORLDS};
use crate::load::{bound, climb, ladder};
use crate::mobility::Grid;
use crate::policy::Kind;
use crate::report::carried;
use crate::threads::thread_pool;
use kit::error::Result;
use kit::files;
use kit::say;
use std::path::PathBuf;

/// Options of `carry`.
#[derive(Clone, Debug, clap::Args)]
pub struct CarryArguments {
    /// The scenario; its number of vehicles counts for nothing.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Policy to load (repeatable) [default: all]
    #[arg(long, value_parser = choice::<&'static Kind>(), value_name = "NAME")]
    pub policy: Vec<&'static Kind>,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Most vehicles in the cell
    #[arg(long, default_value_t = 2000, value_parser = within(1..=10_000))]
    pub most: u32,
    /// Independent worlds of each load
    #[arg(long, default_value_t = 64, value_parser = within(WORLDS))]
    pub worlds: u32,
    /// Least number of slots of 1 ms that count in each, after a quarter as many that do not; old information needs more
    #[arg(long, default_value_t = 2000, value_parser = within(SLOTS))]
    pub slots: u32,
    /// Seed of the worlds; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Folder for figures (SVG) and data (CSV) [default: out]
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    pub out: Option<PathBuf>,
    /// Print one JSON object and nothing else; write no files
    #[arg(long)]
    pub json: bool,
}

impl CarryArguments {
    fn source(&self) -> ExperimentSource {
        ExperimentSource {
            scenario: self.scenario.source(),
            vehicles: Some(self.most),
            policies: self.policy.clone(),
            table: self.table.clone(),
            worlds: Some(self.worlds),
            slots: Some(self.slots),
            warmup: self.slots / 4,
            seed: self.seed,
            ..ExperimentSource::default()
        }
    }
}

/// Simulates and reports.
///
/// # Errors
/// The first input that does not fit; nothing is written then.
pub fn run(arguments: &CarryArguments) -> Result<()> {
    arguments.scenario.check_not_set("--most", "cell.vehicles")?;
    let source = arguments.source();
    // Whoever cannot serve the highest load is refused before the first.
    let experiment = source.read_with(Box::new(Grid))?;
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from("out"));
    if !arguments.json {
        files::check_folder(&out)?;
    }
    let sub_channels = experiment.scenario.radio.sub_channels;
    let ladder = ladder(sub_channels, arguments.most);
    let steps = experiment.policies.len() * ladder.len();
    let template = "{msg:30} {bar:40} {pos}/{len} loads, {elapsed} so far";
    let progress = progress_bar(steps as u64, template, arguments.json);
    let mut climbs = thread_pool(arguments.threads)?.install(|| {
        let climbs = experiment.policies.iter().enumerate().map(|(index, &policy)| {
            // Whoever stops early has skipped the rest.
            progress.set_position((index * ladder.len()) as u64);
            climb(&source, policy, &ladder, |vehicles| {
                progress.set_message(format!("{}, {vehicles} vehicles", policy.name));
                progress.inc(1);
            })
        });
        climbs.collect::<Result<Vec<_>>>()
    })?;
    progress.finish_and_clear();
    climbs.push(bound(sub_channels, &ladder));
    if arguments.json {
        say!("{}", carried::to_json(&experiment, &climbs));
        return Ok(());
    }
    let table = carried::table(&experiment, &climbs, arguments.most)?;
    say!("{}", TextArguments::default().of(&table));
    let set = carried::files(&experiment, &climbs, &table)?;
    files::write_set(&out, &set)?;
    let names: Vec<String> = set
        .iter()
        .map(|(name, _)| out.join(name).display().to_string())
        .collect();
    say!("Written: {}.", names.join(", "));
    Ok(())
}
