//! The image's ELF file.

use kit::error::{Error, Result};
use object::{Architecture, Object, ObjectSymbol};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const TARGET: &str = "thumbv7em-none-eabihf";

/// Builds the release image as its users do, and gives its path.
///
/// # Errors
/// [`Error::Input`] with Cargo's first error.
pub fn build() -> Result<PathBuf> {
    build_firmware(&["--bin", "firmware"])?
        .pop()
        .ok_or_else(|| wrong_build("no executable"))
}

/// Builds the package `firmware` for the chip with these further arguments, and gives its programs' paths.
///
/// # Errors
/// [`Error::Input`] with Cargo's first error.
pub fn build_firmware(arguments: &[&str]) -> Result<Vec<PathBuf>> {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args([
            "build",
            "-p",
            "firmware",
            "--profile",
            "firmware",
            "--target",
            TARGET,
        ])
        .args(["--message-format", "json-render-diagnostics"])
        .args(arguments)
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .stdin(Stdio::null())
        .output()
        .map_err(|error| wrong_build(&error.to_string()))?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        let error = words.lines().find(|line| line.starts_with("error"));
        return Err(wrong_build(error.unwrap_or("a failure without an error")));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let messages = text
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    Ok(messages
        .filter_map(|message| message.get("executable")?.as_str().map(PathBuf::from))
        .collect())
}

fn wrong_build(found: &str) -> Error {
    let expected = format!("a build for {TARGET} (`rustup target add {TARGET}` if the target is missing)");
    Error::input("cargo build -p firmware", found, expected)
}

/// A checked image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Its file.
    pub path: PathBuf,
    /// Where in memory it counts what its answers cost.
    pub slot_cost: u64,
}

impl Image {
    /// Checks that the file is an image that the machine can run and whose costs can be read.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Input`] if it is something else.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
        let place = path.display().to_string();
        let wrong =
            |found: &dyn std::fmt::Display| Error::input(&place, found, format!("an ELF image for {TARGET}"));
        let file = object::File::parse(bytes.as_slice()).map_err(|error| wrong(&error))?;
        if file.architecture() != Architecture::Arm {
            return Err(wrong(&format!("an ELF file for {:?}", file.architecture())));
        }
        let mut symbols = file.symbols();
        let slot_cost = symbols.find(|symbol| symbol.name().is_ok_and(|name| name.contains("SLOT_COST")));
        slot_cost
            .map(|symbol| Self {
                path: path.to_owned(),
                slot_cost: symbol.address(),
            })
            .ok_or_else(|| wrong(&"no symbol SLOT_COST"))
    }
}
