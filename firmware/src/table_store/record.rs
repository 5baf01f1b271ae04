//! What must outlive both slots: which versions are past, and how often slots were erased.
//!
//! The record is a third sector of as many places as it has [words](super::words::WORD), written one after the other and never erased by the unit.
//! So it bounds the erases by itself: each takes a place before it happens, and when places run out no update begins any more.

use super::words::{WORD, is_blank, read, write};
use super::{SLOT_LEN, SlotFlash};
use crate::table::CHECKSUM;

/// Places of a record.
pub const PLACES: u32 = SLOT_LEN.wrapping_div(WORD) as u32;
/// Places that erases leave for verdicts (chosen).
const KEPT_FOR_VERDICTS: u32 = 8;
/// Places that an entry may find broken (chosen).
const TRIES: u32 = 4;

/// An entry's first word.
const ERASE: [u8; 4] = *b"ERAS";
const FLOOR: [u8; 4] = *b"PAST";
/// What fills a place up.
const FILLING: u8 = 0x5a;

/// What the record says, and where it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// No version up to this one is taken any more.
    pub floor: u32,
    /// How often a slot was erased. A place that cannot be read counts, too.
    pub erases: u32,
    next: u32,
}

impl Record {
    /// Reads it all: a place that a power cut left half-written may look empty.
    #[inline(never)]
    pub fn read<F: SlotFlash>(flash: &mut F) -> Self {
        let mut record = Self {
            floor: 0,
            erases: 0,
            next: 0,
        };
        for place in 0..PLACES {
            let word = read(flash, offset(place));
            if word.is_some_and(|word| is_blank::<F>(&word)) {
                continue;
            }
            record.next = place.saturating_add(1);
            match word.as_ref().and_then(past) {
                Some(version) => record.floor = record.floor.max(version),
                None => record.erases = record.erases.saturating_add(1),
            }
        }
        record
    }

    /// Whether there is room for another update.
    pub const fn has_room(&self) -> bool {
        self.next < PLACES.saturating_sub(KEPT_FOR_VERDICTS)
    }

    /// Notes an erase that is about to happen; `None` if that cannot be noted.
    pub fn note_erase<F: SlotFlash>(&mut self, flash: &mut F, version: u32) -> Option<()> {
        self.erases = self.erases.saturating_add(1);
        self.append(flash, ERASE, version)
    }

    /// Notes that no version up to this one is taken any more; `None` if that cannot be noted.
    pub fn raise_floor<F: SlotFlash>(&mut self, flash: &mut F, version: u32) -> Option<()> {
        if version <= self.floor {
            return Some(());
        }
        self.floor = version;
        self.append(flash, FLOOR, version)
    }

    #[inline(never)]
    fn append<F: SlotFlash>(&mut self, flash: &mut F, kind: [u8; 4], version: u32) -> Option<()> {
        let word = entry(kind, version);
        (0..TRIES).find_map(|_| {
            let place = self.next;
            self.next = place.saturating_add(1);
            (place < PLACES).then(|| write(flash, offset(place), &word))?
        })
    }
}

/// Where a place lies in the store's flash.
const fn offset(place: u32) -> u32 {
    place.saturating_mul(WORD as u32)
}

fn entry(kind: [u8; 4], version: u32) -> [u8; WORD] {
    let version = version.to_le_bytes();
    let check = CHECKSUM.checksum([kind, version].as_flattened()).to_le_bytes();
    let mut word = [FILLING; WORD];
    if let [first, second, third, ..] = word.as_chunks_mut().0 {
        [*first, *second, *third] = [kind, version, check];
    }
    word
}

/// The version up to which all are past, if the entry says one.
fn past(word: &[u8; WORD]) -> Option<u32> {
    let (_, version) = word.split_first_chunk::<4>()?;
    let version = u32::from_le_bytes(*version.first_chunk()?);
    (*word == entry(FLOOR, version)).then_some(version)
}
