//! `trainer distil`: from a seed to a table.

use crate::distil::table::{DistilledTable, distil_table};
use crate::distil::{MAX_SUB_CHANNELS, Recipe};
use crate::evaluate::compare;
use crate::provenance::provenance;
use crate::run_folder::RunFolder;
use firmware::network::MAX_LAYERS;
use firmware::table::Provenance;
use host_sim::command::options::{ScenarioArguments, progress_bar};
use host_sim::mobility::Grid;
use host_sim::scenario::Scenario;
use host_sim::simulation::{Extent, Simulation};
use host_sim::thread_pool;
use kit::error::{Error, Result};
use kit::files::check_folder;
use kit::say;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Options of `distil`.
#[derive(Clone, Debug, clap::Args)]
pub struct DistilArguments {
    /// Seed of the run
    #[arg(long, default_value_t = Recipe::default().seed)]
    pub seed: u64,
    /// Widths of the hidden layers
    #[arg(long, value_delimiter = ',', default_values_t = Recipe::default().hidden,
          value_parser = parse_width)]
    pub hidden: Vec<usize>,
    /// The scenario to distil in.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Folder for the network, the table and the report
    #[arg(long, default_value = "out/distil")]
    pub out: PathBuf,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

fn parse_width(text: &str) -> std::result::Result<usize, String> {
    let most = firmware::network::MAX_WIDTH;
    let width = text.parse().ok().filter(|width| (1..=most).contains(width));
    width.ok_or_else(|| format!("expected a width from 1 to {most}"))
}

/// Distils and quantises, and shows how far it is.
///
/// # Errors
/// If the network cannot be quantised.
pub fn distil_table_visibly(
    scenario: &Scenario,
    recipe: &Recipe,
    provenance: Provenance,
    hide_progress: bool,
) -> Result<DistilledTable> {
    let template = "distilling {bar:40} round {pos}/{len}, {eta} left, {msg}";
    let progress = progress_bar(u64::from(recipe.iterations), template, hide_progress);
    let made = distil_table(scenario, recipe, provenance, |round| {
        progress.set_position(u64::from(round.number));
        progress.set_message(format!(
            "cross entropy {:.4} over {} samples",
            round.loss, round.samples
        ));
    })?;
    progress.finish_and_clear();
    Ok(made)
}

/// Runs and reports.
///
/// # Errors
/// What cannot be quantised or written.
pub fn run(arguments: &DistilArguments) -> Result<()> {
    let pool = thread_pool(arguments.threads)?;
    let scenario = arguments.scenario.source().read()?;
    let sub_channels = scenario.radio.sub_channels;
    if sub_channels > MAX_SUB_CHANNELS {
        let expected = format!("at most {MAX_SUB_CHANNELS}, which the table will serve");
        return Err(Error::input("radio.sub_channels", sub_channels, expected));
    }
    let most = MAX_LAYERS - 1;
    if arguments.hidden.len() > most {
        let found = format!("{} layers", arguments.hidden.len());
        return Err(Error::input(
            "--hidden",
            found,
            format!("at most {most}, which a table holds"),
        ));
    }
    check_folder(&arguments.out)?;
    let folder = RunFolder::new(&arguments.out);
    let recipe = Recipe {
        seed: arguments.seed,
        hidden: arguments.hidden.clone(),
        ..Recipe::default()
    };
    let task = json!({
        "seed": recipe.seed,
        "scenario": scenario,
        "hidden": recipe.hidden,
    });
    folder.check_free_for(&task)?;
    let start = Instant::now();
    let made =
        pool.install(|| distil_table_visibly(&scenario, &recipe, provenance(recipe.seed), arguments.json))?;
    let seconds = start.elapsed().as_secs_f64();
    let table = made.table.parse()?;
    let extent = Extent {
        seed: recipe.seed,
        worlds: 64,
        slots: 1000,
        warmup: 500,
    };
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent,
    };
    let comparison = pool.install(|| compare(&simulation, &made.actors, &[table]))?;
    let report = json!({
        "seed": task["seed"],
        "scenario": task["scenario"],
        "hidden": task["hidden"],
        "cross_entropy": made.loss,
        "table_bytes": made.table.bytes().len(),
        "seconds": seconds,
        "worlds": extent.worlds,
        "slots": extent.slots,
        "agreement": comparison.agreement,
        "mean_age_ms": comparison.quantised_age_ms,
        "float_mean_age_ms": comparison.float_age_ms,
        "age_lost_ms": comparison.quantised_age_ms - comparison.float_age_ms,
    });
    folder.write(&made.actors, Some(made.table.bytes()), &report)?;
    if arguments.json {
        say!("{report}");
    } else {
        say!(
            "Distilled the ring clock in {seconds:.1} s: {} bytes, cross entropy {:.5}.\n\
             On {} held-out worlds x {} slots: int8 {:.3} ms, float {:.3} ms, {:.3} % of decisions agree.\n\
             Written to {}.",
            made.table.bytes().len(),
            made.loss,
            extent.worlds,
            extent.slots,
            comparison.quantised_age_ms,
            comparison.float_age_ms,
            100.0 * comparison.agreement,
            arguments.out.display(),
        );
    }
    Ok(())
}
