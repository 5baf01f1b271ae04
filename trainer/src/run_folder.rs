//! The folder of a training run: the files in it, and which run it belongs to.

use crate::actor_file;
use crate::configuration::Configuration;
use crate::laboratory::actors::Actors;
use crate::laboratory::checkpoint::{Checksums, first_difference};
use crate::laboratory::state::State;
use kit::error::{Error, Result};
use kit::files::{check_folder, remove, write_whole};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Names of the files in a run folder.
#[derive(Clone, Debug)]
pub struct RunFolder(PathBuf);

/// A state that was read from a folder.
#[derive(Debug)]
pub struct Checkpoint {
    /// Its file.
    pub place: String,
    /// The state.
    pub state: State,
    /// Checksums of its parts.
    pub parts: Checksums,
    /// Why it is not the newest, if it is not.
    pub damage: Option<Error>,
}

/// What a run was told: with the same version of the program, all that its result depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunIdentity {
    /// Version of the program.
    pub version: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Scenario and algorithm.
    pub configuration: Configuration,
    /// Which losses, where users write them: see [`crate::maddpg::options::Maddpg::losses_checksum`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub losses: Option<String>,
    /// Episodes at which it was done and told to go on for more, the first first. What schedules there are then stretched over the new
    /// length, so that this is another run than one that was told its last length at once.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_before: Vec<u64>,
}

/// Which run may be in a folder already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GoOn {
    /// None.
    No,
    /// This one, as far as it came.
    Same,
    /// This one, or this one with fewer episodes, which are done.
    Longer,
}

impl RunIdentity {
    /// A run of this program.
    pub fn new(seed: u64, configuration: Configuration) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed,
            losses: configuration.algorithm.options().losses_checksum(),
            configuration,
            lengths_before: Vec::new(),
        }
    }

    /// Episodes of the run.
    fn episodes(&self) -> u64 {
        *self.configuration.algorithm.clone().options_mut().episodes_mut()
    }

    /// The same run with so many episodes, after these.
    fn of_length(&self, episodes: u64, lengths_before: &[u64]) -> Self {
        let mut other = self.clone();
        *other.configuration.algorithm.options_mut().episodes_mut() = episodes;
        other.lengths_before = lengths_before.to_vec();
        other
    }

    /// What the run has been, as JSON: at each of its lengths, the last last. A checkpoint may be of any of them.
    pub fn stages(&self) -> Vec<Value> {
        let lengths = self
            .lengths_before
            .iter()
            .chain([&self.episodes()])
            .copied()
            .collect::<Vec<_>>();
        let stages = lengths.iter().enumerate();
        stages
            .map(|(index, &episodes)| self.of_length(episodes, &lengths[..index]).to_json())
            .collect()
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        serde_json::json!(self)
    }

    /// As the text of its file.
    fn to_text(&self) -> String {
        format!("{:#}\n", self.to_json())
    }

    /// What the run was told, by the names of the keys as settings have them, such as `ppo.clip`, and its seed.
    pub fn told(&self) -> BTreeMap<String, Value> {
        let Configuration {
            scenario,
            mixture,
            reward,
            algorithm,
        } = &self.configuration;
        let mut told = BTreeMap::from([("seed".to_owned(), self.seed.into())]);
        if let Some(reward) = reward {
            let _new = told.insert("reward".to_owned(), serde_json::json!(reward));
        }
        name_keys("scenario", &serde_json::json!(scenario), &mut told);
        if !mixture.is_empty() {
            name_keys("mixture", &serde_json::json!(mixture), &mut told);
        }
        for (section, values) in serde_json::json!(algorithm).as_object().into_iter().flatten() {
            name_keys(section, values, &mut told);
        }
        told
    }
}

/// The values of a section by their dotted names.
fn name_keys(name: &str, value: &Value, keys: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(section) => {
            for (key, value) in section {
                name_keys(&format!("{name}.{key}"), value, keys);
            }
        }
        other => drop(keys.insert(name.to_owned(), other.clone())),
    }
}

