//! A table as it travels: with a version, and signed.
//!
//! # Layout
//! Little-endian; offsets in bytes.
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | 4 bytes | magic `FLPK` |
//! | 4 | u32 | format, 1 |
//! | 8 | u32 | version of the table, counted up by whoever signs |
//! | 12 | u32 | length of the table |
//! | 16 | bytes | the table ([`crate::table`]), whose last four bytes are its CRC-32 |
//! | 16 + length | 64 bytes | Ed25519 signature (RFC 8032) of everything before |

use super::key::{self, Key};
use super::{MAX_PACKAGE, PackageError};
use crate::table::Table;

/// First bytes of a package.
pub const MAGIC: [u8; 4] = *b"FLPK";
/// The format.
pub const FORMAT: u32 = 1;
/// Bytes before the table.
pub const HEADER_LEN: usize = 16;
/// Bytes after it.
pub const SIGNATURE_LEN: usize = 64;
/// The shortest package: one with an empty table, which no check passes.
pub const MIN_PACKAGE: usize = HEADER_LEN.saturating_add(SIGNATURE_LEN);

/// A checked package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Package<'p> {
    /// Its version.
    pub version: u32,
    /// Its table, which parses.
    pub table: &'p [u8],
}

impl<'p> Package<'p> {
    /// Checks the package at the front of `bytes`; what follows it is not looked at.
    ///
    /// The cheap checks come first, so that noise costs no signature check. All of them must hold.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn check(bytes: &'p [u8], key: &Key) -> Result<Self, PackageError> {
        let (header, rest) = bytes
            .split_first_chunk::<HEADER_LEN>()
            .ok_or(PackageError::Truncated)?;
        let (words, _) = header.as_chunks::<4>();
        let [magic, format, version, length] = *words else {
            return Err(PackageError::Header);
        };
        if magic != MAGIC || u32::from_le_bytes(format) != FORMAT {
            return Err(PackageError::Header);
        }
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_PACKAGE.saturating_sub(MIN_PACKAGE) {
            return Err(PackageError::Header);
        }
        let (table, rest) = rest.split_at_checked(length).ok_or(PackageError::Truncated)?;
        let signature = rest
            .first_chunk::<SIGNATURE_LEN>()
            .ok_or(PackageError::Truncated)?;
        let version = u32::from_le_bytes(version);
        if version < key::MINIMUM_VERSION {
            return Err(PackageError::Version(version));
        }
        Table::parse(table).map_err(PackageError::Table)?;
        let signed = bytes
            .get(..HEADER_LEN.saturating_add(length))
            .ok_or(PackageError::Truncated)?;
        if !key.verifies(signed, signature) {
            return Err(PackageError::Signature);
        }
        Ok(Self { version, table })
    }
}
