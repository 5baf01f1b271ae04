//! Computes the checksum of the sources that decide what the page's program does.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// What the program is made of, seen from the workspace.
const SOURCES: &[&str] = &[
    "firmware/src",
    "kit/src",
    "assignment/src",
    "host-sim/presets",
    "host-sim/src",
    "web/src",
];

/// What stands behind `host-sim`'s feature `program`, without which the page is built.
const NOT_BUILT: &[&str] = &[
    "command",
    "deadline",
    "difference.rs",
    "hil",
    "image",
    "main.rs",
    "report",
    "sweep",
];

fn main() -> Result<(), Box<dyn Error>> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let checksum = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let mut digest = checksum.digest();
    for source in SOURCES {
        println!("cargo::rerun-if-changed=../{source}");
        for path in files(&workspace.join(source))? {
            let of_simulator = path.strip_prefix(workspace.join("host-sim/src"));
            if of_simulator.is_ok_and(|path| NOT_BUILT.iter().any(|room| path.starts_with(room))) {
                continue;
            }
            digest.update(path.strip_prefix(&workspace)?.to_string_lossy().as_bytes());
            digest.update(&fs::read(&path)?);
        }
    }
    println!("cargo::rustc-env=FRESHLANE_SOURCES={:016x}", digest.finalize());
    Ok(())
}

/// A file, or all files in a folder, in the order of their names.
fn files(path: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut entries = fs::read_dir(path)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<Vec<_>, std::io::Error>>()?;
    entries.sort();
    let mut found = Vec::new();
    for entry in entries {
        found.extend(files(&entry)?);
    }
    Ok(found)
}
