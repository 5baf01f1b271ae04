//! Bytes to frames.

use super::MAX_FRAME;
use crate::table::CHECKSUM;
use heapless::Vec;
use serde::de::DeserializeOwned;

/// Why bytes are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LinkError {
    /// More bytes than any frame has without a delimiter.
    TooLong,
    /// The byte stuffing is broken.
    Stuffing,
    /// The checksum or the fields do not fit.
    Contents,
    /// A frame does not fit its buffer.
    Encoding,
}

impl core::fmt::Display for LinkError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TooLong => "no delimiter within the longest frame",
            Self::Stuffing => "broken byte stuffing",
            Self::Contents => "checksum or fields do not fit",
            Self::Encoding => "frame longer than its buffer",
        })
    }
}

impl core::error::Error for LinkError {}

/// Collects bytes until a delimiter and decodes what came before it. A damaged frame costs itself only: the next
/// delimiter starts anew.
#[derive(Clone, Debug, Default)]
pub struct Receiver {
    bytes: Vec<u8, MAX_FRAME>,
    overflowed: bool,
}

impl Receiver {
    /// Takes one byte. `None` while a frame is incomplete and for an empty frame.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<T, LinkError>> {
        if byte != 0 {
            self.overflowed |= self.bytes.push(byte).is_err();
            return None;
        }
        let outcome = if self.overflowed {
            Some(Err(LinkError::TooLong))
        } else if self.bytes.is_empty() {
            None
        } else {
            Some(decode(&mut self.bytes))
        };
        self.bytes.clear();
        self.overflowed = false;
        outcome
    }
}

fn decode<T: DeserializeOwned>(wire: &mut [u8]) -> Result<T, LinkError> {
    let (fields, checksum) = unstuff(wire)?.split_last_chunk().ok_or(LinkError::Contents)?;
    // The checksum at once and not byte by byte as fields are read, which takes three times as long.
    if CHECKSUM.checksum(fields) != u32::from_le_bytes(*checksum) {
        return Err(LinkError::Contents);
    }
    match postcard::take_from_bytes(fields) {
        // Bytes behind the fields belong to no frame.
        Ok((frame, [])) => Ok(frame),
        _ => Err(LinkError::Contents),
    }
}

/// Undoes the byte stuffing in place. Every block begins with its length, where a zero was; none is as long as COBS's longest, behind
/// which was none, since no frame is.
fn unstuff(wire: &mut [u8]) -> Result<&[u8], LinkError> {
    let mut rest = &mut *wire;
    while let Some(first) = rest.first_mut() {
        let length = usize::from(core::mem::take(first)).max(1);
        (_, rest) = rest.split_at_mut_checked(length).ok_or(LinkError::Stuffing)?;
    }
    wire.get(1..).ok_or(LinkError::Stuffing)
}

const _: () = assert!(MAX_FRAME < 255, "blocks of COBS hold at most 254 bytes");
