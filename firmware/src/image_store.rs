//! Images over the air: a signed package into the room of the next image, which a boot loader then exchanges for the running one.
//!
//! The package is as that of a table ([`crate::table_store::package`]), with a magic of its own. Its header comes first, and only if it is
//! signed and its version is above that of the running image is anything erased, at most [`MAX_ERASES`] sectors between two starts.
//! The bytes are written as they come; when their digest is the header's, the boot loader is asked to exchange the images at the next
//! start.
//!
//! # Trial
//! The new image runs on trial. It is kept once it has decided for a whole window of [`crate::health::Health`]; any start before that, whatever
//! the cause, brings the old one back.
//!
//! # Rollback
//! The version stands in the image itself, so an image only ever gives way to a newer one of the same key. One that was taken back can
//! come again.
//!
//! The boot loader is the board's: [`Exchange`] is all that this module asks of it.

use crate::link::{CHUNK_LEN, Refusal, UpdateAnswer, UpdateFrame};
use crate::table_store::key::Digest;
use crate::table_store::package::{Content, HEADER_LEN, Header, HeaderBytes};
use crate::table_store::{Key, MAX_ERASES};
use embedded_storage::nor_flash::NorFlash;

/// What a boot loader does with two images. `None` means that its flash does not do it.
pub trait Exchange {
    /// Whether the running image goes at the next start unless it is kept.
    fn is_on_trial(&mut self) -> Option<bool>;
    /// Exchanges the images at the next start.
    fn exchange_at_next_start(&mut self) -> Option<()>;
    /// Keeps the running image.
    fn keep(&mut self) -> Option<()>;
}

/// The room of the next image, and the boot loader that knows it.
#[derive(Debug)]
pub struct ImageStore<F, B> {
    /// From offset 0 on the next image, and behind it a sector that the exchange needs.
    room: F,
    boot_loader: B,
    key: Key,
    version: u32,
    on_trial: bool,
    receiving: Option<Receiving>,
    stored: Option<u32>,
    erases_left: u8,
}

/// An update under way.
#[derive(Clone, Copy, Debug)]
struct Receiving {
    /// Of the package.
    length: u32,
    /// What came so far.
    came: u32,
    header_bytes: HeaderBytes,
    /// Once it is whole and checked.
    header: Option<Header>,
}

impl<F: NorFlash, B: Exchange> ImageStore<F, B> {
    /// As at a start of the image of this version. Where the boot loader cannot be read, the image counts as kept.
    pub fn boot(room: F, mut boot_loader: B, key: Key, version: u32) -> Self {
        let on_trial = boot_loader.is_on_trial().unwrap_or(false);
        Self {
            room,
            boot_loader,
            key,
            version,
            on_trial,
            receiving: None,
            stored: None,
            erases_left: MAX_ERASES,
        }
    }

    /// Whether a step is one of an image's update and not of a table's.
    pub const fn concerns(&self, step: &UpdateFrame) -> bool {
        match step {
            UpdateFrame::Begin { .. } => false,
            UpdateFrame::BeginImage { .. } => true,
            UpdateFrame::Chunk { .. } | UpdateFrame::Commit => {
                self.receiving.is_some() || self.stored.is_some()
            }
        }
    }

    /// Gives an update up.
    pub const fn abandon(&mut self) {
        self.receiving = None;
        self.stored = None;
    }

    /// Takes one step. [`UpdateAnswer::Stored`] means that the next start exchanges the images.
    #[inline(never)]
    pub fn step(&mut self, step: &UpdateFrame) -> UpdateAnswer {
        let outcome = match step {
            UpdateFrame::BeginImage { length } => self.begin(*length),
            UpdateFrame::Chunk { offset, bytes } => self.chunk(*offset, bytes),
            UpdateFrame::Commit => self.commit(),
            UpdateFrame::Begin { .. } => Err(Refusal::NotBegun),
        };
        outcome.unwrap_or_else(|refusal| {
            self.abandon();
            UpdateAnswer::Refused(refusal)
        })
    }

    /// The longest package: the room without the sector that the exchange needs.
    fn longest(&self) -> usize {
        let image = self.room.capacity().saturating_sub(F::ERASE_SIZE);
        image.saturating_add(HEADER_LEN)
    }