impl RunFolder {
    /// The folder at this path.
    pub fn new(path: &Path) -> Self {
        Self(path.to_owned())
    }

    /// What the run was told; only `train` writes it.
    pub fn identity(&self) -> PathBuf {
        self.0.join("run.json")
    }

    /// The learner's state.
    pub fn checkpoint(&self) -> PathBuf {
        self.0.join("checkpoint.safetensors")
    }

    /// The state before, while the run is at work.
    fn previous_checkpoint(&self) -> PathBuf {
        self.0.join("checkpoint.previous.safetensors")
    }

    /// The parts of the states, a file each.
    fn parts(&self) -> PathBuf {
        self.0.join("replay")
    }

    /// A part's file.
    fn part(&self, name: &str) -> PathBuf {
        self.parts().join(format!("{name}.safetensors.gz"))
    }

    /// Metrics of every episode.
    pub fn metrics(&self) -> PathBuf {
        self.0.join("metrics.csv")
    }

    /// The same for other programs.
    pub fn parquet(&self) -> PathBuf {
        self.0.join("metrics.parquet")
    }

    /// The same for TensorBoard, which goes by the name.
    pub fn events(&self) -> PathBuf {
        self.0.join("events.out.tfevents.0.freshlane")
    }

    /// The float networks.
    pub fn actors(&self) -> PathBuf {
        self.0.join(actor_file::NAME)
    }

    /// The networks as a model, if all vehicles share one.
    pub fn onnx(&self) -> PathBuf {
        self.0.join("actor.onnx")
    }

    /// The weight table.
    pub fn table(&self) -> PathBuf {
        self.0.join("table.bin")
    }

    /// All files that cannot be made again from others of the folder.
    pub fn records(&self) -> [PathBuf; 9] {
        [
            self.identity(),
            self.checkpoint(),
            self.previous_checkpoint(),
            self.metrics(),
            self.parquet(),
            self.events(),
            self.actors(),
            self.table(),
            self.report(),
        ]
    }

    /// What was run and what came out. Written last.
    pub fn report(&self) -> PathBuf {
        self.0.join("report.json")
    }

    /// The newest checkpoint that `read` takes, given its place and bytes.
    ///
    /// # Errors
    /// If there are checkpoints, and none can be read: what is wrong with the newest.
    pub fn newest_checkpoint(
        &self,
        read: impl Fn(&str, &[u8]) -> Result<(State, Checksums)>,
    ) -> Result<Option<Checkpoint>> {
        let mut damage = None;
        for path in [self.checkpoint(), self.previous_checkpoint()] {
            let place = path.display().to_string();
            let state = match std::fs::read(&path) {
                Ok(bytes) => read(&place, &bytes),
                Err(source) if source.kind() == ErrorKind::NotFound => continue,
                Err(source) => Err(Error::file(&path, source)),
            };
            match (state, &damage) {
                (Ok((state, parts)), _) => {
                    return Ok(Some(Checkpoint {
                        place,
                        state,
                        parts,
                        damage,
                    }));
                }
                (Err(error), None) => damage = Some(error),
                (Err(_), Some(_)) => {}
            }
        }
        damage.map_or(Ok(None), Err)
    }

