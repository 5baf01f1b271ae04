//! Links as tables name them: by their nodes, or by names of their own.

use crate::csv_table::id;
use crate::network::Network;
use kit::error::{Error, Result};
use std::collections::HashMap;

/// Names of columns with the node that a link leaves, in the order of preference.
pub(crate) const FROM: [&str; 6] = ["init_node", "from_node_id", "from_node", "from", "a_node", "a"];

/// The same for the node that it enters.
pub(crate) const TO: [&str; 6] = ["term_node", "to_node_id", "to_node", "to", "b_node", "b"];

/// Name of the column with a link's own name.
pub(crate) const LINK: &str = "link_id";

/// Links that no row of a table has named yet. Of several with the same name, the first row means the first in the network's
/// order.
pub(crate) struct LinkNames {
    /// By the names of their nodes, the next to be named last.
    by_nodes: HashMap<(String, String), Vec<u32>>,
    /// The same by their own names.
    by_name: HashMap<String, Vec<u32>>,
}

impl LinkNames {
    /// `road_names` are what files call the roads; where they have no names, a link is called by its number in file order.
    pub(crate) fn new(network: &Network, road_names: &[String]) -> Self {
        let mut by_nodes: HashMap<(String, String), Vec<u32>> = HashMap::new();
        let mut by_name: HashMap<String, Vec<u32>> = HashMap::new();
        for (index, link) in network.links().iter().enumerate().rev() {
            let index = index as u32;
            let [from, to] =
                [link.init_node, link.term_node].map(|node| network.node_name(node).into_owned());
            by_nodes.entry((from, to)).or_default().push(index);
            let name = road_names.get(index as usize).cloned();
            let name = name.unwrap_or_else(|| (index + 1).to_string());
            by_name.entry(name).or_default().push(index);
        }
        Self { by_nodes, by_name }
    }

    /// The next link from one node to another.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` if there is none, or none left.
    pub(crate) fn take_between(&mut self, place: &str, (from, to): (&str, &str)) -> Result<u32> {
        let key = (id(from).to_owned(), id(to).to_owned());
        let link = self.by_nodes.get_mut(&key).and_then(Vec::pop);
        link.ok_or_else(|| {
            let found = format!("link {} to {}", key.0, key.1);
            Error::input(place, found, "a link of the network, once")
        })
    }

    /// The only link from one node to another.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` if there is none, several, or a row named it before.
    pub(crate) fn take_only(&mut self, place: &str, nodes: (&str, &str)) -> Result<u32> {
        let key = (id(nodes.0).to_owned(), id(nodes.1).to_owned());
        let (found, expected) = match self.by_nodes.get(&key).map(Vec::len) {
            Some(1) => return self.take_between(place, nodes),
            Some(0) => ("again", "each road once"),
            Some(_) => ("one of several", "their link_id instead, which tells them apart"),
            None => ("no road of the network", "two nodes that a road joins"),
        };
        let found = format!("{} to {}, {found}", key.0, key.1);
        Err(Error::input(place, found, expected))
    }

    /// The links of a name, the next one last; none if no link has it.
    pub(crate) fn named(&mut self, name: &str) -> Option<&mut Vec<u32>> {
        self.by_name.get_mut(name)
    }
}
