//! Link flows as files: CSV, or Parquet where the name ends in `.parquet`.

#[cfg(feature = "parquet")]
mod parquet_flows;

use crate::assign::Assignment;
use crate::report::table::{Column, Table};
use assignment::check;
use assignment::{ClassSolution, Network, flow_table, text};
use kit::error::Result;
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
    #[cfg(feature = "parquet")]
    if is_parquet(path) {
        return table.to_parquet();
    }
    Ok(table.to_csv().into_bytes())
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
/// As [`flow_table::read`], and [`kit::error::Error::Input`] for a file that is not Parquet, or has other columns.
pub fn read(path: &Path, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    #[cfg(feature = "parquet")]
    if is_parquet(path) {
        return parquet_flows::read(path, network, road_names);
    }
    flow_table::read(&text::read(path)?, network, road_names)
}
