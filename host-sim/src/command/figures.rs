//! `host-sim figures`: the paper's figures with their data: path planning, which sweeps delta m itself, and learning, from
//! runs that come with the program.

use crate::command::options::ScenarioArguments;
use crate::error::Result;
use crate::report::{files, learning, traffic};
use crate::say;
use serde_json::json;
use std::path::PathBuf;

/// Options of `figures`.
#[derive(Clone, Debug, clap::Args)]
pub struct FigureArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Folder for figures (SVG) and data (CSV)
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    /// Accepted like everywhere; these figures draw nothing at random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Draws and writes.
///
/// # Errors
/// What is wrong with the scenario, or the file that cannot be written.
pub fn run(arguments: &FigureArguments) -> Result<()> {
    let scenario = arguments.scenario.read([])?;
    files::check_folder(&arguments.out)?;
    let mut set = traffic::paper_figures(&scenario)?;
    set.extend(learning::paper_figures()?);
    files::write_set(&arguments.out, &set)?;
    let files: Vec<String> = set
        .iter()
        .map(|(name, _)| arguments.out.join(name).display().to_string())
        .collect();
    if arguments.json {
        say!("{}", json!({ "files": files }));
    } else {
        say!("Written: {}.", files.join(", "));
    }
    Ok(())
}
