//! Float networks as a file: safetensors with PyTorch's names and shapes.
//!
//! `layers.0.weight` is `[outputs, inputs]`; with one network for each vehicle, `vehicles.0.layers.0.weight` and so on. What goes in
//! and what comes out is metadata, and so is a checksum: a damaged weight is no other weight.

use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::checkpoint::{check, checksum, from_safetensors, to_safetensors};
use crate::laboratory::state::{State, Tensor, Values};
use crate::network::Network;
use kit::error::{Error, Result};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Its name in the folder of a run.
pub const NAME: &str = "actor.safetensors";

/// Where the metadata has the checksum, beside the form's keys.
const CHECKSUM: &str = "checksum";

/// Reads the networks.
///
/// # Errors
/// The file and what is wrong with it.
pub fn read(path: &Path) -> Result<Actors> {
    let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
    from_bytes(&path.display().to_string(), &bytes)
}

/// What the names of a vehicle's tensors begin with.
fn prefix(vehicle: usize, shared: bool) -> String {
    if shared {
        String::new()
    } else {
        format!("vehicles.{vehicle}.")
    }
}

/// The file's bytes.
///
/// # Errors
/// If the format cannot hold the networks.
pub fn to_bytes(actors: &Actors) -> Result<Vec<u8>> {
    let mut state = State::default();
    for (vehicle, network) in actors.networks.iter().enumerate() {
        let prefix = prefix(vehicle, actors.shared());
        for (index, layer) in network.layers().enumerate() {
            let name = format!("{prefix}layers.{index}");
            let shape = [layer.outputs, layer.inputs];
            state.put(format!("{name}.weight"), &shape, layer.weights.to_vec());
            state.put(format!("{name}.bias"), &shape[..1], layer.biases.to_vec());
        }
    }
    let mut header = json!(actors.form);
    header[CHECKSUM] = checksum(&header, &state.tensors).into();
    to_safetensors(&state.tensors, &header)
}

fn from_bytes(place: &str, bytes: &[u8]) -> Result<Actors> {
    let (mut header, mut tensors): (Map<String, Value>, _) = from_safetensors(place, bytes)?;
    let written = header.remove(CHECKSUM);
    let form: ActorForm = serde_json::from_value(header.into())
        .map_err(|error| Error::input(place, error, "the metadata of such a file"))?;
    let written = written.as_ref().and_then(Value::as_u64).ok_or_else(|| {
        let expected = "a file of this version of the trainer";
        Error::input(format!("{place}: {CHECKSUM}"), "none", expected)
    })?;
    check(place, written, &json!(form), &tensors)?;
    let shared = tensors.contains_key("layers.0.weight");
    let mut networks = Vec::new();
    while let Some(network) = take_network(place, &mut tensors, &prefix(networks.len(), shared))? {
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
fn take_network(
    place: &str,
    tensors: &mut BTreeMap<String, Tensor>,
    prefix: &str,
) -> Result<Option<Network>> {
    let (mut widths, mut parameters) = (Vec::new(), Vec::new());
    for layer in 0.. {
        let name = format!("{prefix}layers.{layer}");
        let mut take = |part: &str| match tensors.remove(&format!("{name}.{part}"))? {
            Tensor {
                shape,
                values: Values::F32(values),
            } => Some((shape, values)),
            _ => None,
        };
        let Some((shape, weights)) = take("weight") else {
            break;
        };
        let [outputs, inputs] = shape[..] else {
            let found = format!("shape {shape:?}");
            return Err(Error::input(
                format!("{place}: {name}"),
                found,
                "[outputs, inputs]",
            ));
        };
        if layer == 0 {
            widths.push(inputs);
        }
        let biases = take("bias").filter(|(shape, _)| shape[..] == [outputs]);
        let (Some((_, biases)), true) = (biases, widths[layer] == inputs) else {
            let (found, expected) = (format!("shape {shape:?}"), widths[layer]);
            let expected = format!("{expected} inputs and a bias");
            return Err(Error::input(format!("{place}: {name}"), found, expected));
        };
        widths.push(outputs);
        parameters.extend(weights);
        parameters.extend(biases);
    }
    Ok((!widths.is_empty()).then(|| Network::new(&widths, parameters)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random;
    use firmware::form::{ObservationForm, OutputForm};

    fn actors(count: u32) -> Actors {
        let widths = [ObservationForm::Paper.inputs(), 3, 2];
        Actors {
            form: ActorForm {
                observation: ObservationForm::Paper,
                output: OutputForm::SubChannelAndPower,
                noise: 0.1,
                min_vehicles: 5,
                max_vehicles: 5,
            },
            networks: (0..count)
                .map(|member| Network::random(&widths, &mut random::initial(1, member)))
                .collect(),
        }
    }

    #[test]
    fn networks_survive_a_file() {
        for count in [1, 12] {
            let bytes = to_bytes(&actors(count)).unwrap();
            assert_eq!(from_bytes("file", &bytes).unwrap(), actors(count));
        }
    }

    #[test]
    fn a_flipped_bit_makes_no_other_actor() {
        let whole = to_bytes(&actors(2)).unwrap();
        for byte in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[byte] ^= 1;
            // Of a number's many digits the last may say nothing.
            let same = from_bytes("file", &damaged).is_ok_and(|read| read == actors(2));
            assert!(same || from_bytes("file", &damaged).is_err(), "byte {byte}");
        }
        let mut damaged = whole;
        *damaged.last_mut().unwrap() ^= 1;
        let message = from_bytes("file", &damaged).unwrap_err().to_string();
        assert!(message.starts_with("file: checksum: found "), "{message}");
    }

    #[test]
    fn a_file_without_a_checksum_is_refused() {
        let actors = actors(1);
        let (_, tensors): (Value, _) = from_safetensors("file", &to_bytes(&actors).unwrap()).unwrap();
        let bytes = to_safetensors(&tensors, &json!(actors.form)).unwrap();
        assert_eq!(
            from_bytes("file", &bytes).unwrap_err().to_string(),
            "file: checksum: found none, expected a file of this version of the trainer"
        );
    }

    #[test]
    fn foreign_files_are_refused() {
        let message = |bytes: &[u8]| from_bytes("file", bytes).unwrap_err().to_string();
        assert!(message(b"no").starts_with("file: found "));
        let whole = to_bytes(&actors(1)).unwrap();
        assert!(message(&whole[..whole.len() - 1]).starts_with("file: found "));
        assert_eq!(
            message(&to_bytes(&actors(0)).unwrap()),
            "file: actors: found no network, expected at least one"
        );
        let mut narrow = actors(1);
        narrow.networks[0] = Network::random(&[7, 3], &mut random::initial(1, 0));
        assert_eq!(
            message(&to_bytes(&narrow).unwrap()),
            "file: actors: found widths [7, 3], expected 7 inputs and 2 outputs"
        );
        let mut diverged = actors(2);
        diverged.networks[1].layer_mut(0).1[2] = f32::NAN;
        assert_eq!(
            message(&to_bytes(&diverged).unwrap()),
            "file: actor of vehicle 1: layers.0: found NaN, expected finite numbers"
        );
        let mut odd = actors(2);
        odd.networks[1] = Network::random(&[7, 4, 2], &mut random::initial(1, 0));
        assert_eq!(
            message(&to_bytes(&odd).unwrap()),
            "file: actor of vehicle 1: found widths [7, 4, 2], expected [7, 3, 2] as of vehicle 0"
        );
    }
}
