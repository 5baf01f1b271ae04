//! Weight tables over the air: two flash slots, signed packages, and always one table that can be run.
//!
//! A [`package`] is a table behind a signed header. An update begins with the header alone, and only if that is signed and newer than all
//! before, and if no table is on trial, is anything erased. The table goes into the slot that is not confirmed; when its digest is the header's,
//! one mark makes it complete. Power may fail at any point before or after.
//!
//! # Trial
//! A complete table is not yet trusted. The unit first sees how it does with the table it has, for a window of [`Health`], then runs the new
//! one for a window, and compares: a table that does as well is **confirmed**, any other is **rejected** and the one before runs on.
//! A table that does not live to its verdict within [`MAX_STARTS`] starts is rejected, too. At boot the confirmed one with the highest
//! version runs; with none, the table that is built into the image.
//!
//! # Rollback
//! A package must have a version above every one that was confirmed or rejected, and at least [`key::MINIMUM_VERSION`]. A version counts
//! tables of one signing key, not images. Nobody without the key can make a package, so only packages that were signed once can be
//! played again. What is past stands in three places, the two slots and the [`record`], so damage to one of them does not bring it
//! back. The largest version is refused, since nothing could follow it.
//!
//! # Wear
//! Every erase takes a place in the record, which has [`record::PLACES`] and is never erased; after [`MAX_ERASES`] of them no further one
//! happens before the next start.
//!
//! # While it runs
//! [`TableStore::check_running`] re-reads the running table piece by piece. When its checksum no longer fits, another table runs.
//!
//! The store owns no bytes of the flash: a board gives it [`SlotFlash`], and the tests a simulated one whose power fails at
//! every single write and erase, and that lies.

pub mod key;
pub mod package;
pub mod record;
mod running;
mod slots;
mod update;
mod words;

pub use key::Key;
pub use slots::{MAX_STARTS, MAX_TABLE, SLOT_LEN, Slot, Stored, TABLE_OFFSET, inspect};
pub use update::{MAX_ERASES, MAX_PACKAGE, Updating};
pub use words::WORD;

use crate::health::Health;
use crate::link::{Refusal, TableStatus, Trial};
use crate::table::TableError;
use embedded_storage::nor_flash::NorFlash;
use record::Record;
use running::Check;
use slots::Mark;

/// Bytes of the store's flash: the record, then the slots.
pub const FLASH_LEN: usize = 3 * SLOT_LEN;

/// Flash of a record and two slots from offset 0 on, each of [`SLOT_LEN`], which can also be read in place.
///
/// Words of any size that divides [`WORD`] will do. Everything that is read in place was read through
/// [`read`](embedded_storage::nor_flash::ReadNorFlash::read) before: where a damaged word is a fault of the bus (flash with error
/// correction), that is the place to say so instead.
pub trait SlotFlash: NorFlash {
    /// What an erased byte reads as: 0xff with most flash, 0x00 with that of STM32L0 and L1.
    const ERASED: u8;

    /// A slot's bytes as they are now.
    fn mapped(&self, slot: Slot) -> &[u8];
}

/// Why a slot's content is not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PackageError {
    /// No mark: the slot is empty or an update did not come to its end.
    NotComplete,
    /// It failed its trial.
    Rejected,
    /// The flash cannot read it.
    Unreadable,
    /// Too short for a header, the magic, or the format.
    Header,
    /// The table is empty or does not fit a slot, or its bytes are not as many.
    Length(u32),
    /// The version is below [`key::MINIMUM_VERSION`], or above [`package::MAX_VERSION`].
    Version(u32),
    /// The signature is not that of the key.
    Signature,
    /// The table is not the one that the header was signed for.
    Digest,
    /// The table inside.
    Table(TableError),
}

impl core::fmt::Display for PackageError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotComplete => formatter.write_str("not complete"),
            Self::Rejected => formatter.write_str("rejected after its trial"),
            Self::Unreadable => formatter.write_str("flash that cannot be read"),
            Self::Header => formatter.write_str("no header of this format"),
            Self::Length(length) => write!(formatter, "length {length} does not fit"),
            Self::Version(version) => write!(formatter, "version {version} is out of range"),
            Self::Signature => formatter.write_str("signed with another key, or changed"),
            Self::Digest => formatter.write_str("another table than the header was signed for"),
            Self::Table(error) => write!(formatter, "table: {error}"),
        }
    }
}

impl core::error::Error for PackageError {}

impl From<PackageError> for Refusal {
    fn from(error: PackageError) -> Self {
        match error {
            PackageError::NotComplete | PackageError::Rejected | PackageError::Header => Self::Header,
            PackageError::Unreadable => Self::Flash,
            PackageError::Length(_) => Self::Length,
            PackageError::Version(_) => Self::Version,
            PackageError::Signature => Self::Signature,
            PackageError::Digest => Self::Digest,
            PackageError::Table(_) => Self::Table,
        }
    }
}

/// Both slots, the record, the update under way and the trial.
#[derive(Debug)]
pub struct TableStore<F> {
    flash: F,
    key: Key,
    built_in: &'static [u8],
    record: Record,
    held: [Option<Stored>; 2],
    /// How the confirmed or built-in table did, last.
    before: Option<Health>,
    /// How the table before did, while the one on trial runs.
    trial: Option<Health>,
    check: Check,
    updating: Option<Updating>,
    /// An update whose slot was erased, before the modem started over.
    interrupted: Option<Updating>,
    completed: Option<u32>,
    erases_left: u8,
}

