//! Reader and writer for GMNS, the General Modeling Network Specification: `node.csv`, `link.csv` and a demand table.
//!
//! Columns come in any order, and unknown ones are passed over.
//!
//! | file | columns read |
//! |---|---|
//! | `node.csv` | `node_id`; `zone_id` (empty: no zone), `node_type` (`centroid`: may not be passed) |
//! | `link.csv` | `from_node_id`, `to_node_id`, `length`, `capacity` per hour and lane; `free_speed` or `vdf_fftt`; `directed`, `lanes`, `toll`, `vdf_alpha`, `vdf_beta` |
//! | demand | `o_zone_id`, `d_zone_id`, `volume` |
//!
//! Free-flow time is `vdf_fftt`, in minutes, or `length / free_speed` in minutes where that is missing: the speed is per
//! hour. Where their column is missing or the field is empty, `directed` is true, `lanes` 1, `toll` 0, and
//! `vdf_alpha` and `vdf_beta` are 0.15 and 4, the values of the Bureau of Public Roads.

use crate::coordinates::{Collected, LengthUnit, NodePlaces};
use crate::csv_table::{CsvTable, Row};
use crate::demand::{Demand, Trip};
use crate::link::{CostWeights, Link, NodeNumbering};
use crate::network::{Names, Network};
use crate::volume_delay::{BPR_B, BPR_POWER};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::HashMap;
use std::fmt::Write as _;

const MINUTES_PER_HOUR: f64 = 60.0;

/// The node type that may not be passed.
const CENTROID: &str = "centroid";

/// Reads a `node.csv` and a `link.csv`.
///
/// # Errors
/// [`Error::Input`] naming file, line and column for a column that is missing, a field that does not fit, a node or zone given
/// twice, a centroid without a zone, or a link between unknown nodes.
pub fn read_network(nodes: &Text, links: &Text, weights: CostWeights) -> Result<Network> {
    let (nodes, links) = (CsvTable::parse(nodes)?, CsvTable::parse(links)?);
    let (numbering, names) = number_nodes(&nodes)?;
    let numbers: HashMap<&str, u32> = names.nodes.iter().map(String::as_str).zip(1..).collect();
    let links = read_links(&links, &numbers, weights)?;
    Network::new(numbering, links, weights)?.with_names(names)
}

