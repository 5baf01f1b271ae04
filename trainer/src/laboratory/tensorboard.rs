//! Event files that TensorBoard reads: the run's hyperparameters, then one scalar summary an episode.
//!
//! # Source
//! TensorFlow's `record_writer.h` (framing, masked CRC-32C), `event.proto` and `summary.proto` (field numbers); of TensorBoard's plugin
//! hparams `plugin_data.proto`, `api.proto` and `metadata.py`.

use prost::Message as _;
use serde_json::Value as Json;
use std::collections::BTreeMap;

/// CRC-32C (Castagnoli).
const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);

/// Bytes of a record around its data: length, the length's checksum, the data's checksum.
const FRAME: usize = 8 + 4 + 4;

#[derive(prost::Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5")]
    what: Option<What>,
}

#[derive(prost::Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
}

#[derive(prost::Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Value>,
}

#[derive(prost::Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    // Within a oneof of `summary.proto`, so that a zero is written out too.
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
    #[prost(message, optional, tag = "9")]
    metadata: Option<Metadata>,
}

/// `SummaryMetadata`: which plugin of TensorBoard a value is for.
#[derive(prost::Message)]
struct Metadata {
    #[prost(message, optional, tag = "1")]
    plugin_data: Option<PluginData>,
}

#[derive(prost::Message)]
struct PluginData {
    #[prost(string, tag = "1")]
    plugin_name: String,
    #[prost(bytes, tag = "2")]
    content: Vec<u8>,
}

/// `HParamsPluginData`, version 0.
#[derive(prost::Message)]
struct Hyperparameters {
    #[prost(oneof = "Part", tags = "2, 3")]
    part: Option<Part>,
}

#[derive(prost::Oneof)]
enum Part {
    #[prost(message, tag = "2")]
    Experiment(Experiment),
    #[prost(message, tag = "3")]
    Session(Session),
}

#[derive(prost::Message)]
struct Experiment {
    #[prost(message, repeated, tag = "4")]
    hyperparameters: Vec<Described>,
    #[prost(message, repeated, tag = "5")]
    metrics: Vec<Metric>,
}

/// `HParamInfo`.
#[derive(prost::Message)]
struct Described {
    #[prost(string, tag = "1")]
    name: String,
    /// A `DataType`: 1 text, 2 a truth, 3 a number.
    #[prost(int32, tag = "4")]
    kind: i32,
}

/// `MetricInfo`.
#[derive(prost::Message)]
struct Metric {
    #[prost(message, optional, tag = "1")]
    name: Option<MetricName>,
}

#[derive(prost::Message)]
struct MetricName {
    #[prost(string, tag = "2")]
    tag: String,
}

/// `SessionStartInfo`.
#[derive(prost::Message)]
struct Session {
    #[prost(btree_map = "string, message", tag = "1")]
    hyperparameters: BTreeMap<String, Parameter>,
}

/// `google.protobuf.Value`.
#[derive(PartialEq, prost::Message)]
struct Parameter {
    #[prost(oneof = "Kind", tags = "2, 3, 4")]
    kind: Option<Kind>,
}

#[derive(PartialEq, prost::Oneof)]
enum Kind {
    #[prost(double, tag = "2")]
    Number(f64),
    #[prost(string, tag = "3")]
    Text(String),
    #[prost(bool, tag = "4")]
    Truth(bool),
}

impl From<&Json> for Parameter {
    fn from(value: &Json) -> Self {
        let kind = match value {
            Json::Bool(truth) => Kind::Truth(*truth),
            Json::Number(number) => Kind::Number(number.as_f64().unwrap_or(f64::NAN)),
            Json::String(text) => Kind::Text(text.clone()),
            other => Kind::Text(other.to_string()),
        };
        Self { kind: Some(kind) }
    }
}

/// The records that begin a file: the format's version, and what the run was told, as TensorBoard's page of hyperparameters shows it
/// beside these metrics.
pub fn header(told: &BTreeMap<String, Json>, metrics: &[&str]) -> Vec<u8> {
    let version = What::FileVersion("brain.Event:2".to_owned());
    let hyperparameters: BTreeMap<String, Parameter> = told
        .iter()
        .map(|(name, value)| (name.clone(), value.into()))
        .collect();
    let described = hyperparameters.iter().map(|(name, value)| Described {
        name: name.clone(),
        kind: match value.kind {
            Some(Kind::Text(_)) | None => 1,
            Some(Kind::Truth(_)) => 2,
            Some(Kind::Number(_)) => 3,
        },
    });
    let metrics = metrics.iter().map(|&tag| Metric {
        name: Some(MetricName { tag: tag.to_owned() }),
    });
    let experiment = Part::Experiment(Experiment {
        hyperparameters: described.collect(),
        metrics: metrics.collect(),
    });
    let value = |tag: &str, part: Part| Value {
        tag: tag.to_owned(),
        simple_value: None,
        metadata: Some(Metadata {
            plugin_data: Some(PluginData {
                plugin_name: "hparams".to_owned(),
                content: Hyperparameters { part: Some(part) }.encode_to_vec(),
            }),
        }),
    };
    let value = vec![
        value("_hparams_/experiment", experiment),
        value(
            "_hparams_/session_start_info",
            Part::Session(Session { hyperparameters }),
        ),
    ];
    [record(0, version), record(0, What::Summary(Summary { value }))].concat()
}

/// The record of a step's named numbers.
pub fn scalars<'n>(step: u64, values: impl Iterator<Item = (&'n str, f64)>) -> Vec<u8> {
    let value = values
        .map(|(name, value)| Value {
            tag: name.to_owned(),
            simple_value: Some(value as f32),
            metadata: None,
        })
        .collect();
    record(step, What::Summary(Summary { value }))
}

/// A record's time is its step in seconds: equal runs leave equal files.
fn record(step: u64, what: What) -> Vec<u8> {
    let event = Event {
        wall_time: step as f64,
        step: step.cast_signed(),
        what: Some(what),
    };
    let data = event.encode_to_vec();
    let length = (data.len() as u64).to_le_bytes();
    let mut bytes = Vec::with_capacity(data.len() + FRAME);
    bytes.extend(length);
    bytes.extend(masked_checksum(&length).to_le_bytes());
    bytes.extend(&data);
    bytes.extend(masked_checksum(&data).to_le_bytes());
    bytes
}

/// TensorFlow stores no plain checksum, so that data which themselves hold records are safe.
fn masked_checksum(data: &[u8]) -> u32 {
    CHECKSUM.checksum(data).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_specification() {
        // RFC 3720 B.4: 32 bytes of zeros, of ones, ascending.
        assert_eq!(CHECKSUM.checksum(&[0; 32]), 0x8a91_36aa);
        assert_eq!(CHECKSUM.checksum(&[0xff; 32]), 0x62a8_ab43);
        let ascending: Vec<u8> = (0..32).collect();
        assert_eq!(CHECKSUM.checksum(&ascending), 0x46dd_794e);
    }

    /// These bytes were read back with TensorBoard's own reader; `tests/check_exports.py` reads a whole run.
    #[test]
    fn records_have_the_bytes_that_tensorboard_reads() {
        let bytes = scalars(3, [("age", 0.0)].into_iter());
        let hexadecimal: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(
            hexadecimal,
            "19000000000000008bf1082809000000000000084010032a0c0a0a0a03616765150000000051dd5603"
        );
    }
}
