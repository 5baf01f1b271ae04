//! Select link: whose trips use a road. The origin-destination pairs behind the flow of chosen links, from path flows.
//!
//! Equilibrium link flows are unique, path flows are not: pairs that could swap routes without anybody's cost changing
//! show one of many equally good answers. A gap of 1e-6 still leaves errors of several vehicles; solve to 1e-10 for this.

use crate::network::Network;
use crate::path_flows::PathFlow;
use kit::error::{Error, Result};
use std::fmt::Write as _;

/// First line of a select-link file.
pub const HEADER: &str = "init_node,term_node,origin,destination,volume,share";

/// What a pair of zones sends over the chosen links.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelectedPair {
    /// Zone its trips start from, from 1.
    pub origin: u32,
    /// Zone they go to, from 1.
    pub destination: u32,
    /// Vehicles per unit of time that use a chosen link.
    pub volume: f64,
    /// That volume as a share of all the pair's trips.
    pub share: f64,
}

/// The links from one node to another, by name: indices from 0, several where roads run in parallel.
///
/// # Errors
/// [`Error::Input`] at `place` if there is none.
pub fn links_between(network: &Network, place: &str, init_node: &str, term_node: &str) -> Result<Vec<u32>> {
    let links = (0_u32..).zip(network.links());
    let between = links.filter(|(_, link)| {
        network.node_name(link.init_node) == init_node && network.node_name(link.term_node) == term_node
    });
    let found: Vec<u32> = between.map(|(link, _)| link).collect();
    if found.is_empty() {
        let expected = "two nodes that a link joins";
        return Err(Error::input(place, format!("{init_node},{term_node}"), expected));
    }
    Ok(found)
}

/// The pairs whose trips use any of `links`, by ascending origin and destination. `path_flows` come in that order, as in
/// [`Solution::path_flows`](crate::Solution::path_flows).
pub fn select_links(path_flows: &[PathFlow], links: &[u32]) -> Vec<SelectedPair> {
    let of_one_pair = |a: &PathFlow, b: &PathFlow| (a.origin, a.destination) == (b.origin, b.destination);
    let mut selected = Vec::new();
    for paths in path_flows.chunk_by(of_one_pair) {
        let uses = |path: &&PathFlow| path.links.iter().any(|link| links.contains(link));
        let volume: f64 = paths.iter().filter(uses).map(|path| path.volume).sum();
        if volume > 0.0 {
            let total: f64 = paths.iter().map(|path| path.volume).sum();
            selected.push(SelectedPair {
                origin: paths[0].origin,
                destination: paths[0].destination,
                volume,
                share: volume / total,
            });
        }
    }
    selected
}

/// The rows of a select-link file for the links from one node to another, without the [`HEADER`].
pub fn format_rows(network: &Network, init_node: &str, term_node: &str, selected: &[SelectedPair]) -> String {
    let mut text = String::new();
    for pair in selected {
        let (origin, destination) = (
            network.zone_name(pair.origin),
            network.zone_name(pair.destination),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{init_node},{term_node},{origin},{destination},{},{}",
            pair.volume, pair.share
        );
    }
    text
}
