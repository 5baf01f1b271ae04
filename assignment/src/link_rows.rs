//! Links by the node they leave, in compressed rows, and which nodes no cheapest path passes through.

use crate::link::{Link, NodeNumbering};

/// A link seen from the node it leaves: nodes and links as indices from 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutgoingLink {
    pub(crate) link: u32,
    pub(crate) term_node: u32,
}

/// Links in compressed rows, one row per node that they leave.
#[derive(Debug, Clone)]
pub(crate) struct LinkRows {
    /// Where each node's row begins, and at last where the final row ends.
    first: Vec<u32>,
    links: Vec<OutgoingLink>,
}

impl LinkRows {
    /// Rows of the `chosen` ones among all `links`; within a row they keep their order.
    pub(crate) fn new(nodes: u32, links: &[Link], chosen: impl Iterator<Item = u32> + Clone) -> Self {
        let mut first = vec![0_u32; nodes as usize + 1];
        for link in chosen.clone() {
            first[links[link as usize].init_node as usize] += 1;
        }
        for node in 1..first.len() {
            first[node] += first[node - 1];
        }
        let mut by_init_node: Vec<u32> = chosen.collect();
        by_init_node.sort_by_key(|&link| links[link as usize].init_node);
        let outgoing = |link| OutgoingLink {
            link,
            term_node: links[link as usize].term_node - 1,
        };
        Self {
            first,
            links: by_init_node.into_iter().map(outgoing).collect(),
        }
    }

    #[inline]
    pub(crate) fn of(&self, node: usize) -> &[OutgoingLink] {
        &self.links[self.first[node] as usize..self.first[node + 1] as usize]
    }
}

/// Which nodes no cheapest path passes through: those that may not be passed, and those with a single neighbour, such as
/// most zones that hang on the network by one connector each way.
pub(crate) fn dead_ends(numbering: NodeNumbering, links: &[Link]) -> Vec<bool> {
    const NOBODY: u32 = 0;
    const SEVERAL: u32 = u32::MAX;
    let mut neighbours = vec![NOBODY; numbering.nodes as usize];
    for link in links {
        for (node, other) in [(link.init_node, link.term_node), (link.term_node, link.init_node)] {
            let neighbour = &mut neighbours[node as usize - 1];
            if *neighbour == NOBODY {
                *neighbour = other;
            } else if *neighbour != other {
                *neighbour = SEVERAL;
            }
        }
    }
    (1..)
        .zip(neighbours)
        .map(|(number, neighbour)| number < numbering.first_thru_node || neighbour != SEVERAL)
        .collect()
}
