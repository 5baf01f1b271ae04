//! defmt's logger where there is no debug probe: counts what would have gone out. It makes a host build with the feature
//! link, and lets tests see that something was logged.

use std::sync::atomic::{AtomicU32, Ordering};

static FRAMES: AtomicU32 = AtomicU32::new(0);
static BYTES: AtomicU32 = AtomicU32::new(0);

/// Log frames and bytes since the program started.
pub fn logged() -> (u32, u32) {
    (FRAMES.load(Ordering::Relaxed), BYTES.load(Ordering::Relaxed))
}

/// The same in words.
#[allow(dead_code, reason = "tests read the numbers")]
pub fn summary() -> String {
    let (frames, bytes) = logged();
    format!("logged              {frames} defmt frames, {bytes} bytes")
}

#[defmt::global_logger]
struct Logger;

// SAFETY: the contract is that frames of different threads do not interleave. Nothing is stored but two counters, so there
// is nothing to interleave; their sums do not depend on the order.
#[allow(unsafe_code, reason = "defmt's trait is unsafe to implement")]
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        let _ = FRAMES.fetch_add(1, Ordering::Relaxed);
    }

    unsafe fn flush() {}

    unsafe fn release() {}

    unsafe fn write(bytes: &[u8]) {
        let _ = BYTES.fetch_add(bytes.len() as u32, Ordering::Relaxed);
    }
}

defmt::timestamp!("{=u32}", logged().0);
