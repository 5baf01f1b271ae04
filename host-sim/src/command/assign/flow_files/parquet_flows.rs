//! Link flows in Parquet, ours or another program's.

use super::columns;
use assignment::check::{self, FlowRow};
use assignment::link::check_not_negative;
use assignment::{Network, flow_table};
use kit::error::{Error, Result};
use kit::files::Text;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::reader::RowIter;
use parquet::record::{Field, Row};
use std::fs::File;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;

/// Reads the volumes of a Parquet file.
///
/// # Errors
/// As [`super::read`].
pub(super) fn read(path: &Path, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    let place = path.display().to_string();
    let file = File::open(path).map_err(|source| Error::file(path, source))?;
    refuse_panics(&place, || read_rows(&place, file, network, road_names))
}

fn read_rows(place: &str, file: File, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    let broken = |failure: ParquetError| Error::input(place, failure, "a Parquet file");
    let reader = SerializedFileReader::new(file).map_err(broken)?;
    let rows = reader.get_row_iter(None).map_err(broken)?;
    let names = reader.metadata().file_metadata().schema().get_fields();
    let has = |name: &str| names.iter().any(|field| field.name() == name);
    if !columns().into_iter().all(has) {
        let text = as_csv(place, rows).map_err(broken)?;
        return flow_table::read(&text, network, road_names);
    }
    // Counted like the lines of a CSV, which has a header.
    let rows = rows.zip(2..);
    let rows = rows.map(|(row, line)| flow_row(format!("{place}:{line}"), &row.map_err(broken)?));
    check::volumes(place, rows, network)
}

/// What `work` gives. At some damaged files the library panics, and would say so on standard error: they are refused like others.
fn refuse_panics<T>(place: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let outcome = panic::catch_unwind(AssertUnwindSafe(work));
    panic::set_hook(hook);
    outcome.unwrap_or_else(|_| Err(Error::input(place, "damaged data", "a Parquet file")))
}

/// A table of another program as the CSV that it could be.
fn as_csv(name: &str, rows: RowIter<'_>) -> std::result::Result<Text, ParquetError> {
    let mut text = String::new();
    for row in rows {
        let row = row?;
        if text.is_empty() {
            let names: Vec<&str> = row.get_column_iter().map(|(name, _)| name.as_str()).collect();
            text = names.join(",") + "\n";
        }
        let fields = row.get_column_iter().map(|(_, field)| match field {
            Field::Null => String::new(),
            Field::Str(text) => text.replace([',', '"', '\n', '\r'], " "),
            Field::Double(number) => number.to_string(),
            Field::Float(number) => number.to_string(),
            other => whole(other).map_or_else(String::new, |number| number.to_string()),
        });
        text += &fields.collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    Ok(Text::new(name, &text))
}

/// A row of a Parquet file, whose columns may come in any order.
fn flow_row(place: String, row: &Row) -> Result<FlowRow> {
    let [init_node, term_node, volume, cost] = columns();
    let column = |name: &str| {
        let found = row.get_column_iter().find(|(column, _)| *column == name);
        found.map(|(_, field)| field)
    };
    let node = |name: &str| {
        let found = column(name).and_then(|field| match field {
            Field::Str(text) => Some(text.clone()),
            field => whole(field).map(|number| number.to_string()),
        });
        found.ok_or_else(|| Error::input(format!("{place}: {name}"), "none", "a node's number or name"))
    };
    let number = |name: &str| {
        let found = column(name).and_then(|field| match field {
            Field::Double(number) => Some(*number),
            Field::Float(number) => Some(f64::from(*number)),
            field => whole(field).map(|number| number as f64),
        });
        let place = format!("{place}: {name}");
        let number = found.ok_or_else(|| Error::input(&place, "none", "a number"))?;
        check_not_negative(&place, number).map(|()| number)
    };
    let (nodes, volume) = ([node(init_node)?, node(term_node)?], number(volume)?);
    let _cost = number(cost)?;
    Ok(FlowRow { place, nodes, volume })
}

/// A whole number of any width.
fn whole(field: &Field) -> Option<i128> {
    match field {
        Field::Int(number) => Some((*number).into()),
        Field::Long(number) => Some((*number).into()),
        Field::UInt(number) => Some((*number).into()),
        Field::ULong(number) => Some((*number).into()),
        _ => None,
    }
}
