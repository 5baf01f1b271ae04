//! The folder of a training run: the files in it, and which run it belongs to.

use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::checkpoint::{METADATA, first_difference, metadata};
use crate::laboratory::configuration::Configuration;
use crate::network::{Layer, Network};
use kit::error::{Error, Result};
use kit::files::{check_folder, write_whole};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView, serialize};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Names of the files in a run folder.
#[derive(Clone, Debug)]
pub struct RunFolder(PathBuf);

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
}

impl RunIdentity {
    /// A run of this program.
    pub fn new(seed: u64, configuration: Configuration) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed,
            losses: configuration.algorithm.losses_checksum(),
            configuration,
        }
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        serde_json::json!(self)
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

    /// The float networks: safetensors with PyTorch's names and shapes. `layers.0.weight` is `[outputs, inputs]`; with one
    /// network for each vehicle, `vehicles.0.layers.0.weight` and so on.
    pub fn actors(&self) -> PathBuf {
        self.0.join("actor.safetensors")
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
    pub fn records(&self) -> [PathBuf; 8] {
        [
            self.identity(),
            self.checkpoint(),
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

    /// Writes a run's result, each file whole or not at all, the report last.
    ///
    /// # Errors
    /// The file that cannot be written.
    pub fn write(&self, actors: &Actors, table: Option<&[u8]>, report: &Value) -> Result<()> {
        write_whole(&self.actors(), &to_safetensors(actors)?)?;
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

    /// Begins a run, or goes on with it, and keeps other processes out for as long as the returned file is held.
    ///
    /// # Errors
    /// If the folder holds another run, this one without `resume`, or a process that works on it.
    pub fn claim(&self, identity: &RunIdentity, resume: bool) -> Result<File> {
        check_folder(&self.0)?;
        let path = self.identity();
        if path.exists() {
            check_same_run(&path, &read_json(&path)?, &identity.to_json())?;
            if !resume {
                return Err(Error::input(
                    path.display(),
                    "this run already begun",
                    "--resume to go on with it, or another folder",
                ));
            }
        } else {
            check_absent(&[
                self.checkpoint(),
                self.metrics(),
                self.actors(),
                self.table(),
                self.report(),
            ])?;
            write_whole(&path, format!("{:#}\n", identity.to_json()).as_bytes())?;
        }
        let file = File::open(&path).map_err(|source| Error::file(&path, source))?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(std::fs::TryLockError::WouldBlock) => Err(Error::input(
                path.display(),
                "a process at work on this run",
                "none",
            )),
            Err(std::fs::TryLockError::Error(source)) => Err(Error::file(&path, source)),
        }
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
        let path = self.actors();
        let bytes = std::fs::read(&path).map_err(|source| Error::file(&path, source))?;
        from_safetensors(&path.display().to_string(), &bytes)
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

/// What the names of a vehicle's tensors begin with.
fn prefix(vehicle: usize, shared: bool) -> String {
    if shared {
        String::new()
    } else {
        format!("vehicles.{vehicle}.")
    }
}

/// Networks as safetensors with their form as metadata.
///
/// # Errors
/// If the format cannot hold them.
pub fn to_safetensors(actors: &Actors) -> Result<Vec<u8>> {
    let mut tensors = Vec::new();
    for (vehicle, network) in actors.networks.iter().enumerate() {
        let prefix = prefix(vehicle, actors.shared());
        for (index, layer) in network.layers.iter().enumerate() {
            let bytes = |values: &mut dyn Iterator<Item = f32>| -> Vec<u8> {
                values.flat_map(f32::to_le_bytes).collect()
            };
            let name = format!("{prefix}layers.{index}");
            let shape = vec![layer.outputs, layer.inputs];
            tensors.push((format!("{name}.weight"), shape, bytes(&mut layer.rows())));
            let biases = bytes(&mut layer.biases.iter().copied());
            tensors.push((format!("{name}.bias"), vec![layer.outputs], biases));
        }
    }
    let failure = |error: safetensors::SafeTensorError| Error::input("safetensors", error, "a network");
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| Ok((name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes)?)))
        .collect::<std::result::Result<Vec<_>, _>>()
        .map_err(failure)?;
    let metadata = HashMap::from([(METADATA.to_owned(), serde_json::json!(actors.form).to_string())]);
    serialize(views, Some(metadata)).map_err(failure)
}

fn from_safetensors(place: &str, bytes: &[u8]) -> Result<Actors> {
    let form: ActorForm = metadata(place, bytes)?;
    let tensors =
        SafeTensors::deserialize(bytes).map_err(|error| Error::input(place, error, "whole safetensors"))?;
    let shared = tensors.tensor("layers.0.weight").is_ok();
    let mut networks = Vec::new();
    while let Some(network) = read_network(place, &tensors, &prefix(networks.len(), shared))? {
        networks.push(network);
        if shared {
            break;
        }
    }
    let actors = Actors { form, networks };
    actors.check().map_err(|error| error.within(place))?;
    Ok(actors)
}

/// The network whose tensors' names begin so; `None` if there is no tensor of its first layer.
fn read_network(place: &str, tensors: &SafeTensors<'_>, prefix: &str) -> Result<Option<Network>> {
    let read = |name: &str| -> Option<(Vec<usize>, Vec<f32>)> {
        let view = tensors
            .tensor(name)
            .ok()
            .filter(|view| view.dtype() == Dtype::F32)?;
        let (values, _) = view.data().as_chunks::<4>();
        Some((
            view.shape().to_vec(),
            values.iter().map(|&value| f32::from_le_bytes(value)).collect(),
        ))
    };
    let mut layers: Vec<Layer> = Vec::new();
    while let Some((shape, rows)) = read(&format!("{prefix}layers.{}.weight", layers.len())) {
        let name = format!("{prefix}layers.{}", layers.len());
        let place = format!("{place}: {name}");
        let [outputs, inputs] = shape[..] else {
            return Err(Error::input(
                place,
                format!("shape {shape:?}"),
                "[outputs, inputs]",
            ));
        };
        let previous = layers.last().map_or(inputs, |layer| layer.outputs);
        let bias = read(&format!("{name}.bias")).filter(|(shape, _)| shape[..] == [outputs]);
        let (Some((_, biases)), true) = (bias, previous == inputs) else {
            return Err(Error::input(
                place,
                format!("shape {shape:?}"),
                format!("{previous} inputs and a bias"),
            ));
        };
        let weights = (0..inputs)
            .flat_map(|input| rows.iter().skip(input).step_by(inputs.max(1)).copied())
            .collect();
        layers.push(Layer {
            inputs,
            outputs,
            weights,
            biases,
        });
    }
    Ok((!layers.is_empty()).then_some(Network { layers }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::configuration::{Algorithm, Preset};
    use crate::laboratory::forms::{ObservationForm, OutputForm};
    use crate::laboratory::random;
    use crate::maddpg::options::Backend;

    fn actors(count: u32) -> Actors {
        let widths = [ObservationForm::Paper.length(), 3, 2];
        Actors {
            form: ActorForm {
                observation: ObservationForm::Paper,
                output: OutputForm::SubChannelAndPower { noise: 0.1 },
                min_vehicles: 5,
                max_vehicles: 5,
            },
            networks: (0..count)
                .map(|member| Network::random(&widths, &mut random::initial(1, member)))
                .collect(),
        }
    }

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
    fn networks_survive_a_file() {
        for count in [1, 12] {
            let bytes = to_safetensors(&actors(count)).unwrap();
            assert_eq!(from_safetensors("file", &bytes).unwrap(), actors(count));
        }
    }

    #[test]
    fn foreign_files_are_refused() {
        let message = |bytes: &[u8]| from_safetensors("file", bytes).unwrap_err().to_string();
        assert!(message(b"no").starts_with("file: found "));
        let whole = to_safetensors(&actors(1)).unwrap();
        assert!(message(&whole[..whole.len() - 1]).starts_with("file: found "));
        assert_eq!(
            message(&to_safetensors(&actors(0)).unwrap()),
            "file: actors: found no network, expected at least one"
        );
        let mut narrow = actors(1);
        narrow.networks[0].layers.pop();
        assert_eq!(
            message(&to_safetensors(&narrow).unwrap()),
            "file: actors: found widths [7, 3], expected 7 inputs and 2 outputs"
        );
        let mut diverged = actors(2);
        diverged.networks[1].layers[0].biases[2] = f32::NAN;
        assert_eq!(
            message(&to_safetensors(&diverged).unwrap()),
            "file: actor of vehicle 1: layers.0: found NaN, expected finite numbers"
        );
        let mut odd = actors(2);
        odd.networks[1] = Network::random(&[7, 4, 2], &mut random::initial(1, 0));
        assert_eq!(
            message(&to_safetensors(&odd).unwrap()),
            "file: actor of vehicle 1: found widths [7, 4, 2], expected [7, 3, 2] as of vehicle 0"
        );
    }

    #[test]
    fn a_folder_is_claimed_by_one_run_and_one_process() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path());
        let configuration = Preset::Evolution.with(&[]).unwrap();
        let identity = |seed| RunIdentity::new(seed, configuration.clone());
        let message = |seed, resume| run.claim(&identity(seed), resume).unwrap_err().to_string();
        let lock = run.claim(&identity(1), false).unwrap();
        assert!(message(1, false).contains("this run already begun"));
        assert!(
            message(2, true).contains("key seed: found 1, so another run, expected 2, or another folder")
        );
        assert!(message(1, true).contains("a process at work"));
        drop(lock);
        drop(run.claim(&identity(1), true).unwrap());
        std::fs::rename(run.identity(), run.report()).unwrap();
        assert!(message(1, true).contains("a file of another run"));
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
