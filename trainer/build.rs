//! Stamps the trainer with a digest of its sources, which its tables carry: the same sources give the same tables, with git or
//! without, wherever they lie.

use sha2::{Digest as _, Sha256};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// What decides over a table, from the top folder: the code between a seed and a table's bytes, and its values.
const SOURCES: [&str; 9] = [
    "Cargo.lock",
    "assignment/src",
    "firmware/src",
    "host-sim/presets",
    "host-sim/src",
    "kit/src",
    "trainer/mixtures",
    "trainer/presets",
    "trainer/src",
];

/// Tables that were made are no source.
const TABLES: &str = "firmware/src/tables";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    let trainer = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?);
    let top = trainer.parent().unwrap_or(&trainer);
    let mut files = Vec::new();
    for source in SOURCES {
        println!("cargo::rerun-if-changed={}", top.join(source).display());
        collect(top, Path::new(source), &mut files)?;
    }
    files.sort();
    let mut digest = Sha256::new();
    for file in files {
        let mut bytes = fs::read(top.join(&file))?;
        // Some checkouts end lines in two bytes.
        bytes.retain(|byte| *byte != b'\r');
        digest.update(file.as_bytes());
        digest.update((bytes.len() as u64).to_le_bytes());
        digest.update(bytes);
    }
    let digest: [u8; 32] = digest.finalize().into();
    let source = format!("const SOURCES: [u8; 20] = {:?};\n", &digest[..20]);
    fs::write(PathBuf::from(env::var("OUT_DIR")?).join("sources.rs"), source)?;
    Ok(())
}

/// All files below a path, with slashes on every system.
fn collect(top: &Path, path: &Path, files: &mut Vec<String>) -> Result<(), Box<dyn Error>> {
    if path == Path::new(TABLES) {
        return Ok(());
    }
    let whole = top.join(path);
    if whole.is_dir() {
        for entry in fs::read_dir(whole)? {
            collect(top, &path.join(entry?.file_name()), files)?;
        }
    } else {
        let parts = path.components().map(|part| part.as_os_str().to_string_lossy());
        files.push(parts.collect::<Vec<_>>().join("/"));
    }
    Ok(())
}
