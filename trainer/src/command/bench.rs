//! `trainer bench`: how fast the paper's algorithm learns at the paper's sizes.

use crate::configuration::{Algorithm, ConfigurationSource, Preset};
use crate::laboratory::learner::Learner as _;
use crate::maddpg::in_cell::MaddpgInCell;
use crate::maddpg::options::Backend;
use host_sim::command::options::choice;
use host_sim::thread_pool;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::{say, tell};
use serde_json::json;
use std::time::{Duration, Instant};

/// Options of `bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct BenchArguments {
    /// Episodes of 100 slots and updates to time, after one that is not timed
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub episodes: u32,
    /// What finds the gradients
    #[arg(long, value_parser = choice::<Backend>(), default_value = Backend::default().name())]
    pub backend: Backend,
    /// Time networks of which no unit is ever silent, and which therefore do not learn
    #[arg(long)]
    pub dense: bool,
    /// Seed of the networks and worlds
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
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
/// Threads that cannot be started.
pub fn run(arguments: &BenchArguments) -> Result<()> {
    let pool = thread_pool(arguments.threads)?;
    let backend = arguments.backend.name();
    // The schedule of preset `companion`, with a replay that holds what is played here.
    let mut settings = vec![
        "maddpg.replay=10000".to_owned(),
        format!("maddpg.backend={backend}"),
    ];
    if arguments.dense {
        // So that it stays so.
        let rates = [
            "actor_learning_rate",
            "critic_learning_rate",
            "last_actor_learning_rate",
            "last_critic_learning_rate",
        ];
        settings.extend(rates.map(|rate| format!("maddpg.{rate}=0")));
    }
    let source = ConfigurationSource {
        preset: Preset::Companion,
        file: None,
        settings,
    };
    let configuration = source.read()?;
    let Algorithm::Maddpg(options) = &configuration.algorithm else {
        return Err(Error::input("preset", configuration.algorithm.name(), "maddpg"));
    };
    let vehicles = configuration.scenario.cell.vehicles;
    let mut learner = MaddpgInCell::new(&configuration.scenario, options, arguments.seed);
    if arguments.dense {
        learner.learner.wake();
    }
    let (total, times, updates) = pool.install(|| {
        let _untimed = learner.advance();
        let (before, first) = (learner.learner.times(), learner.learner.updates());
        let start = Instant::now();
        for _ in 0..arguments.episodes {
            let _metrics = learner.advance();
        }
        let spent = learner.learner.times();
        let times = [
            spent.learning - before.learning,
            spent.environment - before.environment,
        ];
        (start.elapsed(), times, learner.learner.updates() - first)
    });
    let [learning, environment] = times.map(|time: Duration| time.as_secs_f64());
    let updates_per_second = updates as f64 / learning;
    let slots_per_second = f64::from(arguments.episodes * options.slots) / total.as_secs_f64();
    let environment_share = environment / total.as_secs_f64();
    if arguments.json {
        say!(
            "{}",
            json!({
                "updates_per_second": updates_per_second,
                "backend": backend,
                "dense": arguments.dense,
                "environment_share": environment_share,
                "slots_per_second": slots_per_second,
                "vehicles": vehicles,
                "batch": options.batch,
                "delay": options.delay,
                "updates": updates,
                "threads": pool.current_num_threads(),
            })
        );
    } else {
        tell!(
            "The paper's MADDPG{}, backend {backend}, {vehicles} vehicles, batch {}, delay {}, {} threads: {updates_per_second:.2} updates/s.\n\
             With one slot and one update after the other: {slots_per_second:.2} slots/s, of which the environment takes {:.2} %.",
            if arguments.dense {
                " without silent units"
            } else {
                ""
            },
            options.batch,
            options.delay,
            pool.current_num_threads(),
            100.0 * environment_share,
        );
    }
    Ok(())
}
