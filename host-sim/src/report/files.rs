//! Output files appear whole or not at all.

use crate::error::{Error, Result};
use std::io::Write as _;
use std::path::Path;

/// Writes `contents` to `path`, through a temporary file beside it and a rename.
///
/// # Errors
/// [`Error::File`] names the path; nothing is left behind then.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder).map_err(|source| Error::file(folder, source))?;
    let mut builder = tempfile::Builder::new();
    let _same = builder.suffix(".partial");
    // A temporary file is private; what is published has the permissions that the user's umask gives.
    #[cfg(unix)]
    let _same = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder
        .tempfile_in(folder)
        .map_err(|source| Error::file(folder, source))?;
    file.write_all(contents)
        .map_err(|source| Error::file(path, source))?;
    file.persist(path)
        .map_err(|failure| Error::file(path, failure.error))?;
    Ok(())
}
