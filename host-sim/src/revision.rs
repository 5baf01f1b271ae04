//! Which sources a result comes from.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// A git object name in hexadecimal; "unknown" for zeros.
pub fn revision_text(revision: &[u8; 20]) -> String {
    if revision.iter().all(|&byte| byte == 0) {
        return "unknown".to_owned();
    }
    revision.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// The git revision of the sources in a folder and whether they have uncommitted changes; unknown where git or its history
/// is missing.
pub fn source_revision(folder: &Path) -> ([u8; 20], bool) {
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .arg("-C")
            .arg(folder)
            .args(arguments)
            .output()
            .ok()?;
        let text = || String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then(text)
    };
    let mut revision = [0; 20];
    let Some(name) = git(&["rev-parse", "HEAD"]).filter(|name| name.len() == 40 && name.is_ascii()) else {
        return (revision, false);
    };
    for (byte, digits) in revision.iter_mut().zip(name.as_bytes().chunks(2)) {
        *byte = u8::from_str_radix(&String::from_utf8_lossy(digits), 16).unwrap_or(0);
    }
    // The shipped table itself does not count: exporting would otherwise mark every table as modified.
    let changes = git(&["status", "--porcelain", "--", ".", ":!firmware/src/tables"]);
    (revision, changes.is_none_or(|changes| !changes.is_empty()))
}
