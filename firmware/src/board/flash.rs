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

use super::flash_controller::{Controller, FlashError, WORD};
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash, check_erase, check_read, check_write};
use firmware::table_store::{FLASH_LEN, SLOT_LEN, Slot, SlotFlash};
use stm32f4::stm32f405::FLASH;

/// The record's sector.
const FIRST_SECTOR: u8 = 1;

#[allow(unsafe_code, reason = "names a place in the memory map")]
unsafe extern "C" {
    /// Defined by `memory.x`. Mutable, because programming changes it.
    static mut _table_store: [u8; FLASH_LEN];
}

#[allow(unsafe_code, reason = "names a place in the memory map")]
const STORE: *const [u8; FLASH_LEN] = &raw const _table_store;

/// The store's three sectors.
pub struct Flash(Controller);

impl Flash {
    /// Takes the controller over.
    pub const fn new(controller: FLASH) -> Self {
        Self(Controller::new(controller))
    }

    /// A slot's bytes for as long as the program runs. Only for the slot that runs, which the store never writes.
    pub fn running(slot: Slot) -> &'static [u8] {
        slot_bytes(slot)
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
        let sectors = [from, to].map(|offset| FIRST_SECTOR + (offset / SLOT_LEN as u32) as u8);
        // Sectors 1 to 3, by the check above; they hold the store alone.
        self.0.erase(sectors[0]..sectors[1])
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len())?;
        // SAFETY: inside the store, by the check above.
        #[allow(unsafe_code, reason = "memory-mapped flash")]
        unsafe {
            let first = STORE.cast_mut().cast::<u32>().add(offset as usize / WORD);
            self.0.program(first, bytes)
        }
    }
}