impl<F: SlotFlash> TableStore<F> {
    /// Looks at both slots. The confirmed table with the highest version runs, of equal ones the first; with none, the one that is built in.
    pub fn boot(mut flash: F, key: Key, built_in: &'static [u8]) -> Self {
        let record = Record::read(&mut flash);
        let held = Slot::ALL.map(|slot| match inspect(&mut flash, slot, &key) {
            Ok(found) => Some(found),
            Err(PackageError::NotComplete) => None,
            Err(_error) => {
                crate::fmt::log_warning!("table slot {}: {}", slot, _error);
                None
            }
        });
        Self {
            flash,
            key,
            built_in,
            record,
            held,
            before: None,
            trial: None,
            check: Check::new(),
            updating: None,
            interrupted: None,
            completed: None,
            erases_left: MAX_ERASES,
        }
    }

    /// The stored table that runs; without one, the built-in table does.
    pub fn running(&self) -> Option<Stored> {
        if self.trial.is_some() {
            self.candidate()
        } else {
            self.confirmed()
        }
    }

    /// Whether the running table is on trial.
    pub const fn is_on_trial(&self) -> bool {
        self.trial.is_some()
    }

    /// The running table's bytes.
    pub fn running_bytes(&self) -> &[u8] {
        match self.running() {
            Some(stored) => stored.table(self.flash.mapped(stored.slot)),
            None => self.built_in,
        }
    }

    /// The checksum that the running table states.
    fn running_checksum(&self) -> u32 {
        let built_in = || self.built_in.last_chunk().copied().map_or(0, u32::from_le_bytes);
        self.running().map_or_else(built_in, |stored| stored.checksum)
    }

    #[inline(never)]
    fn confirmed(&self) -> Option<Stored> {
        let confirmed = self.held.into_iter().flatten().filter(|stored| stored.confirmed);
        confirmed.reduce(newer)
    }

    /// The complete table that has no verdict yet.
    #[inline(never)]
    pub fn candidate(&self) -> Option<Stored> {
        let confirmed = self.confirmed().map_or(0, |stored| stored.version);
        let waiting = self.held.into_iter().flatten();
        waiting
            .filter(|stored| !stored.confirmed && stored.version > confirmed)
            .reduce(newer)
    }

    /// The highest version that is past: only what is above it is taken.
    pub fn floor(&self) -> u32 {
        let held = self.held.iter().flatten();
        let confirmed = held
            .filter(|stored| stored.confirmed)
            .map(|stored| stored.version);
        confirmed
            .fold(self.record.floor, u32::max)
            .max(key::MINIMUM_VERSION.saturating_sub(1))
    }

    /// Takes in a window of a unit's health. Says whether another table runs from now on: it may start a trial, or end one.
    #[inline(never)]
    pub fn judge(&mut self, window: &Health) -> bool {
        if window.checksum != self.running_checksum() {
            // Of a table that ran before.
            return false;
        }
        match (self.trial, self.candidate()) {
            (Some(before), Some(candidate)) => {
                self.trial = None;
                if window.is_worse_than(&before) {
                    self.reject(candidate);
                    return true;
                }
                self.before = Some(*window);
                self.confirm(candidate);
                false
            }
            _ => {
                self.before = Some(*window);
                self.start_trial()
            }
        }
    }

    /// Starts the table that waits, if it is known how the present one does.
    #[inline(never)]
    fn start_trial(&mut self) -> bool {
        let (Some(candidate), Some(before)) = (self.candidate(), self.before) else {
            return false;
        };
        // A table that has no start left has lived to no verdict.
        if Mark::Start.set(&mut self.flash, candidate.slot).is_none() {
            self.reject(candidate);
            return false;
        }
        self.trial = Some(before);
        self.check = Check::new();
        true
    }

    fn confirm(&mut self, candidate: Stored) {
        // First what is past: between the two the table is on trial still, and its trial goes on with the next start.
        let noted = self.record.raise_floor(&mut self.flash, candidate.version);
        let marked = Mark::Confirmed.set(&mut self.flash, candidate.slot);
        if noted.and(marked).is_none() {
            crate::fmt::log_warning!(
                "version {} passed its trial, but the flash does not keep it",
                candidate.version
            );
        }
        self.hold(Stored {
            confirmed: true,
            ..candidate
        });
    }

    fn reject(&mut self, candidate: Stored) {
        let noted = self.record.raise_floor(&mut self.flash, candidate.version);
        let marked = Mark::Rejected.set(&mut self.flash, candidate.slot);
        if noted.and(marked).is_none() {
            crate::fmt::log_warning!(
                "version {} is rejected, but the flash does not keep it",
                candidate.version
            );
        }
        self.drop_slot(candidate.slot);
    }

    /// Where a slot's content is kept.
    fn hold(&mut self, stored: Stored) {
        if let Some(held) = self.held.get_mut(stored.slot as usize) {
            *held = Some(stored);
        }
    }

    /// Forgets a slot's content.
    #[inline(never)]
    fn drop_slot(&mut self, slot: Slot) {
        if let Some(held) = self.held.get_mut(slot as usize) {
            *held = None;
        }
        self.trial = None;
        self.check = Check::new();
    }

    /// What there is to say of it.
    pub fn status(&self) -> TableStatus {
        TableStatus {
            version: self.running().map_or(0, |stored| stored.version),
            checksum: self.running_checksum(),
            trial: match self.candidate() {
                None => Trial::None,
                Some(_) if self.is_on_trial() => Trial::Running,
                Some(waiting) => Trial::Waiting(waiting.version),
            },
            floor: self.floor(),
            erases: self.record.erases,
        }
    }

    /// The flash.
    pub const fn flash(&self) -> &F {
        &self.flash
    }

    /// The flash, to change it from outside, as time does.
    pub const fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }
}

/// The newer of two tables, of equal ones the first.
fn newer(first: Stored, second: Stored) -> Stored {
    if second.version > first.version {
        second
    } else {
        first
    }
}
