//! The road network: directed links in file order, and the outgoing links of each node in compressed rows.

use crate::link::{CostWeights, DelayFunction, Link, NodeNumbering, check_not_negative};
use crate::link_rows::{LinkRows, OutgoingLink, dead_ends};
use crate::volume_delay::VolumeDelay;
use kit::error::{Error, Result};
use std::borrow::Cow;
use std::collections::HashMap;

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
    /// So many of the first links are roads; behind them come connectors and turns.
    roads: usize,
    volume_delays: Vec<VolumeDelay>,
    /// How each link's time grows with its flow; empty where all are BPR.
    delay_functions: Vec<DelayFunction>,
    /// Vehicles that use each link whatever happens; empty where there are none.
    preloads: Vec<f64>,
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
            volume_delays.push(link.volume_delay(DelayFunction::Bpr, weights, &place)?);
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
            roads: links.len(),
            links,
            volume_delays,
            delay_functions: Vec::new(),
            preloads: Vec::new(),
        })
    }

    /// The same network, of whose links only the first `roads` are roads.
    #[cfg(feature = "formats")]
    pub(crate) fn with_roads(mut self, roads: usize) -> Self {
        self.roads = roads.min(self.links.len());
        self
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
            let function = self.delay_function(index);
            network.volume_delays[index] = link.volume_delay(function, self.weights, &place)?;
        }
        Ok(network)
    }

    /// The same roads with other delay functions, one per link in file order.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of functions than of links, or one that [`Link::volume_delay`] refuses.
    pub fn with_delay_functions(mut self, functions: Vec<DelayFunction>) -> Result<Self> {
        if functions.len() != self.links.len() {
            let expected = format!("{}, one per link", self.links.len());
            return Err(Error::input("delay functions", functions.len(), expected));
        }
        self.delay_functions = functions;
        self.volume_delays = self.delays(self.weights)?;
        Ok(self)
    }

    /// How the time on a link, given by index from 0, grows with its flow.
    #[inline]
    pub fn delay_function(&self, link: usize) -> DelayFunction {
        self.delay_functions.get(link).copied().unwrap_or_default()
    }

    /// The same roads with vehicles on them that no demand accounts for, such as buses and through traffic: so many passenger
    /// cars per link in file order. They slow others down, and take no decision.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of preloads than of links, or one that is negative or not finite.
    pub fn with_preloads(mut self, preloads: Vec<f64>) -> Result<Self> {
        if preloads.len() != self.links.len() {
            let expected = format!("{}, one per link", self.links.len());
            return Err(Error::input("preloads", preloads.len(), expected));
        }
        for (index, &preload) in preloads.iter().enumerate() {
            check_not_negative(&format!("link {}: preload", index + 1), preload)?;
        }
        self.preloads = preloads;
        Ok(self)
    }

    /// Vehicles that use a link, given by index from 0, whatever happens.
    #[inline]
    pub fn preload(&self, link: usize) -> f64 {
        self.preloads.get(link).copied().unwrap_or(0.0)
    }

    /// Whether any link has vehicles that use it whatever happens.
    pub fn has_preloads(&self) -> bool {
        self.preloads.iter().any(|preload| *preload > 0.0)
    }

    /// What each road carries, [preload](Self::with_preloads) included, over its capacity; 0 on one that has none, which never
    /// fills.
    pub fn volume_over_capacity(&self, link_flows: &[f64]) -> Vec<f64> {
        let roads = self.roads().iter().zip(link_flows).enumerate();
        let ratio = |(index, (road, flow)): (usize, (&Link, &f64))| {
            if road.capacity > 0.0 {
                (self.preload(index) + flow) / road.capacity
            } else {
                0.0
            }
        };
        roads.map(ratio).collect()
    }

    /// Flows of the roads without any demand.
    pub(crate) fn fill_with_preloads(&self, link_flows: &mut [f64]) {
        if self.preloads.is_empty() {
            link_flows.fill(0.0);
        } else {
            link_flows.copy_from_slice(&self.preloads);
        }
    }

    /// Of the flows of all vehicles, those of the demand.
    pub(crate) fn without_preloads<'f>(&self, link_flows: &'f [f64]) -> Cow<'f, [f64]> {
        if self.preloads.is_empty() {
            return Cow::Borrowed(link_flows);
        }
        let flows = link_flows.iter().zip(&self.preloads);
        flows.map(|(flow, preload)| (flow - preload).max(0.0)).collect()
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

    /// The links: roads in file order, then the connectors and turns that a reader added.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The links that are roads: the first ones, in file order.
    pub fn roads(&self) -> &[Link] {
        &self.links[..self.roads]
    }

    /// The links' volume-delay functions, in file order.
    pub fn volume_delays(&self) -> &[VolumeDelay] {
        &self.volume_delays
    }

    /// Generalised travel cost of every link at the given flows, beside the [preloads](Self::with_preloads).
    pub fn link_costs(&self, link_flows: &[f64]) -> Vec<f64> {
        self.costs(&self.volume_delays, link_flows)
    }

    /// The links' volume-delay functions without toll and distance.
    pub(crate) fn times(&self) -> Result<Vec<VolumeDelay>> {
        self.delays(CostWeights::default())
    }

    /// The links' volume-delay functions where toll and distance cost so much.
    fn delays(&self, weights: CostWeights) -> Result<Vec<VolumeDelay>> {
        let links = self.links.iter().enumerate();
        links
            .map(|(index, link)| {
                let function = self.delay_function(index);
                link.volume_delay(function, weights, &format!("link {}", index + 1))
            })
            .collect()
    }

    /// What the given delays come to at the given flows, beside the preloads.
    pub(crate) fn costs(&self, delays: &[VolumeDelay], link_flows: &[f64]) -> Vec<f64> {
        let links = delays.iter().zip(link_flows).enumerate();
        links
            .map(|(link, (delay, &flow))| delay.cost(self.preload(link) + flow))
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
