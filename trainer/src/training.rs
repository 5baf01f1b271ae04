//! A training run in its folder: episode after episode, with metrics, checkpoints and, at the end, everything that a run leaves.

use crate::actor_file;
use crate::actor_table::{actor_tables, check_widths};
use crate::laboratory::checkpoint::{self, Checksums};
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::metrics_log::MetricsLog;
use crate::laboratory::state::{State, Values};
use crate::onnx;
use crate::run_folder::{Checkpoint, GoOn, RunFolder, RunIdentity};
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};
use kit::files::write_whole;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// How a run is carried out; none of it changes the result.
#[derive(Clone, Copy, Debug)]
pub struct Conduct {
    /// Which run in the folder to go on with.
    pub go_on: GoOn,
    /// Least time between two checkpoints.
    pub checkpoint_every: Duration,
}

/// What happens on the way, for who looks on.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'m> {
    /// The run begins, or goes on after `done` of `length` episodes.
    Begun {
        /// Episodes of the whole run.
        length: u64,
        /// Episodes done before.
        done: u64,
        /// Bytes of a checkpoint.
        checkpoint_bytes: u64,
        /// Bytes of its parts at most, before they are packed; each is written once.
        parts_bytes: u64,
    },
    /// A run that was to go on has no checkpoint, and begins anew.
    NoCheckpoint,
    /// The newest checkpoint is not whole; the run goes on from the one before.
    Damaged(&'m Error),
    /// An episode ended.
    Episode {
        /// Episodes done.
        done: u64,
        /// Its metrics.
        metrics: &'m Metrics,
    },
}

/// Trains in a folder, on the current rayon pool, and gives the report that is also written there. `watch` is told how it goes.
///
/// # Errors
/// What is wrong with the configuration or the folder, a learner that diverges, and what cannot be written.
pub fn train(
    identity: &RunIdentity,
    out: &Path,
    conduct: &Conduct,
    mut watch: impl FnMut(&Progress<'_>),
) -> Result<Value> {
    let mut learner = identity.configuration.learner(identity.seed)?;
    let folder = RunFolder::new(out);
    let (_claim, identity) = folder.claim(identity, conduct.go_on)?;
    let (run, stages) = (identity.to_json(), identity.stages());
    let found = folder.newest_checkpoint(|place, bytes| {
        checkpoint::from_bytes(place, bytes, &stages, |name| folder.read_part(name))
    })?;
    if let Some(damage) = found.as_ref().and_then(|found| found.damage.as_ref()) {
        watch(&Progress::Damaged(damage));
        folder.return_to_previous_checkpoint()?;
    }
    let mut saver = Saver::new(&folder, run);
    let mut log = match found {
        Some(Checkpoint {
            place, state, parts, ..
        }) => {
            saver.parts = parts;
            restore(learner.as_mut(), &folder, &place, state, identity.told())?
        }
        None => {
            if conduct.go_on != GoOn::No {
                watch(&Progress::NoCheckpoint);
            }
            MetricsLog::new(&folder.metrics(), &folder.events(), identity.told())?
        }
    };
    let (length, before) = (learner.length(), learner.done());
    if before < length {
        folder.forget_results()?;
    }
    watch(&Progress::Begun {
        length,
        done: before,
        checkpoint_bytes: learner.state().tensors_bytes(),
        parts_bytes: learner.parts_bytes(),
    });
    let mut checkpointed = Instant::now();
    let mut saved = before;
    while learner.done() < length {
        let metrics = learner.advance();
        log.push(&metrics)?;
        watch(&Progress::Episode {
            done: learner.done(),
            metrics: &metrics,
        });
        if checkpointed.elapsed() >= conduct.checkpoint_every || learner.done() == length {
            saver.save(learner.as_ref(), &mut log)?;
            saved = learner.done();
            checkpointed = Instant::now();
        }
    }
    if saved < length {
        let found = format!("{saved} episodes");
        return Err(Error::input(folder.checkpoint().display(), found, length));
    }
    let report = conclude(learner.as_ref(), &identity, &folder, &log)?;
    saver.conclude()?;
    Ok(report)
}

/// The tensor of a checkpoint that holds the text of the log.
const LOG: &str = "log";

/// Goes back to a checkpoint, and gives its log.
fn restore(
    learner: &mut dyn Learner,
    folder: &RunFolder,
    place: &str,
    mut state: State,
    told: BTreeMap<String, Value>,
) -> Result<MetricsLog> {
    let text = match state.tensors.remove(LOG).map(|tensor| tensor.values) {
        Some(Values::U8(bytes)) => String::from_utf8(bytes).ok(),
        _ => None,
    };
    let text = text.ok_or_else(|| Error::input(place, "no metrics", "those of all episodes"))?;
    learner.restore(state).map_err(|error| error.within(place))?;
    MetricsLog::resume(place, &text, &folder.metrics(), &folder.events(), told)
}

/// Writes checkpoints, each part of a state once.
struct Saver<'f> {
    folder: &'f RunFolder,
    run: Value,
    /// The parts of the last checkpoint.
    parts: Checksums,
    /// Those of the one before.
    parts_before: Checksums,
}

impl<'f> Saver<'f> {
    /// One that knows of no checkpoint.
    fn new(folder: &'f RunFolder, run: Value) -> Self {
        Self {
            folder,
            run,
            parts: Checksums::new(),
            parts_before: Checksums::new(),
        }
    }

    /// Writes a checkpoint; the one before stays beside it. A learner that holds anything but numbers ends the run, and leaves the last
    /// checkpoint that was sound.
    fn save(&mut self, learner: &dyn Learner, log: &mut MetricsLog) -> Result<()> {
        log.flush()?;
        let mut state = learner.state();
        state
            .check_finite()
            .map_err(|error| error.within(format!("after episode {}", learner.done())))?;
        let text = log.text().into_bytes();
        state.put(LOG, &[text.len()], text);
        let parts = std::mem::take(&mut state.parts)
            .into_par_iter()
            .map(|(name, part)| {
                if let Some(&checksum) = self.parts.get(&name) {
                    return Ok((name, checksum));
                }
                let (checksum, bytes) = checkpoint::part_to_bytes(&part)?;
                self.folder.keep_part(&name, &bytes)?;
                Ok((name, checksum))
            })
            .collect::<Result<Checksums>>()?;
        let bytes = checkpoint::to_bytes(&self.run, &state, &parts)?;
        self.folder.keep_checkpoint(&bytes)?;
        self.parts_before = std::mem::replace(&mut self.parts, parts);
        self.folder.forget_parts_but(&[&self.parts, &self.parts_before])?;
        write_whole(&self.folder.actors(), &actor_file::to_bytes(&learner.actors())?)
    }

    /// Leaves the last checkpoint alone.
    fn conclude(self) -> Result<()> {
        self.folder.forget_previous_checkpoint()?;
        self.folder.forget_parts_but(&[&self.parts])
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::Preset;
    use crate::laboratory::actors::Actors;

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
        let mut log = MetricsLog::new(&run.metrics(), &run.events(), BTreeMap::new()).unwrap();
        let mut saver = Saver::new(&run, Value::Null);
        saver.save(learner.as_ref(), &mut log).unwrap();
        let saved = || [run.checkpoint(), run.actors()].map(|path| std::fs::read(path).unwrap());
        let before = saved();
        let _metrics = learner.advance();
        let failure = saver.save(&Diverged(learner), &mut log).unwrap_err();
        assert_eq!(
            failure.to_string(),
            "after episode 1: deviation: found NaN, expected finite numbers"
        );
        assert_eq!(saved(), before);
    }
}
