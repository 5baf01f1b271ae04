//! Event files that TensorBoard reads: one scalar summary an episode.
//!
//! # Source
//! TensorFlow's `record_writer.h` (framing, masked CRC-32C), `event.proto` and `summary.proto` (field numbers).

use prost::Message as _;

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
}

/// The record that begins a file.
pub fn header(wall_time_s: f64) -> Vec<u8> {
    let version = What::FileVersion("brain.Event:2".to_owned());
    record(wall_time_s, 0, version)
}

/// The record of a step's named numbers.
pub fn scalars<'n>(wall_time_s: f64, step: u64, values: impl Iterator<Item = (&'n str, f64)>) -> Vec<u8> {
    let value = values
        .map(|(name, value)| Value {
            tag: name.to_owned(),
            simple_value: Some(value as f32),
        })
        .collect();
    record(wall_time_s, step, What::Summary(Summary { value }))
}

fn record(wall_time: f64, step: u64, what: What) -> Vec<u8> {
    let event = Event {
        wall_time,
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

/// Length in bytes of the first `records` whole records; `None` if there are fewer.
pub fn length_of(bytes: &[u8], records: u64) -> Option<u64> {
    let mut position = 0;
    for _ in 0..records {
        let rest = bytes.get(position..)?;
        let (length, after) = rest.split_first_chunk::<8>()?;
        let (checksum, _) = after.split_first_chunk::<4>()?;
        if masked_checksum(length) != u32::from_le_bytes(*checksum) {
            return None;
        }
        let whole = usize::try_from(u64::from_le_bytes(*length))
            .ok()?
            .checked_add(FRAME)?;
        position = (rest.len() >= whole).then(|| position + whole)?;
    }
    Some(position as u64)
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

    #[test]
    fn a_file_can_be_cut_to_its_whole_records() {
        let mut bytes = header(0.0);
        let first = bytes.len() as u64;
        bytes.extend(scalars(0.0, 1, [("a", 1.0)].into_iter()));
        let all = bytes.len() as u64;
        assert_eq!(length_of(&bytes, 0), Some(0));
        assert_eq!(length_of(&bytes, 1), Some(first));
        assert_eq!(length_of(&bytes, 2), Some(all));
        assert_eq!(length_of(&bytes, 3), None);
        assert_eq!(length_of(&bytes[..bytes.len() - 1], 2), None);
        bytes[0] ^= 1;
        assert_eq!(length_of(&bytes, 1), None);
    }
}
