//! Path flows: which ways the trips of each pair of zones take, as a result, as a file, and as a start for the next solve.

use crate::classes::ClassFlows;
use crate::csv_rows::csv_rows;
use crate::demand::Demand;
use crate::network::Network;
use crate::path_tree::{PathTree, ROOT};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::{BTreeMap, HashMap};
use std::fmt::{Display, Write as _};

/// First line of a path file.
pub const HEADER: &str = "origin,destination,volume,cost,links";

/// First line of a path file of several classes.
pub const CLASS_HEADER: &str = "class,origin,destination,volume,cost,links";

/// Stands for indices beyond those of any network's links.
const NO_LINK: u32 = i32::MAX as u32;

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

/// The paths that all trips take, by ascending origin and destination. Those of an origin share what they have in common
/// at their beginning, so that millions of pairs fit.
#[derive(Debug, Clone, Default)]
pub struct PathFlows {
    /// By ascending origin.
    origins: Vec<OriginFlows>,
}

/// The paths from one origin.
#[derive(Debug, Clone)]
pub(crate) struct OriginFlows {
    /// Zone, from 1.
    origin: u32,
    tree: PathTree,
    /// By ascending destination.
    flows: Vec<FlowInTree>,
}

/// One path of an origin's tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlowInTree {
    /// Zone, from 1.
    destination: u32,
    /// Where in the tree it ends.
    pub(crate) end: u32,
    pub(crate) volume: f64,
}

impl FlowInTree {
    pub(crate) fn new(destination: u32, end: u32, volume: f64) -> Self {
        Self {
            destination,
            end,
            volume,
        }
    }
}

impl OriginFlows {
    /// Zones are numbers from 1; `flows` come by ascending destination.
    pub(crate) fn new(origin: u32, tree: PathTree, flows: Vec<FlowInTree>) -> Self {
        Self { origin, tree, flows }
    }

    pub(crate) fn tree(&self) -> &PathTree {
        &self.tree
    }

    /// The paths to a zone, given by number from 1; empty if it had no demand.
    pub(crate) fn to(&self, destination: u32) -> &[FlowInTree] {
        let first = self.flows.partition_point(|flow| flow.destination < destination);
        let rest = &self.flows[first..];
        let count = rest
            .iter()
            .take_while(|flow| flow.destination == destination)
            .count();
        &rest[..count]
    }

    fn iter(&self) -> impl Iterator<Item = PathFlow> {
        self.flows.iter().map(|flow| PathFlow {
            origin: self.origin,
            destination: flow.destination,
            volume: flow.volume,
            links: self.tree.path(flow.end),
        })
    }
}

impl PathFlows {
    /// `origins` come in ascending order.
    pub(crate) fn new(origins: Vec<OriginFlows>) -> Self {
        Self { origins }
    }

    /// How many paths there are.
    pub fn len(&self) -> usize {
        self.origins.iter().map(|from| from.flows.len()).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Every path, by ascending origin and destination.
    pub fn iter(&self) -> impl Iterator<Item = PathFlow> {
        self.origins.iter().flat_map(OriginFlows::iter)
    }

    /// Checks every path, as [`PathFlow::check`] does.
    ///
    /// # Errors
    /// [`Error::Input`] naming the path by its number, from 1.
    pub fn check(&self, network: &Network) -> Result<()> {
        for (index, path) in self.iter().enumerate() {
            path.check(network, format_args!("start: path {}", index + 1))?;
        }
        Ok(())
    }

    /// The paths from a zone, given by number from 1.
    pub(crate) fn of_origin(&self, origin: u32) -> Option<&OriginFlows> {
        let index = self.origins.binary_search_by_key(&origin, |from| from.origin);
        index.ok().map(|index| &self.origins[index])
    }
}

impl<'p> IntoIterator for &'p PathFlows {
    type Item = PathFlow;
    type IntoIter = Box<dyn Iterator<Item = PathFlow> + 'p>;

