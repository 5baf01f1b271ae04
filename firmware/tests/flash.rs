//! Flash as chips have it, and as it lies: words of any size that are written once, an erased value of either kind, power that fails in
//! the middle of an operation, words that then read otherwise each time or not at all, writes and erases that do nothing.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use firmware::table_store::{FLASH_LEN, SLOT_LEN, Slot, SlotFlash};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;

/// Bytes that one step of an erase clears before the power may fail.
const ERASE_STEP: usize = 1 << 10;

/// How flash lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lie {
    /// Not at all.
    #[default]
    None,
    /// An erase clears nothing.
    NoErase,
    /// A write changes nothing from this place on.
    NoWrite(usize),
    /// One bit of every word from this place on stays as it was.
    StuckBit(usize),
}

/// A record and two slots, of words of `W` bytes that read `E` when erased.
#[derive(Clone, Debug)]
pub struct Flash<const W: usize, const E: u8> {
    pub bytes: Vec<u8>,
    /// Words and erase steps until the power fails; it then stays off.
    pub operations_left: Option<u32>,
    pub operations: u32,
    pub erases: u32,
    pub lie: Lie,
    /// Whether half-written words are errors when they are read, as with error correction; otherwise they read otherwise each time.
    pub corrects_errors: bool,
    /// What cut words hold for sure and what they may: by their places.
    cut: BTreeMap<usize, (Vec<u8>, Vec<u8>)>,
    pub rng: Pcg64Mcg,
}

/// The chip's own.
pub type ChipFlash = Flash<4, 0xff>;

impl<const W: usize, const E: u8> Flash<W, E> {
    pub fn new() -> Self {
        Self {
            bytes: vec![E; FLASH_LEN],
            operations_left: None,
            operations: 0,
            erases: 0,
            lie: Lie::None,
            corrects_errors: false,
            cut: BTreeMap::new(),
            rng: Pcg64Mcg::new(5),
        }
    }

    /// Slots as a chip with erased bytes of 0xff holds them; blank parts take this flash's value.
    pub fn with(slots: [&[u8]; 2]) -> Self {
        let mut flash = Self::new();
        for (index, slot) in slots.into_iter().enumerate() {
            for (at, word) in slot.chunks(32).enumerate() {
                if word.iter().any(|&byte| byte != 0xff) {
                    let at = (index + 1) * SLOT_LEN + 32 * at;
                    flash.bytes[at..at + word.len()].copy_from_slice(word);
                }
            }
        }
        flash
    }

    pub fn powered_again(mut self) -> Self {
        self.operations_left = None;
        self
    }

    /// Programs or erases towards `target`; a failing operation changes an arbitrary part of the bits.
    fn operate(&mut self, at: usize, target: &[u8]) -> Result<(), NorFlashErrorKind> {
        let fails = match &mut self.operations_left {
            Some(0) => return Err(NorFlashErrorKind::Other),
            Some(left) => {
                *left -= 1;
                *left == 0
            }
            None => false,
        };
        self.operations += 1;
        let range = at..at + target.len();
        for place in range.clone().step_by(W) {
            self.cut.remove(&place);
        }
        let before = self.bytes[range.clone()].to_vec();
        self.bytes[range.clone()].copy_from_slice(target);
        if !fails {
            return Ok(());
        }
        for place in range.step_by(W) {
            let word = place - at..place - at + W;
            if before[word.clone()] != target[word.clone()] {
                self.cut
                    .insert(place, (before[word.clone()].to_vec(), target[word].to_vec()));
                self.settle(place);
            }
        }
        Err(NorFlashErrorKind::Other)
    }

    /// Draws what a cut word reads as now.
    fn settle(&mut self, place: usize) {
        let Some((before, target)) = self.cut.get(&place) else {
            return;
        };
        for index in 0..W {
            let done = self.rng.next_u32() as u8;
            self.bytes[place + index] = (before[index] & !done) | (target[index] & done);
        }
    }
}

impl<const W: usize, const E: u8> ErrorType for Flash<W, E> {
    type Error = NorFlashErrorKind;
}

impl<const W: usize, const E: u8> ReadNorFlash for Flash<W, E> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let range = offset as usize..offset as usize + bytes.len();
        let cut: Vec<usize> = self.cut.range(range.clone()).map(|(&place, _)| place).collect();
        if self.corrects_errors && !cut.is_empty() {
            return Err(NorFlashErrorKind::Other);
        }
        for place in cut {
            self.settle(place);
        }
        bytes.copy_from_slice(&self.bytes[range]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const W: usize, const E: u8> NorFlash for Flash<W, E> {
    const WRITE_SIZE: usize = W;
    const ERASE_SIZE: usize = SLOT_LEN;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        assert!(
            from.is_multiple_of(SLOT_LEN as u32) && to == from + SLOT_LEN as u32 && from > 0,
            "one whole slot"
        );
        self.erases += 1;
        if self.lie == Lie::NoErase {
            return Ok(());
        }
        (from as usize..to as usize)
            .step_by(ERASE_STEP)
            .try_for_each(|at| self.operate(at, &[E; ERASE_STEP]))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let offset = offset as usize;
        assert!(
            offset.is_multiple_of(W) && bytes.len().is_multiple_of(W),
            "whole words"
        );
        for (index, word) in bytes.chunks(W).enumerate() {
            let at = offset + W * index;
            if self.cut.contains_key(&at) {
                // Nobody promises what a second write to a half-written word does.
                return Err(NorFlashErrorKind::Other);
            }
            let mut target = word.to_vec();
            match self.lie {
                Lie::NoWrite(from) if at >= from => continue,
                Lie::StuckBit(from) if at >= from => target[0] = (target[0] & !1) | (self.bytes[at] & 1),
                _ => assert_eq!(
                    self.bytes[at..at + W],
                    [E; W],
                    "a word is programmed once after an erase"
                ),
            }
            self.operate(at, &target)?;
        }
        Ok(())
    }
}

impl<const W: usize, const E: u8> SlotFlash for Flash<W, E> {
    const ERASED: u8 = E;

    fn mapped(&self, slot: Slot) -> &[u8] {
        &self.bytes[slot.offset() as usize..][..SLOT_LEN]
    }
}
