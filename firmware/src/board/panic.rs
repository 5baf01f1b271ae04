//! What happens if something panics after all.

use core::panic::PanicInfo;
use cortex_m::{asm, interrupt};

/// Stops for good, and at once: with interrupts off not even a queued frame is sent to its end, and the modem drops half a
/// frame by its checksum. Silence is the only safe act of a unit that no longer knows its state. It does not restart,
/// because a restarted unit could decide a slot for the second time.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    interrupt::disable();
    #[cfg(feature = "defmt")]
    defmt::error!("panicked: the unit stays silent");
    loop {
        asm::wfi();
    }
}
