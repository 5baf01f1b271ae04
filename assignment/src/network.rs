//! The road network: directed links in file order, and the outgoing links of each node in compressed rows.

use crate::link_rows::{LinkRows, OutgoingLink, dead_ends};
use crate::volume_delay::VolumeDelay;
use kit::error::{Error, Result};
use std::borrow::Cow;
use std::collections::HashMap;

/// More nodes than this are taken for a typing error rather than for a network.
const NODE_LIMIT: u32 = 10_000_000;

/// One directed link, as a network file states it. Units are the file's own; only costs must be in units of
/// `free_flow_time`, and capacity in units of the demand.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Number of the node it leaves, from 1.
    pub init_node: u32,
    /// Number of the node it enters, from 1.
    pub term_node: u32,
    /// Flow at which the BPR function adds `b` times the free-flow time.
    pub capacity: f64,
    /// Length, which costs [`CostWeights::distance`] per unit.
    pub length: f64,
    /// Travel time of an empty link.
    pub free_flow_time: f64,
    /// BPR's B; 0 for a link that never congests.
    pub b: f64,
    /// BPR's power, not necessarily an integer.
    pub power: f64,
    /// Toll, which costs [`CostWeights::toll`] per unit.
    pub toll: f64,
}

impl Link {
    /// The link's volume-delay function with toll and distance weighed in.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` for an attribute that is negative or not finite, a capacity of 0 on a link that can
    /// congest, or a coefficient `free_flow_time b / capacity^power` beyond floating point.
    pub fn volume_delay(&self, weights: CostWeights, place: &str) -> Result<VolumeDelay> {
        for (name, value) in [
            ("capacity", self.capacity),
            ("length", self.length),
            ("free_flow_time", self.free_flow_time),
            ("b", self.b),
            ("power", self.power),
            ("toll", self.toll),
        ] {
            check_not_negative(&format!("{place}: {name}"), value)?;
        }
        let congests = self.free_flow_time > 0.0 && self.b > 0.0 && self.power > 0.0;
        if congests && self.capacity == 0.0 {
            return Err(Error::input(
                format!("{place}: capacity"),
                0,
                "a positive number where b, power and free_flow_time are positive",
            ));
        }
        let fixed_cost = weights.toll * self.toll + weights.distance * self.length;
        let delay = VolumeDelay::bpr(self.free_flow_time, self.b, self.capacity, self.power, fixed_cost);
        if delay.is_finite() {
            Ok(delay)
        } else {
            Err(Error::input(
                place,
                "a cost that overflows",
                "attributes of a usual size",
            ))
        }
    }
}

/// What a unit of toll and of distance costs, in units of time. Both 0 by default: cost is time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CostWeights {
    /// Time per unit of toll.
    pub toll: f64,
    /// Time per unit of length.
    pub distance: f64,
}

/// How nodes are numbered: zones first, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeNumbering {
    /// Nodes 1 to `zones` are where trips start and end.
    pub zones: u32,
    /// Nodes 1 to `nodes` exist.
    pub nodes: u32,
    /// Nodes with a smaller number can start or end a trip, but no trip passes through them; 1 lets all be passed.
    pub first_thru_node: u32,
}

impl NodeNumbering {
    /// Checks that the three numbers make sense together.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` for no nodes, more than ten million, more zones than nodes, or a first thru node
    /// outside 1 to nodes + 1.
    pub fn check(&self, place: &str) -> Result<()> {
        let Self {
            zones,
            nodes,
            first_thru_node,
        } = *self;
        if !(1..=NODE_LIMIT).contains(&nodes) {
            let expected = format!("1 to {NODE_LIMIT}");
            return Err(Error::input(format!("{place}: NUMBER OF NODES"), nodes, expected));
        }
        if zones > nodes {
            let expected = format!("at most the {nodes} nodes");
            return Err(Error::input(format!("{place}: NUMBER OF ZONES"), zones, expected));
        }
        if !(1..=nodes + 1).contains(&first_thru_node) {
            let expected = format!("1 to {}", nodes + 1);
            return Err(Error::input(
                format!("{place}: FIRST THRU NODE"),
                first_thru_node,
                expected,
            ));
        }
        Ok(())
    }

