//! How far the stack ever went.

use cortex_m::register::msp;

#[allow(unsafe_code, reason = "names a place in the memory map")]
unsafe extern "C" {
    /// Defined by `memory.x`: the lowest byte that the stack may take.
    static _stack_end: u32;
    /// The byte above the highest.
    static _stack_start: u32;
}

/// Bytes that [`clear`] leaves: what it may itself push after it has read the stack pointer (chosen).
const OWN: usize = 256;

fn words() -> core::ops::Range<*const u32> {
    (&raw const _stack_end)..(&raw const _stack_start)
}

/// Clears what lies below the stack's present end, where nothing lives. Called once, with interrupts off.
#[inline(never)]
pub fn clear() {
    let end = (msp::read() as usize).saturating_sub(OWN);
    let mut word = words().start.cast_mut();
    while (word as usize) < end {
        // SAFETY: a word of the stack's own region that is not in use: below the stack pointer, and no interrupt comes in between.
        #[allow(unsafe_code, reason = "memory below the stack pointer")]
        unsafe {
            word.write_volatile(0);
            word = word.add(1);
        }
    }
}

/// The most bytes that it took since then: up to the lowest word that is not 0.
pub fn most() -> u16 {
    let words = words();
    let mut word = words.start;
    // SAFETY: reads words of the stack's own region, whatever they hold.
    #[allow(unsafe_code, reason = "memory below the stack pointer")]
    while word < words.end && unsafe { word.read_volatile() } == 0 {
        word = word.wrapping_add(1);
    }
    (words.end as usize - word as usize) as u16
}
