//! A folder of results: which grid they belong to, and one file a point, each with its checksum.
//!
//! ```text
//! grid.json                        the grid's fingerprint and size
//! points/012/012345.json           one line of JSON, one line "crc64 <of that line>"
//! ```

use super::commands::Command;
use super::{Grid, Outcome};
use kit::error::{Error, Result};
use kit::files::{check_folder, sweep_up, write_whole};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Files of one folder; file systems slow down where there are too many (chosen).
const FILES_PER_FOLDER: usize = 1000;

/// CRC-64/XZ of bytes as 16 hexadecimal digits: against accidents, not against forgery.
pub(super) fn checksum(bytes: &[u8]) -> String {
    let crc = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    format!("{:016x}", crc.checksum(bytes))
}

/// What `grid.json` says.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    fingerprint: String,
    points: usize,
}

/// A point's line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    grid: String,
    point: usize,
    outcome: Outcome,
}

/// What a folder has of a point.
#[derive(Debug)]
pub enum Kept {
    /// Nothing.
    Nothing,
    /// A file that is not this point's result, as it was written; the error names it. It counts as nothing.
    Damaged(Error),
    /// Its outcome.
    Outcome(Outcome),
}

/// The results of one grid in one folder.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    command: &'static Command,
    fingerprint: String,
    points: usize,
}

impl Store {
    /// The folder of a grid's results, whether or not it exists; nothing is written.
    ///
    /// # Errors
    /// If the folder holds another grid's results, or the grid's own files cannot be read.
    pub fn new(folder: &Path, grid: &Grid) -> Result<Self> {
        let store = Self {
            folder: folder.to_owned(),
            command: grid.command(),
            fingerprint: grid.fingerprint()?,
            points: grid.points(),
        };
        let manifest = read(&store.manifest_path())?;
        // Every point says its grid too: a damaged manifest is written anew.
        match manifest.and_then(|text| serde_json::from_str::<Manifest>(&text).ok()) {
            Some(found) if found != store.manifest() => Err(Error::input(
                folder.display(),
                format!("results of another grid ({})", found.fingerprint),
                format!("those of {} ({})", grid.path().display(), store.fingerprint),
            )),
            _ => Ok(store),
        }
    }

    /// Whether a sweep of the grid was begun here.
    pub fn exists(&self) -> bool {
        self.manifest_path().exists()
    }

    /// The grid's fingerprint.
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// Says which grid the folder is for, before the first result.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn begin(&self) -> Result<()> {
        check_folder(&self.folder)?;
        for folder in 0..self.points.div_ceil(FILES_PER_FOLDER) {
            sweep_up(&self.points_folder(folder));
        }
        write_whole(&self.manifest_path(), &line(&self.manifest())?)
    }

    /// What there is of a point.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn kept(&self, point: usize) -> Result<Kept> {
        let path = self.point_path(point);
        let Some(text) = read(&path)? else {
            return Ok(Kept::Nothing);
        };
        Ok(match self.outcome(&text, point) {
            Ok(outcome) => Kept::Outcome(outcome),
            Err(found) => Kept::Damaged(Error::input(path.display(), found, "a result with its checksum")),
        })
    }

    /// The outcome in a point's file, or what stands there instead.
    fn outcome(&self, text: &str, point: usize) -> std::result::Result<Outcome, String> {
        let (body, sum) = text
            .strip_suffix('\n')
            .and_then(|text| text.split_once("\ncrc64 "))
            .ok_or("no checksum")?;
        let actual = checksum(body.as_bytes());
        if actual != sum {
            return Err(format!("bytes of checksum {actual} where the file says {sum}"));
        }
        let record: Record = serde_json::from_str(body).map_err(|error| error.to_string())?;
        if (record.grid.as_str(), record.point) != (self.fingerprint.as_str(), point) {
            return Err(format!("point {} of grid {}", record.point, record.grid));
        }
        if !record.outcome.fits(self.command) {
            return Err(format!("other numbers than those of {}", self.command.name));
        }
        Ok(record.outcome)
    }

    /// Keeps a point's outcome, whole.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep(&self, point: usize, outcome: Outcome) -> Result<()> {
        let mut bytes = line(&Record {
            grid: self.fingerprint.clone(),
            point,
            outcome,
        })?;
        let sum = checksum(bytes.trim_ascii_end());
        bytes.extend(format!("crc64 {sum}\n").bytes());
        write_whole(&self.point_path(point), &bytes)
    }

    fn manifest(&self) -> Manifest {
        Manifest {
            fingerprint: self.fingerprint.clone(),
            points: self.points,
        }
    }

    fn manifest_path(&self) -> PathBuf {
        self.folder.join("grid.json")
    }

    /// Where a point's outcome lies.
    pub fn point_path(&self, point: usize) -> PathBuf {
        let folder = self.points_folder(point / FILES_PER_FOLDER);
        folder.join(format!("{point:06}.json"))
    }

    fn points_folder(&self, index: usize) -> PathBuf {
        self.folder.join(format!("points/{index:03}"))
    }
}

/// One line of JSON.
fn line(value: &impl Serialize) -> Result<Vec<u8>> {
    let mut text = serde_json::to_string(value)
        .map_err(|error| Error::input("result", error, "values that JSON can hold"))?;
    text.push('\n');
    Ok(text.into_bytes())
}

/// A file's text, if the file exists. Bytes that are no UTF-8 become signs that no checksum fits.
fn read(path: &Path) -> Result<Option<String>> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(String::from_utf8_lossy(&bytes).into_owned())),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::file(path, error)),
    }
}
