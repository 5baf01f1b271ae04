//! Where the nodes of a network lie: TNTP node files, `x_coord` and `y_coord` of GMNS, junctions of SUMO.

use super::csv_table::CsvTable;
use super::network::Network;
use super::xml::{Element, Scan, elements};
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::path::Path;

/// The unit of coordinates, as far as the format says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Metres.
    Metre,
    /// Degrees, feet or anything else.
    Unknown,
}

/// Coordinates of every node, in the order of node numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct NodePlaces {
    /// Eastwards and northwards.
    pub places: Vec<(f64, f64)>,
    /// In which unit.
    pub unit: LengthUnit,
}

/// Reads a TNTP node file: a heading, then a node's number and coordinates on each line, with a closing `;`.
///
/// # Errors
/// [`Error::File`] if it cannot be read; [`Error::Input`] naming the line for another number of columns, a node that does
/// not exist or comes twice, or a coordinate that is no finite number; or naming a node that the file leaves out.
pub fn read_tntp(path: &Path, network: &Network) -> Result<NodePlaces> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
    parse_tntp(&path.display().to_string(), &text, network)
}

/// [`read_tntp`] from memory; `name` stands for the file in errors.
///
/// # Errors
/// As [`read_tntp`].
pub fn parse_tntp(name: &str, text: &str, network: &Network) -> Result<NodePlaces> {
    let mut collected = Collected::new(network, LengthUnit::Unknown);
    let lines = (1..).zip(text.lines().map(|line| line.trim().trim_end_matches(';').trim()));
    let content = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('~'));
    // The first line is the heading.
    for (number, line) in content.skip(1) {
        let place = format!("{name}:{number}");
        let columns: Vec<&str> = line.split_whitespace().collect();
        let &[node, x, y] = columns.as_slice() else {
            let found = format!("{} columns", columns.len());
            return Err(Error::input(place, found, "3: node X Y"));
        };
        collected.put(&place, node, (x, y))?;
    }
    collected.finish(name)
}

/// Reads the coordinates in the `node.csv` of a GMNS folder.
///
/// # Errors
/// [`Error::File`] if it cannot be read; [`Error::Input`] for missing columns `x_coord` and `y_coord`, and otherwise as
/// [`read_tntp`].
pub fn read_gmns(folder: &Path, network: &Network) -> Result<NodePlaces> {
    let path = folder.join("node.csv");
    let table = CsvTable::read(&path)?;
    let [id, x, y] = [
        table.column("node_id")?,
        table.column("x_coord")?,
        table.column("y_coord")?,
    ];
    let mut collected = Collected::new(network, LengthUnit::Unknown);
    for row in table.rows() {
        let coordinates = (row.text(Some(x)), row.text(Some(y)));
        collected.put(&row.place(), row.text(Some(id)), coordinates)?;
    }
    collected.finish(&path.display().to_string())
}

/// Reads the junctions of a SUMO `net.xml`; junctions that are no node of `network` are passed over.
///
/// # Errors
/// As [`read_tntp`], and for broken XML.
pub fn read_sumo(path: &Path, network: &Network) -> Result<NodePlaces> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::file(path, source))?;
    let name = path.display().to_string();
    let mut collected = Collected::new(network, LengthUnit::Metre);
    elements(&name, &text, "net", &mut |scan| match scan {
        Scan::Open(element) if element.tag() == "junction" => put_junction(&mut collected, element),
        _ => Ok(()),
    })?;
    collected.finish(&name)
}

fn put_junction(collected: &mut Collected<'_>, element: &Element<'_>) -> Result<()> {
    let id = element.required("id")?;
    if !collected.numbers.contains_key(&id) {
        return Ok(());
    }
    let (x, y) = (element.required("x")?, element.required("y")?);
    collected.put(&element.place(), &id, (&x, &y))
}

/// Coordinates on the way.
struct Collected<'n> {
    network: &'n Network,
    /// Number of every node from 1, by its name.
    numbers: HashMap<String, u32>,
    places: Vec<Option<(f64, f64)>>,
    unit: LengthUnit,
}

impl<'n> Collected<'n> {
    fn new(network: &'n Network, unit: LengthUnit) -> Self {
        let nodes = network.numbering().nodes;
        Self {
            network,
            numbers: (1..=nodes)
                .map(|number| (network.node_name(number).into_owned(), number))
                .collect(),
            places: vec![None; nodes as usize],
            unit,
        }
    }

    fn put(&mut self, place: &str, node: &str, (x, y): (&str, &str)) -> Result<()> {
        let number = self.numbers.get(node).copied().ok_or_else(|| {
            Error::input(
                format!("{place}: node"),
                format!("`{node}`"),
                "a node of the network",
            )
        })?;
        let coordinate = |name: &str, text: &str| {
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| {
                Error::input(format!("{place}: {name}"), format!("`{text}`"), "a finite number")
            })
        };
        let coordinates = (coordinate("X", x)?, coordinate("Y", y)?);
        if self.places[number as usize - 1].replace(coordinates).is_some() {
            let found = format!("`{node}` again");
            return Err(Error::input(format!("{place}: node"), found, "each node once"));
        }
        Ok(())
    }

    fn finish(self, name: &str) -> Result<NodePlaces> {
        let mut places = Vec::with_capacity(self.places.len());
        for (number, place) in (1..).zip(self.places) {
            places.push(place.ok_or_else(|| {
                let found = format!("no coordinates of node {}", self.network.node_name(number));
                Error::input(name, found, "coordinates of every node")
            })?);
        }
        Ok(NodePlaces {
            places,
            unit: self.unit,
        })
    }
}
