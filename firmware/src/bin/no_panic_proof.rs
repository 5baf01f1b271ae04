//! The deployed image, linked only if nothing in it can panic, and without the signature check. A proof, never for a chip: it
//! accepts no table.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../board/mod.rs"]
mod board;

/// Whether a boot loader has started this program and can exchange it: see `maps`.
#[cfg(target_os = "none")]
const IS_RENEWABLE: bool = false;

#[cfg(not(target_os = "none"))]
fn main() {
    println!(
        "found a host, expected thumbv7em-none-eabihf: the proof is that the linker makes this program there"
    );
}
