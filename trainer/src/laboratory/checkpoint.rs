//! A learner's state as a safetensors file that says which run it belongs to; its parts, which never change, as files of their own.

use super::state::{Part, State, Tensor, Values};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use kit::error::{Error, Result};
use safetensors::tensor::{Dtype, TensorView, serialize};
use safetensors::{SafeTensorError, SafeTensors};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
use std::io::{Read as _, Write as _};

/// The one key of a file's metadata. One, because safetensors writes several in no fixed order.
const METADATA: &str = "freshlane";

/// What a checkpoint says besides tensors.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    /// What the run was told.
    run: Value,
    counters: Value,
    /// Of the counters and all tensors: a damaged file is no other state.
    checksum: u64,
    /// The checksum of each part.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    parts: Checksums,
}

/// The checksums of parts by their names.
pub type Checksums = BTreeMap<String, u64>;

/// CRC-64/XZ, sixteen bytes at a time: checkpoints are large.
const CHECKSUM: crc::Crc<u64, crc::Table<16>> = crc::Crc::<u64, crc::Table<16>>::new(&crc::CRC_64_XZ);

/// Most bytes that a part is unpacked to (chosen: an episode of 60 vehicles and 1,000 slots has 6 MB).
const MOST_UNPACKED: u64 = 1 << 28;

/// CRC-64/XZ of what a file says and of all its tensors, names and little-endian values, in the order of their names.
pub(crate) fn checksum(said: &Value, tensors: &BTreeMap<String, Tensor>) -> u64 {
    let mut digest = CHECKSUM.digest();
    digest.update(said.to_string().as_bytes());
    for (name, tensor) in tensors {
        digest.update(name.as_bytes());
        digest.update(&little_endian(&tensor.values));
    }
    digest.finalize()
}

/// The bytes of the file that holds a state without its parts, which are told by their checksums.
///
/// # Errors
/// If the format cannot hold the state.
pub fn to_bytes(run: &Value, state: &State, parts: &Checksums) -> Result<Vec<u8>> {
    let header = Header {
        run: run.clone(),
        counters: state.counters.clone(),
        checksum: checksum(&state.counters, &state.tensors),
        parts: parts.clone(),
    };
    to_safetensors(&state.tensors, &serde_json::json!(header))
}

/// Reads a checkpoint of one of these stages of a run, the last last, and the checksums of its parts; `read_part` gives the place and
/// the bytes of a part's file.
///
/// # Errors
/// If a file is not whole, or that of another run.
pub fn from_bytes(
    place: &str,
    bytes: &[u8],
    stages: &[Value],
    read_part: impl Fn(&str) -> Result<(String, Vec<u8>)>,
) -> Result<(State, Checksums)> {
    let (header, tensors): (Header, _) = from_safetensors(place, bytes)?;
    let of = |stage| first_difference(&header.run, stage);
    if !stages.iter().any(|stage| of(stage).is_none())
        && let Some((key, found, expected)) = stages.last().and_then(of)
    {
        return Err(Error::input(format!("{place}: key {key}"), found, expected));
    }
    check(place, header.checksum, &header.counters, &tensors)?;
    let mut state = State::new(header.counters);
    state.tensors = tensors;
    for (name, &checksum) in &header.parts {
        let (place, bytes) = read_part(name)?;
        let part = part_from_bytes(&place, &bytes, checksum)?;
        let _new = state.parts.insert(name.clone(), part);
    }
    Ok((state, header.parts))
}

/// The state of a checkpoint of whichever run, without its parts.
///
/// # Errors
/// If the file is not whole.
pub fn of_any_run(place: &str, bytes: &[u8]) -> Result<State> {
    let (header, tensors): (Header, _) = from_safetensors(place, bytes)?;
    check(place, header.checksum, &header.counters, &tensors)?;
    let mut state = State::new(header.counters);
    state.tensors = tensors;
    Ok(state)
}

/// The checksum of a part and the bytes of its file, which is packed: what a replay holds are small numbers, each many times.
///
/// # Errors
/// If the format cannot hold the part.
pub fn part_to_bytes(part: &Part) -> Result<(u64, Vec<u8>)> {
    let bytes = to_safetensors(&part.0, &Value::Null)?;
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    let packed = packed.write_all(&bytes).and_then(|()| packed.finish());
    let packed = packed.map_err(|error| Error::input("part", error, "one that can be packed"))?;
    Ok((checksum(&Value::Null, &part.0), packed))
}

