//! Open Matrix: matrices between zones in HDF5 files, as travel demand programs exchange them.
//!
//! A file holds matrices under `/data` and, under `/lookup`, lists of what the rows and columns are called. Here a matrix
//! has as many rows as columns.
//!
//! Source: <https://github.com/osPlanning/omx/wiki/Specification>, version 0.2.

use crate::csv_table::id;
use crate::demand::Trip;
use crate::demand_table::Zones;
use crate::report::{ImportReport, NoteKind};
use hdf5_pure::{AttrValue, Dataset, File, FileBuilder, Group};
use kit::error::{Error, Result};
use std::path::Path;

/// The first bytes of every HDF5 file (its specification, section II.A).
const MAGIC: [u8; 8] = [0x89, b'H', b'D', b'F', b'\r', b'\n', 0x1a, b'\n'];

/// Most zones of a matrix (chosen: several times the largest models'; a small file can claim any size).
const MOST_ZONES: u64 = 30_000;

/// Rows that are read at once (chosen).
const ROWS: u64 = 64;

/// How hard matrices are compressed: zlib's fastest, as other programs write them.
const DEFLATE_LEVEL: u32 = 1;

/// Whether a file is HDF5 by its first bytes.
///
/// # Errors
/// [`Error::File`] if it cannot be read.
pub fn is_omx(path: &Path) -> Result<bool> {
    use std::io::Read as _;
    let failure = |source| Error::file(path, source);
    let mut magic = Vec::new();
    let file = std::fs::File::open(path).map_err(failure)?;
    let _read = file
        .take(MAGIC.len() as u64)
        .read_to_end(&mut magic)
        .map_err(failure)?;
    Ok(magic == MAGIC)
}

/// Reads the trips of a matrix; without a name, of the only one.
///
/// # Errors
/// [`Error::Input`] naming the file for one that is broken or cut off, no matrix of the name, one that is not square, or trips
/// that are negative.
pub(crate) fn read(
    path: &Path,
    name: Option<&str>,
    zones: &mut Zones<'_>,
    report: &mut ImportReport,
) -> Result<Vec<Trip>> {
    let place = path.display().to_string();
    let broken = |failure: hdf5_pure::Error| Error::input(&place, failure, "an Open Matrix (OMX) file");
    let file = File::open(path).map_err(broken)?;
    let matrices = file
        .group("data")
        .and_then(|group| group.datasets())
        .map_err(broken)?;
    let named = || format!("one of: {}", matrices.join(", "));
    let name = match (name, matrices.as_slice()) {
        (Some(name), known) if known.iter().any(|matrix| matrix == name) => name,
        (Some(name), _) => {
            return Err(Error::input(
                format!("{place}: matrix"),
                format!("`{name}`"),
                named(),
            ));
        }
        (None, [only]) => only,
        (None, _) => {
            let found = format!("{} matrices", matrices.len());
            return Err(Error::input(
                &place,
                found,
                format!("a matrix by --matrix, or `matrix` of a class, {}", named()),
            ));
        }
    };
    let place = format!("{place}: /data/{name}");
    let matrix = file.dataset(&format!("data/{name}")).map_err(broken)?;
    let count = match matrix.shape().map_err(broken)?.as_slice() {
        &[rows, columns] if rows == columns && rows <= MOST_ZONES => rows,
        shape => {
            let expected = format!("as many rows as columns, at most {MOST_ZONES}");
            return Err(Error::input(place, format!("the shape {shape:?}"), expected));
        }
    };
    let names = names(&file, count, zones, report)?;
    let numbers: Vec<Option<u32>> = names
        .iter()
        .map(|name| zones.number(name, 0.0, || place.clone()))
        .collect();
    let mut trips = Vec::new();
    let mut missing = 0;
    for first in (0..count).step_by(ROWS as usize) {
        let rows = ROWS.min(count - first);
        let values = matrix.read_f64_rows(first, rows).map_err(broken)?;
        for (row, values) in (first..).zip(values.chunks(count as usize)) {
            for (column, &value) in values.iter().enumerate() {
                if value.is_nan() {
                    missing += 1;
                    continue;
                }
                crate::link::check_not_negative(
                    &format!("{place}: row {}, column {}", row + 1, column + 1),
                    value,
                )?;
                if let (Some(origin), Some(destination), true) =
                    (numbers[row as usize], numbers[column], value > 0.0)
                {
                    trips.push(Trip {
                        origin,
                        destination,
                        volume: value,
                    });
                }
            }
        }
    }
    report.say(NoteKind::Read, name, format!("a matrix of {count} zones"));
    if missing > 0 {
        report.count(
            NoteKind::Default,
            name,
            "0 where the matrix has no number",
            missing,
        );
    }
    let others = matrices.iter().filter(|matrix| *matrix != name);
    let others: Vec<&str> = others.map(String::as_str).collect();
    if !others.is_empty() {
        report.say(NoteKind::Unused, "matrices", others.join(", "));
    }
    Ok(trips)
}