    /// The place and the bytes of a part's file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read_part(&self, name: &str) -> Result<(String, Vec<u8>)> {
        let path = self.part(name);
        let bytes = std::fs::read(&path).map_err(|source| Error::file(&path, source))?;
        Ok((path.display().to_string(), bytes))
    }

    /// Writes a part's file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep_part(&self, name: &str, bytes: &[u8]) -> Result<()> {
        write_whole(&self.part(name), bytes)
    }

    /// Removes all files of parts but those of these names.
    ///
    /// # Errors
    /// If one cannot be removed.
    pub fn forget_parts_but(&self, names: &[&Checksums]) -> Result<()> {
        let kept: BTreeSet<PathBuf> = names
            .iter()
            .flat_map(|names| names.keys().map(|name| self.part(name)))
            .collect();
        let files = std::fs::read_dir(self.parts()).into_iter().flatten().flatten();
        files
            .map(|file| file.path())
            .filter(|path| !kept.contains(path))
            .try_for_each(|path| remove(&path))
    }

    /// Writes a checkpoint, and keeps the one before.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn keep_checkpoint(&self, bytes: &[u8]) -> Result<()> {
        let (path, previous) = (self.checkpoint(), self.previous_checkpoint());
        if path.exists() {
            std::fs::rename(&path, &previous).map_err(|source| Error::file(&previous, source))?;
        }
        write_whole(&path, bytes)
    }

    /// Puts the checkpoint before in the place of the last, which is damaged.
    ///
    /// # Errors
    /// If it cannot be renamed.
    pub fn return_to_previous_checkpoint(&self) -> Result<()> {
        let path = self.checkpoint();
        std::fs::rename(self.previous_checkpoint(), &path).map_err(|source| Error::file(&path, source))
    }

    /// Removes the checkpoint before the last, once a run is done.
    ///
    /// # Errors
    /// If it cannot be removed.
    pub fn forget_previous_checkpoint(&self) -> Result<()> {
        remove(&self.previous_checkpoint())
    }

    /// Writes a run's result, each file whole or not at all, the report last.
    ///
    /// # Errors
    /// The file that cannot be written.
    pub fn write(&self, actors: &Actors, table: Option<&[u8]>, report: &Value) -> Result<()> {
        write_whole(&self.actors(), &actor_file::to_bytes(actors)?)?;
        if let Some(table) = table {
            write_whole(&self.table(), table)?;
        }
        write_whole(&self.report(), format!("{report:#}\n").as_bytes())
    }

    /// Checks that this is not the folder of a training run, which other results would mingle with.
    ///
    /// # Errors
    /// If it is.
    pub fn check_no_run(&self) -> Result<()> {
        let identity = self.identity();
        if identity.exists() {
            return Err(Error::input(
                identity.display(),
                "a run of train",
                "another folder",
            ));
        }
        Ok(())
    }

    /// Checks that a result of this task, whose report repeats it, takes no other's place.
    ///
    /// # Errors
    /// If the folder holds a run of `train`, or a result of another task.
    pub fn check_free_for(&self, task: &Value) -> Result<()> {
        self.check_no_run()?;
        let report = self.report();
        if !report.exists() {
            return check_absent(&[self.actors(), self.table()]);
        }
        let mut found = read_json(&report)?;
        if let Value::Object(found) = &mut found {
            found.retain(|key, _| task.get(key).is_some());
        }
        check_same_run(&report, &found, task)
    }

    /// Begins a run, or goes on with one, and keeps other processes out for as long as the returned file is held; gives the run as the
    /// folder has it now.
    ///
    /// # Errors
    /// If the folder holds another run than may be in it, or a process that works on it.
    pub fn claim(&self, asked: &RunIdentity, go_on: GoOn) -> Result<(File, RunIdentity)> {
        check_folder(&self.0)?;
        let path = self.identity();
        let mut identity = asked.clone();
        if path.exists() {
            match read_json(&path) {
                Ok(found) if go_on == GoOn::Longer => identity = self.longer(&found, asked)?,
                Ok(found) => check_same_run(&path, &found, &asked.to_json())?,
                // Every checkpoint says its run too.
                Err(error) => (go_on != GoOn::No).then_some(()).ok_or(error)?,
            }
            if go_on == GoOn::No {
                return Err(Error::input(
                    path.display(),
                    "this run already begun",
                    "--resume to go on with it, or another folder",
                ));
            }
            let _before = lock(&path)?;
            let text = identity.to_text();
            if std::fs::read(&path).map_or(true, |found| found != text.as_bytes()) {
                write_whole(&path, text.as_bytes())?;
            }
        } else {
            check_absent(&[
                self.checkpoint(),
                self.metrics(),
                self.actors(),
                self.table(),
                self.report(),
            ])?;
            write_whole(&path, identity.to_text().as_bytes())?;
        }
        Ok((lock(&path)?, identity))
    }

    /// The run that was found, as long as the one that is asked for.
    fn longer(&self, found: &Value, asked: &RunIdentity) -> Result<RunIdentity> {
        let path = self.identity();
        let of_this_version = serde_json::from_value(found.clone());
        let of_this_version: RunIdentity =
            of_this_version.map_err(|error| Error::input(path.display(), error, "a run of this version"))?;
        let (before, episodes) = (of_this_version.episodes(), asked.episodes());
        let mut lengths_before = of_this_version.lengths_before.clone();
        let same = of_this_version.of_length(episodes, &[]);
        check_same_run(&path, &same.to_json(), &asked.to_json())?;
        if episodes < before || (episodes > before && !self.report().exists()) {
            let found = match self.report().exists() {
                true => format!("{before} episodes"),
                false => format!("{before} episodes that are not done"),
            };
            return Err(Error::input(
                path.display(),
                found,
                format!("at most {episodes} that are done, to go on for more"),
            ));
        }
        if episodes > before {
            lengths_before.push(before);
        }
        Ok(asked.of_length(episodes, &lengths_before))
    }

    /// Removes what a run leaves at its end: one that goes on has not come to it.
    ///
    /// # Errors
    /// The file that cannot be removed.
    pub fn forget_results(&self) -> Result<()> {
        let results = [self.report(), self.table(), self.onnx(), self.parquet()];
        results.iter().try_for_each(|path| remove(path))
    }

    /// What the run was told; `None` if the folder is not that of `train`.
    ///
    /// # Errors
    /// If the file cannot be read, or is of another version of the program.
    pub fn read_identity(&self) -> Result<Option<RunIdentity>> {
        if !self.identity().exists() {
            return Ok(None);
        }
        let identity = serde_json::from_value(read_json(&self.identity())?);
        identity
            .map(Some)
            .map_err(|error| Error::input(self.identity().display(), error, "a run of this version"))
    }

    /// Reads the float networks.
    ///
    /// # Errors
    /// The file and what is wrong with it.
    pub fn read_actors(&self) -> Result<Actors> {
        actor_file::read(&self.actors())
    }
}

