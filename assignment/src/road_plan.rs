//! From roads between junctions to a network: turns that are banned or cost time, and zones that begin in several places.
//!
//! Where a junction has rules, every road that enters it ends in a node of its own, every road that leaves it begins in
//! one, and a link joins the two wherever the turn may be made. Elsewhere a junction stays one node. A zone that is no
//! junction is a node that nothing passes, joined by connectors without length or time to where its trips begin and end.
//! In the network the roads come first, in the order that they were given in, then what was added.

use crate::link::{CostWeights, Link, NodeNumbering};
use crate::network::{Names, Network};
use kit::error::{Error, Result};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Vehicles per unit of time of a link without a limit.
const UNLIMITED: f64 = 1e9;

/// What precedes the name of a zone in the name of its node.
const ZONE_PREFIX: &str = "zone:";

/// Where trips begin or end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// A junction, by number from 1: on any of its roads.
    Junction(u32),
    /// A road, by index from 0: they begin at its beginning or end at its end.
    Road(u32),
}

/// A zone on its way into a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Zone {
    /// A junction that trips pass as they pass any other.
    Open(u32),
    /// A junction that only its own trips use.
    Closed(u32),
    /// A place of its own, joined to others.
    Apart {
        /// Where its trips begin.
        from: Vec<Access>,
        /// Where trips to it end.
        to: Vec<Access>,
    },
}

/// A turn that may be made: roads by index from 0, and what it costs in units of travel time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// The road that it leaves.
    pub from: u32,
    /// The road that it enters.
    pub to: u32,
    /// What it costs.
    pub penalty: f64,
}

/// All turns at the junctions that have rules, by the junctions' numbers.
pub type Turns = BTreeMap<u32, Vec<Turn>>;

/// What is said of some turns.
#[derive(Debug, Clone, Default)]
pub struct TurnRules {
    /// What the turn from one road into another costs; none where it is banned.
    pub penalties: HashMap<(u32, u32), Option<f64>>,
    /// Roads from which only the turns that have a penalty, be it 0, may be made.
    pub listed_only: HashSet<u32>,
}

impl TurnRules {
    /// Every turn at the junctions that have rules: what no rule names is free.
    pub fn turns(&self, roads: &[Link], junctions: u32) -> Turns {
        let mut with_rules = vec![false; junctions as usize + 1];
        let ruled = self.penalties.keys().map(|(from, _)| from);
        for &from in ruled.chain(&self.listed_only) {
            with_rules[roads[from as usize].term_node as usize] = true;
        }
        let (entering, leaving) = by_junction(roads, junctions);
        let mut turns = Turns::new();
        for junction in (1..=junctions).filter(|&junction| with_rules[junction as usize]) {
            let mut here = Vec::new();
            for &from in &entering[junction as usize] {
                for &to in &leaving[junction as usize] {
                    let penalty = match self.penalties.get(&(from, to)) {
                        Some(penalty) => *penalty,
                        None => (!self.listed_only.contains(&from)).then_some(0.0),
                    };
                    here.extend(penalty.map(|penalty| Turn { from, to, penalty }));
                }
            }
            turns.insert(junction, here);
        }
        turns
    }
}

/// Roads that enter and roads that leave each junction, by its number.
fn by_junction(roads: &[Link], junctions: u32) -> (Vec<Vec<u32>>, Vec<Vec<u32>>) {
    let mut entering = vec![Vec::new(); junctions as usize + 1];
    let mut leaving = entering.clone();
    for (index, road) in (0..).zip(roads) {
        entering[road.term_node as usize].push(index);
        leaving[road.init_node as usize].push(index);
    }
    (entering, leaving)
}

/// Roads, junctions, turns and zones.
#[derive(Debug, Clone)]
pub struct RoadPlan {
    /// Names of the junctions, number 1 first.
    pub junctions: Vec<String>,
    /// The roads; their nodes are numbers of junctions.
    pub roads: Vec<Link>,
    /// Every zone with its name.
    pub zones: Vec<(String, Zone)>,
    /// What turns there are where not all are free.
    pub turns: Turns,
}

