//! Hands the linker the memory map and its scripts, for the target alone.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

/// The one memory map of the workspace. The linker also searches the directory it runs in, which is the workspace root
/// and comes before every search path: a second map anywhere would lose or win silently.
const MEMORY_MAP: &str = "../memory.x";

fn main() -> Result<(), Box<dyn Error>> {
    // Cargo does not know that a linker reads this file; without the line an edit would not relink.
    println!("cargo::rerun-if-changed={MEMORY_MAP}");
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy(MEMORY_MAP, out.join("memory.x")).map_err(|error| format!("{MEMORY_MAP}: {error}"))?;
    println!("cargo::rustc-link-search={}", out.display());
    // Here and not in `.cargo/config.toml`: a RUSTFLAGS variable replaces the flags there, and the image links empty.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
    Ok(())
}
