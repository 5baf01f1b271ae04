//! Texts with their names; output files appear whole or not at all, also when the power goes: contents are on the disk before
//! a name points at them, and names before the work is called done.

use crate::error::{Error, Result};
use crate::text::wrapped;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::NamedTempFile;

/// What names of files begin and end with that are not complete yet.
const PREFIX: &str = ".tmp";
const SUFFIX: &str = ".partial";

/// Longest time from the making of a file to its lock (chosen).
const JUST_NOW: Duration = Duration::from_secs(1);

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

    /// The text of a file, without its byte-order mark.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Input`] naming the line with bytes that are no UTF-8.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
        Self::decode(path.display().to_string(), bytes)
    }

    /// The text that a file's bytes are, without its byte-order mark.
    ///
    /// # Errors
    /// [`Error::Input`] naming the line with bytes that are no UTF-8.
    pub fn decode(name: String, bytes: Vec<u8>) -> Result<Self> {
        match String::from_utf8(bytes) {
            Ok(mut text) => {
                if text.starts_with('\u{feff}') {
                    text.drain(..'\u{feff}'.len_utf8());
                }
                Ok(Self { name, text })
            }
            Err(error) => {
                let good = error.utf8_error().valid_up_to();
                let bytes = error.as_bytes();
                let line = 1 + bytes[..good].iter().filter(|byte| **byte == b'\n').count();
                let found = format!("the byte {:#04x}", bytes[good]);
                Err(Error::input(format!("{name}:{line}"), found, "text in UTF-8"))
            }
        }
    }
}

/// Checks, before long work, that files can be written to a folder, which is made if missing and [swept up](sweep_up) if not.
///
/// # Errors
/// [`Error::File`] names the folder.
pub fn check_folder(folder: &Path) -> Result<()> {
    sweep_up(folder);
    stage(&folder.join("probe"), &[])
        .map(drop)
        .map_err(|error| match error {
            Error::File { source, .. } => Error::file(folder, source),
            other => other,
        })
}

/// Removes what killed programs have left half-written in a folder. A file that somebody still writes is locked, and stays.
pub fn sweep_up(folder: &Path) {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let partial = |path: &PathBuf| {
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
        name.starts_with(PREFIX) && name.ends_with(SUFFIX)
    };
    for path in files.map(|file| file.path()).filter(partial) {
        let abandoned = File::open(&path).is_ok_and(|file| {
            let age = file
                .metadata()
                .and_then(|data| data.modified())
                .map(|time| time.elapsed());
            // Not yet locked, if it was made just now.
            matches!(age, Ok(Ok(age)) if age > JUST_NOW) && file.try_lock().is_ok()
        });
        if abandoned {
            // Another program may have been faster.
            let _removed = std::fs::remove_file(&path);
        }
    }
}

/// Removes a file, if it is there.
///
/// # Errors
/// [`Error::File`] if it is and stays.
pub fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != ErrorKind::NotFound => Err(Error::file(path, source)),
        _ => Ok(()),
    }
}

/// Refuses an output that is one of the inputs.
///
/// # Errors
/// [`Error::Input`] names the option and the file.
pub fn check_output(option: &str, output: &Path, inputs: &[PathBuf]) -> Result<()> {
    // By what the file system calls the files: names may differ.
    let same = |input: &&PathBuf| same_file::is_same_file(input, output).unwrap_or(false);
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
    publish(vec![(stage(path, contents)?, path.to_owned())])
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
    publish(staged)
}

/// A line on where a set went, and which of its files to open first.
pub fn written(folder: &Path, first: &str, files: &[NamedText]) -> String {
    let others = files
        .iter()
        .map(|(name, _)| name.as_str())
        .filter(|name| *name != first);
    let others: Vec<&str> = others.collect();
    let line = format!(
        "Report: {}. Beside it: {}.",
        folder.join(first).display(),
        others.join(", ")
    );
    wrapped(&line, "")
}

/// A complete temporary file beside `path`, on the disk; it vanishes unless it is published.
fn stage(path: &Path, contents: &[u8]) -> Result<NamedTempFile> {
    let folder = parent(path);
    make_folder(folder)?;
    let mut builder = tempfile::Builder::new();
    let _same = builder.prefix(PREFIX).suffix(SUFFIX);
    // A temporary file is private; what is published has the permissions that the user's umask gives.
    #[cfg(unix)]
    let _same = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    // Only the kind of failure: the temporary name means nothing to anybody.
    let mut file = builder
        .tempfile_in(folder)
        .map_err(|source| Error::file(folder, source.kind().into()))?;
    let in_file = |source: std::io::Error| Error::file(path, source.kind().into());
    // Where files cannot be locked, nobody sweeps them up either.
    let _locked = file.as_file().lock();
    file.write_all(contents).map_err(in_file)?;
    file.as_file().sync_all().map_err(in_file)?;
    done(Step::Contents, path);
    Ok(file)
}

