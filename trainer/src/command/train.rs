//! `trainer train`: runs a learning algorithm, saves it as it goes, and goes on with it after an interruption.

use crate::actor_file;
use crate::actor_table::{actor_tables, check_widths};
use crate::configuration::{ConfigurationSource, Preset};
use crate::laboratory::checkpoint;
use crate::laboratory::learner::{Learner, Metrics, name};
use crate::laboratory::metrics_log::MetricsLog;
use crate::onnx;
use crate::run_folder::{RunFolder, RunIdentity};
use host_sim::command::options::{choice, progress_bar};
use host_sim::thread_pool;
use host_sim::weight_table::WeightTable;
use indicatif::ProgressBar;
use kit::error::{Error, Result};
use kit::files::write_whole;
use kit::say;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
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

/// How a run is carried out; none of it changes the result.
#[derive(Clone, Copy, Debug)]
pub struct Conduct {
    /// Go on with the run in the folder, if it has begun.
    pub resume: bool,
    /// Least time between two checkpoints.
    pub checkpoint_every: Duration,
    /// Say nothing.
    pub quiet: bool,
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
        resume: arguments.resume,
        checkpoint_every: Duration::from_secs(arguments.checkpoint_every),
        quiet: arguments.json,
    };
    let pool = thread_pool(arguments.threads)?;
    let report = pool.install(|| train(&identity, &arguments.out, &conduct))?;
    if arguments.json {
        say!("{report}");
    } else {
        say!(
            "{} episodes of {}, seed {}. Last: {}.\nWritten to {}.",
            report["episodes"],
            identity.configuration.algorithm.name(),
            identity.seed,
            brief(&|name| report["last"][name].as_f64()),
            arguments.out.display()
        );
        if let Some(obstacle) = report["no_table_because"].as_str() {
            say!("No weight table: {obstacle}.");
        }
    }
    Ok(())
}

/// Trains in a folder, on the current rayon pool, and gives the report that is also written there.
///
/// # Errors
/// As [`run`].
pub fn train(identity: &RunIdentity, out: &Path, conduct: &Conduct) -> Result<Value> {
    let mut learner = identity.configuration.learner(identity.seed)?;
    let folder = RunFolder::new(out);
    let _claim = folder.claim(identity, conduct.resume)?;
    let run = identity.to_json();
    restore(learner.as_mut(), &folder, &run, conduct)?;
    let (length, before) = (learner.length(), learner.done());
    let mut log = MetricsLog::open(&folder.metrics(), &folder.events(), before)?;
    let progress = Progress::new(length, before, conduct.quiet);
    let mut checkpointed = Instant::now();
    let mut saved = before;
    while learner.done() < length {
        let metrics = learner.advance();
        log.push(&metrics)?;
        progress.episode(learner.done(), &metrics);
        if checkpointed.elapsed() >= conduct.checkpoint_every || learner.done() == length {
            save(learner.as_ref(), &folder, &run, &mut log)?;
            saved = learner.done();
            checkpointed = Instant::now();
        }
    }
    progress.finish();
    if saved < length {
        let found = format!("{saved} episodes");
        return Err(Error::input(folder.checkpoint().display(), found, length));
    }
    conclude(learner.as_ref(), identity, &folder, &log)
}

/// Goes back to the folder's checkpoint, if there is one.
fn restore(learner: &mut dyn Learner, folder: &RunFolder, run: &Value, conduct: &Conduct) -> Result<()> {
    let path = folder.checkpoint();
    if !path.exists() {
        if conduct.resume && !conduct.quiet {
            eprintln!("{}: no checkpoint, the run begins anew", path.display());
        }
        return Ok(());
    }
    let place = path.display().to_string();
    let bytes = std::fs::read(&path).map_err(|source| Error::file(&path, source))?;
    let state = checkpoint::from_bytes(&place, &bytes, run)?;
    learner.restore(state).map_err(|error| error.within(place))
}

/// Metrics first: a checkpoint never knows of an episode that they lack. A learner that holds anything but numbers ends the run, and
/// leaves the last checkpoint that was sound.
fn save(learner: &dyn Learner, folder: &RunFolder, run: &Value, log: &mut MetricsLog) -> Result<()> {
    log.flush()?;
    let state = learner.state();
    state
        .check_finite()
        .map_err(|error| error.within(format!("after episode {}", learner.done())))?;
    let bytes = checkpoint::to_bytes(run, &state)?;
    write_whole(&folder.checkpoint(), &bytes)?;
    write_whole(&folder.actors(), &actor_file::to_bytes(&learner.actors())?)
}

