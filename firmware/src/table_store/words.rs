//! Flash in words that every chip can write: whatever is written, lies alone in its own.

use super::SlotFlash;

/// Bytes of a word: the largest word that a chip writes at once (STM32H7's 256 bits). Smaller words divide it.
pub const WORD: usize = 32;

/// A word's content, or `None` where the flash cannot read it.
#[inline(never)]
pub fn read<F: SlotFlash>(flash: &mut F, offset: u32) -> Option<[u8; WORD]> {
    let mut word = [0; WORD];
    flash.read(offset, &mut word).ok()?;
    Some(word)
}

/// Writes a word and reads it back: a controller that does nothing (an emulator's) reports no error either.
#[inline(never)]
pub fn write<F: SlotFlash>(flash: &mut F, offset: u32, word: &[u8; WORD]) -> Option<()> {
    const {
        assert!(
            F::WRITE_SIZE <= WORD && WORD.is_multiple_of(F::WRITE_SIZE) && WORD.is_multiple_of(F::READ_SIZE),
            "words do not divide a word"
        );
    }
    flash.write(offset, word).ok()?;
    (read(flash, offset)? == *word).then_some(())
}

/// Whether a word is as an erase leaves it.
#[inline(never)]
pub fn is_blank<F: SlotFlash>(word: &[u8; WORD]) -> bool {
    word.iter().all(|&byte| byte == F::ERASED)
}

/// The content of a set mark: no bit pattern that an erased word has, whichever value that is.
pub const MARK: [u8; WORD] = [0x5a; WORD];

/// Whether a word is a set mark: whether as many of its bytes are a mark's as an erased word's, or more. So no bit that rots sets or clears
/// one, and what a power cut leaves is one or the other.
#[inline(never)]
pub fn is_marked<F: SlotFlash>(word: &[u8; WORD]) -> bool {
    let [mark, ..] = MARK;
    let count = |value: u8| word.iter().filter(|&&byte| byte == value).count();
    count(mark) >= count(F::ERASED)
}
