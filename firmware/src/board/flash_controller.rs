//! The chip's flash controller: what erases and programs.
//!
//! # Source
//! RM0090 chapter 3: sections 3.5.2 (caches), 3.6 (erase and program), table 5 (sectors).

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};
use stm32f4::stm32f405::FLASH;

/// Bytes that are programmed at once.
pub const WORD: usize = 4;

/// Reads of the busy flag before the flash counts as stuck: the slowest erase is 2 s, and a read takes four cycles of at most
/// 168 MHz. On the chip the stalled core reads far fewer.
const POLLS: u32 = 84_000_000;

/// The controller.
pub struct Controller(FLASH);

/// What the controller says.
#[derive(Debug)]
pub struct FlashError(NorFlashErrorKind);

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        self.0
    }
}

impl From<NorFlashErrorKind> for FlashError {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self(kind)
    }
}

impl Controller {
    /// Takes the controller over.
    pub const fn new(controller: FLASH) -> Self {
        Self(controller)
    }

    /// Erases these sectors. Nothing else may borrow them.
    pub fn erase(&mut self, sectors: core::ops::Range<u8>) -> Result<(), FlashError> {
        self.unlocked(|flash| {
            for sector in sectors {
                // SAFETY: the chip has sectors 0 to 11, and callers know theirs.
                #[allow(
                    unsafe_code,
                    reason = "the register description knows no range for this field"
                )]
                flash
                    .0
                    .cr()
                    .write(|w| unsafe { w.ser().set_bit().snb().bits(sector).psize().psize32() });
                flash.0.cr().modify(|_, w| w.strt().set_bit());
                flash.wait()?;
            }
            Ok(())
        })
    }

    /// Programs whole words from `first` on.
    ///
    /// # Safety
    /// They lie in flash, and nothing else borrows them.
    #[allow(unsafe_code, reason = "memory-mapped flash")]
    pub unsafe fn program(&mut self, first: *mut u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.unlocked(|flash| {
            flash.0.cr().write(|w| w.pg().set_bit().psize().psize32());
            let (words, _) = bytes.as_chunks::<WORD>();
            for (index, word) in words.iter().enumerate() {
                // SAFETY: the caller's; the controller programs what is written there.
                unsafe {
                    first.add(index).write_volatile(u32::from_le_bytes(*word));
                }
                flash.wait()?;
            }
            Ok(())
        })
    }

    #[inline(never)]
    fn wait(&self) -> Result<(), FlashError> {
        let done = (0..POLLS).any(|_| self.0.sr().read().bsy().bit_is_clear());
        let status = self.0.sr().read();
        let failed = status.pgserr().bit_is_set()
            || status.pgperr().bit_is_set()
            || status.pgaerr().bit_is_set()
            || status.wrperr().bit_is_set();
        if done && !failed {
            Ok(())
        } else {
            Err(FlashError(NorFlashErrorKind::Other))
        }
    }

    /// Runs `work` with the controller unlocked, and locks it again.
    fn unlocked(&mut self, work: impl FnOnce(&Self) -> Result<(), FlashError>) -> Result<(), FlashError> {
        // SAFETY: the unlocking keys of section 3.6.1; status bits are cleared by writing ones.
        #[allow(
            unsafe_code,
            reason = "the register description knows no values for these fields"
        )]
        unsafe {
            self.0.sr().write(|w| w.bits(0xf2));
            self.0.keyr().write(|w| w.bits(0x4567_0123));
            self.0.keyr().write(|w| w.bits(0xcdef_89ab));
        }
        let outcome = self.wait().and_then(|()| work(self));
        self.0.cr().write(|w| w.lock().set_bit());
        // The data cache may still hold what was there before (section 3.5.2): it must be off to be reset.
        let cached = self.0.acr().read().dcen().bit();
        self.0.acr().modify(|_, w| w.dcen().clear_bit());
        self.0.acr().modify(|_, w| w.dcrst().set_bit());
        self.0.acr().modify(|_, w| w.dcrst().clear_bit());
        self.0.acr().modify(|_, w| w.dcen().bit(cached));
        // Neither the core nor the compiler may answer a later read with what was there before.
        cortex_m::asm::dsb();
        outcome
    }
}
