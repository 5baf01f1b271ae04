//! `trainer adapt`: the same network for cells in which a report needs another rate.

use crate::evaluate::Setting;
use crate::export::adapted;
use firmware::form::{ObservationForm, OutputForm};
use firmware::table::SINR;
use firmware::units::Level;
use host_sim::command::options::ScenarioArguments;
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};
use kit::files::{check_output, write_whole};
use kit::{say, tell};
use serde_json::json;
use std::path::PathBuf;

/// Options of `adapt`.
#[derive(Clone, Debug, clap::Args)]
pub struct AdaptArguments {
    /// The table [default: the one that is built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// The cell that it is to serve.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Where to write the adapted table
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Adapts, and reports.
///
/// # Errors
/// A scenario or a table that cannot be read, or a file that cannot be written.
pub fn run(arguments: &AdaptArguments) -> Result<()> {
    let inputs: Vec<PathBuf> = arguments
        .table
        .iter()
        .chain(&arguments.scenario.scenario)
        .cloned()
        .collect();
    check_output("--out", &arguments.out, &inputs)?;
    let scenario = arguments.scenario.source().read()?;
    let table = WeightTable::read_or_built_in(arguments.table.as_deref())?;
    let (name, table) = (table.name().to_owned(), table.parse()?);
    let (before, now) = (Setting::of_table(&table), Setting::of_scenario(&scenario));
    let form = (table.observation_form(), table.output_form());
    if form != (ObservationForm::Ring, OutputForm::Actions) {
        let found = format!("a network of the form {form:?}");
        let expected = "one of the shipped form, which alone is told what is enough";
        return Err(Error::input(name, found, expected));
    }
    if !SINR.contains(&now.required_sinr.to_bits()) {
        let expected = "at most 19.9, whose 60 dB of SINR a table can hold";
        let rate = scenario.radio.min_spectral_efficiency;
        return Err(Error::input("radio.min_spectral_efficiency", rate, expected));
    }
    write_whole(&arguments.out, &adapted(&table, &now))?;
    let db = |level: Level| level.to_num::<f64>();
    let [required, required_before] = [now, before].map(|setting| db(setting.required_sinr));
    let out = arguments.out.display();
    if arguments.json {
        let levels = now.power_plan.joiner_levels.map(db);
        say!(
            "{}",
            json!({
                "table": arguments.out,
                "required_sinr_db": required,
                "required_sinr_before_db": required_before,
                "joiner_levels_db": levels,
            })
        );
    } else {
        tell!(
            "Wrote {out}: a required SINR of {required:.2} dB instead of {required_before:.2} dB, and the joiner levels that go with it."
        );
        tell!("Whether its network serves there: trainer compare --table {out}, with the same scenario.");
    }
    Ok(())
}
