//! `host-sim merge`: the results of all shards as one table, whose bytes depend on the grid alone.

use crate::command::sweep::GridArguments;
use crate::sweep::Store;
use crate::sweep::figure;
use crate::sweep::merged::{Merged, listed};
use kit::error::{Error, Result};
use kit::files;
use kit::{remark, say, tell};
use serde_json::json;
use std::path::PathBuf;

/// Options of `merge`.
#[derive(Clone, Debug, clap::Args)]
pub struct MergeArguments {
    /// The grid.
    #[command(flatten)]
    pub grid: GridArguments,
    /// Folder for merged.parquet and merged.csv
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Folder of results, as `sweep --out` (repeatable) [default: --out]
    #[arg(long, value_name = "DIR")]
    pub results: Vec<PathBuf>,
    /// Merge what is there although points are missing
    #[arg(long)]
    pub allow_missing: bool,
    /// Draw mean ages (run), trip losses (loop) or travel times (assign) against this key of the grid too, such as vehicles
    #[arg(long, value_name = "KEY")]
    pub figure: Option<String>,
    /// Print one JSON object and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

/// Reads, checks and writes.
///
/// # Errors
/// A folder of another grid, or missing points, to which damaged results belong; nothing is written then.
pub fn run(arguments: &MergeArguments) -> Result<()> {
    let grid = arguments.grid.read()?;
    let folders = match arguments.results.as_slice() {
        [] => std::slice::from_ref(&arguments.out),
        folders => folders,
    };
    let mut stores = Vec::new();
    for folder in folders {
        let store = Store::new(folder, &grid)?;
        if !store.exists() {
            let expected = format!("results of `host-sim sweep --grid {}`", grid.path().display());
            return Err(Error::input(folder.display(), "no grid.json", expected));
        }
        stores.push(store);
    }
    let merged = Merged::read(&grid, &stores)?;
    for error in &merged.damaged {
        remark!("{error}; it counts as missing");
    }
    let mut object = json!({
        "grid": stores[0].fingerprint(),
        "points": grid.points(),
        "merged": merged.present.len(),
        "missing": merged.missing,
        "files": [],
    });
    if !merged.missing.is_empty() && !arguments.allow_missing {
        if arguments.json {
            say!("{object}");
        }
        let found = format!(
            "{} of {} points missing: {}",
            merged.missing.len(),
            grid.points(),
            listed(&merged.missing)
        );
        let expected = "every point (run `host-sim sweep` again, or merge with --allow-missing)";
        return Err(Error::input(arguments.out.display(), found, expected));
    }
    let table = merged.table(&grid)?;
    let mut set = vec![
        #[cfg(feature = "parquet")]
        ("merged.parquet".to_owned(), table.to_parquet()?),
        ("merged.csv".to_owned(), table.to_csv().into_bytes()),
    ];
    if let Some(key) = &arguments.figure {
        let files = figure::files(&grid, &merged, key)?;
        set.extend(files.into_iter().map(|(name, text)| (name, text.into_bytes())));
    }
    files::check_folder(&arguments.out)?;
    files::write_set(&arguments.out, &set)?;
    let written: Vec<String> = set
        .iter()
        .map(|(name, _)| arguments.out.join(name).display().to_string())
        .collect();
    if arguments.json {
        object["files"] = json!(written);
        say!("{object}");
    } else {
        let missing = match merged.missing.as_slice() {
            [] => String::new(),
            missing => format!(" Missing {}: {}.", missing.len(), listed(missing)),
        };
        tell!(
            "{} of {} points merged.{missing} Written: {}.",
            merged.present.len(),
            grid.points(),
            written.join(", ")
        );
    }
    Ok(())
}