impl RoadPlan {
    /// The network. Zones keep their order.
    ///
    /// # Errors
    /// As [`Network::new`], and for a junction that is two zones.
    pub fn network(mut self, weights: CostWeights) -> Result<Network> {
        self.set_zones_apart();
        let closed: HashSet<u32> = self
            .zones
            .iter()
            .filter_map(|(_, zone)| match zone {
                Zone::Closed(junction) => Some(*junction),
                _ => None,
            })
            .collect();
        // Nothing turns where nothing passes.
        self.turns.retain(|junction, _| !closed.contains(junction));
        let mut nodes = Nodes::new(&self)?;
        let mut ends = self.road_ends(&mut nodes);
        let mut links: Vec<Link> = self.roads.clone();
        for (link, &(start, end)) in links.iter_mut().zip(&ends.nodes) {
            (link.init_node, link.term_node) = (start, end);
        }
        links.append(&mut ends.joints);
        for turn in self.turns.values().flatten() {
            let (from, to) = (ends.nodes[turn.from as usize].1, ends.nodes[turn.to as usize].0);
            links.push(connector(from, to, turn.penalty));
        }
        self.connect_zones(&nodes, &ends.nodes, &mut links);
        let open = self
            .zones
            .iter()
            .filter(|(_, zone)| matches!(zone, Zone::Open(_)));
        let numbering = NodeNumbering {
            zones: self.zones.len() as u32,
            nodes: nodes.names.len() as u32,
            first_thru_node: (self.zones.len() - open.count()) as u32 + 1,
        };
        let names = Names {
            nodes: nodes.names,
            zones: self.zones.into_iter().map(|(name, _)| name).collect(),
        };
        let roads = self.roads.len();
        Network::new(numbering, links, weights)?
            .with_names(names)
            .map(|network| network.with_roads(roads))
    }

    /// Open zones are nodes of roads only where no turn has rules, and behind all others: a network numbers the nodes
    /// that may not be passed first.
    fn set_zones_apart(&mut self) {
        let last_other = self
            .zones
            .iter()
            .rposition(|(_, zone)| !matches!(zone, Zone::Open(_)));
        let open_from = match (self.turns.is_empty(), last_other) {
            (true, last) => last.map_or(0, |last| last + 1),
            (false, _) => self.zones.len(),
        };
        for (_, zone) in &mut self.zones[..open_from] {
            if let Zone::Open(junction) = *zone {
                *zone = Zone::Apart {
                    from: vec![Access::Junction(junction)],
                    to: vec![Access::Junction(junction)],
                };
            }
        }
    }

    /// Gives nodes of their own to the ends of roads that need them, and joins those to junctions where turns are free.
    fn road_ends(&self, nodes: &mut Nodes) -> RoadEnds {
        let mut own: Vec<(bool, bool)> = self
            .roads
            .iter()
            .map(|road| {
                (
                    self.turns.contains_key(&road.init_node),
                    self.turns.contains_key(&road.term_node),
                )
            })
            .collect();
        for (_, zone) in &self.zones {
            if let Zone::Apart { from, to } = zone {
                for access in from {
                    if let Access::Road(road) = *access {
                        own[road as usize].0 = true;
                    }
                }
                for access in to {
                    if let Access::Road(road) = *access {
                        own[road as usize].1 = true;
                    }
                }
            }
        }
        let mut ends = RoadEnds {
            nodes: Vec::with_capacity(self.roads.len()),
            joints: Vec::new(),
        };
        for (road, (own_start, own_end)) in self.roads.iter().zip(own) {
            let [mut start, mut end] = [road.init_node, road.term_node].map(|junction| nodes.of(junction));
            if own_start {
                let junction = std::mem::replace(&mut start, nodes.add(road.init_node));
                if !self.turns.contains_key(&road.init_node) {
                    ends.joints.push(connector(junction, start, 0.0));
                }
            }
            if own_end {
                let junction = std::mem::replace(&mut end, nodes.add(road.term_node));
                if !self.turns.contains_key(&road.term_node) {
                    ends.joints.push(connector(end, junction, 0.0));
                }
            }
            ends.nodes.push((start, end));
        }
        ends
    }