    /// Checks that node `number` exists.
    ///
    /// # Errors
    /// [`Error::Input`] at `place`, for the column `name`.
    pub fn check_node(&self, place: &str, name: &str, number: u32) -> Result<()> {
        if (1..=self.nodes).contains(&number) {
            return Ok(());
        }
        let expected = format!("a node from 1 to {}", self.nodes);
        Err(Error::input(format!("{place}: {name}"), number, expected))
    }
}

/// What a file calls the nodes and zones that have numbers here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names {
    /// One per node.
    pub nodes: Vec<String>,
    /// One per zone.
    pub zones: Vec<String>,
}

/// A directed network. Links keep the order they were given in; that is the order of every flow and cost vector.
#[derive(Debug, Clone)]
pub struct Network {
    numbering: NodeNumbering,
    weights: CostWeights,
    /// None where numbers are names.
    names: Option<Names>,
    links: Vec<Link>,
    volume_delays: Vec<VolumeDelay>,
    /// Index from 0 of the node that each link leaves: paths are traced often, and links are large.
    init_nodes: Vec<u32>,
    /// Index from 0 of the node that each link enters.
    term_nodes: Vec<u32>,
    /// All links, by the node they leave.
    outgoing: LinkRows,
    /// Links to nodes through which no cheapest path leads, in file order.
    dead_end_links: Vec<u32>,
    /// All other links, by the node they leave.
    through: LinkRows,
    dead_ends: Vec<bool>,
}

impl Network {
    /// Builds a network from its links.
    ///
    /// # Errors
    /// [`Error::Input`] for a numbering or weights that make no sense, a link with an unknown node, or one that
    /// [`Link::volume_delay`] refuses. Links are named by their number, from 1.
    pub fn new(numbering: NodeNumbering, links: Vec<Link>, weights: CostWeights) -> Result<Self> {
        numbering.check("network")?;
        check_not_negative("toll weight", weights.toll)?;
        check_not_negative("distance weight", weights.distance)?;
        if i32::try_from(links.len()).is_err() {
            return Err(Error::input("network", links.len(), "fewer than 2^31 links"));
        }
        let mut volume_delays = Vec::with_capacity(links.len());
        for (index, link) in links.iter().enumerate() {
            let place = format!("link {}", index + 1);
            numbering.check_node(&place, "init_node", link.init_node)?;
            numbering.check_node(&place, "term_node", link.term_node)?;
            volume_delays.push(link.volume_delay(weights, &place)?);
        }
        let dead_ends = dead_ends(numbering, &links);
        let leads_on = |&link: &u32| !dead_ends[links[link as usize].term_node as usize - 1];
        let all = 0..links.len() as u32;
        Ok(Self {
            numbering,
            weights,
            names: None,
            init_nodes: links.iter().map(|link| link.init_node - 1).collect(),
            term_nodes: links.iter().map(|link| link.term_node - 1).collect(),
            outgoing: LinkRows::new(numbering.nodes, &links, all.clone()),
            dead_end_links: all.clone().filter(|link| !leads_on(link)).collect(),
            through: LinkRows::new(numbering.nodes, &links, all.filter(leads_on)),
            dead_ends,
            links,
            volume_delays,
        })
    }

    /// The same roads with other capacities, one per link in file order.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of capacities than of links, or one that is not positive.
    pub fn with_capacities(&self, capacities: &[f64]) -> Result<Self> {
        if capacities.len() != self.links.len() {
            let expected = format!("{}, one per link", self.links.len());
            return Err(Error::input("capacities", capacities.len(), expected));
        }
        let mut network = self.clone();
        for (index, &capacity) in capacities.iter().enumerate() {
            let place = format!("link {}", index + 1);
            if !(capacity.is_finite() && capacity > 0.0) {
                return Err(Error::input(
                    format!("{place}: capacity"),
                    capacity,
                    "a positive number",
                ));
            }
            let link = &mut network.links[index];
            link.capacity = capacity;
            network.volume_delays[index] = link.volume_delay(self.weights, &place)?;
        }
        Ok(network)
    }

