//! One update, step by step.

use super::package::{MIN_PACKAGE, Package};
use super::{Active, MARKER, MARKER_LEN, MAX_PACKAGE, Slot, SlotFlash, TableStore};
use crate::link::{CHUNK_LEN, Refusal, UpdateAnswer, UpdateFrame};

/// An update under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Updating {
    slot: Slot,
    length: u32,
    written: u32,
}

impl<F: SlotFlash> TableStore<F> {
    /// Takes one step. The running slot is never touched; after [`UpdateAnswer::Activated`] the other one runs
    /// ([`TableStore::active`]).
    pub fn step(&mut self, step: &UpdateFrame) -> UpdateAnswer {
        let outcome = match step {
            UpdateFrame::Begin { length } => self.begin(*length),
            UpdateFrame::Chunk { offset, bytes } => self.chunk(*offset, bytes),
            UpdateFrame::Commit => self.commit(),
        };
        outcome.unwrap_or_else(|refusal| {
            self.updating = None;
            UpdateAnswer::Refused(refusal)
        })
    }

    fn begin(&mut self, length: u32) -> Result<UpdateAnswer, Refusal> {
        if (length as usize) < MIN_PACKAGE || length as usize > MAX_PACKAGE {
            return Err(Refusal::Length);
        }
        let slot = self.active.map_or(Slot::A, |active| active.slot.other());
        let end = slot.offset().saturating_add(super::SLOT_LEN as u32);
        self.flash.erase(slot.offset(), end).map_err(|_| Refusal::Flash)?;
        // A controller that does nothing (an emulator's) reports no error either.
        if self.flash.slot(slot).iter().any(|&byte| byte != 0xff) {
            return Err(Refusal::Flash);
        }
        self.updating = Some(Updating {
            slot,
            length,
            written: 0,
        });
        Ok(UpdateAnswer::Continue { offset: 0 })
    }

    fn chunk(&mut self, offset: u32, bytes: &[u8; CHUNK_LEN]) -> Result<UpdateAnswer, Refusal> {
        let mut update = self.updating.ok_or(Refusal::NotBegun)?;
        // A chunk whose answer was lost comes again, and must not be written twice.
        if offset == update.written && offset < update.length {
            let place = MARKER_LEN.saturating_add(offset as usize);
            let room = super::SLOT_LEN.saturating_sub(place).min(CHUNK_LEN);
            let bytes = bytes.get(..room).unwrap_or(bytes);
            let address = update.slot.offset().saturating_add(place as u32);
            self.flash.write(address, bytes).map_err(|_| Refusal::Flash)?;
            let stored = self
                .flash
                .slot(update.slot)
                .get(place..place.saturating_add(room));
            if stored != Some(bytes) {
                return Err(Refusal::Flash);
            }
            update.written = offset.saturating_add(CHUNK_LEN as u32);
            self.updating = Some(update);
        }
        Ok(UpdateAnswer::Continue {
            offset: update.written,
        })
    }

    fn commit(&mut self) -> Result<UpdateAnswer, Refusal> {
        let update = self.updating.ok_or(Refusal::NotBegun)?;
        if update.written < update.length {
            return Err(Refusal::Incomplete);
        }
        let package = self
            .flash
            .slot(update.slot)
            .get(MARKER_LEN..MARKER_LEN.saturating_add(update.length as usize))
            .ok_or(Refusal::Length)?;
        let package = Package::check(package, &self.key)?;
        let active = Active {
            slot: update.slot,
            version: package.version,
            table_len: package.table.len(),
        };
        if self
            .active
            .is_some_and(|running| active.version <= running.version)
        {
            return Err(Refusal::Version);
        }
        // The one write that matters: before it this slot does not exist, after it it is the newest.
        self.flash
            .write(update.slot.offset(), &MARKER)
            .map_err(|_| Refusal::Flash)?;
        if !self.flash.slot(update.slot).starts_with(&MARKER) {
            return Err(Refusal::Flash);
        }
        self.updating = None;
        self.active = Some(active);
        Ok(UpdateAnswer::Activated {
            version: active.version,
        })
    }
}
