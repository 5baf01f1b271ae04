//! A priority queue of nodes by cost: an indexed 4-ary heap.
//!
//! Four children per entry halve the depth of a binary heap and share a cache line. Every node's position is known, so
//! that a cost that falls moves its node up instead of queueing it twice.

/// Children per entry.
const ARITY: usize = 4;

/// "Never queued".
const NOWHERE: u32 = u32::MAX;

/// Nodes, given by index from 0, with the cheapest at the top.
#[derive(Debug, Clone)]
pub(crate) struct NodeHeap {
    entries: Vec<(f64, u32)>,
    /// Where each node stands in `entries`; out of date for nodes that were taken out.
    positions: Vec<u32>,
}

impl NodeHeap {
    /// An empty heap for nodes 0 to `nodes` - 1.
    pub(crate) fn new(nodes: usize) -> Self {
        Self {
            entries: Vec::with_capacity(nodes),
            positions: vec![NOWHERE; nodes],
        }
    }

    /// Forgets all nodes.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.positions.fill(NOWHERE);
    }

    /// Puts a node in, or moves it up to a cost lower than it had. A node that was taken out must not come again.
    #[inline]
    pub(crate) fn put(&mut self, cost: f64, node: u32) {
        let position = match self.positions[node as usize] {
            NOWHERE => {
                self.entries.push((cost, node));
                self.entries.len() - 1
            }
            position => position as usize,
        };
        self.sift_up(position, (cost, node));
    }

    /// Takes out the cheapest node.
    #[inline]
    pub(crate) fn pop(&mut self) -> Option<(f64, u32)> {
        let last = self.entries.pop()?;
        let Some(&top) = self.entries.first() else {
            return Some(last);
        };
        self.sift_down(last);
        Some(top)
    }

    /// Fills the hole at `position` with `entry`, after moving dearer ancestors down.
    #[inline]
    fn sift_up(&mut self, mut position: usize, entry: (f64, u32)) {
        let (entries, positions) = (self.entries.as_mut_slice(), self.positions.as_mut_slice());
        while position > 0 {
            let parent = (position - 1) / ARITY;
            let above = entries[parent];
            if above.0 <= entry.0 {
                break;
            }
            entries[position] = above;
            positions[above.1 as usize] = position as u32;
            position = parent;
        }
        entries[position] = entry;
        positions[entry.1 as usize] = position as u32;
    }

    /// Fills the hole at the top with `entry`, after moving cheaper descendants up.
    #[inline]
    fn sift_down(&mut self, entry: (f64, u32)) {
        let (entries, positions) = (self.entries.as_mut_slice(), self.positions.as_mut_slice());
        let mut position = 0;
        loop {
            let first_child = ARITY * position + 1;
            let end = (first_child + ARITY).min(entries.len());
            let Some(children) = entries.get(first_child..end) else {
                break;
            };
            // Costs alone are compared, so that the minimum needs no branch.
            let (mut cheapest, mut least) = (position, entry.0);
            for (child, &(cost, _)) in (first_child..).zip(children) {
                cheapest = if cost < least { child } else { cheapest };
                least = if cost < least { cost } else { least };
            }
            if cheapest == position {
                break;
            }
            let below = entries[cheapest];
            entries[position] = below;
            positions[below.1 as usize] = position as u32;
            position = cheapest;
        }
        entries[position] = entry;
        positions[entry.1 as usize] = position as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_come_out_by_their_latest_cost() {
        let mut heap = NodeHeap::new(100);
        for round in 0..2 {
            heap.clear();
            for node in 0..100 {
                heap.put(f64::from(node * 37 % 101) + 200.0, node);
            }
            for node in (0..100).step_by(3) {
                heap.put(f64::from(node), node);
            }
            let mut previous = f64::NEG_INFINITY;
            for _ in 0..100 {
                let (cost, node) = heap.pop().unwrap();
                let expected = if node % 3 == 0 {
                    node
                } else {
                    node * 37 % 101 + 200
                };
                assert_eq!(cost, f64::from(expected), "round {round}");
                assert!(cost >= previous);
                previous = cost;
            }
            assert_eq!(heap.pop(), None);
        }
    }
}
