//! Select link: whose trips use a road. The origin-destination pairs behind the flow of chosen links, from path flows.
//!
//! Equilibrium link flows are unique, path flows are not: pairs that could swap routes without anybody's cost changing
//! show one of many equally good answers. A gap of 1e-6 still leaves errors of several vehicles; solve to 1e-10 for this.

use crate::network::Network;
use crate::path_flows::PathFlows;
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

/// The pairs whose trips use any of `links`, by ascending origin and destination.
pub fn select_links(path_flows: &PathFlows, links: &[u32]) -> Vec<SelectedPair> {
    // What uses the links, and the pair's whole volume.
    let mut pairs: Vec<(SelectedPair, f64)> = Vec::new();
    for path in path_flows {
        let (origin, destination) = (path.origin, path.destination);
        if pairs
            .last()
            .is_none_or(|(pair, _)| (pair.origin, pair.destination) != (origin, destination))
        {
            let pair = SelectedPair {
                origin,
                destination,
                volume: 0.0,
                share: 0.0,
            };
            pairs.push((pair, 0.0));
        }
        if let Some((pair, total)) = pairs.last_mut() {
            *total += path.volume;
            if path.links.iter().any(|link| links.contains(link)) {
                pair.volume += path.volume;
            }
        }
    }
    let selected = pairs.into_iter().filter(|(pair, _)| pair.volume > 0.0);
    let shares = selected.map(|(pair, total)| SelectedPair {
        share: pair.volume / total,
        ..pair
    });
    shares.collect()
}

/// The rows of a select-link file for the links from one node to another, without the [`HEADER`]; each begins with `first`.
pub fn format_rows(
    network: &Network,
    first: &str,
    init_node: &str,
    term_node: &str,
    selected: &[SelectedPair],
) -> String {
    let mut text = String::new();
    for pair in selected {
        let (origin, destination) = (
            network.zone_name(pair.origin),
            network.zone_name(pair.destination),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{first}{init_node},{term_node},{origin},{destination},{},{}",
            pair.volume, pair.share
        );
    }
    text
}
