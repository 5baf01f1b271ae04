//! The deployed image. On a host the same binary describes the weight table that is built into it.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

/// Whether a boot loader has started this program and can exchange it: see `maps`.
#[cfg(target_os = "none")]
const IS_RENEWABLE: bool = false;

#[cfg(not(target_os = "none"))]
mod host;

#[cfg(all(not(target_os = "none"), feature = "defmt"))]
mod host_logger;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    host::describe_built_in_table()
}
