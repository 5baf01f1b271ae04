//! A whole slot of the deployed image, every interrupt included: `firmware/whole_slot.py` counts, in an emulator that comes as a package of
//! Python.

use crate::image::build;
use kit::error::{Error, Result};
use serde::Deserialize;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a slot of at most three sub-channels took, of those recorded for the tests.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct WholeSlot {
    /// Most instructions.
    #[serde(rename = "slot_with_interrupts_max_instructions")]
    pub instructions: u64,
    /// Most exceptions.
    #[serde(rename = "slot_with_interrupts_exceptions")]
    pub exceptions: u64,
    /// Most modelled cycles.
    #[serde(rename = "slot_with_interrupts_max_cycles")]
    pub cycles: u64,
}

/// Counts it; `None` where Python or its packages `unicorn` and `capstone` are not there, or no clone of the repository.
///
/// # Errors
/// An image that answers otherwise than the library, or that is none of this program's sources.
pub fn count(image: &Path) -> Result<Option<WholeSlot>> {
    let Some(workspace) = build::clone() else {
        return Ok(None);
    };
    // `./test slot` makes an environment with the packages.
    let own = workspace.join("target/unicorn/bin/python");
    let python = if own.exists() {
        own.as_path()
    } else {
        Path::new("python3")
    };
    let has_packages = Command::new(python)
        .args(["-c", "import unicorn, capstone"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_packages {
        return Ok(None);
    }
    let output = Command::new(python)
        .arg(workspace.join("firmware/whole_slot.py"))
        .arg(image)
        .arg("--json")
        .stdin(Stdio::null())
        .output()
        .map_err(|source| Error::file(python, source))?;
    let found = String::from_utf8_lossy(&output.stderr);
    let found = found.trim().trim_start_matches("error: ");
    serde_json::from_slice(&output.stdout)
        .map(Some)
        .map_err(|_| Error::input("firmware/whole_slot.py", found, "the counts of a whole slot"))
}
