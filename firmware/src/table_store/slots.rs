//! The two places for packages, and what is in them.
//!
//! # Layout of a slot
//! Everything lies at multiples of a [word](super::words::WORD); offsets in bytes.
//!
//! | offset | content |
//! |---|---|
//! | 0 | mark: the package is complete |
//! | 32, 64, 96 | marks: the table was started on trial, once each |
//! | 128, 160 | mark: confirmed |
//! | 192, 224 | mark: rejected |
//! | 256 | the package: its header, 128 bytes |
//! | 384 | its table |

use super::key::Digest;
use super::package::{Content, HEADER_LEN, Header, HeaderBytes};
use super::words::{MARK, WORD, is_blank, is_marked, read, write};
use super::{Key, PackageError, SlotFlash};
use crate::table::Table;

/// Bytes of a slot: one 16 KiB sector of the STM32F405 (RM0090 table 5), which erases in a quarter of a second where the
/// large ones take one to two.
pub const SLOT_LEN: usize = 16 << 10;

/// Starts of a table on trial: one that does not live to its verdict so often is rejected (chosen).
pub const MAX_STARTS: u32 = 3;

/// Words of marks.
const MARKS: u32 = 8;

/// Where a slot's package begins.
const PACKAGE_OFFSET: usize = MARKS as usize * WORD;
/// Where its table does.
pub const TABLE_OFFSET: usize = PACKAGE_OFFSET.saturating_add(HEADER_LEN);
/// The longest table.
pub const MAX_TABLE: usize = SLOT_LEN.saturating_sub(TABLE_OFFSET);

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

    /// Where it begins in the store's flash, behind the record.
    pub const fn offset(self) -> u32 {
        match self {
            Self::A => SLOT_LEN as u32,
            Self::B => (2 * SLOT_LEN) as u32,
        }
    }
}

/// A table that a slot holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stored {
    /// Where.
    pub slot: Slot,
    /// Its version.
    pub version: u32,
    /// Its length; it begins at [`TABLE_OFFSET`].
    pub table_len: usize,
    /// Its own checksum.
    pub checksum: u32,
    /// Whether it passed its trial.
    pub confirmed: bool,
}

impl Stored {
    /// The table among its slot's bytes.
    pub fn table<'f>(&self, slot: &'f [u8]) -> &'f [u8] {
        slot.get(TABLE_OFFSET..)
            .and_then(|rest| rest.get(..self.table_len))
            .unwrap_or(&[])
    }
}

/// A slot's marks.
#[derive(Clone, Copy)]
pub enum Mark {
    /// The package is complete.
    Complete,
    /// The table was started on trial: set once more each time.
    Start,
    /// It passed.
    Confirmed,
    /// It did not.
    Rejected,
}

impl Mark {
    /// The words for it. Verdicts have two, since a word that a power cut left half-written cannot be written again.
    const fn words(self) -> core::ops::Range<u32> {
        match self {
            Self::Complete => 0..1,
            Self::Start => 1..1 + MAX_STARTS,
            Self::Confirmed => 4..6,
            Self::Rejected => 6..MARKS,
        }
    }

    /// Sets the next blank one of its words; `None` if there is none that takes it.
    #[inline(never)]
    pub fn set<F: SlotFlash>(self, flash: &mut F, slot: Slot) -> Option<()> {
        self.words().find_map(|word| {
            let offset = mark_offset(slot, word);
            let blank = read(flash, offset).is_some_and(|word| is_blank::<F>(&word));
            blank.then(|| write(flash, offset, &MARK))?
        })
    }

    /// Whether one of its words is set; an unreadable one is not.
    #[inline(never)]
    pub fn is_set<F: SlotFlash>(self, flash: &mut F, slot: Slot) -> bool {
        self.words().any(|word| {
            let word = read(flash, mark_offset(slot, word));
            word.is_some_and(|word| is_marked::<F>(&word))
        })
    }
}

const fn mark_offset(slot: Slot, word: u32) -> u32 {
    slot.offset().saturating_add(word.saturating_mul(WORD as u32))
}

/// Erases a slot, sees that it is, and writes a package's header into it.
#[inline(never)]
pub fn prepare<F: SlotFlash>(flash: &mut F, slot: Slot, header: &HeaderBytes) -> Option<()> {
    let (begin, len) = (slot.offset(), SLOT_LEN as u32);
    flash.erase(begin, begin.saturating_add(len)).ok()?;
    for offset in (0..len).step_by(WORD) {
        let word = read(flash, begin.saturating_add(offset))?;
        if !is_blank::<F>(&word) {
            return None;
        }
    }
    let mut at = 0_u32;
    for word in header {
        write_chunk(flash, slot, at, word)?;
        at = at.saturating_add(WORD as u32);
    }
    Some(())
}

/// Writes a chunk of a package.
pub fn write_chunk<F: SlotFlash>(flash: &mut F, slot: Slot, at: u32, chunk: &[u8; WORD]) -> Option<()> {
    let offset = slot
        .offset()
        .saturating_add(PACKAGE_OFFSET as u32)
        .saturating_add(at);
    write(flash, offset, chunk)
}

/// The complete and valid content of a slot that was not rejected.
///
/// # Errors
/// The first check that fails.
pub fn inspect<F: SlotFlash>(flash: &mut F, slot: Slot, key: &Key) -> Result<Stored, PackageError> {
    if !Mark::Complete.is_set(flash, slot) {
        return Err(PackageError::NotComplete);
    }
    if Mark::Rejected.is_set(flash, slot) {
        return Err(PackageError::Rejected);
    }
    let confirmed = Mark::Confirmed.is_set(flash, slot);
    inspect_package(flash, slot, key).map(|stored| Stored { confirmed, ..stored })
}

/// The valid package of a slot, whatever its marks.
///
/// # Errors
/// The first check that fails.
#[inline(never)]
pub fn inspect_package<F: SlotFlash>(flash: &mut F, slot: Slot, key: &Key) -> Result<Stored, PackageError> {
    let mut header = HeaderBytes::default();
    let mut offset = slot.offset().saturating_add(PACKAGE_OFFSET as u32);
    for word in &mut header {
        *word = read(flash, offset).ok_or(PackageError::Unreadable)?;
        offset = offset.saturating_add(WORD as u32);
    }
    let header = Header::check(&header, Content::Table, key)?;
    let mut digest = Digest::new();
    let mut rest = header.length as usize;
    while rest > 0 {
        let word = read(flash, offset).ok_or(PackageError::Unreadable)?;
        digest.update(word.get(..rest).unwrap_or(&word));
        rest = rest.saturating_sub(WORD);
        offset = offset.saturating_add(WORD as u32);
    }
    if digest.finish() != header.digest {
        return Err(PackageError::Digest);
    }
    let stored = Stored {
        slot,
        version: header.version,
        table_len: header.length as usize,
        checksum: 0,
        confirmed: false,
    };
    let table = Table::parse(stored.table(flash.mapped(slot))).map_err(PackageError::Table)?;
    Ok(Stored {
        checksum: table.checksum(),
        ..stored
    })
}
