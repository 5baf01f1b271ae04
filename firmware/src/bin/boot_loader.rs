//! Starts the image `renewable`, after it has exchanged it for the next one, or taken the one before back, if that is due.
//!
//! The rules are embassy-boot's: an exchange goes on after a power cut where it was, and an image that was not kept goes at the
//! next start. It runs at the 16 MHz of reset; an exchange takes six erases of 128 KiB, 6 s, 12 at most.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../board/flash_controller.rs"]
mod flash_controller;
#[cfg(target_os = "none")]
#[path = "../board/image_flash.rs"]
mod image_flash;

#[cfg(target_os = "none")]
mod start {
    use crate::image_flash::{Room, Sectors, State};
    use core::panic::PanicInfo;
    use embassy_boot::{BootLoader, BootLoaderConfig};
    // Its interrupt vectors.
    use stm32f4 as _;

    /// Where the running image begins: `maps/renewable/flash.x` links it there.
    const RUNNING: u32 = 0x0802_0000;
    type Running = Sectors<5, 1, { 128 << 10 }, RUNNING>;
    /// Bytes that are copied at once (chosen).
    const COPY: usize = 1024;

    #[allow(unsafe_code, reason = "owns the flash, and leaves for another program")]
    #[cortex_m_rt::entry]
    fn start() -> ! {
        // SAFETY: nothing else runs, and the three lie apart.
        let images = unsafe {
            BootLoaderConfig {
                active: Running::new(),
                dfu: Room::new(),
                state: State::new(),
            }
        };
        let mut buffer = [0; COPY];
        // Flash that fails in an exchange fails again at the next start; until then what is there may still run.
        let _ = BootLoader::new(images).prepare_boot(&mut buffer);
        // SAFETY: interrupts were never on, and the image begins with its vectors: the stack's start, then where to go.
        unsafe {
            (*cortex_m::peripheral::SCB::PTR).vtor.write(RUNNING);
            cortex_m::asm::bootload(core::ptr::with_exposed_provenance(RUNNING as usize))
        }
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("found a host, expected thumbv7em-none-eabihf: the boot loader of the STM32F405's image");
}
