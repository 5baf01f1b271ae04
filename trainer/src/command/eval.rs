//! `trainer eval`: a table, or a run's float network beside its table, on held-out worlds.

use crate::evaluate::{Agreement, FloatActor};
use crate::network::Network;
use crate::run_folder::RunFolder;
use firmware::table::Table;
use host_sim::command::options::thread_pool;
use host_sim::command::run::RunOptions;
use host_sim::environment::Environment;
use host_sim::error::{Error, Result};
use host_sim::policy::{Policy, PolicyName};
use host_sim::report::ages;
use host_sim::say;
use host_sim::simulation::Simulation;
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
    pub options: RunOptions,
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

/// Compares a network with its table, on the current rayon pool.
///
/// # Errors
/// If the table does not serve the scenario.
pub fn compare(simulation: &Simulation<'_>, network: &Network, table: &Table<'_>) -> Result<Comparison> {
    let (quantised, _) = simulation.run_policy(PolicyName::Actor, table, |_| ())?;
    let agreement = Agreement::default();
    let build = |_: &Environment<'_>| -> Box<dyn Policy + '_> {
        Box::new(FloatActor::new(network, table, &agreement))
    };
    let (float, _) = simulation.run(build, |_| ())?;
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
    let mut options = arguments.options.clone();
    let folder = arguments.run.as_deref().map(RunFolder::new);
    if let Some(folder) = &folder {
        options.table = Some(folder.table());
    }
    let prepared = options.prepare()?;
    let table = prepared.table()?;
    let network = folder
        .as_ref()
        .map(|folder| read_network(folder, &table))
        .transpose()?;
    let pool = thread_pool(options.threads)?;
    let results = pool.install(|| prepared.results(options.json))?;
    let mut object = prepared.to_json(&results);
    if !options.json {
        say!(
            "{}",
            ages::table(
                &results,
                &prepared.description(),
                prepared.simulation().bound_age_ms()
            )
        );
    }
    if let Some(network) = network {
        let comparison = pool.install(|| compare(&prepared.simulation(), &network, &table))?;
        let age_lost_ms = comparison.quantised_age_ms - comparison.float_age_ms;
        object["float_mean_age_ms"] = json!(comparison.float_age_ms);
        object["age_lost_ms"] = json!(age_lost_ms);
        object["agreement"] = json!(comparison.agreement);
        if !options.json {
            say!(
                "Float network: {:.3} ms; int8 loses {age_lost_ms:.3} ms; {:.3} % of decisions agree.",
                comparison.float_age_ms,
                100.0 * comparison.agreement
            );
        }
    }
    if options.json {
        say!("{object}");
    }
    Ok(())
}

/// Reads a run's network and checks that the table is one of its kind.
fn read_network(folder: &RunFolder, table: &Table<'_>) -> Result<Network> {
    let network = folder.read_network()?;
    let layers = table.hidden_layers().iter().chain([table.output_layer()]);
    let first = table
        .hidden_layers()
        .first()
        .unwrap_or(table.output_layer())
        .inputs_len();
    let expected: Vec<usize> = [first]
        .into_iter()
        .chain(layers.map(|layer| layer.outputs_len()))
        .collect();
    if network.widths() == expected {
        return Ok(network);
    }
    let found = format!("widths {:?}", network.widths());
    Err(Error::input(
        folder.network().display(),
        found,
        format!("{expected:?} as in the table"),
    ))
}
