//! A folder of results: which grid they belong to, and one file a point, each with its checksum.
//!
//! ```text
//! grid.json                        the grid's fingerprint and size
//! points/012/012345.json           one line of JSON, one line "crc64 <of that line>"
//! ```

use super::commands::Command;
use super::{Grid, Outcome};
use kit::error::{Error, Result};
use kit::files::{check_folder, write_whole};
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
        if let Some(text) = read(&store.manifest_path())? {
            let place = store.manifest_path();
            let found = serde_json::from_str::<Manifest>(&text).map_err(|error| {
                Error::input(
                    place.display(),
                    error,
                    "a grid's fingerprint and number of points",
                )
            })?;
            if found != store.manifest() {
                return Err(Error::input(
                    folder.display(),
                    format!("results of another grid ({})", found.fingerprint),
                    format!("those of {} ({})", grid.path().display(), store.fingerprint),
                ));
            }
        }
        Ok(store)
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
        write_whole(&self.manifest_path(), &line(&self.manifest())?)
    }

    /// A point's outcome, if there is one.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged, or belongs to another grid or point; its place names it.
    pub fn outcome(&self, point: usize) -> Result<Option<Outcome>> {
        let path = self.point_path(point);
        let Some(text) = read(&path)? else {
            return Ok(None);
        };
        let damaged = |found: String| {
            let expected = "a result with its checksum; delete the file and run its shard again";
            Error::input(path.display(), found, expected)
        };
        let (body, sum) = text
            .strip_suffix('\n')
            .and_then(|text| text.split_once("\ncrc64 "))
            .ok_or_else(|| damaged("no checksum".to_owned()))?;
        let actual = checksum(body.as_bytes());
        if actual != sum {
            return Err(damaged(format!(
                "bytes of checksum {actual} where the file says {sum}"
            )));
        }
        let record: Record = serde_json::from_str(body).map_err(|error| damaged(error.to_string()))?;
        if (record.grid.as_str(), record.point) != (self.fingerprint.as_str(), point) {
            return Err(damaged(format!("point {} of grid {}", record.point, record.grid)));
        }
        if !record.outcome.fits(self.command) {
            return Err(damaged(format!(
                "other numbers than those of {}",
                self.command.name
            )));
        }
        Ok(Some(record.outcome))
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
        self.folder
            .join(format!("points/{:03}/{point:06}.json", point / FILES_PER_FOLDER))
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
