//! Link flows as files: CSV, or Parquet where the name ends in `.parquet`.

use crate::assign::Assignment;
use crate::report::table::{Column, Table};
use assignment::check::{self, FlowRow};
use assignment::link::check_not_negative;
use assignment::{ClassSolution, Network, flow_table, text};
use kit::error::{Error, Result};
use kit::files::Text;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::reader::RowIter;
use parquet::record::{Field, Row};
use std::fs::File;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;

/// Whether a file is Parquet by its name.
fn is_parquet(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "parquet")
}

/// The bytes of a flow file of the kind that its name asks for: one row per link in file order. Volumes are passenger cars where
/// there are classes, whose vehicles and costs follow in columns of their own; a class has no cost where it may not drive.
/// Preloads have a column where there are any.
///
/// # Errors
/// If the table is larger than Parquet can hold.
pub(super) fn encode(path: &Path, assignment: &Assignment, solved: &ClassSolution) -> Result<Vec<u8>> {
    let network = &assignment.network;
    let ClassSolution { total, classes } = solved;
    if !is_parquet(path) && classes.is_empty() && !network.has_preloads() {
        let text = check::format_flows(network, &total.link_flows, &total.link_costs);
        return Ok(text.into_bytes());
    }
    let [init_node, term_node, volume, cost] = columns();
    let links = network.links();
    let mut table = vec![
        nodes(init_node, network, links.iter().map(|link| link.init_node)),
        nodes(term_node, network, links.iter().map(|link| link.term_node)),
        Column::number(volume, total.link_flows.iter().copied()),
        Column::number(cost, total.link_costs.iter().copied()),
    ];
    if network.has_preloads() {
        let preloads = (0..links.len()).map(|link| network.preload(link));
        table.push(Column::number("preload", preloads));
    }
    for (described, class) in assignment.classes.iter().zip(classes) {
        let mut open = vec![true; links.len()];
        for &link in &described.banned_links {
            open[link as usize] = false;
        }
        let costs = class.link_costs.iter().zip(open);
        let costs = costs.map(|(cost, open)| open.then_some(*cost));
        let (volume, cost) = (
            format!("{volume}_{}", class.name),
            format!("{cost}_{}", class.name),
        );
        table.push(Column::number(&volume, class.link_flows.iter().copied()));
        table.push(Column::number(&cost, costs));
    }
    let table = Table::new(table)?;
    if is_parquet(path) {
        table.to_parquet()
    } else {
        Ok(table.to_csv().into_bytes())
    }
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
/// As [`flow_table::read`], and [`Error::Input`] for a file that is not Parquet, or has other columns.
pub fn read(path: &Path, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    if !is_parquet(path) {
        return flow_table::read(&text::read(path)?, network, road_names);
    }
    let place = path.display().to_string();
    let file = File::open(path).map_err(|source| Error::file(path, source))?;
    refuse_panics(&place, || read_parquet(&place, file, network, road_names))
}

fn read_parquet(place: &str, file: File, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    let broken = |failure: parquet::errors::ParquetError| Error::input(place, failure, "a Parquet file");
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
fn as_csv(name: &str, rows: RowIter<'_>) -> std::result::Result<Text, parquet::errors::ParquetError> {
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
