//! `trainer train`: runs a learning algorithm, saves it as it goes, and goes on with it after an interruption.

use crate::configuration::{ConfigurationSource, Preset};
use crate::laboratory::learner::{Metrics, name};
use crate::run_folder::{GoOn, RunFolder, RunIdentity};
use crate::training::{Conduct, Progress, train};
use host_sim::command::options::{choice, progress_bar};
use host_sim::thread_pool;
use indicatif::ProgressBar;
use kit::error::Result;
use kit::{say, tell};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between two lines on how it goes (chosen).
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Options of `train`.
#[derive(Clone, Debug, clap::Args)]
pub struct TrainArguments {
    /// Configuration to start from
    #[arg(long, value_parser = choice::<Preset>())]
    pub preset: Preset,
    /// TOML file whose keys replace the preset's
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Replace one key, such as scenario.cell.vehicles=5 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder of the run
    #[arg(long, value_name = "DIR", default_value = "out/train")]
    pub out: PathBuf,
    /// Go on with the run in the folder, if it has begun
    #[arg(long)]
    pub resume: bool,
    /// Go on with the run in the folder although it was done after fewer episodes; schedules stretch over the new length. If it is
    /// interrupted, --extend again goes on
    #[arg(long, conflicts_with = "resume")]
    pub extend: bool,
    /// Seconds between two checkpoints; with 0, one after each episode
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    pub checkpoint_every: u64,
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
/// What is wrong with the configuration or the folder, and what cannot be written.
pub fn run(arguments: &TrainArguments) -> Result<()> {
    let source = ConfigurationSource {
        preset: arguments.preset,
        file: arguments.config.clone(),
        settings: arguments.set.clone(),
    };
    let identity = RunIdentity::new(arguments.seed, source.read()?);
    let conduct = Conduct {
        go_on: match (arguments.resume, arguments.extend) {
            (_, true) => GoOn::Longer,
            (true, false) => GoOn::Same,
            (false, false) => GoOn::No,
        },
        checkpoint_every: Duration::from_secs(arguments.checkpoint_every),
    };
    let quiet = arguments.json;
    let mut display: Option<Display> = None;
    let watch = |progress: &Progress<'_>| match *progress {
        Progress::Begun {
            length,
            done,
            checkpoint_bytes,
            parts_bytes,
        } => {
            if !quiet {
                kit::remark!("{}", size(arguments, checkpoint_bytes, parts_bytes));
            }
            display = Some(Display::new(length, done, quiet));
        }
        Progress::Damaged(error) => kit::remark!("{error}; the run goes on from the checkpoint before"),
        Progress::NoCheckpoint if quiet => {}
        Progress::NoCheckpoint => {
            let path = RunFolder::new(&arguments.out).checkpoint();
            kit::remark!("{}: no checkpoint, the run begins anew", path.display());
        }
        Progress::Episode { done, metrics } => {
            if let Some(display) = &mut display {
                display.episode(done, metrics);
            }
        }
    };
    let pool = thread_pool(arguments.threads)?;
    let report = pool.install(|| train(&identity, &arguments.out, &conduct, watch));
    drop(display);
    let report = report?;
    if arguments.json {
        say!("{report}");
    } else {
        tell!(
            "{} episodes of {}, seed {}. Last: {}.\nWritten to {}.",
            report["episodes"],
            identity.configuration.algorithm.name(),
            identity.seed,
            brief(&|name| report["last"][name].as_f64()),
            arguments.out.display()
        );
        if let Some(obstacle) = report["no_table_because"].as_str() {
            tell!("No weight table: {obstacle}.");
        }
    }
    Ok(())
}

/// What checkpoints take of the disk, before it is taken.
fn size(arguments: &TrainArguments, checkpoint_bytes: u64, parts_bytes: u64) -> String {
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    let mut text = format!(
        "checkpoint every {} s: {}, twice while the run is at work",
        arguments.checkpoint_every,
        megabytes(checkpoint_bytes)
    );
    if parts_bytes > 0 {
        text += &format!(
            "; beside it up to {} of replay, packed, each episode once",
            megabytes(parts_bytes)
        );
    }
    text
}

/// The metrics that every algorithm has, for a line.
fn brief(metric: &dyn Fn(&str) -> Option<f64>) -> String {
    let part =
        |label: &str, name: &str, unit: &str| metric(name).map(|value| format!("{label} {value:.3}{unit}"));
    let parts = [
        part("reward", name::REWARD, ""),
        part("age", name::AGE, " ms"),
        part("successes", name::SUCCESSES, " a slot"),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// The bar, and a line every so often that stays on the screen or in a file.
struct Display {
    bar: ProgressBar,
    quiet: bool,
    length: u64,
    before: u64,
    start: Instant,
    said: Instant,
}

impl Display {
    fn new(length: u64, before: u64, quiet: bool) -> Self {
        let template = "{bar:30} episode {pos}/{len}, {per_sec}, {eta} left, {msg}";
        let bar = progress_bar(length, template, quiet).with_position(before);
        bar.reset_eta();
        Self {
            bar,
            quiet,
            length,
            before,
            start: Instant::now(),
            said: Instant::now(),
        }
    }

    fn episode(&mut self, done: u64, metrics: &Metrics) {
        let text = brief(&|name| metrics.get(name));
        self.bar.set_position(done);
        self.bar.set_message(text.clone());
        if self.quiet || self.said.elapsed() < LINE_EVERY {
            return;
        }
        self.said = Instant::now();
        let rate = (done - self.before) as f64 / self.start.elapsed().as_secs_f64();
        let left_s = (self.length - done) as f64 / rate;
        let length = self.length;
        self.bar.suspend(|| {
            kit::remark!("episode {done}/{length}: {text}; {rate:.2} episodes/s, {left_s:.0} s left");
        });
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
