//! `trainer distil`: from a seed to a table.

use crate::configuration::EXPLAIN;
use crate::distil::table::{DistilledTable, distil_table};
use crate::distil::{Recipe, VEHICLES};
use crate::evaluate::{Comparison, compare};
use crate::mixture::{Mixture, MixtureSource, VARIED_SUB_CHANNELS};
use crate::provenance::provenance;
use crate::run_folder::RunFolder;
use firmware::network::MAX_LAYERS;
use firmware::table::Provenance;
use host_sim::command::options::{ScenarioArguments, progress_bar};
use host_sim::mobility::Grid;
use host_sim::scenario::{Preset, ScenarioSource};
use host_sim::simulation::{Extent, Simulation};
use host_sim::thread_pool;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::files::check_folder;
use kit::layers::Layers;
use kit::{say, tell};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;
use toml::Table;

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
    /// The scenario to distil in, varied.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// TOML file of a mixture to distil in, such as one of trainer/mixtures; --scenario and --set lie over each cell's preset
    #[arg(long, value_name = "FILE")]
    pub mixture: Option<PathBuf>,
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
    mixture: &Mixture,
    recipe: &Recipe,
    provenance: Provenance,
    hide_progress: bool,
) -> Result<DistilledTable> {
    let template = "distilling {bar:40} round {pos}/{len}, {left} left, {msg}";
    let progress = progress_bar(u64::from(recipe.iterations), template, hide_progress);
    let made = distil_table(mixture, recipe, provenance, |round| {
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
    let mixture = read_mixture(arguments)?;
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
    let (what, cells) = match &arguments.mixture {
        Some(_) => ("mixture", json!(mixture.cells())),
        None => ("scenario", json!(mixture.cells()[0].scenario)),
    };
    let task = json!({ "seed": recipe.seed, what: cells, "hidden": recipe.hidden });
    folder.check_free_for(&task)?;
    let start = Instant::now();
    let made =
        pool.install(|| distil_table_visibly(&mixture, &recipe, provenance(recipe.seed), arguments.json))?;
    let seconds = start.elapsed().as_secs_f64();
    let table = made.table.parse()?;
    let extent = Extent {
        seed: recipe.seed,
        worlds: 64,
        slots: 1000,
        warmup: 500,
    };
    let compared = mixture.cells().iter().map(|cell| {
        let simulation = Simulation {
            scenario: &cell.scenario,
            source: &Grid,
            extent,
        };
        compare(&simulation, &made.actors, std::slice::from_ref(&table))
    });
    let compared: Vec<Comparison> = pool.install(|| compared.collect::<Result<_>>())?;
    let mut report = json!({
        "seed": task["seed"],
        what: task[what],
        "hidden": task["hidden"],
        "cross_entropy": made.loss,
        "table_bytes": made.table.bytes().len(),
        "worlds": extent.worlds,
        "slots": extent.slots,
    });
    let add = |object: &mut Value, comparison: &Comparison| {
        object["agreement"] = json!(comparison.agreement);
        object["mean_age_ms"] = json!(comparison.quantised_age_ms);
        object["float_mean_age_ms"] = json!(comparison.float_age_ms);
        object["age_lost_ms"] = json!(comparison.quantised_age_ms - comparison.float_age_ms);
    };
    match &arguments.mixture {
        None => add(&mut report, &compared[0]),
        Some(_) => {
            let cells = mixture.cells().iter().zip(&compared);
            let cells = cells.map(|(cell, comparison)| {
                let mut object = json!({ "cell": cell.name });
                add(&mut object, comparison);
                object
            });
            report["cells"] = cells.collect();
        }
    }
    folder.write(&made.actors, Some(made.table.bytes()), &report)?;
    if arguments.json {
        say!("{report}");
        return Ok(());
    }
    say!(
        "Distilled the ring clock in {seconds:.1} s: {} bytes, cross entropy {:.5}.",
        made.table.bytes().len(),
        made.loss,
    );
    for (cell, comparison) in mixture.cells().iter().zip(&compared) {
        let of = arguments.mixture.as_ref().map(|_| format!(" of {}", cell.name));
        tell!(
            "On {} held-out worlds{} x {} slots: int8 {:.3} ms, float {:.3} ms, {:.3} % of decisions agree.",
            extent.worlds,
            of.unwrap_or_default(),
            extent.slots,
            comparison.quantised_age_ms,
            comparison.float_age_ms,
            100.0 * comparison.agreement,
        );
    }
    say!("Written to {}.", arguments.out.display());
    Ok(())
}

/// The cells to distil in: the scenario, varied, or those of a file.
fn read_mixture(arguments: &DistilArguments) -> Result<Mixture> {
    let source = arguments.scenario.source();
    let Some(file) = &arguments.mixture else {
        let scenario = source.read()?;
        let sub_channels = scenario.radio.sub_channels;
        if sub_channels > VARIED_SUB_CHANNELS {
            let expected = format!("at most {VARIED_SUB_CHANNELS}, which the table will serve");
            return Err(Error::input("radio.sub_channels", sub_channels, expected));
        }
        return Ok(Mixture::varied(&scenario, VEHICLES));
    };
    if source.preset != Preset::default() {
        let expected = "none with --mixture, whose cells have their own";
        return Err(Error::input("--preset", source.preset.name(), expected));
    }
    let common = |preset| {
        let scenario = ScenarioSource {
            preset,
            ..source.clone()
        };
        Table::try_from(scenario.read()?)
            .map_err(|error| Error::input("scenario", error, "one that TOML can hold"))
    };
    let mut layers = Layers::new(MixtureSource::KEYS, EXPLAIN);
    layers.lay_over(Some(file), &[])?;
    let written: MixtureSource = layers.read()?;
    Mixture::read(&written.mixture, VEHICLES, common).map_err(|error| layers.located(error))
}
