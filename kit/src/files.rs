//! Texts with their names; output files appear whole or not at all.

use crate::error::{Error, Result};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file's name and contents.
pub type NamedText = (String, String);

/// A text with what errors call it.
#[derive(Debug, Clone)]
pub struct Text {
    /// Usually the path of its file.
    pub name: String,
    /// All of it.
    pub text: String,
}

impl Text {
    /// A text from memory.
    pub fn new(name: &str, text: &str) -> Self {
        Self {
            name: name.to_owned(),
            text: text.to_owned(),
        }
    }

    /// The text of a file.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
        let name = path.display().to_string();
        Ok(Self { name, text })
    }
}

/// Checks, before long work, that files can be written to a folder, which is made if missing.
///
/// # Errors
/// [`Error::File`] names the folder.
pub fn check_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|source| Error::file(folder, source))?;
    stage(&folder.join("probe"), &[])
        .map(drop)
        .map_err(|error| match error {
            Error::File { source, .. } => Error::file(folder, source),
            other => other,
        })
}

/// Refuses an output that is one of the inputs.
///
/// # Errors
/// [`Error::Input`] names the option and the file.
pub fn check_output(option: &str, output: &Path, inputs: &[PathBuf]) -> Result<()> {
    let Ok(existing) = output.canonicalize() else {
        return Ok(());
    };
    let same = |input: &&PathBuf| input.canonicalize().is_ok_and(|input| input == existing);
    inputs.iter().find(same).map_or(Ok(()), |input| {
        let found = format!("{}, which is read", input.display());
        Err(Error::input(option, found, "a file of its own"))
    })
}

/// Writes `contents` to `path`, through a temporary file beside it and a rename.
///
/// # Errors
/// [`Error::File`] names the path; nothing is left behind then.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<()> {
    // A device or a pipe takes bytes; it is not replaced.
    if path
        .metadata()
        .is_ok_and(|found| !found.is_file() && !found.is_dir())
    {
        return std::fs::write(path, contents).map_err(|source| Error::file(path, source));
    }
    publish(stage(path, contents)?, path)
}

/// Writes a set of files to a folder: none is published before all are complete.
///
/// # Errors
/// [`Error::File`] names the path that cannot be written.
pub fn write_set(folder: &Path, files: &[(String, impl AsRef<[u8]>)]) -> Result<()> {
    let mut staged = Vec::new();
    for (name, contents) in files {
        let path = folder.join(name);
        if path.is_dir() {
            return Err(Error::file(&path, ErrorKind::IsADirectory.into()));
        }
        staged.push((stage(&path, contents.as_ref())?, path));
    }
    staged
        .into_iter()
        .try_for_each(|(file, path)| publish(file, &path))
}

/// A line on where a set went, and which of its files to open first.
pub fn written(folder: &Path, first: &str, files: &[NamedText]) -> String {
    let others = files
        .iter()
        .map(|(name, _)| name.as_str())
        .filter(|name| *name != first);
    let others: Vec<&str> = others.collect();
    format!(
        "Report: {}. Beside it: {}.",
        folder.join(first).display(),
        others.join(", ")
    )
}

/// A complete temporary file beside `path`; it vanishes unless it is published.
fn stage(path: &Path, contents: &[u8]) -> Result<NamedTempFile> {
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
    // Only the kind of failure: the temporary name means nothing to anybody.
    let mut file = builder
        .tempfile_in(folder)
        .map_err(|source| Error::file(folder, source.kind().into()))?;
    file.write_all(contents)
        .map_err(|source| Error::file(path, source))?;
    Ok(file)
}

fn publish(file: NamedTempFile, path: &Path) -> Result<()> {
    file.persist(path)
        .map(drop)
        .map_err(|failure| Error::file(path, failure.error))
}
