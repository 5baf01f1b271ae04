//! `trainer eval`: a table, or a run's float network beside its table, on held-out worlds.

use crate::evaluate::{Agreement, FloatActor};
use crate::network::Network;
use crate::run_folder::RunFolder;
use firmware::table::Table;
use host_sim::command::run::{self, RunArguments};
use host_sim::error::{Error, Result};
use host_sim::policy::PolicyName;
use host_sim::scenario::Scenario;
use host_sim::simulation::{Extent, simulate, simulate_policy};
use serde_json::json;
use std::path::PathBuf;

/// Options of `eval`.
#[derive(Clone, Debug, clap::Args)]
pub struct EvalArguments {
    /// Folder of a training run: evaluates its table and its float network
    #[arg(long, value_name = "DIR", conflicts_with = "table")]
    pub run: Option<PathBuf>,
    /// Worlds, policies and output.
    #[command(flatten)]
    pub options: RunArguments,
}

/// Float and int8 on the same worlds.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// Fraction of decisions that agree, along the float network's trajectories.
    pub agreement: f64,
    /// Mean age with the table.
    pub quantised_age_ms: f64,
    /// Mean age with the float network.
    pub float_age_ms: f64,
}

/// Compares a network with its table.
///
/// # Errors
/// If the table does not serve the scenario.
pub fn compare(
    scenario: &Scenario,
    extent: &Extent,
    network: &Network,
    table: &Table<'_>,
) -> Result<Comparison> {
    let quantised = simulate_policy(scenario, extent, PolicyName::Actor, table, || ())?;
    let agreement = Agreement::default();
    let build = |_: &_| -> Box<dyn host_sim::policy::Policy + '_> {
        Box::new(FloatActor::new(network, table, &agreement))
    };
    let float = simulate(scenario, extent, build, || ())?;
    Ok(Comparison {
        agreement: agreement.fraction().unwrap_or(1.0),
        quantised_age_ms: quantised.mean_ms,
        float_age_ms: float.mean_ms,
    })
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &EvalArguments) -> Result<()> {
    let Some(folder) = arguments.run.as_deref().map(RunFolder::new) else {
        return run::run(&arguments.options);
    };
    let mut options = arguments.options.clone();
    options.table = Some(folder.table());
    let scenario = options.scenario()?;
    let network = folder.read_network()?;
    let bytes = run::table_bytes(options.table.as_deref())?;
    let table = run::parse_table(options.table.as_deref(), &bytes)?;
    let first = table.hidden_layers().first().unwrap_or(table.output_layer());
    if network.widths().first() != Some(&first.inputs_len()) {
        let found = format!("{:?} inputs", network.widths().first());
        return Err(Error::input(
            folder.network().display(),
            found,
            first.inputs_len(),
        ));
    }
    let results = run::results(&options, &scenario, &table)?;
    let mut object = run::to_json(&scenario, &options.extent(), &results);
    let comparison = options
        .pool()?
        .install(|| compare(&scenario, &options.extent(), &network, &table))?;
    object["float_mean_age_ms"] = json!(comparison.float_age_ms);
    object["age_lost_ms"] = json!(comparison.quantised_age_ms - comparison.float_age_ms);
    object["agreement"] = json!(comparison.agreement);
    if options.json {
        println!("{object}");
    } else {
        println!("{}", run::age_table(&scenario, &options.extent(), &results));
        println!(
            "Float network: {:.3} ms; int8 loses {:.3} ms; {:.3} % of decisions agree.",
            comparison.float_age_ms,
            comparison.quantised_age_ms - comparison.float_age_ms,
            100.0 * comparison.agreement
        );
    }
    Ok(())
}
