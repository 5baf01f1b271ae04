//! Cheapest paths from one node to all others: Dijkstra's algorithm on a 4-ary heap.
//!
//! Four children per heap node halve the depth of a binary heap and share a cache line; positions are indexed, so a
//! label that improves moves up instead of being queued twice.

use super::network::Network;

/// "No link" and "not in the heap".
const NONE: u32 = u32::MAX;

/// Children per heap node.
const ARITY: usize = 4;

/// A tree of cheapest paths, with buffers that the next search reuses. Nodes and links are indices from 0.
#[derive(Debug, Clone)]
pub struct ShortestPathTree {
    cost: Vec<f64>,
    entering_link: Vec<u32>,
    settled: Vec<u32>,
    heap: Vec<(f64, u32)>,
    heap_position: Vec<u32>,
}

impl ShortestPathTree {
    /// Buffers for searches in a network of this size.
    pub fn new(network: &Network) -> Self {
        let nodes = network.numbering().nodes as usize;
        Self {
            cost: vec![f64::INFINITY; nodes],
            entering_link: vec![NONE; nodes],
            settled: Vec::with_capacity(nodes),
            heap: Vec::with_capacity(nodes),
            heap_position: vec![NONE; nodes],
        }
    }

    /// Finds the cheapest path from `origin` to every node at the given link costs, which must not be negative.
    ///
    /// No path passes through a node before the network's first thru node; such a node can be its origin or its end.
    pub fn search(&mut self, network: &Network, link_costs: &[f64], origin: u32) {
        self.cost.fill(f64::INFINITY);
        self.entering_link.fill(NONE);
        self.heap_position.fill(NONE);
        self.settled.clear();
        self.heap.clear();
        let first_thru = network.first_thru_index();
        self.cost[origin as usize] = 0.0;
        self.push(0.0, origin);
        while let Some((node_cost, node)) = self.pop() {
            self.settled.push(node);
            if (node as usize) < first_thru && node != origin {
                continue;
            }
            for outgoing in network.outgoing(node as usize) {
                let cost = node_cost + link_costs[outgoing.link as usize];
                let neighbour = outgoing.term_node as usize;
                if cost < self.cost[neighbour] {
                    self.cost[neighbour] = cost;
                    self.entering_link[neighbour] = outgoing.link;
                    match self.heap_position[neighbour] {
                        NONE => self.push(cost, outgoing.term_node),
                        position => self.sift_up(position as usize, (cost, outgoing.term_node)),
                    }
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

    fn push(&mut self, cost: f64, node: u32) {
        self.heap.push((cost, node));
        self.sift_up(self.heap.len() - 1, (cost, node));
    }

    /// Takes out the cheapest entry.
    fn pop(&mut self) -> Option<(f64, u32)> {
        let last = self.heap.pop()?;
        let Some(&top) = self.heap.first() else {
            return Some(last);
        };
        self.sift_down(last);
        Some(top)
    }

    /// Puts `entry` in the hole at `position`, after moving dearer ancestors down.
    #[inline]
    fn sift_up(&mut self, mut position: usize, entry: (f64, u32)) {
        while position > 0 {
            let parent = (position - 1) / ARITY;
            if self.heap[parent].0 <= entry.0 {
                break;
            }
            self.place(position, self.heap[parent]);
            position = parent;
        }
        self.place(position, entry);
    }

    /// Puts `entry` in the hole at the top, after moving cheaper descendants up.
    #[inline]
    fn sift_down(&mut self, entry: (f64, u32)) {
        let mut position = 0;
        loop {
            let first_child = ARITY * position + 1;
            let children = first_child..(first_child + ARITY).min(self.heap.len());
            let Some(cheapest) = children.reduce(|a, b| if self.heap[b].0 < self.heap[a].0 { b } else { a })
            else {
                break;
            };
            if self.heap[cheapest].0 >= entry.0 {
                break;
            }
            self.place(position, self.heap[cheapest]);
            position = cheapest;
        }
        self.place(position, entry);
    }

    #[inline]
    fn place(&mut self, position: usize, entry: (f64, u32)) {
        self.heap[position] = entry;
        self.heap_position[entry.1 as usize] = position as u32;
    }
}
