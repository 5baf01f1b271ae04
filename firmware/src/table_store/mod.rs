//! Weight tables over the air: two flash slots, signed packages, and always one table that can be run.
//!
//! A [`package`] is a table with a version and an Ed25519 signature. The store writes a new one into the slot that is not
//! running, checks it there, and only then writes the slot's marker: that one word is the activation. Power may fail at any
//! point before or after. At boot the valid slot with the highest version runs; with none, the table that is built into the image.
//!
//! The store owns no bytes of the flash: a board gives it [`SlotFlash`], and the tests a simulated one whose power fails at
//! every single write and erase.
//!
//! # Rollback
//! A package must have a version above the one that runs, and at least [`key::MINIMUM_VERSION`]. A version counts tables of one
//! signing key, not images. Nobody without the key can make a package, so only packages that were signed once can be played again.
//! The floor is the version that runs: while the built-in table runs it is [`key::MINIMUM_VERSION`], and after damage to the newest
//! slot it is the older one's. Raise [`key::MINIMUM_VERSION`] in a new image to withdraw versions for good, and never sign the
//! largest one, which nothing could follow.

pub mod key;
pub mod package;
mod update;

pub use key::Key;
pub use update::Updating;

use crate::link::Refusal;
use crate::table::TableError;
use embedded_storage::nor_flash::NorFlash;
use package::Package;

/// Bytes of a slot: one 16 KiB sector of the STM32F405 (RM0090 table 5), which erases in a quarter of a second where the
/// large ones take one to two.
pub const SLOT_LEN: usize = 16 << 10;

/// Bytes before a slot's package: the marker, and room that keeps the package on a flash line of 128 bits.
pub const MARKER_LEN: usize = 16;

/// The first word of an active slot; the other words up to [`MARKER_LEN`] stay erased.
pub const MARKER: [u8; 4] = *b"LIVE";

/// The longest package.
pub const MAX_PACKAGE: usize = SLOT_LEN.saturating_sub(MARKER_LEN);

/// One of the two places for a package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Slot {
    /// The first.
    A,
    /// The second.
    B,
}

impl Slot {
    /// Both.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// Where it begins in the store's flash.
    pub const fn offset(self) -> u32 {
        match self {
            Self::A => 0,
            Self::B => SLOT_LEN as u32,
        }
    }
}

/// Flash of two slots from offset 0 on, which can also be read in place.
pub trait SlotFlash: NorFlash {
    /// A slot's bytes as they are now.
    fn slot(&self, slot: Slot) -> &[u8];
}

/// A slot whose package is valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Active {
    /// Which.
    pub slot: Slot,
    /// The package's version.
    pub version: u32,
    /// The table's length; it begins at [`TABLE_OFFSET`].
    pub table_len: usize,
}

/// Where a slot's table begins.
pub const TABLE_OFFSET: usize = MARKER_LEN.saturating_add(package::HEADER_LEN);

impl Active {
    /// The table among its slot's bytes.
    pub fn table<'f>(&self, slot: &'f [u8]) -> &'f [u8] {
        slot.get(TABLE_OFFSET..)
            .and_then(|rest| rest.get(..self.table_len))
            .unwrap_or(&[])
    }
}

/// Why a slot's content is not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PackageError {
    /// No marker: the slot is empty or an update did not come to its end.
    NotActivated,
    /// Too few bytes for what the header says, or for a header.
    Truncated,
    /// The magic, the format or the length.
    Header,
    /// The version is below [`key::MINIMUM_VERSION`].
    Version(u32),
    /// The table inside.
    Table(TableError),
    /// The signature is not that of the key.
    Signature,
}

impl From<PackageError> for Refusal {
    fn from(error: PackageError) -> Self {
        match error {
            PackageError::NotActivated | PackageError::Header => Self::Header,
            PackageError::Truncated => Self::Incomplete,
            PackageError::Version(_) => Self::Version,
            PackageError::Table(_) => Self::Table,
            PackageError::Signature => Self::Signature,
        }
    }
}

/// The valid content of a slot.
///
/// # Errors
/// The first check that fails.
pub fn inspect(slot: Slot, bytes: &[u8], key: &Key) -> Result<Active, PackageError> {
    let package = bytes
        .strip_prefix(&MARKER)
        .and_then(|rest| rest.get(MARKER_LEN.saturating_sub(MARKER.len())..))
        .ok_or(PackageError::NotActivated)?;
    let package = Package::check(package, key)?;
    Ok(Active {
        slot,
        version: package.version,
        table_len: package.table.len(),
    })
}

/// Both slots, and the update under way.
#[derive(Debug)]
pub struct TableStore<F> {
    flash: F,
    key: Key,
    active: Option<Active>,
    updating: Option<Updating>,
}

impl<F: SlotFlash> TableStore<F> {
    /// Looks at both slots and keeps the valid one with the highest version; of equal ones the first.
    pub fn boot(flash: F, key: Key) -> Self {
        let mut active: Option<Active> = None;
        for slot in Slot::ALL {
            match inspect(slot, flash.slot(slot), &key) {
                Ok(found) if active.is_none_or(|active| found.version > active.version) => {
                    active = Some(found)
                }
                Ok(_) | Err(PackageError::NotActivated) => {}
                Err(_error) => crate::fmt::log_warning!("table slot {}: {}", slot, _error),
            }
        }
        Self {
            flash,
            key,
            active,
            updating: None,
        }
    }

    /// The slot that runs; without one, the built-in table does.
    pub const fn active(&self) -> Option<Active> {
        self.active
    }

    /// The flash.
    pub const fn flash(&self) -> &F {
        &self.flash
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }
}
