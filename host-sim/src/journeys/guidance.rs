//! Advice: a better way from here to the end of the trip, on what is believed.
//!
//! Everybody sees the roads a little differently, so that not all take the same way out (a probit choice with uniform
//! errors, as in Burrell 1968), and nobody changes for a small gain.

use crate::stream::{Role, Stream, WorldKey};
use assignment::Network;
use assignment::shortest_path::{SearchOrder, ShortestPathTree};

/// How vehicles choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// A vehicle takes a road's believed time for up to so large a share longer or shorter, for good.
    pub spread: f64,
    /// Share of the time ahead that another way must save.
    pub gain: f64,
}

/// Finds ways.
pub struct Guide<'n> {
    network: &'n Network,
    choice: Choice,
    tree: ShortestPathTree,
    costs: Vec<f64>,
    backwards: Vec<u32>,
}

impl<'n> Guide<'n> {
    /// A guide on a network.
    pub fn new(network: &'n Network, choice: Choice) -> Self {
        Self {
            network,
            choice,
            tree: ShortestPathTree::new(network),
            costs: vec![0.0; network.links().len()],
            backwards: Vec::new(),
        }
    }

    /// A way from the node where the vehicle will be, or starts, to where its present way ends, if it saves enough at these
    /// times by road in s. The vehicle is a member of the world whose tastes `key` draws.
    pub fn better_way(
        &mut self,
        vehicle: u32,
        onward: &[u32],
        times_s: &[f64],
        key: &WorldKey,
    ) -> Option<Vec<u32>> {
        let links = self.network.links();
        let (first, last) = (*onward.first()?, *onward.last()?);
        let origin = links[first as usize].init_node - 1;
        let destination = links[last as usize].term_node - 1;
        let mut taste: Stream = key.stream(Role::Tastes, vehicle);
        for (cost, time_s) in self.costs.iter_mut().zip(times_s) {
            *cost = time_s * taste.uniform_between(1.0 - self.choice.spread, 1.0 + self.choice.spread);
        }
        let mut order = SearchOrder::default();
        self.tree.search(self.network, &self.costs, origin, &mut order);
        let present: f64 = onward.iter().map(|&road| self.costs[road as usize]).sum();
        if self.tree.cost_to(destination) >= (1.0 - self.choice.gain) * present {
            return None;
        }
        self.tree.trace(self.network, destination, &mut self.backwards);
        Some(self.backwards.iter().rev().copied().collect())
    }
}
