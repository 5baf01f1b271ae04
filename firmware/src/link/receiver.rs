//! Bytes to frames.

use super::MAX_FRAME;
use crate::table::CHECKSUM;
use cobs::{DecodeResult, DecoderState};
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
            Some(decode(&self.bytes))
        };
        self.bytes.clear();
        self.overflowed = false;
        outcome
    }
}

fn decode<T: DeserializeOwned>(wire: &[u8]) -> Result<T, LinkError> {
    let fields = unstuff(wire)?;
    let (frame, rest) =
        postcard::take_from_bytes_crc32(&fields, CHECKSUM.digest()).map_err(|_| LinkError::Contents)?;
    // Bytes behind the checksum belong to no frame.
    if rest.is_empty() {
        Ok(frame)
    } else {
        Err(LinkError::Contents)
    }
}

/// Undoes the byte stuffing. Byte by byte, because `cobs::decode_in_place` indexes a slice in a way that the compiler cannot
/// prove to stay inside, and would bring the only panic into the image.
fn unstuff(wire: &[u8]) -> Result<Vec<u8, MAX_FRAME>, LinkError> {
    let mut fields = Vec::new();
    let mut decoder = DecoderState::default();
    for &byte in wire {
        if let DecodeResult::DataContinue(byte) = decoder.feed(byte).map_err(|_| LinkError::Stuffing)? {
            fields.push(byte).map_err(|_| LinkError::TooLong)?;
        }
    }
    match decoder.feed(0) {
        Ok(DecodeResult::DataComplete) => Ok(fields),
        _ => Err(LinkError::Stuffing),
    }
}
