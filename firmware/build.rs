//! Tells the library what its processor can do and which key signs its tables, and the image's linker its memory map. A program that
//! uses the library alone gets no link argument, no search path and no memory map.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

#[path = "src/table_store/key/sound.rs"]
mod sound;

/// The one memory map of the workspace. The linker also searches the directory it runs in, which is the workspace root
/// and comes before every search path: a second map anywhere would lose or win silently.
const MEMORY_MAP: &str = "../memory.x";

/// The public key of whoever signs tables for a release, in hexadecimal.
const TABLE_KEY: &str = "FRESHLANE_TABLE_KEY";
/// The test key: its secret half is 32 bytes of 0x42, and in the repository's tests.
const TEST_KEY: &str = "2152f8d19b791d24453242e15f2eab6cb7cffa7b6a5ed30097960e069881db12";

/// What the image is built for.
const IMAGE_TARGET: &str = "thumbv7em-none-eabihf";

/// Processors of ARMv8-M with the DSP extension, by their names in `-C target-cpu`. On a Cortex-M33 or M35P the extension is the
/// chip maker's choice; the compiler, too, takes it as there.
const ARMV8M_WITH_DSP: [&str; 7] = [
    "cortex-m33",
    "cortex-m35p",
    "cortex-m52",
    "cortex-m55",
    "cortex-m85",
    "star-mc1",
    "star-mc3",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-check-cfg=cfg(dsp_extension)");
    if has_dsp_extension()? {
        println!("cargo::rustc-cfg=dsp_extension");
    }
    write_table_key()?;
    if env::var_os("CARGO_FEATURE_STM32F405").is_some() && env::var("CARGO_CFG_TARGET_OS")? == "none" {
        link_image()?;
    }
    Ok(())
}

/// Whether the processor has the DSP extension of ARMv7-M or ARMv8-M. The compiler knows, but tells `cfg(target_feature)` only from nightly
/// on: ARMv7E-M is by definition ARMv7-M with it, and on ARMv8-M it is what the build's flags say.
fn has_dsp_extension() -> Result<bool, env::VarError> {
    let target = env::var("TARGET")?;
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    // `-C name=value` comes as one flag or as two.
    let value = |name: &str| {
        let mut values = flags.split('\x1f').filter_map(|flag| {
            let flag = flag.strip_prefix("-C").unwrap_or(flag).trim_start();
            flag.strip_prefix(name)?.strip_prefix('=')
        });
        values.next_back().unwrap_or_default()
    };
    let mut features = value("target-feature").split(',');
    Ok(target.starts_with("thumbv7em")
        || target.starts_with("thumbv8m.main")
            && (ARMV8M_WITH_DSP.contains(&value("target-cpu")) || features.any(|feature| feature == "+dsp")))
}

/// The memory map and the linker's scripts, for the image.
fn link_image() -> Result<(), Box<dyn Error>> {
    let target = env::var("TARGET")?;
    if target != IMAGE_TARGET {
        return Err(format!(
            "feature stm32f405: found target {target}, expected {IMAGE_TARGET}, or `default-features = false` for a library"
        )
        .into());
    }
    // Cargo does not know that a linker reads this file; without the line an edit would not relink.
    println!("cargo::rerun-if-changed={MEMORY_MAP}");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy(MEMORY_MAP, out.join("memory.x")).map_err(|error| format!("{MEMORY_MAP}: {error}"))?;
    println!("cargo::rustc-link-search={}", out.display());
    // A program's place in flash is in a file of one name in a folder of its own.
    let maps = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("maps");
    println!("cargo::rerun-if-changed=maps");
    let image_update = env::var_os("CARGO_FEATURE_IMAGE_UPDATE").is_some();
    for (program, map, is_built) in [
        ("firmware", "image", true),
        ("measure", "image", env::var_os("CARGO_FEATURE_MEASURE").is_some()),
        (
            "no-panic-proof",
            "image",
            env::var_os("CARGO_FEATURE_NO_PANIC_PROOF").is_some(),
        ),
        ("boot-loader", "boot-loader", image_update),
        ("renewable", "renewable", image_update),
    ] {
        if is_built {
            println!(
                "cargo::rustc-link-arg-bin={program}=-L{}",
                maps.join(map).display()
            );
        }
    }
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
    println!("cargo::rerun-if-changed=src/table_store/key/sound.rs");
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
    if !sound::is_sound(&key) || salty::PublicKey::try_from(&key).is_err() {
        return Err(format!(
            "{TABLE_KEY}: found {digits}, expected the public half of an Ed25519 key: anybody could sign for a point of small order, \
             and nobody for what is no point"
        )
        .into());
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