/// Reads a part's file.
///
/// # Errors
/// If it is not what was written.
pub fn part_from_bytes(place: &str, bytes: &[u8], checksum: u64) -> Result<Part> {
    let mut unpacked = Vec::new();
    let length = GzDecoder::new(bytes)
        .take(MOST_UNPACKED + 1)
        .read_to_end(&mut unpacked)
        .map_err(|error| Error::input(place, error, "a whole part of a checkpoint"))?;
    if length as u64 > MOST_UNPACKED {
        let found = format!("more than {MOST_UNPACKED} bytes when unpacked");
        return Err(Error::input(place, found, "a part of a checkpoint"));
    }
    let (_null, tensors): (Value, _) = from_safetensors(place, &unpacked)?;
    check(place, checksum, &Value::Null, &tensors)?;
    Ok(Part(tensors))
}

/// Refuses what is not what was written.
///
/// # Errors
/// If the checksum is another.
pub(crate) fn check(
    place: &str,
    written: u64,
    said: &Value,
    tensors: &BTreeMap<String, Tensor>,
) -> Result<()> {
    let found = checksum(said, tensors);
    if found == written {
        return Ok(());
    }
    let expected = format!("{written:016x}, as it was written");
    Err(Error::input(
        format!("{place}: checksum"),
        format!("{found:016x}"),
        expected,
    ))
}

/// Tensors and metadata as the bytes of a safetensors file.
///
/// # Errors
/// If the format cannot hold them.
pub(crate) fn to_safetensors(tensors: &BTreeMap<String, Tensor>, header: &Value) -> Result<Vec<u8>> {
    let bytes: Vec<Vec<u8>> = tensors
        .values()
        .map(|tensor| little_endian(&tensor.values))
        .collect();
    let views = tensors.iter().zip(&bytes).map(|((name, tensor), bytes)| {
        let dtype = match tensor.values {
            Values::F32(_) => Dtype::F32,
            Values::U8(_) => Dtype::U8,
        };
        Ok((name, TensorView::new(dtype, tensor.shape.clone(), bytes)?))
    });
    let metadata = HashMap::from([(METADATA.to_owned(), header.to_string())]);
    views
        .collect::<std::result::Result<Vec<_>, SafeTensorError>>()
        .and_then(|views| serialize(views, Some(metadata)))
        .map_err(|error| Error::input("safetensors", error, "tensors that a file can hold"))
}

/// Metadata and tensors of a safetensors file of this product.
///
/// # Errors
/// If the file is not whole, or of another product or purpose.
pub(crate) fn from_safetensors<T: DeserializeOwned>(
    place: &str,
    bytes: &[u8],
) -> Result<(T, BTreeMap<String, Tensor>)> {
    let header = metadata(place, bytes)?;
    let file =
        SafeTensors::deserialize(bytes).map_err(|error| Error::input(place, error, "whole safetensors"))?;
    let mut tensors = BTreeMap::new();
    for (name, view) in file.tensors() {
        let values = match view.dtype() {
            Dtype::F32 => {
                let (values, _) = view.data().as_chunks();
                Values::F32(values.iter().map(|&value| f32::from_le_bytes(value)).collect())
            }
            Dtype::U8 => Values::U8(view.data().to_vec()),
            other => {
                let found = format!("{other:?}");
                return Err(Error::input(format!("{place}: {name}"), found, "F32 or U8"));
            }
        };
        let shape = view.shape().to_vec();
        let _none = tensors.insert(name, Tensor { shape, values });
    }
    Ok((header, tensors))
}

/// Reads this product's part of a file's metadata.
///
/// # Errors
/// If the file is not safetensors, or of another product or purpose.
fn metadata<T: DeserializeOwned>(place: &str, bytes: &[u8]) -> Result<T> {
    let (_, metadata) =
        SafeTensors::read_metadata(bytes).map_err(|error| Error::input(place, error, "safetensors"))?;
    let text = metadata.metadata().as_ref().and_then(|all| all.get(METADATA));
    let Some(text) = text else {
        return Err(Error::input(
            place,
            format!("no metadata \"{METADATA}\""),
            "a file of this program",
        ));
    };
    serde_json::from_str(text).map_err(|error| Error::input(place, error, "the metadata of such a file"))
}

fn little_endian(values: &Values) -> Vec<u8> {
    match values {
        Values::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Values::U8(values) => values.clone(),
    }
}

