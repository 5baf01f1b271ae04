//! Which trips have no way: pairs of zones with demand that no path joins.

use crate::demand::{Demand, Trip};
use crate::network::Network;

/// The trips of `demand` whose destination no path reaches without `banned_links`, given as indices from 0; by ascending origin
/// and destination.
///
/// Most networks are one piece: what leads into it and out of it is found with two searches. One search for each origin is
/// left only for the pairs that this does not settle.
pub fn unreachable(network: &Network, demand: &Demand, banned_links: &[u32]) -> Vec<Trip> {
    let mut open = vec![true; network.links().len()];
    for &link in banned_links {
        open[link as usize] = false;
    }
    let core = Core::new(network, &open);
    let mut reached = Vec::new();
    let mut searched = None;
    let mut lost = Vec::new();
    for trip in demand.trips() {
        let (origin, destination) = (trip.origin as usize - 1, trip.destination as usize - 1);
        if core.from[origin] && core.into[destination] {
            continue;
        }
        if searched.replace(trip.origin) != Some(trip.origin) {
            reached = search(network, origin, &core.along);
        }
        if !reached[destination] {
            lost.push(trip);
        }
    }
    lost
}

/// One piece of the network in which every node reaches every other.
struct Core {
    /// Which nodes reach it.
    from: Vec<bool>,
    /// Which nodes it reaches.
    into: Vec<bool>,
    /// All links.
    along: Links,
}

impl Core {
    /// The piece around the node with the most links: that is in the largest piece almost always.
    fn new(network: &Network, open: &[bool]) -> Self {
        let numbering = network.numbering();
        let mut degrees = vec![0_u32; numbering.nodes as usize];
        for (link, _) in network.links().iter().zip(open).filter(|(_, open)| **open) {
            degrees[link.init_node as usize - 1] += 1;
            degrees[link.term_node as usize - 1] += 1;
        }
        let first = numbering.first_thru_node as usize - 1;
        let centre = (first..degrees.len()).max_by_key(|&node| degrees[node]);
        let along = Links::of(network, open, true);
        let Some(centre) = centre else {
            let nothing = vec![false; degrees.len()];
            return Self {
                from: nothing.clone(),
                into: nothing,
                along,
            };
        };
        Self {
            from: search(network, centre, &Links::of(network, open, false)),
            into: search(network, centre, &along),
            along,
        }
    }
}

/// Neighbours of every node, along the links or against them, in compressed rows.
struct Links {
    first: Vec<u32>,
    ends: Vec<u32>,
}

impl Links {
    fn of(network: &Network, open: &[bool], along: bool) -> Self {
        let pairs = || {
            let links = network.links().iter().zip(open).filter(|(_, open)| **open);
            links.map(move |(link, _)| {
                if along {
                    (link.init_node, link.term_node)
                } else {
                    (link.term_node, link.init_node)
                }
            })
        };
        let mut first = vec![0_u32; network.numbering().nodes as usize + 1];
        for (node, _) in pairs() {
            first[node as usize] += 1;
        }
        for node in 1..first.len() {
            first[node] += first[node - 1];
        }
        let mut next = first.clone();
        let mut ends = vec![0; first[first.len() - 1] as usize];
        for (node, end) in pairs() {
            let slot = &mut next[node as usize - 1];
            ends[*slot as usize] = end - 1;
            *slot += 1;
        }
        Self { first, ends }
    }
}

/// Which nodes a search from one reaches without passing closed ones; it is among them.
fn search(network: &Network, start: usize, links: &Links) -> Vec<bool> {
    let closed = network.numbering().first_thru_node as usize - 1;
    let mut reached = vec![false; network.numbering().nodes as usize];
    reached[start] = true;
    let mut waiting = vec![start];
    while let Some(node) = waiting.pop() {
        if node < closed && node != start {
            continue;
        }
        for &next in &links.ends[links.first[node] as usize..links.first[node + 1] as usize] {
            if !std::mem::replace(&mut reached[next as usize], true) {
                waiting.push(next as usize);
            }
        }
    }
    reached
}
