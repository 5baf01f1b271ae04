//! `trainer export`: the table into the firmware's sources and a binary file, or proof that the shipped one is what its
//! seed gives.

use crate::command::cells::{self, InCell};
use crate::command::distil::distil_table_visibly;
use crate::command::eval::Forms;
use crate::distil::Recipe;
use crate::distil::table::shipped_mixture;
use crate::export::table_source;
use crate::onnx;
use crate::provenance::{provenance, workspace_folder};
use crate::run_folder::RunFolder;
use crate::trained_actors::{TrainedActors, table_of};
use firmware::table::Table;
use host_sim::deadline::cycles::{SLOT_CYCLES, slot_cycles};
use host_sim::experiment::ExperimentSource;
use host_sim::revision::revision_text;
use host_sim::thread_pool;
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};
use kit::files::{check_output, write_whole};
use kit::{say, tell};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Held-out worlds of each cell of a mixture in which a run is shown, and their slots (chosen: a minute).
const WORLDS: u32 = 64;
const SLOTS: u32 = 1000;

/// Options of `export`.
#[derive(Clone, Debug, clap::Args)]
pub struct ExportArguments {
    /// Folder of a training run whose actor to export [default: distil anew]
    #[arg(long, value_name = "DIR", conflicts_with_all = ["seed", "check"])]
    pub run: Option<PathBuf>,
    /// Which vehicle's, where each has an actor of its own
    #[arg(long, value_name = "INDEX", requires = "run")]
    pub vehicle: Option<usize>,
    /// Write the float network as an ONNX model to this file, and nothing else
    #[arg(long, value_name = "FILE", requires = "run", conflicts_with_all = ["check", "out"])]
    pub onnx: Option<PathBuf>,
    /// Seed to distil with
    #[arg(long, conflicts_with = "check")]
    pub seed: Option<u64>,
    /// Write nothing: distil with the shipped table's seed and compare every byte
    #[arg(long)]
    pub check: bool,
    /// The binary file
    #[arg(long, value_name = "FILE", default_value = "out/table.bin")]
    pub out: PathBuf,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Runs and reports.
///
/// # Errors
/// A table that cannot be read, made or written, and a shipped one that its seed does not give.
pub fn run(arguments: &ExportArguments) -> Result<()> {
    let pool = thread_pool(arguments.threads)?;
    if arguments.check {
        return pool.install(|| check(arguments.json));
    }
    if let (Some(folder), Some(path)) = (&arguments.run, &arguments.onnx) {
        let folder = RunFolder::new(folder);
        check_output("--onnx", path, &folder.records())?;
        let actors = folder.read_actors()?;
        let vehicle = chosen(actors.networks.len(), arguments.vehicle)?;
        let model = onnx::model(&actors.networks[vehicle], actors.form.output);
        write_whole(path, &model)?;
        if arguments.json {
            say!("{}", json!({ "onnx": path, "onnx_bytes": model.len() }));
        } else {
            say!("Wrote {}, {} bytes.", path.display(), model.len());
        }
        return Ok(());
    }
    let source = workspace_folder().join("firmware/src/tables/distilled.rs");
    let run = arguments.run.as_ref().map(|folder| RunFolder::new(folder));
    let mut inputs = run.iter().flat_map(RunFolder::records).collect::<Vec<_>>();
    inputs.push(source.clone());
    check_output("--out", &arguments.out, &inputs)?;
    let mut cells = Vec::new();
    let table = match &run {
        Some(folder) => {
            cells = pool.install(|| in_each_cell(folder, arguments.json))?;
            let actors = folder.read_actors()?;
            let vehicle = chosen(actors.networks.len(), arguments.vehicle)?;
            pool.install(|| table_of(folder, &actors, vehicle))?
        }
        None => {
            let recipe = Recipe {
                seed: arguments.seed.unwrap_or(Recipe::default().seed),
                ..Recipe::default()
            };
            pool.install(|| {
                distil_table_visibly(
                    &shipped_mixture()?,
                    &recipe,
                    provenance(recipe.seed),
                    arguments.json,
                )
            })?
            .table
        }
    };
    let table = table.parse()?;
    let command = "cargo run --release -p trainer -- export";
    write_whole(&arguments.out, table.bytes())?;
    let out = arguments.out.display();
    // A unit whose slots are too long for its decisions misses every one of them.
    let fits = slot_share(&table) < 1.0;
    let message = if fits {
        write_whole(&source, table_source(&table, "DISTILLED", command).as_bytes())?;
        format!("Wrote {} and {out}.", source.display())
    } else {
        format!(
            "Wrote {out}, but not the firmware's sources: it does not meet the slot. The simulator runs it (--table)."
        )
    };
    report(arguments.json, &table, &message, fits.then_some(&source), &cells)
}

/// What a run of a mixture is worth in each of its cells, before its table takes another's place.
fn in_each_cell(folder: &RunFolder, hide_progress: bool) -> Result<Vec<InCell>> {
    let Some(identity) = folder.read_identity()? else {
        return Ok(Vec::new());
    };
    let mixture = &identity.configuration.mixture;
    if mixture.is_empty() {
        return Ok(Vec::new());
    }
    let source = ExperimentSource {
        worlds: Some(WORLDS),
        slots: Some(SLOTS),
        ..ExperimentSource::default()
    };
    cells::in_each(
        mixture,
        &TrainedActors::read(folder)?,
        &source,
        Forms::Deployed,
        hide_progress,
    )
}

/// The longest slot with this table over 1 ms, modelled.
fn slot_share(table: &Table<'_>) -> f64 {
    slot_cycles(table.network()) / SLOT_CYCLES
}

/// Index of the actor that is meant.
fn chosen(actors: usize, vehicle: Option<usize>) -> Result<usize> {
    match (actors, vehicle) {
        (1, None) => Ok(0),
        (_, Some(vehicle)) if vehicle < actors => Ok(vehicle),
        (_, vehicle) => {
            let found = vehicle.map_or("none".to_owned(), |vehicle| vehicle.to_string());
            let expected = match actors {
                1 => "0 or none: all vehicles share one actor".to_owned(),
                _ => format!("0 to {}: each vehicle has an actor of its own", actors - 1),
            };
            Err(Error::input("--vehicle", found, expected))
        }
    }
}

/// Distils the shipped table again, with the provenance it states.
fn check(json: bool) -> Result<()> {
    let shipped = WeightTable::read_or_built_in(None)?;
    let shipped = shipped.parse()?;
    let stated = *shipped.provenance();
    let recipe = Recipe {
        seed: stated.seed,
        ..Recipe::default()
    };
    let made = distil_table_visibly(&shipped_mixture()?, &recipe, stated, json)?;
    let made = made.table.bytes();
    let different = made
        .iter()
        .zip(shipped.bytes())
        .position(|(made, shipped)| made != shipped);
    if made.len() != shipped.bytes().len() || different.is_some() {
        let found = match different {
            Some(offset) => format!("another byte at offset {offset}"),
            None => format!("{} bytes", made.len()),
        };
        return Err(Error::input(
            format!("the table of seed {}", stated.seed),
            found,
            format!("the {} shipped bytes", shipped.bytes().len()),
        ));
    }
    let message = "The shipped table is what its seed gives, byte for byte.";
    report(json, &shipped, message, None, &[])
}

/// The JSON object of a table that was written to the firmware's source, or to none, and of the cells that it was learned in.
///
/// # Errors
/// If two policies of a cell ran in different worlds.
pub fn to_json(table: &Table<'_>, source: Option<&PathBuf>, cells: &[InCell]) -> Result<Value> {
    let provenance = table.provenance();
    let mut object = json!({
        "seed": provenance.seed,
        "source_revision": revision_text(&provenance.revision),
        "source_modified": provenance.modified,
        "table_bytes": table.bytes().len(),
        "max_vehicles": table.max_vehicles(),
        "slot_modelled_share": slot_share(table),
        "firmware_source": source,
    });
    if !cells.is_empty() {
        let each = cells.iter().map(|cell| cell.to_json(false, false));
        object["cells"] = json!(each.collect::<Result<Vec<_>>>()?);
    }
    Ok(object)
}

fn report(
    json: bool,
    table: &Table<'_>,
    message: &str,
    source: Option<&PathBuf>,
    cells: &[InCell],
) -> Result<()> {
    if json {
        say!("{}", to_json(table, source, cells)?);
    } else {
        let provenance = table.provenance();
        let revision = revision_text(&provenance.revision);
        tell!(
            "{message}\n{} bytes for up to {} vehicles, seed {}, sources {revision}. The longest slot takes {:.1} % of 1 ms \
             (modelled).",
            table.bytes().len(),
            table.max_vehicles(),
            provenance.seed,
            100.0 * slot_share(table)
        );
        if !cells.is_empty() {
            say!("{}", cells::table(cells)?);
        }
    }
    Ok(())
}