    fn into_iter(self) -> Self::IntoIter {
        Box::new(self.iter())
    }
}

impl PartialEq for PathFlows {
    /// Whether both hold the same paths in the same order.
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl FromIterator<PathFlow> for PathFlows {
    /// Paths that carry nothing are left out. Those of a pair keep their order.
    fn from_iter<T: IntoIterator<Item = PathFlow>>(paths: T) -> Self {
        let mut origins: BTreeMap<u32, OriginFlows> = BTreeMap::new();
        // Which link goes on where, in the tree of the present origin.
        let mut present = None;
        let mut branches = HashMap::new();
        for path in paths.into_iter().filter(|path| path.volume > 0.0) {
            let origin = path.origin;
            let empty = || OriginFlows::new(origin, PathTree::default(), Vec::new());
            let from = origins.entry(origin).or_insert_with(empty);
            if present.replace(origin) != Some(origin) {
                branches.clear();
                from.tree.for_each(|link, position, before| {
                    branches.insert((before, link), position);
                });
            }
            let mut end = ROOT;
            for &link in &path.links {
                let link = link.min(NO_LINK);
                let tree = &mut from.tree;
                end = *branches
                    .entry((end, link))
                    .or_insert_with(|| tree.grow(end, [link]));
            }
            from.flows
                .push(FlowInTree::new(path.destination, end, path.volume));
        }
        let mut flows = Self::new(origins.into_values().collect());
        for from in &mut flows.origins {
            from.flows.sort_by_key(|flow| flow.destination);
        }
        flows
    }
}

/// Link flows as the sum of path flows, and as many as the network has links.
pub fn link_flows(network: &Network, path_flows: &PathFlows) -> Vec<f64> {
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
pub fn format_paths(network: &Network, path_flows: &PathFlows, link_costs: &[f64]) -> String {
    let mut text = format!("{HEADER}\n");
    push_paths(&mut text, network, "", path_flows, link_costs);
    text
}

/// The paths of all classes, class by class, each row with its class first.
pub fn format_class_paths(network: &Network, classes: &[ClassFlows]) -> String {
    let mut text = format!("{CLASS_HEADER}\n");
    for class in classes {
        let first = format!("{},", class.name);
        push_paths(&mut text, network, &first, &class.path_flows, &class.link_costs);
    }
    text
}

/// Appends a row for each path, which begins with `first`.
fn push_paths(text: &mut String, network: &Network, first: &str, path_flows: &PathFlows, link_costs: &[f64]) {
    for path in path_flows {
        let (origin, destination) = (
            network.zone_name(path.origin),
            network.zone_name(path.destination),
        );
        let cost = path.cost(link_costs);
        // Writing to a string cannot fail.
        let _ = write!(text, "{first}{origin},{destination},{},{cost},", path.volume);
        for (index, link) in path.links.iter().enumerate() {
            let blank = if index == 0 { "" } else { " " };
            let _ = write!(text, "{blank}{}", link + 1);
        }
        text.push('\n');
    }
}

/// Reads a path file. Its costs are not believed, nor looked at.
///
/// # Errors
/// [`Error::Input`] naming the line for another header, a missing column, a field
/// that is no number, or a path that [`PathFlow::check`] refuses.
pub fn read_paths(text: &Text, network: &Network) -> Result<PathFlows> {
    let zones = network.zone_numbers();
    let rows = csv_rows(text, HEADER)?;
    rows.map(|row| row.and_then(|(place, fields)| path_of(&place, fields, network, &zones)))
        .collect()
}

/// Reads the paths of the classes of these names, as [`format_class_paths`] wrote them.
///
/// # Errors
/// As [`read_paths`], and for a class of another name.
pub fn read_class_paths(text: &Text, network: &Network, classes: &[&str]) -> Result<Vec<PathFlows>> {
    let zones = network.zone_numbers();
    let mut paths = vec![Vec::new(); classes.len()];
    for row in csv_rows(text, CLASS_HEADER)? {
        let (place, [class, origin, destination, volume, cost, links]) = row?;
        let index = classes.iter().position(|name| *name == class).ok_or_else(|| {
            let expected = format!("one of {}", classes.join(", "));
            Error::input(format!("{place}: class"), format!("`{class}`"), expected)
        })?;
        let fields = [origin, destination, volume, cost, links];
        paths[index].push(path_of(&place, fields, network, &zones)?);
    }
    Ok(paths.into_iter().map(PathFlows::from_iter).collect())
}

/// The path of a row.
fn path_of(
    place: &str,
    [origin, destination, volume, _cost, links]: [&str; 5],
    network: &Network,
    zones: &HashMap<String, u32>,
) -> Result<PathFlow> {
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
    path.check(network, place)?;
    Ok(path)
}

/// Whether the paths carry each pair's demand, within `tolerance` of it.
pub fn carry_demand(path_flows: &PathFlows, demand: &Demand, tolerance: f64) -> bool {
    let mut carried = BTreeMap::new();
    for path in path_flows {
        *carried.entry((path.origin, path.destination)).or_insert(0.0) += path.volume;
    }
    let met = demand.trips().all(|trip| {
        let volume = carried.remove(&(trip.origin, trip.destination)).unwrap_or(0.0);
        (volume - trip.volume).abs() <= tolerance * trip.volume
    });
    met && carried.into_values().all(|volume| volume == 0.0)
}
