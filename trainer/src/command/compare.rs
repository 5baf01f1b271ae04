//! `trainer compare`: whether a table beats other policies. On the same worlds the luck of places and fading cancels out, so
//! that differences show which two separate means would hide.

use crate::run_folder::RunFolder;
use host_sim::age::AgeSummary;
use host_sim::command::run::{self, RunOptions, results_with_progress};
use host_sim::policy::{actor, clock};
use host_sim::thread_pool;
use kit::error::{Error, Result};
use kit::{say, tell};
use serde_json::json;
use std::path::PathBuf;

/// Options of `compare`.
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("policy", |policy| policy.help("Policy to compare the table with (repeatable) [default: clock]")))]
pub struct CompareArguments {
    /// Folder of a training run whose table to judge
    #[arg(long, value_name = "DIR", conflicts_with = "table")]
    pub run: Option<PathBuf>,
    /// Worlds, output, and the policies to compare the table with [default: clock].
    #[command(flatten)]
    pub options: RunOptions,
}

/// How much older or younger one policy's ages are than another's, over the same worlds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Mean over worlds.
    pub mean_ms: f64,
    /// Half the width of its 95 % interval; `None` for a single world.
    pub ci95_ms: Option<f64>,
}

/// The ages of `judged` less those of `reference`, world by world.
///
/// # Errors
/// If they are not of the same number of worlds.
pub fn difference(judged: &AgeSummary, reference: &AgeSummary) -> Result<Difference> {
    let (found, expected) = (judged.by_world_ms.len(), reference.by_world_ms.len());
    if found != expected {
        return Err(Error::input(
            "worlds with vehicles",
            found,
            format!("{expected} as in the other run"),
        ));
    }
    let pairs = judged.by_world_ms.iter().zip(&reference.by_world_ms);
    let differences: Vec<f64> = pairs.map(|(judged, reference)| judged - reference).collect();
    let (mean_ms, ci95_ms) = AgeSummary::mean_and_interval(&differences);
    Ok(Difference { mean_ms, ci95_ms })
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &CompareArguments) -> Result<()> {
    let mut options = arguments.options.clone();
    if let Some(folder) = &arguments.run {
        let folder = RunFolder::new(folder);
        if folder.actors().exists() && !folder.table().exists() {
            let expected = "a run whose vehicles share one network, or --table with one that export made";
            return Err(Error::input("--run", "a run that left no table", expected));
        }
        options.table = Some(folder.table());
    }
    if options.policy.contains(&&actor::KIND) {
        return Err(Error::input("--policy", "actor", "others to compare it with"));
    }
    if options.policy.is_empty() {
        options.policy.push(&clock::KIND);
    }
    options.policy.push(&actor::KIND);
    options.check_typed()?;
    let experiment = options.source().read()?;
    let pool = thread_pool(options.threads)?;
    let results = pool.install(|| results_with_progress(&experiment, options.json))?;
    let mut object = run::json(&experiment, &results, options.timing);
    // The actor comes first in any list of policies.
    let [actor, others @ ..] = results.as_slice() else {
        return Err(Error::input("policies", "none", "at least one besides the actor"));
    };
    let mut differences = Vec::new();
    for other in others {
        let Difference { mean_ms, ci95_ms } = difference(&actor.ages, &other.ages)?;
        differences.push(json!({
            "policy": other.name,
            "difference_ms": mean_ms,
            "difference_ci95_ms": ci95_ms,
            "ratio": actor.ages.mean_ms / other.ages.mean_ms,
        }));
        if !options.json {
            let interval = ci95_ms.map_or_else(String::new, |half| format!(" +- {half:.4}"));
            tell!(
                "actor {:.4} ms, {} {:.4} ms: difference {mean_ms:+.4}{interval} ms, ratio {:.4}",
                actor.ages.mean_ms,
                other.name,
                other.ages.mean_ms,
                actor.ages.mean_ms / other.ages.mean_ms
            );
        }
    }
    object["differences"] = json!(differences);
    if options.json {
        say!("{object}");
    }
    Ok(())
}