    /// The same network, with the names that files shall call its nodes and zones by.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of names than of nodes and zones.
    pub fn with_names(mut self, names: Names) -> Result<Self> {
        let NodeNumbering { nodes, zones, .. } = self.numbering;
        for (what, found, expected) in [
            ("node names", names.nodes.len(), nodes),
            ("zone names", names.zones.len(), zones),
        ] {
            if found != expected as usize {
                return Err(Error::input(what, found, expected));
            }
        }
        self.names = Some(names);
        Ok(self)
    }

    /// What files call a node, given by number from 1.
    pub fn node_name(&self, number: u32) -> Cow<'_, str> {
        let name = self
            .names
            .as_ref()
            .and_then(|names| names.nodes.get(number as usize - 1));
        name.map_or_else(
            || Cow::Owned(number.to_string()),
            |name| Cow::Borrowed(name.as_str()),
        )
    }

    /// What files call a zone, given by number from 1.
    pub fn zone_name(&self, number: u32) -> Cow<'_, str> {
        let name = self
            .names
            .as_ref()
            .and_then(|names| names.zones.get(number as usize - 1));
        name.map_or_else(
            || Cow::Owned(number.to_string()),
            |name| Cow::Borrowed(name.as_str()),
        )
    }

    /// Number from 1 of every zone, by its name.
    pub fn zone_numbers(&self) -> HashMap<String, u32> {
        let zones = 1..=self.numbering.zones;
        zones
            .map(|number| (self.zone_name(number).into_owned(), number))
            .collect()
    }

    /// How many nodes and zones there are, and which may be passed.
    pub fn numbering(&self) -> NodeNumbering {
        self.numbering
    }

    /// What toll and distance cost.
    pub fn weights(&self) -> CostWeights {
        self.weights
    }

    /// The links, in file order.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The links' volume-delay functions, in file order.
    pub fn volume_delays(&self) -> &[VolumeDelay] {
        &self.volume_delays
    }

    /// Generalised travel cost of every link at the given flows.
    pub fn link_costs(&self, link_flows: &[f64]) -> Vec<f64> {
        let flows = link_flows.iter();
        self.volume_delays
            .iter()
            .zip(flows)
            .map(|(delay, &flow)| delay.cost(flow))
            .collect()
    }

    /// The links that leave a node, given by index from 0.
    #[inline]
    pub(crate) fn outgoing(&self, node: usize) -> &[OutgoingLink] {
        self.outgoing.of(node)
    }

    /// Of the links that leave a node, given by index from 0, those from whose end a cheapest path may lead on.
    #[inline]
    pub(crate) fn outgoing_through(&self, node: usize) -> &[OutgoingLink] {
        self.through.of(node)
    }

    /// The links that [`outgoing_through`](Self::outgoing_through) leaves out.
    pub(crate) fn dead_end_links(&self) -> &[u32] {
        &self.dead_end_links
    }

    /// Whether no cheapest path passes through a node, given by index from 0: it may not be passed, or its only
    /// neighbour is where it came from.
    #[inline]
    pub(crate) fn is_dead_end(&self, node: u32) -> bool {
        self.dead_ends[node as usize]
    }

    /// Index from 0 of the node that a link leaves.
    #[inline]
    pub(crate) fn init_node(&self, link: u32) -> u32 {
        self.init_nodes[link as usize]
    }

    /// Index from 0 of the node that a link enters.
    #[inline]
    pub(crate) fn term_node(&self, link: u32) -> u32 {
        self.term_nodes[link as usize]
    }
}

/// Refuses what is negative, infinite or not a number.
pub fn check_not_negative(place: &str, value: f64) -> Result<()> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Error::input(place, value, "a finite number, not negative"))
}
