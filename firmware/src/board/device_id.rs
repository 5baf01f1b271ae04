//! The chip's unique identity.

use stm32f4::stm32f405::RCC;

/// The 96-bit unique device identity (RM0090 section 39.1); zeros where there is none.
///
/// A chip starts on its internal oscillator, which this program never turns off, and says so. An emulator that does not know
/// of oscillators (QEMU) does not know this memory either, and reading it there is a bus fault.
pub fn read(rcc: &RCC) -> [u32; 3] {
    const ADDRESS: *const [u32; 3] = 0x1fff_7a10 as *const [u32; 3];
    if rcc.cr().read().hsirdy().bit_is_clear() {
        return [0; 3];
    }
    // SAFETY: three aligned words of factory-programmed memory that every STM32F405 has, and that nothing writes.
    #[allow(unsafe_code, reason = "the register description lacks this block")]
    unsafe {
        ADDRESS.read_volatile()
    }
}
