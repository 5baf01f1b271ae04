//! All-or-nothing loading: every trip on the cheapest path at given link costs.

use crate::demand::OriginDemand;
use crate::network::Network;
use crate::problem::{OriginBlock, Problem};
use crate::shortest_path::{SearchOrder, ShortestPathTree};
use kit::error::{Error, Result};

/// Buffers of one block of origins.
struct Block<'a> {
    origins: &'a [OriginDemand],
    tree: ShortestPathTree,
    /// Per origin, how the last search went.
    orders: Vec<SearchOrder>,
    /// Branches of the tree that have yet to bring their vehicles, per node.
    branches: Vec<u32>,
    /// Vehicles that still have to be carried towards the origin, per node.
    node_volume: Vec<f64>,
    link_flows: Vec<f64>,
    shortest_path_cost: f64,
    unreachable: Option<(u32, u32)>,
}

/// Loads all trips at once, keeping its buffers between calls.
pub(crate) struct Loader<'a> {
    blocks: Vec<Block<'a>>,
}

impl<'a> Loader<'a> {
    pub(crate) fn new(problem: &Problem<'a>) -> Self {
        let nodes = problem.network.numbering().nodes as usize;
        let block = |OriginBlock { origins, .. }: OriginBlock<'a>| Block {
            origins,
            orders: vec![SearchOrder::default(); origins.len()],
            branches: vec![0; nodes],
            tree: ShortestPathTree::new(problem.network),
            node_volume: vec![0.0; nodes],
            link_flows: vec![0.0; problem.links()],
            shortest_path_cost: 0.0,
            unreachable: None,
        };
        Self {
            blocks: problem.origin_blocks().map(block).collect(),
        }
    }

    /// Puts every trip on its cheapest path, beside what the roads carry anyway: fills `link_flows`, and returns what all trips cost together (SPTT).
    pub(crate) fn load(
        &mut self,
        problem: &Problem<'_>,
        link_costs: &[f64],
        link_flows: &mut [f64],
    ) -> Result<f64> {
        problem.for_each(&mut self.blocks, |block| block.load(problem, link_costs));
        problem.network.fill_with_preloads(link_flows);
        let mut shortest_path_cost = 0.0;
        for block in &self.blocks {
            if let Some((origin, destination)) = block.unreachable {
                return Err(unreachable_pair(problem.network, origin, destination));
            }
            shortest_path_cost += block.shortest_path_cost;
            for (total, part) in link_flows.iter_mut().zip(&block.link_flows) {
                *total += part;
            }
        }
        Ok(shortest_path_cost)
    }
}

impl Block<'_> {
    fn load(&mut self, problem: &Problem<'_>, link_costs: &[f64]) {
        self.link_flows.fill(0.0);
        self.shortest_path_cost = 0.0;
        for (index, from) in self.origins.iter().enumerate() {
            let order = &mut self.orders[index];
            self.tree.search(problem.network, link_costs, from.origin, order);
            self.node_volume.fill(0.0);
            for &(destination, volume) in &from.destinations {
                let cost = self.tree.cost_to(destination);
                if cost == f64::INFINITY && self.unreachable.is_none() {
                    self.unreachable = Some((from.origin, destination));
                }
                self.shortest_path_cost += volume * cost;
                self.node_volume[destination as usize] += volume;
            }
            self.carry_to_origin(problem.network);
        }
    }

    /// From the leaves to the root: a node hands on its vehicles when all its branches have brought theirs.
    fn carry_to_origin(&mut self, network: &Network) {
        let nodes = self.branches.len() as u32;
        self.branches.fill(0);
        for node in 0..nodes {
            if let Some(link) = self.tree.entering_link(node) {
                self.branches[network.init_node(link) as usize] += 1;
            }
        }
        for leaf in 0..nodes {
            let mut node = leaf;
            while self.branches[node as usize] == 0
                && let Some(link) = self.tree.entering_link(node)
            {
                // Never a leaf again.
                self.branches[node as usize] = u32::MAX;
                let volume = self.node_volume[node as usize];
                self.link_flows[link as usize] += volume;
                node = network.init_node(link);
                self.node_volume[node as usize] += volume;
                self.branches[node as usize] -= 1;
            }
        }
    }
}

/// Demand between two zones, given by index from 0, that no path joins.
pub(crate) fn unreachable_pair(network: &Network, origin: u32, destination: u32) -> Error {
    let (from, to) = (network.zone_name(origin + 1), network.zone_name(destination + 1));
    Error::input(
        format!("trips from {from} to {to}"),
        "no path in the network",
        "a path wherever there is demand",
    )
}
