//! The table store in the chip's own flash: its record in sector 1, its slots in sectors 2 and 3.
//!
//! # What it costs the unit
//! The chip has one bank: while it erases or programs, the core stalls at its next fetch. A word takes 16 us, so a chunk of an
//! update takes 0.13 ms, which a slot can spare. **A sector's erase takes 250 ms, 500 at most** (data sheet, table 39), in
//! which no slot is decided: an update should begin where silence is harmless, such as at standstill.
//!
//! # In an emulator
//! QEMU has no flash controller: its registers read 0, and writes to flash are dropped. The store then finds that nothing was
//! written and refuses the update; slots can only be loaded before the start.
//!
//! # Source
//! RM0090 chapter 3: sections 3.5.2 (caches), 3.6 (erase and program), table 5 (sectors).

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use firmware::table_store::{FLASH_LEN, SLOT_LEN, Slot, SlotFlash};
use stm32f4::stm32f405::FLASH;

/// The record's sector.
const FIRST_SECTOR: u8 = 1;
const WORD: usize = 4;

/// Reads of the busy flag before the flash counts as stuck: the slowest erase is 0.5 s, and a read takes four cycles of at most
/// 168 MHz. On the chip the stalled core reads far fewer.
const POLLS: u32 = 42_000_000;

#[allow(unsafe_code, reason = "names a place in the memory map")]
unsafe extern "C" {
    /// Defined by `memory.x`. Mutable, because programming changes it.
    static mut _table_store: [u8; FLASH_LEN];
}

#[allow(unsafe_code, reason = "names a place in the memory map")]
const STORE: *const [u8; FLASH_LEN] = &raw const _table_store;

/// The flash controller, for the store alone.
pub struct Flash(FLASH);

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

impl Flash {
    /// Takes the controller over.
    pub const fn new(controller: FLASH) -> Self {
        Self(controller)
    }

    /// A slot's bytes for as long as the program runs. Only for the slot that runs, which the store never writes.
    pub fn running(slot: Slot) -> &'static [u8] {
        slot_bytes(slot)
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

fn bytes() -> &'static [u8; FLASH_LEN] {
    // SAFETY: three sectors that hold nothing else and are always mapped. Readers of what does not run borrow it from the driver, so none
    // of them is alive when the driver writes it.
    #[allow(unsafe_code, reason = "memory-mapped flash")]
    unsafe {
        &*STORE
    }
}

fn slot_bytes(slot: Slot) -> &'static [u8] {
    let (_, rest) = bytes().split_at(slot.offset() as usize);
    rest.split_at(SLOT_LEN).0
}

impl SlotFlash for Flash {
    const ERASED: u8 = 0xff;

    fn mapped(&self, slot: Slot) -> &[u8] {
        slot_bytes(slot)
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len())?;
        let (_, stored) = self::bytes().split_at(offset as usize);
        for (byte, &stored) in bytes.iter_mut().zip(stored) {
            *byte = stored;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        FLASH_LEN
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SLOT_LEN;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to)?;
        self.unlocked(|flash| {
            for sector in from / SLOT_LEN as u32..to / SLOT_LEN as u32 {
                // SAFETY: sector 1, 2 or 3, by the check above; they hold the store alone.
                #[allow(
                    unsafe_code,
                    reason = "the register description knows no range for this field"
                )]
                flash.0.cr().write(|w| unsafe {
                    w.ser()
                        .set_bit()
                        .snb()
                        .bits(FIRST_SECTOR + sector as u8)
                        .psize()
                        .psize32()
                });
                flash.0.cr().modify(|_, w| w.strt().set_bit());
                flash.wait()?;
            }
            Ok(())
        })
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len())?;
        self.unlocked(|flash| {
            flash.0.cr().write(|w| w.pg().set_bit().psize().psize32());
            let (words, _) = bytes.as_chunks::<WORD>();
            for (index, word) in words.iter().enumerate() {
                // SAFETY: a word inside the store, by the check above; the controller programs what is written there.
                #[allow(unsafe_code, reason = "memory-mapped flash")]
                unsafe {
                    let first = STORE.cast_mut().cast::<u32>();
                    first
                        .add(offset as usize / WORD + index)
                        .write_volatile(u32::from_le_bytes(*word));
                }
                flash.wait()?;
            }
            Ok(())
        })
    }
}
