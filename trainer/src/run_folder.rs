//! What a training run leaves behind: the float network, the weight table, and a report.

use crate::network::{Layer, Network};
use host_sim::error::{Error, Result};
use host_sim::report::files::write_whole;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView, serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Names of the files in a run folder.
#[derive(Clone, Debug)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// The folder at this path.
    pub fn new(path: &Path) -> Self {
        Self(path.to_owned())
    }

    /// The float network: safetensors with PyTorch's names and shapes (`layers.0.weight` is `[outputs, inputs]`).
    pub fn network(&self) -> PathBuf {
        self.0.join("actor.safetensors")
    }

    /// The weight table.
    pub fn table(&self) -> PathBuf {
        self.0.join("table.bin")
    }

    /// What was run and what came out. Written last.
    pub fn report(&self) -> PathBuf {
        self.0.join("report.json")
    }

    /// Writes all files, each whole or not at all, the report last.
    ///
    /// # Errors
    /// The file that cannot be written.
    pub fn write(&self, network: &Network, table: &[u8], report: &Value) -> Result<()> {
        write_whole(&self.network(), &to_safetensors(network)?)?;
        write_whole(&self.table(), table)?;
        write_whole(&self.report(), format!("{report:#}\n").as_bytes())
    }

    /// Reads the float network.
    ///
    /// # Errors
    /// The file and what is wrong with it.
    pub fn read_network(&self) -> Result<Network> {
        read_network(&self.network())
    }
}

/// Reads a float network from a safetensors file.
///
/// # Errors
/// The file and what is wrong with it.
pub fn read_network(path: &Path) -> Result<Network> {
    let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
    from_safetensors(&path.display().to_string(), &bytes)
}

fn to_safetensors(network: &Network) -> Result<Vec<u8>> {
    let mut tensors = Vec::new();
    for (index, layer) in network.layers.iter().enumerate() {
        let mut weights = Vec::new();
        for output in 0..layer.outputs {
            for input in 0..layer.inputs {
                weights.extend(layer.weights[input * layer.outputs + output].to_le_bytes());
            }
        }
        let biases: Vec<u8> = layer.biases.iter().flat_map(|bias| bias.to_le_bytes()).collect();
        tensors.push((
            format!("layers.{index}.weight"),
            vec![layer.outputs, layer.inputs],
            weights,
        ));
        tensors.push((format!("layers.{index}.bias"), vec![layer.outputs], biases));
    }
    let failure = |error: safetensors::SafeTensorError| Error::input("safetensors", error, "a network");
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| Ok((name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes)?)))
        .collect::<std::result::Result<Vec<_>, _>>()
        .map_err(failure)?;
    serialize(views, None).map_err(failure)
}

fn from_safetensors(place: &str, bytes: &[u8]) -> Result<Network> {
    let tensors =
        SafeTensors::deserialize(bytes).map_err(|error| Error::input(place, error, "safetensors"))?;
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
    while let Some((shape, rows)) = read(&format!("layers.{}.weight", layers.len())) {
        let name = format!("{place}: layers.{}", layers.len());
        let [outputs, inputs] = shape[..] else {
            return Err(Error::input(
                name,
                format!("shape {shape:?}"),
                "[outputs, inputs]",
            ));
        };
        let previous = layers.last().map_or(inputs, |layer| layer.outputs);
        let bias = read(&format!("layers.{}.bias", layers.len())).filter(|(shape, _)| shape[..] == [outputs]);
        let (Some((_, biases)), true) = (bias, previous == inputs) else {
            return Err(Error::input(
                name,
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
    if layers.is_empty() {
        return Err(Error::input(
            place,
            "no tensor layers.0.weight of type F32",
            "a network",
        ));
    }
    Ok(Network { layers })
}

#[cfg(test)]
mod tests {
    use super::*;
    use host_sim::stream::{Purpose, Role, WorldKey};

    #[test]
    fn networks_survive_a_file() {
        let mut stream = WorldKey {
            seed: 1,
            purpose: Purpose::Training,
            world: 0,
        }
        .stream(Role::Policy, 0);
        let network = Network::random(&[4, 3, 2], &mut stream);
        assert_eq!(
            from_safetensors("file", &to_safetensors(&network).unwrap()).unwrap(),
            network
        );
    }

    #[test]
    fn foreign_files_are_refused() {
        let message = |bytes: &[u8]| from_safetensors("file", bytes).unwrap_err().to_string();
        assert!(message(b"no").starts_with("file: found "));
        let empty = to_safetensors(&Network { layers: Vec::new() }).unwrap();
        assert_eq!(
            message(&empty),
            "file: found no tensor layers.0.weight of type F32, expected a network"
        );
    }
}
