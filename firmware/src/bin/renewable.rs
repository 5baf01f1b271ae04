//! The deployed image as a boot loader starts it: it takes images over the air, too.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../board/mod.rs"]
mod board;

/// Whether a boot loader has started this program and can exchange it: see `maps`.
#[cfg(target_os = "none")]
const IS_RENEWABLE: bool = true;

#[cfg(not(target_os = "none"))]
fn main() {
    println!("found a host, expected thumbv7em-none-eabihf: the STM32F405's image behind the boot loader");
}