/// Keeps other processes away from a run for as long as the file is held.
fn lock(path: &Path) -> Result<File> {
    let file = File::open(path).map_err(|source| Error::file(path, source))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(Error::input(
            path.display(),
            "a process at work on this run",
            "none",
        )),
        Err(std::fs::TryLockError::Error(source)) => Err(Error::file(path, source)),
    }
}

fn read_json(path: &Path) -> Result<Value> {
    let text = std::fs::read(path).map_err(|source| Error::file(path, source))?;
    serde_json::from_slice(&text).map_err(|error| Error::input(path.display(), error, "a run"))
}

fn check_same_run(path: &Path, found: &Value, expected: &Value) -> Result<()> {
    let Some((key, found, expected)) = first_difference(found, expected) else {
        return Ok(());
    };
    Err(Error::input(
        format!("{}: key {key}", path.display()),
        format!("{found}, so another run"),
        format!("{expected}, or another folder"),
    ))
}

fn check_absent(files: &[PathBuf]) -> Result<()> {
    match files.iter().find(|file| file.exists()) {
        None => Ok(()),
        Some(file) => Err(Error::input(
            file.display(),
            "a file of another run",
            "an empty folder",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::{Algorithm, Preset};
    use crate::maddpg::options::Backend;

    /// What users write themselves tells runs apart; to runs of the own kernels it is nothing.
    #[test]
    fn losses_are_part_of_a_run_on_burn() {
        let mut configuration = Preset::Paper.with(&[]).unwrap();
        assert_eq!(RunIdentity::new(1, configuration.clone()).losses, None);
        if let Algorithm::Maddpg(options) = &mut configuration.algorithm {
            options.backend = Backend::Burn;
        }
        assert!(RunIdentity::new(1, configuration).losses.is_some());
    }

    #[test]
    fn a_folder_is_claimed_by_one_run_and_one_process() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let configuration = Preset::Evolution.with(&[]).unwrap();
        let identity = |seed| RunIdentity::new(seed, configuration.clone());
        let message = |seed, go_on| run.claim(&identity(seed), go_on).unwrap_err().to_string();
        let lock = run.claim(&identity(1), GoOn::No).unwrap();
        assert!(message(1, GoOn::No).contains("this run already begun"));
        assert!(
            message(2, GoOn::Same)
                .contains("key seed: found 1, so another run, expected 2, or another folder")
        );
        assert!(message(1, GoOn::Same).contains("a process at work"));
        drop(lock);
        drop(run.claim(&identity(1), GoOn::Same).unwrap());
        std::fs::rename(run.identity(), run.report()).unwrap();
        assert!(message(1, GoOn::Same).contains("a file of another run"));
    }

    /// A run that is done goes on to more episodes, and remembers where it was done.
    #[test]
    fn a_run_that_is_done_goes_on_for_more() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let of = |episodes: u64, seed| {
            let episodes = format!("evolution.episodes={episodes}");
            RunIdentity::new(seed, Preset::Evolution.with(&[&episodes]).unwrap())
        };
        let claim =
            |identity: &RunIdentity, go_on| run.claim(identity, go_on).map(|(_lock, identity)| identity);
        let message = |identity: &RunIdentity, go_on| claim(identity, go_on).unwrap_err().to_string();
        assert_eq!(claim(&of(5, 1), GoOn::Longer).unwrap(), of(5, 1));
        assert!(message(&of(8, 1), GoOn::Same).contains("episodes: found 5, so another run, expected 8"));
        assert!(message(&of(8, 1), GoOn::Longer).ends_with(
            "found 5 episodes that are not done, expected at most 8 that are done, to go on for more"
        ));
        std::fs::write(run.report(), "{}").unwrap();
        assert!(message(&of(8, 2), GoOn::Longer).contains("key seed: found 1, so another run, expected 2"));
        assert!(
            message(&of(4, 1), GoOn::Longer)
                .ends_with("found 5 episodes, expected at most 4 that are done, to go on for more")
        );
        for (episodes, lengths_before) in [(8, vec![5]), (8, vec![5]), (9, vec![5, 8])] {
            let longer = claim(&of(episodes, 1), GoOn::Longer).unwrap();
            assert_eq!(
                (longer.episodes(), &longer.lengths_before),
                (episodes, &lengths_before)
            );
            assert_eq!(run.read_identity().unwrap(), Some(longer));
        }
        assert!(message(&of(9, 1), GoOn::Same).contains("key lengths_before: found [5,8], so another run"));
        let stages = run.read_identity().unwrap().unwrap().stages();
        assert_eq!(stages[0], of(5, 1).to_json());
        assert_eq!(stages[1]["lengths_before"], serde_json::json!([5]));
        assert_eq!(stages.len(), 3);
    }

    #[test]
    fn a_result_is_written_again_but_takes_no_other_place() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let (task, other) = (serde_json::json!({ "seed": 1 }), serde_json::json!({ "seed": 2 }));
        run.check_free_for(&task).unwrap();
        std::fs::write(run.table(), "a table").unwrap();
        let message = |task| run.check_free_for(task).unwrap_err().to_string();
        assert!(message(&task).contains("a file of another run"));
        std::fs::write(run.report(), r#"{ "seed": 1, "seconds": 2.5 }"#).unwrap();
        run.check_free_for(&task).unwrap();
        assert!(message(&other).contains("key seed: found 1, so another run, expected 2, or another folder"));
        std::fs::write(run.identity(), "{}").unwrap();
        assert!(message(&task).contains("a run of train"));
    }
}