    fn begin(&mut self, length: u32) -> Result<UpdateAnswer, Refusal> {
        if self.on_trial {
            // The room holds the image that a start brings back.
            return Err(Refusal::OnTrial);
        }
        if length as usize <= HEADER_LEN || length as usize > self.longest() {
            return Err(Refusal::Length);
        }
        self.stored = None;
        self.receiving = Some(Receiving {
            length,
            came: 0,
            header_bytes: HeaderBytes::default(),
            header: None,
        });
        Ok(UpdateAnswer::Continue { offset: 0 })
    }

    fn chunk(&mut self, offset: u32, bytes: &[u8; CHUNK_LEN]) -> Result<UpdateAnswer, Refusal> {
        let mut receiving = self.receiving.ok_or(Refusal::NotBegun)?;
        // A chunk whose answer was lost comes again, and must not be written twice.
        if offset == receiving.came && offset < receiving.length {
            if receiving.header.is_some() {
                self.write(offset.saturating_sub(HEADER_LEN as u32), bytes)?;
            } else if let Some(word) = receiving.header_bytes.get_mut(offset as usize / CHUNK_LEN) {
                *word = *bytes;
            }
            receiving.came = offset.saturating_add(CHUNK_LEN as u32);
            if receiving.came as usize == HEADER_LEN {
                receiving.header = Some(self.check(&receiving)?);
            }
            self.receiving = Some(receiving);
        }
        Ok(UpdateAnswer::Continue {
            offset: receiving.came,
        })
    }

    fn check(&self, receiving: &Receiving) -> Result<Header, Refusal> {
        let header = Header::check(&receiving.header_bytes, Content::Image, &self.key)?;
        if header.length as usize != (receiving.length as usize).saturating_sub(HEADER_LEN) {
            return Err(Refusal::Length);
        }
        if header.version <= self.version {
            return Err(Refusal::Version);
        }
        Ok(header)
    }

    /// Erases each sector where it begins, so that no erase takes longer than one of them.
    fn write(&mut self, offset: u32, bytes: &[u8; CHUNK_LEN]) -> Result<(), Refusal> {
        let sector = F::ERASE_SIZE as u32;
        if offset.checked_rem(sector) == Some(0) {
            self.erases_left = self.erases_left.checked_sub(1).ok_or(Refusal::Worn)?;
            let erased = self.room.erase(offset, offset.saturating_add(sector));
            erased.map_err(|_| Refusal::Flash)?;
        }
        self.room.write(offset, bytes).map_err(|_| Refusal::Flash)
    }

    fn commit(&mut self) -> Result<UpdateAnswer, Refusal> {
        if let Some(version) = self.stored {
            // Its answer was lost, and it comes again.
            return Ok(UpdateAnswer::Stored { version });
        }
        let receiving = self.receiving.ok_or(Refusal::NotBegun)?;
        let header = receiving.header.filter(|_| receiving.came >= receiving.length);
        let header = header.ok_or(Refusal::Incomplete)?;
        let mut digest = Digest::new();
        let (mut offset, mut left) = (0, header.length);
        let mut bytes = [0; CHUNK_LEN];
        while left > 0 {
            self.room.read(offset, &mut bytes).map_err(|_| Refusal::Flash)?;
            let there = bytes.get(..left as usize).unwrap_or(&bytes);
            digest.update(there);
            left = left.saturating_sub(CHUNK_LEN as u32);
            offset = offset.saturating_add(CHUNK_LEN as u32);
        }
        if digest.finish() != header.digest {
            return Err(Refusal::Digest);
        }
        // The one write that matters: before it the running image stays.
        self.boot_loader.exchange_at_next_start().ok_or(Refusal::Flash)?;
        self.receiving = None;
        self.stored = Some(header.version);
        Ok(UpdateAnswer::Stored {
            version: header.version,
        })
    }

    /// The unit has decided for a whole window: an image on trial is kept.
    #[inline(never)]
    pub fn prove(&mut self) {
        if self.on_trial && self.boot_loader.keep().is_some() {
            self.on_trial = false;
        }
    }

    /// Whether the running image is on trial.
    pub const fn is_on_trial(&self) -> bool {
        self.on_trial
    }
}