/// What the rows are called: by the first list whose names are all zones, else their numbers from 1.
fn names(file: &File, count: u64, zones: &mut Zones<'_>, report: &mut ImportReport) -> Result<Vec<String>> {
    let lookup: Option<Group> = file.group("lookup").ok();
    let lists = lookup.and_then(|group| group.datasets().ok()).unwrap_or_default();
    for list in &lists {
        let Ok(dataset) = file.dataset(&format!("lookup/{list}")) else {
            continue;
        };
        let names = list_names(&dataset).filter(|names| names.len() as u64 == count);
        if let Some(names) = names.filter(|names| names.iter().all(|name| zones.knows(name))) {
            report.say(NoteKind::Read, format!("/lookup/{list}"), "names of zones");
            return Ok(names);
        }
    }
    let text = "no list of the names of zones: rows are the zones 1, 2, 3 ...";
    report.say(NoteKind::Default, "/lookup", text);
    Ok((1..=count).map(|number| number.to_string()).collect())
}

/// The entries of a list, numbers or texts.
fn list_names(dataset: &Dataset) -> Option<Vec<String>> {
    if let Ok(names) = dataset.read_string() {
        return Some(names.iter().map(|name| id(name.trim()).to_owned()).collect());
    }
    let numbers = dataset.read_f64().ok()?;
    Some(numbers.iter().map(f64::to_string).collect())
}

/// Matrices between zones as a file; rows lie one after the other.
///
/// # Errors
/// [`Error::Input`] for zones without whole numbers, or matrices that the format cannot hold.
pub fn format<Name: AsRef<str>>(zones: &[String], matrices: &[(Name, Vec<f64>)]) -> Result<Vec<u8>> {
    let numbers: Option<Vec<i64>> = zones.iter().map(|name| name.parse().ok()).collect();
    let numbers = numbers.ok_or_else(|| {
        Error::input(
            "OMX",
            "zones with names",
            "zones with whole numbers; a CSV holds any",
        )
    })?;
    let count = zones.len() as u64;
    let mut builder = FileBuilder::new();
    builder.set_attr("OMX_VERSION", AttrValue::AsciiString("0.2".to_owned()));
    builder.set_attr("SHAPE", AttrValue::I32Array(vec![count as i32; 2]));
    let mut data = builder.create_group("data");
    for (name, values) in matrices {
        let dataset = data
            .create_dataset(name.as_ref())
            .with_f64_data(values)
            .with_shape(&[count, count]);
        let _same = dataset
            .with_chunks(&[count.clamp(1, ROWS), count.max(1)])
            .with_deflate(DEFLATE_LEVEL);
    }
    builder.add_group(data.finish());
    let mut lookup = builder.create_group("lookup");
    let _same = lookup
        .create_dataset("zone")
        .with_i64_data(&numbers)
        .with_shape(&[count]);
    builder.add_group(lookup.finish());
    builder
        .finish()
        .map_err(|failure| Error::input("OMX", failure, "matrices that the format can hold"))
}
