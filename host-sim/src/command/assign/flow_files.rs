//! Link flows as files: CSV, or Parquet where the name ends in `.parquet`.

use crate::report::columns::{Column, Columns};
use assignment::{Network, check};
use kit::error::{Error, Result};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::{Field, Row};
use std::fs::File;
use std::path::Path;

/// Whether a file is Parquet by its name.
fn is_parquet(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "parquet")
}

/// The bytes of a flow file of the kind that its name asks for: one row per link in file order.
///
/// # Errors
/// If the table is larger than Parquet can hold.
pub(super) fn encode(
    path: &Path,
    network: &Network,
    link_flows: &[f64],
    link_costs: &[f64],
) -> Result<Vec<u8>> {
    if !is_parquet(path) {
        return Ok(check::format_flows(network, link_flows, link_costs).into_bytes());
    }
    let [init_node, term_node, volume, cost] = columns();
    let links = network.links();
    Columns::new(vec![
        nodes(init_node, network, links.iter().map(|link| link.init_node)),
        nodes(term_node, network, links.iter().map(|link| link.term_node)),
        Column::number(volume, link_flows.iter().copied()),
        Column::number(cost, link_costs.iter().copied()),
    ])?
    .to_parquet()
}

/// Names of the columns, the same in both kinds of file.
fn columns() -> [&'static str; 4] {
    let mut names = check::HEADER.split(',');
    std::array::from_fn(|_| names.next().unwrap_or_default())
}

/// A column of nodes: numbers where all names are, text otherwise.
fn nodes(column: &str, network: &Network, numbers: impl Iterator<Item = u32> + Clone) -> Column {
    let names = numbers.map(|number| network.node_name(number));
    let as_numbers: Option<Vec<u64>> = names.clone().map(|name| name.parse().ok()).collect();
    match as_numbers {
        Some(numbers) => Column::unsigned(column, numbers),
        None => Column::text(column, names.map(|name| name.into_owned())),
    }
}

/// Reads the volumes of a flow file. In errors, the rows of a Parquet file are counted like the lines of the same CSV.
///
/// # Errors
/// As [`check::read_flows`], and [`Error::Input`] for a file that is not Parquet, or has other columns.
pub(super) fn read(path: &Path, network: &Network) -> Result<Vec<f64>> {
    if !is_parquet(path) {
        return check::read_flows(path, network);
    }
    let place = path.display().to_string();
    let file = File::open(path).map_err(|source| Error::file(path, source))?;
    let broken = |failure: parquet::errors::ParquetError| Error::input(&place, failure, "a Parquet file");
    let reader = SerializedFileReader::new(file).map_err(broken)?;
    let mut text = format!("{}\n", check::HEADER);
    for row in reader.get_row_iter(None).map_err(broken)? {
        let row = row.map_err(broken)?;
        let fields = columns().map(|name| field(&row, name));
        for (index, (name, field)) in columns().into_iter().zip(fields).enumerate() {
            let expected = format!("numbers or names in a column `{name}`");
            let field = field.ok_or_else(|| Error::input(&place, format!("none in `{name}`"), expected))?;
            text.push_str(if index == 0 { "" } else { "," });
            text.push_str(&field);
        }
        text.push('\n');
    }
    check::parse_flows(&place, &text, network)
}

/// A field as CSV has it.
fn field(row: &Row, name: &str) -> Option<String> {
    let (_, field) = row.get_column_iter().find(|(column, _)| *column == name)?;
    match field {
        Field::Str(text) => Some(text.clone()),
        Field::Double(number) => Some(number.to_string()),
        Field::Float(number) => Some(number.to_string()),
        Field::Int(number) => Some(number.to_string()),
        Field::Long(number) => Some(number.to_string()),
        Field::UInt(number) => Some(number.to_string()),
        Field::ULong(number) => Some(number.to_string()),
        _ => None,
    }
}
