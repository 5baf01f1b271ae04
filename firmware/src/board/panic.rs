//! What happens if something panics after all, and the proof that nothing does.

use core::panic::PanicInfo;

/// Stops at once: with interrupts off not even a queued frame is sent to its end, and the modem drops half a frame by its
/// checksum. Silence is the only safe act of a unit that no longer knows its state. The watchdog then restarts it; that takes
/// more than a second, so a slot decided before cannot be decided again.
#[cfg(not(feature = "no-panic-proof"))]
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    #[cfg(feature = "defmt")]
    defmt::error!("panicked: the unit stays silent until the watchdog restarts it");
    loop {
        cortex_m::asm::nop();
    }
}

/// Nobody defines this function. If the optimiser has left a single way to a panic in the image, the handler is in it, and
/// the linker names what it misses.
#[cfg(feature = "no-panic-proof")]
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    #[allow(unsafe_code, reason = "declares what must not be called")]
    unsafe extern "Rust" {
        safe fn this_image_can_panic() -> !;
    }
    this_image_can_panic()
}