/// Writes what a finished run leaves behind.
fn conclude(
    learner: &dyn Learner,
    identity: &RunIdentity,
    folder: &RunFolder,
    log: &MetricsLog,
) -> Result<Value> {
    log.write_parquet(&folder.parquet())?;
    let actors = learner.actors();
    actors.check()?;
    if actors.shared() {
        let model = onnx::model(&actors.networks[0], actors.form.output);
        write_whole(&folder.onnx(), &model)?;
    }
    // An actor may not fit a table; that is a finding, not a failure of the training.
    let made = if actors.shared() {
        actor_tables(identity, &actors, 0..1).map(|tables| tables.into_iter().next())
    } else {
        check_widths(&actors).map(|()| None)
    };
    let (table, obstacle) = match made {
        Ok(Some(table)) => (Some(table), None),
        Ok(None) => (
            None,
            Some("one actor for each vehicle; export --vehicle makes its table".to_owned()),
        ),
        Err(error) => (None, Some(error.to_string())),
    };
    let report = json!({
        "algorithm": identity.configuration.algorithm.name(),
        "seed": identity.seed,
        "episodes": learner.done(),
        "form": actors.form,
        "widths": actors.networks[0].widths(),
        "networks": actors.networks.len(),
        "table_bytes": table.as_ref().map(|table| table.bytes().len()),
        "no_table_because": obstacle,
        "last": log.last().collect::<serde_json::Map<_, _>>(),
    });
    folder.write(&actors, table.as_ref().map(WeightTable::bytes), &report)?;
    Ok(report)
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
struct Progress {
    bar: ProgressBar,
    quiet: bool,
    length: u64,
    before: u64,
    start: Instant,
    said: std::cell::Cell<Instant>,
}

impl Progress {
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
            said: std::cell::Cell::new(Instant::now()),
        }
    }

    fn episode(&self, done: u64, metrics: &Metrics) {
        let text = brief(&|name| metrics.get(name));
        self.bar.set_position(done);
        self.bar.set_message(text.clone());
        if self.quiet || self.said.get().elapsed() < LINE_EVERY {
            return;
        }
        self.said.set(Instant::now());
        let rate = (done - self.before) as f64 / self.start.elapsed().as_secs_f64();
        let left_s = (self.length - done) as f64 / rate;
        let length = self.length;
        self.bar.suspend(|| {
            eprintln!("episode {done}/{length}: {text}; {rate:.2} episodes/s, {left_s:.0} s left");
        });
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::actors::Actors;
    use crate::laboratory::state::{State, Values};

    /// Another learner, with one value that is no number.
    struct Diverged(Box<dyn Learner>);

    impl Learner for Diverged {
        fn length(&self) -> u64 {
            self.0.length()
        }

        fn done(&self) -> u64 {
            self.0.done()
        }

        fn advance(&mut self) -> Metrics {
            self.0.advance()
        }

        fn state(&self) -> State {
            let mut state = self.0.state();
            let mut tensors = state.tensors.values_mut();
            let first = tensors.find_map(|tensor| match &mut tensor.values {
                Values::F32(values) => values.first_mut(),
                _ => None,
            });
            *first.unwrap() = f32::NAN;
            state
        }

        fn restore(&mut self, state: State) -> Result<()> {
            self.0.restore(state)
        }

        fn actors(&self) -> Actors {
            self.0.actors()
        }
    }

    #[test]
    fn what_diverged_does_not_replace_what_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let mut learner = Preset::Evolution.with(&[]).unwrap().learner(1).unwrap();
        let mut log = MetricsLog::open(&run.metrics(), &run.events(), 0).unwrap();
        save(learner.as_ref(), &run, &Value::Null, &mut log).unwrap();
        let saved = || [run.checkpoint(), run.actors()].map(|path| std::fs::read(path).unwrap());
        let before = saved();
        let _metrics = learner.advance();
        let failure = save(&Diverged(learner), &run, &Value::Null, &mut log).unwrap_err();
        assert_eq!(
            failure.to_string(),
            "after episode 1: deviation: found NaN, expected finite numbers"
        );
        assert_eq!(saved(), before);
    }
}