/// Gives complete files their names.
fn publish(files: Vec<(NamedTempFile, PathBuf)>) -> Result<()> {
    let mut folders = BTreeSet::new();
    for (file, path) in files {
        let published = file.persist(&path);
        let published = published.map_err(|failure| Error::file(&path, failure.error))?;
        // At once, also where a child that is just being started holds it too.
        let _unlocked = published.unlock();
        done(Step::Name, &path);
        let _new = folders.insert(parent(&path).to_owned());
    }
    folders.iter().try_for_each(|folder| sync_folder(folder))
}

/// The folder of a file.
fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Makes a folder and those above it, where they are missing.
fn make_folder(folder: &Path) -> Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    make_folder(parent(folder))?;
    match std::fs::create_dir(folder) {
        Err(source) if source.kind() != ErrorKind::AlreadyExists || !folder.is_dir() => {
            Err(Error::file(folder, source))
        }
        _ => sync_folder(parent(folder)),
    }
}

/// Brings a folder's names to the disk, where the system can.
fn sync_folder(folder: &Path) -> Result<()> {
    if !cfg!(unix) {
        return Ok(());
    }
    done(Step::Folder, folder);
    match File::open(folder).and_then(|opened| opened.sync_all()) {
        // Some network file systems know no such thing.
        Err(source) if !matches!(source.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => {
            Err(Error::file(folder, source))
        }
        _ => Ok(()),
    }
}

/// What matters to the order in which things reach the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// A file's contents are on the disk.
    Contents,
    /// A file has its name.
    Name,
    /// A folder's names are on the disk.
    Folder,
}

/// Notes a step, in tests.
fn done(_step: Step, _path: &Path) {
    #[cfg(test)]
    tests::STEPS.with_borrow_mut(|steps| steps.push((_step, _path.to_owned())));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    thread_local! {
        pub(super) static STEPS: RefCell<Vec<(Step, PathBuf)>> = const { RefCell::new(Vec::new()) };
    }

    #[test]
    fn bytes_that_are_no_text_are_named_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("caf\u{e9}.csv");
        std::fs::write(&path, b"one\ntwo\ncaf\xe9\n").unwrap();
        let message = Text::read(&path).unwrap_err().to_string();
        let expected = format!(
            "{}:3: found the byte 0xe9, expected text in UTF-8",
            path.display()
        );
        assert_eq!(message, expected);
        std::fs::write(&path, "\u{feff}one").unwrap();
        assert_eq!(Text::read(&path).unwrap().text, "one");
    }

    #[test]
    fn an_input_is_no_output_under_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("input"), "1").unwrap();
        std::fs::hard_link(path("input"), path("link")).unwrap();
        std::fs::write(path("other"), "1").unwrap();
        let check = |name: &str| check_output("--flows", &path(name), &[path("input")]);
        assert!(check("input").is_err() && check("link").is_err());
        assert!(check("other").is_ok() && check("new").is_ok());
    }

    #[test]
    fn what_nobody_writes_any_more_is_swept_up() {
        let folder = tempfile::tempdir().unwrap();
        let name = |name: &str| folder.path().join(name);
        let long_ago = std::time::SystemTime::now() - 10 * JUST_NOW;
        let make = |name: &str| {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(long_ago).unwrap();
            file
        };
        drop(make(".tmpDead.partial"));
        drop(make("a.partial"));
        let written = make(".tmpLive.partial");
        written.lock().unwrap();
        check_folder(folder.path()).unwrap();
        assert!(!name(".tmpDead.partial").exists());
        assert!(name("a.partial").exists() && name(".tmpLive.partial").exists());
    }

    #[test]
    fn nothing_has_a_name_before_its_contents_are_on_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let new = folder.path().join("new/below");
        write_set(&new, &[("a".to_owned(), "1"), ("b".to_owned(), "2")]).unwrap();
        let steps = STEPS.take();
        let names = |step: &(Step, PathBuf)| (step.0, step.1.strip_prefix(folder.path()).unwrap().to_owned());
        let found: Vec<(Step, PathBuf)> = steps.iter().map(names).collect();
        let expected = [
            (Step::Folder, ""),
            (Step::Folder, "new"),
            (Step::Contents, "new/below/a"),
            (Step::Contents, "new/below/b"),
            (Step::Name, "new/below/a"),
            (Step::Name, "new/below/b"),
            (Step::Folder, "new/below"),
        ];
        assert_eq!(found, expected.map(|(step, path)| (step, path.into())));
        assert_eq!(std::fs::read_to_string(new.join("b")).unwrap(), "2");
    }
}
