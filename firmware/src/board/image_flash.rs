//! Where the images lie when a boot loader exchanges them, as flash of its own.
//!
//! | sectors | bytes | what |
//! |---|---|---|
//! | 0 | 16 KiB | the boot loader |
//! | 1 to 3 | 3 x 16 KiB | the table store |
//! | 4 | 64 KiB | the boot loader's state |
//! | 5 | 128 KiB | the running image |
//! | 6, 7 | 2 x 128 KiB | the room of the next image, and the sector that the exchange needs |
//! | 8 to 11 | 4 x 128 KiB | nothing |

use super::flash_controller::{Controller, FlashError, WORD};
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash, check_erase, check_read, check_write};
use stm32f4::stm32f405::FLASH;

/// The boot loader's state.
pub type State = Sectors<4, 1, { 64 << 10 }, 0x0801_0000>;
/// The room of the next image.
pub type Room = Sectors<6, 2, { 128 << 10 }, 0x0804_0000>;

/// So many sectors of one length from `FIRST` on, which begin at this address.
pub struct Sectors<const FIRST: u8, const COUNT: usize, const LENGTH: usize, const ADDRESS: u32>(Controller);

impl<const FIRST: u8, const COUNT: usize, const LENGTH: usize, const ADDRESS: u32>
    Sectors<FIRST, COUNT, LENGTH, ADDRESS>
{
    /// As flash.
    ///
    /// # Safety
    /// Nobody else works with the controller at the same time, and nobody borrows these bytes.
    #[allow(unsafe_code, reason = "several parts of the flash share one controller")]
    pub unsafe fn new() -> Self {
        // SAFETY: the caller's.
        Self(Controller::new(unsafe { FLASH::steal() }))
    }

    fn place(offset: u32) -> *mut u8 {
        core::ptr::with_exposed_provenance_mut(ADDRESS as usize + offset as usize)
    }
}

impl<const FIRST: u8, const COUNT: usize, const LENGTH: usize, const ADDRESS: u32> ErrorType
    for Sectors<FIRST, COUNT, LENGTH, ADDRESS>
{
    type Error = FlashError;
}

impl<const FIRST: u8, const COUNT: usize, const LENGTH: usize, const ADDRESS: u32> ReadNorFlash
    for Sectors<FIRST, COUNT, LENGTH, ADDRESS>
{
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len())?;
        for (index, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: inside these sectors, by the check above. Volatile, since the controller changes them.
            #[allow(unsafe_code, reason = "memory-mapped flash")]
            unsafe {
                *byte = Self::place(offset).add(index).read_volatile();
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        COUNT * LENGTH
    }
}

impl<const FIRST: u8, const COUNT: usize, const LENGTH: usize, const ADDRESS: u32> NorFlash
    for Sectors<FIRST, COUNT, LENGTH, ADDRESS>
{
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = LENGTH;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to)?;
        let [from, to] = [from, to].map(|offset| FIRST + (offset / LENGTH as u32) as u8);
        self.0.erase(from..to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len())?;
        // SAFETY: inside these sectors, by the check above, and nobody borrows them.
        #[allow(unsafe_code, reason = "memory-mapped flash")]
        unsafe {
            self.0.program(Self::place(offset).cast(), bytes)
        }
    }
}
