//! A table, or a whole image, as it travels: behind a header that is signed, and that says everything about it.
//!
//! # Layout
//! Little-endian; offsets in bytes.
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | 4 bytes | magic: `FLPK` for a table, `FLIM` for an image |
//! | 4 | u32 | format, 2 |
//! | 8 | u32 | version, counted up by whoever signs, tables and images apart; never the largest, which nothing could follow |
//! | 12 | u32 | length of what follows the header |
//! | 16 | 48 bytes | digest of that: the first of its SHA-512 |
//! | 64 | 64 bytes | Ed25519 signature (RFC 8032) of everything before |
//! | 128 | bytes | the table ([`crate::table`]), whose last four bytes are its CRC-32; or the image as it lies in flash |
//!
//! The header comes first and is signed by itself, so a unit knows before it erases anything whether it wants what follows.

use super::key::{self, DIGEST_LEN, Key};
use super::{MAX_TABLE, PackageError, WORD};

/// What a package brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// A table of weights.
    Table,
    /// An image.
    Image,
}

impl Content {
    /// First bytes of a package.
    pub const fn magic(self) -> [u8; 4] {
        match self {
            Self::Table => *b"FLPK",
            Self::Image => *b"FLIM",
        }
    }

    /// The most bytes behind a header. How long an image may be, its place in flash says.
    const fn most(self) -> usize {
        match self {
            Self::Table => MAX_TABLE,
            Self::Image => u32::MAX as usize,
        }
    }
}

/// The format.
pub const FORMAT: u32 = 2;
/// Bytes before the content.
pub const HEADER_LEN: usize = 128;
/// Bytes of the header that are signed.
pub const SIGNED_LEN: usize = 64;
/// The largest version: nothing could follow the one after it.
pub const MAX_VERSION: u32 = u32::MAX.saturating_sub(1);

/// A header's bytes, as they travel. They may be anything until they are [checked](Header::check).
pub type HeaderBytes = [[u8; WORD]; HEADER_LEN / WORD];

/// What a header says of its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The content's version.
    pub version: u32,
    /// Its length in bytes.
    pub length: u32,
    /// Its [`Digest`](key::Digest).
    pub digest: [u8; DIGEST_LEN],
}

impl Header {
    /// Reads a header and checks its form alone.
    ///
    /// # Errors
    /// [`PackageError::Header`].
    pub fn read(bytes: &HeaderBytes, content: Content) -> Result<Self, PackageError> {
        let (words, rest) = bytes
            .as_flattened()
            .split_first_chunk()
            .ok_or(PackageError::Header)?;
        let words: &[u8; 16] = words;
        let [magic, format, version, length] = *words.as_chunks::<4>().0 else {
            return Err(PackageError::Header);
        };
        if magic != content.magic() || u32::from_le_bytes(format) != FORMAT {
            return Err(PackageError::Header);
        }
        Ok(Self {
            version: u32::from_le_bytes(version),
            length: u32::from_le_bytes(length),
            digest: *rest.first_chunk().ok_or(PackageError::Header)?,
        })
    }

    /// Reads a header and checks everything that it says. The cheap checks come first, so that noise costs no signature check.
    ///
    /// # Errors
    /// The first check that fails.
    #[inline(never)]
    pub fn check(bytes: &HeaderBytes, content: Content, key: &Key) -> Result<Self, PackageError> {
        let header = Self::read(bytes, content)?;
        if header.length == 0 || header.length as usize > content.most() {
            return Err(PackageError::Length(header.length));
        }
        if header.version < key::MINIMUM_VERSION || header.version > MAX_VERSION {
            return Err(PackageError::Version(header.version));
        }
        let (signed, signature) = bytes.as_flattened().split_at(SIGNED_LEN);
        match signature.first_chunk() {
            Some(signature) if key.verifies(signed, signature) => Ok(header),
            _ => Err(PackageError::Signature),
        }
    }
}
