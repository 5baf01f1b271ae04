//! Path flows: which ways the trips of each pair of zones take, as a result, as a file, and as a start for the next solve.

use crate::csv_rows::csv_rows;
use crate::demand::Demand;
use crate::network::Network;
use kit::error::{Error, Result};
use kit::files::Text;
use std::fmt::{Display, Write as _};

/// First line of a path file.
pub const HEADER: &str = "origin,destination,volume,cost,links";

/// One way from an origin to a destination, with the trips that take it.
#[derive(Debug, Clone, PartialEq)]
pub struct PathFlow {
    /// Zone it starts from, from 1.
    pub origin: u32,
    /// Zone it goes to, from 1.
    pub destination: u32,
    /// Vehicles per unit of time.
    pub volume: f64,
    /// Its links in the order of travel, as indices from 0 into the network's links.
    pub links: Box<[u32]>,
}

impl PathFlow {
    /// Checks that the path leads from its origin to its destination and passes through no node that may not be passed.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` for an unknown zone or link, a volume that is negative or not finite, no links, or
    /// links that do not make a way.
    pub fn check(&self, network: &Network, place: impl Display) -> Result<()> {
        let numbering = network.numbering();
        for (name, zone) in [("origin", self.origin), ("destination", self.destination)] {
            if !(1..=numbering.zones).contains(&zone) {
                let expected = format!("a zone from 1 to {}", numbering.zones);
                return Err(Error::input(format!("{place}: {name}"), zone, expected));
            }
        }
        if !(self.volume.is_finite() && self.volume >= 0.0) {
            let expected = "a finite number, not negative";
            return Err(Error::input(format!("{place}: volume"), self.volume, expected));
        }
        let broken =
            |found: String, expected: String| Err(Error::input(format!("{place}: links"), found, expected));
        let mut node = self.origin - 1;
        for (index, &link) in self.links.iter().enumerate() {
            if link as usize >= network.links().len() {
                let expected = format!("a link from 1 to {}", network.links().len());
                return broken((u64::from(link) + 1).to_string(), expected);
            }
            if network.init_node(link) != node || (index > 0 && node + 1 < numbering.first_thru_node) {
                let from = network.node_name(network.init_node(link) + 1);
                let here = network.node_name(node + 1);
                return broken(
                    format!("link {}, which leaves node {from}", link + 1),
                    format!("a link that goes on from node {here}, if it may be passed"),
                );
            }
            node = network.term_node(link);
        }
        if node + 1 == self.destination && !self.links.is_empty() {
            return Ok(());
        }
        broken(
            format!("an end at node {}", network.node_name(node + 1)),
            format!("the destination {}", network.zone_name(self.destination)),
        )
    }

    /// Sum of the given link costs along the path.
    pub fn cost(&self, link_costs: &[f64]) -> f64 {
        self.links.iter().map(|&link| link_costs[link as usize]).sum()
    }
}

/// Link flows as the sum of path flows, and as many as the network has links.
pub fn link_flows(network: &Network, path_flows: &[PathFlow]) -> Vec<f64> {
    let mut flows = vec![0.0; network.links().len()];
    for path in path_flows {
        for &link in &path.links {
            flows[link as usize] += path.volume;
        }
    }
    flows
}

/// Path flows as a path file: one row per path, zones by their names, links by their numbers from 1 with blanks between
/// them, numbers with all their digits.
pub fn format_paths(network: &Network, path_flows: &[PathFlow], link_costs: &[f64]) -> String {
    let mut text = format!("{HEADER}\n");
    for path in path_flows {
        let (origin, destination) = (
            network.zone_name(path.origin),
            network.zone_name(path.destination),
        );
        let cost = path.cost(link_costs);
        // Writing to a string cannot fail.
        let _ = write!(text, "{origin},{destination},{},{cost},", path.volume);
        for (index, link) in path.links.iter().enumerate() {
            let blank = if index == 0 { "" } else { " " };
            let _ = write!(text, "{blank}{}", link + 1);
        }
        text.push('\n');
    }
    text
}

/// Reads a path file. Its costs are not believed, nor looked at.
///
/// # Errors
/// [`Error::Input`] naming the line for another header, a missing column, a field
/// that is no number, or a path that [`PathFlow::check`] refuses.
pub fn read_paths(text: &Text, network: &Network) -> Result<Vec<PathFlow>> {
    let zones = network.zone_numbers();
    let mut path_flows = Vec::new();
    for row in csv_rows(text, HEADER)? {
        let (place, [origin, destination, volume, _cost, links]) = row?;
        let bad = |column: &str, found: &str, expected: &str| {
            Error::input(format!("{place}: {column}"), format!("`{found}`"), expected)
        };
        let zone = |column: &str, text: &str| {
            let number = zones.get(text).copied();
            number.ok_or_else(|| bad(column, text, "a zone of the network"))
        };
        let link = |text: &str| {
            let number = text.parse::<u32>().ok().filter(|&number| number > 0);
            number
                .map(|number| number - 1)
                .ok_or_else(|| bad("links", text, "numbers of links, from 1"))
        };
        let path = PathFlow {
            origin: zone("origin", origin)?,
            destination: zone("destination", destination)?,
            volume: volume.parse().map_err(|_| bad("volume", volume, "a number"))?,
            links: links.split_whitespace().map(link).collect::<Result<_>>()?,
        };
        path.check(network, &place)?;
        path_flows.push(path);
    }
    Ok(path_flows)
}

/// The paths of an earlier solution by pair, as a start on a network whose capacities, or with a demand whose volumes
/// have changed.
pub(crate) struct WarmStart<'p> {
    /// By ascending origin and destination.
    paths: Vec<&'p PathFlow>,
}

impl<'p> WarmStart<'p> {
    /// Checks every path, because a network with other links would make nonsense of them.
    pub(crate) fn new(network: &Network, path_flows: &'p [PathFlow]) -> Result<Self> {
        for (index, path) in path_flows.iter().enumerate() {
            path.check(network, format_args!("start: path {}", index + 1))?;
        }
        let mut paths: Vec<&PathFlow> = path_flows.iter().filter(|path| path.volume > 0.0).collect();
        paths.sort_by_key(|path| (path.origin, path.destination));
        Ok(Self { paths })
    }

    /// The paths of a pair, zones as indices from 0; empty if it had no demand.
    pub(crate) fn of(&self, origin: u32, destination: u32) -> &[&'p PathFlow] {
        let pair = (origin + 1, destination + 1);
        let first = self
            .paths
            .partition_point(|path| (path.origin, path.destination) < pair);
        let rest = &self.paths[first..];
        let paths = rest
            .iter()
            .take_while(|path| (path.origin, path.destination) == pair);
        &rest[..paths.count()]
    }
}

/// Whether the paths carry each pair's demand, within `tolerance` of it.
pub fn carry_demand(path_flows: &[PathFlow], demand: &Demand, tolerance: f64) -> bool {
    let mut carried = std::collections::BTreeMap::new();
    for path in path_flows {
        *carried.entry((path.origin, path.destination)).or_insert(0.0) += path.volume;
    }
    let met = demand.trips().all(|trip| {
        let volume = carried.remove(&(trip.origin, trip.destination)).unwrap_or(0.0);
        (volume - trip.volume).abs() <= tolerance * trip.volume
    });
    met && carried.into_values().all(|volume| volume == 0.0)
}