    fn connect_zones(&self, nodes: &Nodes, ends: &[(u32, u32)], links: &mut Vec<Link>) {
        let (entering, leaving) = by_junction(&self.roads, self.junctions.len() as u32);
        for (number, (_, zone)) in (1..).zip(&self.zones) {
            let Zone::Apart { from, to } = zone else {
                continue;
            };
            for access in from {
                match *access {
                    Access::Road(road) => links.push(connector(number, ends[road as usize].0, 0.0)),
                    Access::Junction(junction) if self.turns.contains_key(&junction) => {
                        let roads = leaving[junction as usize].iter();
                        links.extend(roads.map(|&road| connector(number, ends[road as usize].0, 0.0)));
                    }
                    Access::Junction(junction) => links.push(connector(number, nodes.of(junction), 0.0)),
                }
            }
            for access in to {
                match *access {
                    Access::Road(road) => links.push(connector(ends[road as usize].1, number, 0.0)),
                    Access::Junction(junction) if self.turns.contains_key(&junction) => {
                        let roads = entering[junction as usize].iter();
                        links.extend(roads.map(|&road| connector(ends[road as usize].1, number, 0.0)));
                    }
                    Access::Junction(junction) => links.push(connector(nodes.of(junction), number, 0.0)),
                }
            }
        }
    }
}

/// Where roads begin and end in the network, and the links that join those nodes to junctions.
struct RoadEnds {
    nodes: Vec<(u32, u32)>,
    joints: Vec<Link>,
}

/// The network's nodes: zones, junctions, then ends of roads.
struct Nodes {
    names: Vec<String>,
    /// Number of every junction's node.
    of_junction: Vec<u32>,
}

impl Nodes {
    fn new(plan: &RoadPlan) -> Result<Self> {
        let mut of_junction = vec![0; plan.junctions.len()];
        let mut names = Vec::new();
        for (number, (name, zone)) in (1..).zip(&plan.zones) {
            match zone {
                Zone::Open(junction) | Zone::Closed(junction) => {
                    let node = &mut of_junction[*junction as usize - 1];
                    if *node != 0 {
                        let found = format!("junction {} again", plan.junctions[*junction as usize - 1]);
                        return Err(Error::input(
                            format!("zone {name}"),
                            found,
                            "one zone for a junction",
                        ));
                    }
                    *node = number;
                    names.push(plan.junctions[*junction as usize - 1].clone());
                }
                Zone::Apart { .. } => names.push(format!("{ZONE_PREFIX}{name}")),
            }
        }
        for (node, name) in of_junction.iter_mut().zip(&plan.junctions) {
            if *node == 0 {
                names.push(name.clone());
                *node = names.len() as u32;
            }
        }
        Ok(Self { names, of_junction })
    }

    fn of(&self, junction: u32) -> u32 {
        self.of_junction[junction as usize - 1]
    }

    /// One more node of a junction's name.
    fn add(&mut self, junction: u32) -> u32 {
        let name = self.names[self.of(junction) as usize - 1].clone();
        self.names.push(name);
        self.names.len() as u32
    }
}

/// A link that nothing fills.
fn connector(init_node: u32, term_node: u32, time: f64) -> Link {
    Link {
        init_node,
        term_node,
        capacity: UNLIMITED,
        length: 0.0,
        free_flow_time: time,
        b: 0.0,
        power: 1.0,
        toll: 0.0,
    }
}