/// Numbers the nodes: centroids first, then other zones, then the rest, each in file order.
fn number_nodes(table: &CsvTable) -> Result<(NodeNumbering, Names)> {
    let id = table.column("node_id")?;
    let zone = table.optional_column("zone_id");
    let node_type = table.optional_column("node_type");
    let mut known = HashMap::new();
    let mut known_zones = HashMap::new();
    let (mut centroids, mut zones, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for row in table.rows() {
        let (name, zone_name) = (row.text(Some(id)), row.text(zone));
        if name.is_empty() {
            return Err(row.refuse(id, "a name or number"));
        }
        if known.insert(name, ()).is_some() {
            return Err(row.refuse(id, "each node once"));
        }
        let is_centroid = row.text(node_type) == CENTROID;
        match zone {
            Some(zone) if !zone_name.is_empty() => {
                if known_zones.insert(zone_name, ()).is_some() {
                    return Err(row.refuse(zone, "one node per zone"));
                }
                let block = if is_centroid { &mut centroids } else { &mut zones };
                block.push((name.to_owned(), zone_name.to_owned()));
            }
            _ if is_centroid => {
                let found = format!("`{name}`, a {CENTROID} without a zone_id");
                return Err(Error::input(row.place(), found, "a zone_id"));
            }
            _ => others.push(name.to_owned()),
        }
    }
    let first_thru_node = centroids.len() as u32 + 1;
    centroids.append(&mut zones);
    let (mut nodes, zones): (Vec<String>, Vec<String>) = centroids.into_iter().unzip();
    nodes.append(&mut others);
    let numbering = NodeNumbering {
        zones: zones.len() as u32,
        nodes: nodes.len() as u32,
        first_thru_node,
    };
    Ok((numbering, Names { nodes, zones }))
}

fn read_links(table: &CsvTable, numbers: &HashMap<&str, u32>, weights: CostWeights) -> Result<Vec<Link>> {
    let (from, to) = (table.column("from_node_id")?, table.column("to_node_id")?);
    let (length, capacity) = (table.column("length")?, table.column("capacity")?);
    let fftt = table.optional_column("vdf_fftt");
    let speed = match fftt {
        Some(_) => table.optional_column("free_speed"),
        None => Some(table.column("free_speed")?),
    };
    let directed = table.optional_column("directed");
    let lanes = table.optional_column("lanes");
    let toll = table.optional_column("toll");
    let (alpha, beta) = (
        table.optional_column("vdf_alpha"),
        table.optional_column("vdf_beta"),
    );
    let mut links = Vec::new();
    for row in table.rows() {
        let node = |column: usize| {
            let number = numbers.get(row.text(Some(column))).copied();
            number.ok_or_else(|| row.refuse(column, "a node of node.csv"))
        };
        let length = row.amount(length)?;
        let link = Link {
            init_node: node(from)?,
            term_node: node(to)?,
            capacity: row.amount(capacity)? * row.optional_amount(lanes)?.unwrap_or(1.0),
            length,
            free_flow_time: free_flow_time(row, fftt, speed, length)?,
            b: row.optional_amount(alpha)?.unwrap_or(BPR_B),
            power: row.optional_amount(beta)?.unwrap_or(BPR_POWER),
            toll: row.optional_amount(toll)?.unwrap_or(0.0),
        };
        link.volume_delay(weights, &row.place())?;
        if !is_directed(row, directed)? {
            links.push(Link {
                init_node: link.term_node,
                term_node: link.init_node,
                ..link
            });
            let back = links.len() - 1;
            links.insert(back, link);
        } else {
            links.push(link);
        }
    }
    Ok(links)
}

/// Minutes.
fn free_flow_time(row: Row<'_>, fftt: Option<usize>, speed: Option<usize>, length: f64) -> Result<f64> {
    if let Some(minutes) = row.optional_amount(fftt)? {
        return Ok(minutes);
    }
    let Some(column) = speed else {
        let expected = "it, or a column `free_speed`";
        return Err(Error::input(row.place(), "no vdf_fftt", expected));
    };
    let speed = row.amount(column)?;
    if speed > 0.0 {
        return Ok(MINUTES_PER_HOUR * length / speed);
    }
    Err(row.refuse(column, "a positive number"))
}

fn is_directed(row: Row<'_>, column: Option<usize>) -> Result<bool> {
    let Some(column) = column else {
        return Ok(true);
    };
    match row.text(Some(column)).to_ascii_lowercase().as_str() {
        "" | "1" | "true" => Ok(true),
        "0" | "false" => Ok(false),
        _ => Err(row.refuse(column, "true or false")),
    }
}

/// Reads a demand table for `network`, by the names of its zones.
///
/// # Errors
/// [`Error::Input`] naming file, line and column for a column that is missing, an unknown zone, or a volume that is negative or no
/// number.
pub fn read_demand(text: &Text, network: &Network) -> Result<Demand> {
    let table = CsvTable::parse(text)?;
    let (origin, destination) = (table.column("o_zone_id")?, table.column("d_zone_id")?);
    let volume = table.column("volume")?;
    let zones = network.zone_numbers();
    let mut trips = Vec::new();
    for row in table.rows() {
        let zone = |column: usize| {
            let number = zones.get(row.text(Some(column))).copied();
            number.ok_or_else(|| row.refuse(column, "a zone of the network"))
        };
        trips.push(Trip {
            origin: zone(origin)?,
            destination: zone(destination)?,
            volume: row.amount(volume)?,
        });
    }
    Demand::new(network.numbering().zones, &trips)
}

/// A network as `node.csv`.
pub fn format_nodes(network: &Network) -> String {
    let numbering = network.numbering();
    let mut text = String::from("node_id,zone_id,node_type\n");
    for number in 1..=numbering.nodes {
        let zone = if number <= numbering.zones {
            network.zone_name(number)
        } else {
            "".into()
        };
        let node_type = if number < numbering.first_thru_node {
            CENTROID
        } else {
            ""
        };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{zone},{node_type}", network.node_name(number));
    }
    text
}

/// A network as `link.csv`, with the free-flow time as `vdf_fftt` whatever its unit, and one lane that has all capacity.
pub fn format_links(network: &Network) -> String {
    let mut text = String::from(
        "link_id,from_node_id,to_node_id,directed,length,capacity,lanes,toll,vdf_fftt,vdf_alpha,vdf_beta\n",
    );
    for (number, link) in (1..).zip(network.links()) {
        let (from, to) = (
            network.node_name(link.init_node),
            network.node_name(link.term_node),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{number},{from},{to},1,{},{},1,{},{},{},{}",
            link.length, link.capacity, link.toll, link.free_flow_time, link.b, link.power
        );
    }
    text
}

/// A demand as a table for `network`, without trips within a zone.
pub fn format_demand(network: &Network, demand: &Demand) -> String {
    let mut text = String::from("o_zone_id,d_zone_id,volume\n");
    for trip in demand.trips() {
        let (origin, destination) = (
            network.zone_name(trip.origin),
            network.zone_name(trip.destination),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{origin},{destination},{}", trip.volume);
    }
    text
}

/// Reads the coordinates in a `node.csv`.
///
/// # Errors
/// [`Error::Input`] for missing columns `x_coord` and `y_coord`, and otherwise as [`crate::tntp::read_places`].
pub fn read_places(text: &Text, network: &Network) -> Result<NodePlaces> {
    let table = CsvTable::parse(text)?;
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
    collected.finish(&text.name)
}
