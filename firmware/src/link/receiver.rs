//! Bytes to frames.

use super::{Frame, MAX_FRAME};
use crate::table::CHECKSUM;

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
#[derive(Clone, Debug)]
pub struct Receiver {
    bytes: [u8; MAX_FRAME],
    length: usize,
    overflowed: bool,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self {
            bytes: [0; MAX_FRAME],
            length: 0,
            overflowed: false,
        }
    }

    /// Takes one byte. `None` while a frame is incomplete and for an empty frame.
    pub fn push<T: Frame>(&mut self, byte: u8) -> Option<Result<T, LinkError>> {
        let fields = self.take(&mut &[byte][..])?;
        Some(fields.and_then(|fields| T::read(fields).ok_or(LinkError::Contents)))
    }

    /// Takes bytes from the front of `bytes`, up to the end of a frame or all of them, and gives the frame's fields. `None` while a frame is
    /// incomplete and for an empty frame.
    pub fn take(&mut self, bytes: &mut &[u8]) -> Option<Result<&[u8], LinkError>> {
        let room = self.bytes.get_mut(self.length..).unwrap_or_default();
        let copied = copy_to_zero(bytes, room);
        self.length = self.length.saturating_add(copied);
        let mut rest = bytes.get(copied..).unwrap_or_default();
        if rest.first().is_some_and(|&byte| byte != 0) {
            self.overflowed = true;
            let end = rest.iter().position(|&byte| byte == 0).unwrap_or(rest.len());
            rest = rest.get(end..).unwrap_or_default();
        }
        let delimiter;
        (delimiter, *bytes) = rest.split_at_checked(1).unwrap_or_default();
        if delimiter.is_empty() {
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.overflowed) {
            return Some(Err(LinkError::TooLong));
        }
        let wire = self.bytes.get_mut(..length).filter(|wire| !wire.is_empty())?;
        Some(checked(wire))
    }
}

/// Copies bytes up to the first zero, the end, or as long as there is room, and says how many; four at a time as far as that goes.
fn copy_to_zero(bytes: &[u8], room: &mut [u8]) -> usize {
    let mut copied = 0_usize;
    let (words, _) = bytes.as_chunks::<4>();
    for (&word, place) in words.iter().zip(room.as_chunks_mut().0) {
        // A byte that is 0 borrows, and had no highest bit to begin with.
        let number = u32::from_le_bytes(word);
        if number.wrapping_sub(0x0101_0101) & !number & 0x8080_8080 != 0 {
            break;
        }
        *place = word;
        copied = copied.wrapping_add(4);
    }
    let rest = bytes.get(copied..).unwrap_or_default();
    let room = room.get_mut(copied..).unwrap_or_default();
    for (&byte, place) in rest.iter().zip(room) {
        if byte == 0 {
            break;
        }
        *place = byte;
        copied = copied.wrapping_add(1);
    }
    copied
}

/// The fields, if their checksum is right.
fn checked(wire: &mut [u8]) -> Result<&[u8], LinkError> {
    let (fields, checksum) = unstuff(wire)?.split_last_chunk().ok_or(LinkError::Contents)?;
    // The checksum at once and not byte by byte as fields are read, which takes three times as long.
    if CHECKSUM.checksum(fields) != u32::from_le_bytes(*checksum) {
        return Err(LinkError::Contents);
    }
    Ok(fields)
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
