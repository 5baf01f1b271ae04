//! Hands the linker the memory map and its scripts, for the target alone, and the image the key that signs its tables.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

/// The one memory map of the workspace. The linker also searches the directory it runs in, which is the workspace root
/// and comes before every search path: a second map anywhere would lose or win silently.
const MEMORY_MAP: &str = "../memory.x";

/// The public key of whoever signs tables for a release, in hexadecimal.
const TABLE_KEY: &str = "FRESHLANE_TABLE_KEY";
/// The test key: its secret half is 32 bytes of 0x42, and in the repository's tests.
const TEST_KEY: &str = "2152f8d19b791d24453242e15f2eab6cb7cffa7b6a5ed30097960e069881db12";

fn main() -> Result<(), Box<dyn Error>> {
    write_table_key()?;
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

/// A build without a release key is a build for tests, and says so where it makes an image.
fn write_table_key() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-env-changed={TABLE_KEY}");
    let given = env::var(TABLE_KEY).ok();
    let digits = given.as_deref().unwrap_or(TEST_KEY);
    let found = || format!("{TABLE_KEY}: found {digits:?}, expected 64 hexadecimal digits");
    if digits.len() != 64 || !digits.is_ascii() {
        return Err(found().into());
    }
    let mut key = [0; 32];
    for (position, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * position..2 * position + 2], 16).map_err(|_| found())?;
    }
    let is_test = digits.eq_ignore_ascii_case(TEST_KEY);
    if is_test && env::var("CARGO_CFG_TARGET_OS")? == "none" {
        println!(
            "cargo::warning=this image holds the TEST key for tables and is not for release: set {TABLE_KEY}"
        );
    }
    let source =
        format!("const TABLE_KEY: [u8; 32] = {key:?};\nconst TABLE_KEY_IS_TEST: bool = {is_test};\n");
    fs::write(PathBuf::from(env::var("OUT_DIR")?).join("table_key.rs"), source)?;
    Ok(())
}
