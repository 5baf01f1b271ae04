//! Cheapest paths from one node to all others: Dijkstra's algorithm.

use super::heap::NodeHeap;
use super::network::Network;

/// "No link".
const NONE: u32 = u32::MAX;

/// A tree of cheapest paths, with buffers that the next search reuses. Nodes and links are indices from 0.
#[derive(Debug, Clone)]
pub struct ShortestPathTree {
    cost: Vec<f64>,
    entering_link: Vec<u32>,
    settled: Vec<u32>,
    heap: NodeHeap,
}

impl ShortestPathTree {
    /// Buffers for searches in a network of this size.
    pub fn new(network: &Network) -> Self {
        let nodes = network.numbering().nodes as usize;
        Self {
            cost: vec![f64::INFINITY; nodes],
            entering_link: vec![NONE; nodes],
            settled: Vec::with_capacity(nodes),
            heap: NodeHeap::new(nodes),
        }
    }

    /// Finds the cheapest path from `origin` to every node at the given link costs, which must not be negative.
    ///
    /// No path passes through a node before the network's first thru node; such a node can be its origin or its end.
    pub fn search(&mut self, network: &Network, link_costs: &[f64], origin: u32) {
        let Self {
            cost,
            entering_link,
            settled,
            heap,
        } = self;
        let (cost, entering_link) = (cost.as_mut_slice(), entering_link.as_mut_slice());
        cost.fill(f64::INFINITY);
        entering_link.fill(NONE);
        settled.clear();
        heap.clear();
        let first_thru = network.first_thru_index();
        cost[origin as usize] = 0.0;
        heap.put(0.0, origin);
        while let Some((node_cost, node)) = heap.pop() {
            settled.push(node);
            if (node as usize) < first_thru && node != origin {
                continue;
            }
            for outgoing in network.outgoing(node as usize) {
                let through_node = node_cost + link_costs[outgoing.link as usize];
                let neighbour = outgoing.term_node as usize;
                if through_node < cost[neighbour] {
                    cost[neighbour] = through_node;
                    entering_link[neighbour] = outgoing.link;
                    heap.put(through_node, outgoing.term_node);
                }
            }
        }
    }

    /// Cost from the origin to `node`; infinite if no path leads there.
    #[inline]
    pub fn cost_to(&self, node: u32) -> f64 {
        self.cost[node as usize]
    }

    /// The link by which the cheapest path enters `node`; none for the origin and for nodes that are not reached.
    #[inline]
    pub fn entering_link(&self, node: u32) -> Option<u32> {
        match self.entering_link[node as usize] {
            NONE => None,
            link => Some(link),
        }
    }

    /// The nodes that are reached, by ascending cost, the origin first.
    pub fn settled(&self) -> &[u32] {
        &self.settled
    }

    /// Writes the links of the cheapest path to `node` into `links`, the last one first.
    pub fn trace(&self, network: &Network, node: u32, links: &mut Vec<u32>) {
        links.clear();
        let mut node = node;
        while let Some(link) = self.entering_link(node) {
            links.push(link);
            node = network.init_node(link);
        }
    }
}
