//! One update, step by step.

use super::package::{Content, HEADER_LEN, Header, HeaderBytes};
use super::slots::{Mark, inspect_package, prepare, write_chunk};
use super::{MAX_TABLE, Slot, SlotFlash, TableStore, WORD};
use crate::link::{CHUNK_LEN, Refusal, UpdateAnswer, UpdateFrame};

/// Erases between two starts of a unit (chosen): enough to begin anew after disturbed transfers, and a hundredth of what a sector
/// survives in a thousand starts.
pub const MAX_ERASES: u8 = 8;

/// The longest package.
pub const MAX_PACKAGE: usize = HEADER_LEN.saturating_add(MAX_TABLE);

const _: () = assert!(CHUNK_LEN == WORD, "a chunk is what the flash writes at once");

/// An update under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Updating {
    /// Of the package.
    length: u32,
    /// What came so far.
    came: u32,
    /// The header, which waits here until it is whole and checked.
    header: HeaderBytes,
    /// The slot that was erased for it.
    slot: Option<Slot>,
}

impl<F: SlotFlash> TableStore<F> {
    /// Takes one step. Nothing that runs is ever touched. [`UpdateAnswer::Stored`] means a trial: at once if the unit knows how its present
    /// table does, and otherwise when it does; so [`TableStore::running`] may have changed.
    #[inline(never)]
    pub fn step(&mut self, step: &UpdateFrame) -> UpdateAnswer {
        let outcome = match step {
            UpdateFrame::Begin { length } => self.begin(*length),
            UpdateFrame::Chunk { offset, bytes } => self.chunk(*offset, bytes),
            UpdateFrame::Commit => self.commit(),
            UpdateFrame::BeginImage { .. } => Err(Refusal::NoBootLoader),
        };
        outcome.unwrap_or_else(|refusal| {
            self.updating = None;
            UpdateAnswer::Refused(refusal)
        })
    }

    /// Costs nothing yet, so anybody may ask for it.
    fn begin(&mut self, length: u32) -> Result<UpdateAnswer, Refusal> {
        if length as usize <= HEADER_LEN || length as usize > MAX_PACKAGE {
            return Err(Refusal::Length);
        }
        // A modem that starts over finds its slot as it left it.
        let before = self.updating.filter(|update| update.slot.is_some());
        self.interrupted = before.or(self.interrupted);
        self.completed = None;
        self.updating = Some(Updating {
            length,
            came: 0,
            header: HeaderBytes::default(),
            slot: None,
        });
        Ok(UpdateAnswer::Continue { offset: 0 })
    }

    fn chunk(&mut self, offset: u32, bytes: &[u8; CHUNK_LEN]) -> Result<UpdateAnswer, Refusal> {
        let mut update = self.updating.ok_or(Refusal::NotBegun)?;
        // A chunk whose answer was lost comes again, and must not be written twice.
        if offset == update.came && offset < update.length {
            if let Some(slot) = update.slot {
                write_chunk(&mut self.flash, slot, offset, bytes).ok_or(Refusal::Flash)?;
            } else if let Some(word) = update.header.get_mut(offset as usize / CHUNK_LEN) {
                *word = *bytes;
            }
            update.came = offset.saturating_add(CHUNK_LEN as u32);
            if update.slot.is_none() && update.came as usize >= HEADER_LEN {
                update = self.make_room(update)?;
            }
            self.updating = Some(update);
        }
        Ok(UpdateAnswer::Continue { offset: update.came })
    }

    /// Checks the header, and then erases a slot for its table.
    fn make_room(&mut self, update: Updating) -> Result<Updating, Refusal> {
        let interrupted = self.interrupted.take();
        if let Some(before) = interrupted.filter(|before| before.header == update.header) {
            return Ok(before);
        }
        let header = Header::check(&update.header, Content::Table, &self.key)?;
        if header.length as usize != (update.length as usize).saturating_sub(HEADER_LEN) {
            return Err(Refusal::Length);
        }
        let waiting = self.candidate();
        if header.version <= self.floor() || waiting.is_some_and(|waiting| header.version <= waiting.version)
        {
            return Err(Refusal::Version);
        }
        if self.is_on_trial() {
            return Err(Refusal::OnTrial);
        }
        self.erases_left = self
            .erases_left
            .checked_sub(1)
            .filter(|_| self.record.has_room())
            .ok_or(Refusal::Worn)?;
        // The slot that neither runs nor would after a rejection.
        let slot = match (self.confirmed(), waiting) {
            (Some(confirmed), _) => confirmed.slot.other(),
            (None, Some(waiting)) => waiting.slot,
            (None, None) => Slot::A,
        };
        self.record
            .note_erase(&mut self.flash, header.version)
            .ok_or(Refusal::Flash)?;
        self.drop_slot(slot);
        prepare(&mut self.flash, slot, &update.header).ok_or(Refusal::Flash)?;
        Ok(Updating {
            slot: Some(slot),
            ..update
        })
    }

    fn commit(&mut self) -> Result<UpdateAnswer, Refusal> {
        let Some(update) = self.updating else {
            // Its answer was lost, and it comes again.
            let version = self.completed.ok_or(Refusal::NotBegun)?;
            return Ok(UpdateAnswer::Stored { version });
        };
        let slot = update.slot.filter(|_| update.came >= update.length);
        let slot = slot.ok_or(Refusal::Incomplete)?;
        let stored = inspect_package(&mut self.flash, slot, &self.key)?;
        // The one write that matters: before it this slot does not exist.
        Mark::Complete.set(&mut self.flash, slot).ok_or(Refusal::Flash)?;
        self.updating = None;
        self.completed = Some(stored.version);
        self.hold(stored);
        let _ = self.start_trial();
        Ok(UpdateAnswer::Stored {
            version: stored.version,
        })
    }
}
