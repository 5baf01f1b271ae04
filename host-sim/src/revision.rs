//! Which sources a table comes from.

use std::fmt::Write as _;

/// The digest of a table's sources in hexadecimal; "unknown" for zeros.
pub fn revision_text(revision: &[u8; 20]) -> String {
    if revision.iter().all(|&byte| byte == 0) {
        return "unknown".to_owned();
    }
    revision.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
