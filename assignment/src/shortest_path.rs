//! Cheapest paths from one node to all others: Dijkstra's algorithm, made to profit from being run again and again.
//!
//! An assignment searches from the same origins at costs that change less and less. A search that begins with the tree of
//! the last one, at the new costs, finds few links that improve on it; a priority queue has to settle only these. Nodes
//! that no path passes through never enter the queue.

use crate::heap::NodeHeap;
use crate::network::Network;

/// "No link".
const NONE: u32 = u32::MAX;

/// A tree of cheapest paths, with buffers that the next search reuses. Nodes and links are indices from 0.
#[derive(Debug, Clone)]
pub struct ShortestPathTree {
    origin: u32,
    cost: Vec<f64>,
    entering_link: Vec<u32>,
    heap: NodeHeap,
    /// Nodes whose outgoing links have been looked at.
    scanned: Vec<bool>,
    /// Nodes by ascending cost, the origin first.
    order: Vec<u32>,
    /// Nodes that were looked at again, by ascending cost.
    corrected: Vec<u32>,
    /// Room for an order to be merged into.
    merged: Vec<u32>,
}

/// How the last search from an origin went: its tree, from the root to the leaves. The next one, at costs that have changed
/// little, begins with it and needs a priority queue only for what has changed.
#[derive(Debug, Clone, Default)]
pub struct SearchOrder {
    /// The links of the tree, by ascending cost of the nodes that they enter.
    entering_links: Vec<u32>,
}

impl ShortestPathTree {
    /// Buffers for searches in a network of this size.
    pub fn new(network: &Network) -> Self {
        let nodes = network.numbering().nodes as usize;
        Self {
            origin: 0,
            cost: vec![f64::INFINITY; nodes],
            entering_link: vec![NONE; nodes],
            heap: NodeHeap::new(nodes),
            scanned: vec![false; nodes],
            order: Vec::new(),
            corrected: Vec::new(),
            merged: Vec::new(),
        }
    }

    /// Finds the cheapest path from `origin` to every node at the given link costs, which must not be negative.
    ///
    /// No path passes through a node before the network's first thru node; such a node can be its origin or its end.
    /// `order` is empty, or comes from an earlier search from the same origin in a network with the same links; this
    /// search leaves its own there. Paths of equal cost apart, it does not change the result.
    pub fn search(&mut self, network: &Network, link_costs: &[f64], origin: u32, order: &mut SearchOrder) {
        self.origin = origin;
        self.cost.fill(f64::INFINITY);
        self.entering_link.fill(NONE);
        self.heap.clear();
        self.cost[origin as usize] = 0.0;
        self.order.clear();
        if order.entering_links.is_empty() {
            self.heap.put(0.0, origin);
            while let Some((cost, node)) = self.heap.pop() {
                self.order.push(node);
                self.scan(network, link_costs, cost, node);
            }
            self.remember_tree(order);
        } else {
            self.grow_again(network, link_costs, order);
            let improved = self.follow(network, link_costs);
            self.correct(network, link_costs);
            if !self.corrected.is_empty() {
                self.merge_corrected();
            }
            if improved {
                self.remember_tree(order);
            }
        }
        self.enter_dead_ends(network, link_costs);
    }

    /// Looks at the links that leave a settled node; what they improve is queued.
    #[inline]
    fn scan(&mut self, network: &Network, link_costs: &[f64], node_cost: f64, node: u32) {
        let (cost, entering_link) = (self.cost.as_mut_slice(), self.entering_link.as_mut_slice());
        for outgoing in network.outgoing_through(node as usize) {
            let through_node = node_cost + link_costs[outgoing.link as usize];
            let neighbour = outgoing.term_node as usize;
            if through_node < cost[neighbour] {
                cost[neighbour] = through_node;
                entering_link[neighbour] = outgoing.link;
                self.heap.put(through_node, outgoing.term_node);
            }
        }
    }

    /// Keeps the tree for the next search, in the order of the nodes.
    fn remember_tree(&self, order: &mut SearchOrder) {
        let nodes = self.order.iter().skip(1);
        let entering = nodes.map(|&node| self.entering_link[node as usize]);
        order.entering_links.clear();
        order.entering_links.extend(entering);
    }

    /// The old tree at the new costs.
    fn grow_again(&mut self, network: &Network, link_costs: &[f64], order: &SearchOrder) {
        let (cost, entering_link) = (self.cost.as_mut_slice(), self.entering_link.as_mut_slice());
        self.order.push(self.origin);
        for &link in &order.entering_links {
            let (from, node) = (network.init_node(link), network.term_node(link));
            self.order.push(node);
            cost[node as usize] = cost[from as usize] + link_costs[link as usize];
            entering_link[node as usize] = link;
        }
    }

    /// Looks at all nodes in the old order; only nodes that are improved after their turn are queued. Returns whether any
    /// was improved.
    fn follow(&mut self, network: &Network, link_costs: &[f64]) -> bool {
        self.scanned.fill(false);
        let (cost, entering_link) = (self.cost.as_mut_slice(), self.entering_link.as_mut_slice());
        let scanned = self.scanned.as_mut_slice();
        let mut improved = false;
        for &node in &self.order {
            let node_cost = cost[node as usize];
            scanned[node as usize] = true;
            for outgoing in network.outgoing_through(node as usize) {
                let through_node = node_cost + link_costs[outgoing.link as usize];
                let neighbour = outgoing.term_node as usize;
                if through_node < cost[neighbour] {
                    cost[neighbour] = through_node;
                    entering_link[neighbour] = outgoing.link;
                    improved = true;
                    if scanned[neighbour] {
                        self.heap.put(through_node, outgoing.term_node);
                    }
                }
            }
        }
        improved
    }

    /// Dijkstra's algorithm from the queued nodes; each comes at most once more.
    fn correct(&mut self, network: &Network, link_costs: &[f64]) {
        self.corrected.clear();
        while let Some((cost, node)) = self.heap.pop() {
            self.corrected.push(node);
            self.scan(network, link_costs, cost, node);
        }
    }

    /// Moves the corrected nodes to where their new cost belongs.
    fn merge_corrected(&mut self) {
        for &node in &self.corrected {
            self.scanned[node as usize] = false;
        }
        self.merged.clear();
        let mut corrected = self.corrected.iter().copied().peekable();
        for &node in self.order.iter().filter(|&&node| self.scanned[node as usize]) {
            let cost = self.cost[node as usize];
            while let Some(earlier) = corrected.next_if(|&next| self.cost[next as usize] < cost) {
                self.merged.push(earlier);
            }
            self.merged.push(node);
        }
        self.merged.extend(corrected);
        std::mem::swap(&mut self.order, &mut self.merged);
    }

    /// Ends the paths to nodes that no path passes through.
    fn enter_dead_ends(&mut self, network: &Network, link_costs: &[f64]) {
        for &link in network.dead_end_links() {
            let from = network.init_node(link);
            if network.is_dead_end(from) && from != self.origin {
                continue;
            }
            let through_node = self.cost[from as usize] + link_costs[link as usize];
            let end = network.term_node(link) as usize;
            if through_node < self.cost[end] {
                self.cost[end] = through_node;
                self.entering_link[end] = link;
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