/// The first key, in dotted form, whose values differ, and both values.
pub fn first_difference(found: &Value, expected: &Value) -> Option<(String, String, String)> {
    if let (Value::Array(one), Value::Array(other)) = (found, expected)
        && one.len() == other.len()
        && one.iter().chain(other).all(Value::is_object)
    {
        let mut entries = one.iter().zip(other).enumerate();
        return entries.find_map(|(index, (one, other))| {
            let (key, found, expected) = first_difference(one, other)?;
            Some((format!("[{index}].{key}"), found, expected))
        });
    }
    let (Value::Object(one), Value::Object(other)) = (found, expected) else {
        return (found != expected).then(|| (String::new(), found.to_string(), expected.to_string()));
    };
    let keys = one
        .keys()
        .chain(other.keys().filter(|key| !one.contains_key(*key)));
    for key in keys {
        let (left, right) = (one.get(key), other.get(key));
        let difference = match (left, right) {
            (Some(left), Some(right)) => first_difference(left, right),
            (left, right) => {
                let text = |value: Option<&Value>| match value {
                    None => "nothing".to_owned(),
                    Some(Value::Object(section)) => format!("a section of {} keys", section.len()),
                    Some(value) => value.to_string(),
                };
                Some((String::new(), text(left), text(right)))
            }
        };
        if let Some((rest, found, expected)) = difference {
            let dot = if rest.is_empty() || rest.starts_with('[') {
                ""
            } else {
                "."
            };
            return Some((format!("{key}{dot}{rest}"), found, expected));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn state() -> State {
        let mut state = State::new(json!({ "done": 7 }));
        state.put("weights", &[2, 2], vec![1.0_f32, -0.0, f32::MIN_POSITIVE, 3.5]);
        state.put("actions", &[3], vec![0_u8, 1, 255]);
        let mut part = Part::default();
        part.put("known", &[500], vec![0.25_f32; 500]);
        let _new = state.parts.insert("replay.7".to_owned(), part);
        state
    }

    /// The files of a state: of itself, and of its one part.
    fn written(run: &Value) -> [Vec<u8>; 2] {
        let state = state();
        let (checksum, part) = part_to_bytes(&state.parts["replay.7"]).unwrap();
        let parts = BTreeMap::from([("replay.7".to_owned(), checksum)]);
        [to_bytes(run, &state, &parts).unwrap(), part]
    }

    fn read(bytes: &[u8], part: &[u8], run: &Value) -> Result<State> {
        let read = from_bytes("file", bytes, std::slice::from_ref(run), |name| {
            Ok((name.to_owned(), part.to_vec()))
        });
        read.map(|(state, _)| state)
    }

    #[test]
    fn states_survive_their_files() {
        let run = json!({ "seed": 1 });
        let [bytes, part] = written(&run);
        assert_eq!([&bytes, &part], [&written(&run)[0], &written(&run)[1]]);
        assert!(part.len() < 500, "packed: {}", part.len());
        assert_eq!(read(&bytes, &part, &run).unwrap(), state());
    }

    #[test]
    fn truncated_damaged_foreign_and_other_runs_checkpoints_are_refused() {
        let run = json!({ "seed": 1, "algorithm": { "ppo": { "hidden": [64, 64] } } });
        let [bytes, part] = written(&run);
        let message = |bytes: &[u8], run: &Value| read(bytes, &part, run).unwrap_err().to_string();
        for length in [0, 7, 100, bytes.len() - 1] {
            let message = message(&bytes[..length], &run);
            assert!(message.starts_with("file: found "), "{message}");
        }
        let mut damaged = bytes.clone();
        *damaged.last_mut().unwrap() ^= 1;
        assert!(message(&damaged, &run).starts_with("file: checksum: found "));
        for length in [0, 5, part.len() / 2, part.len() - 1] {
            let cut = read(&bytes, &part[..length], &run).unwrap_err().to_string();
            assert!(cut.starts_with("replay.7: found "), "{cut}");
        }
        let (_checksum, other) = part_to_bytes(&Part::default()).unwrap();
        let other = read(&bytes, &other, &run).unwrap_err().to_string();
        assert!(other.starts_with("replay.7: checksum: found "), "{other}");
        let foreign = serialize([("a", TensorView::new(Dtype::U8, vec![1], &[1]).unwrap())], None).unwrap();
        assert_eq!(
            message(&foreign, &run),
            "file: found no metadata \"freshlane\", expected a file of this program"
        );
        let other = json!({ "seed": 1, "algorithm": { "ppo": { "hidden": [64, 32] } } });
        assert_eq!(
            message(&bytes, &other),
            "file: key algorithm.ppo.hidden: found [64,64], expected [64,32]"
        );
        let cells = |weight| json!({ "mixture": [{ "name": "a" }, { "name": "b", "weight": weight }] });
        let found = first_difference(&cells(1), &cells(2)).unwrap();
        assert_eq!(
            found,
            ("mixture[1].weight".to_owned(), "1".to_owned(), "2".to_owned())
        );
    }
}
