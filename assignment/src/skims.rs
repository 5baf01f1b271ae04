//! Skims: what the cheapest way between each two zones costs, and what of it is time, length and toll.

use crate::network::Network;
use crate::shortest_path::{SearchOrder, ShortestPathTree};
use kit::error::{Error, Result};
use std::fmt::Write as _;

/// First line of a skim file.
pub const HEADER: &str = "origin,destination,cost,time,length,toll";

/// The cheapest way between two zones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skim {
    /// Zone it starts from, from 1.
    pub origin: u32,
    /// Zone it goes to, from 1.
    pub destination: u32,
    /// Generalised cost.
    pub cost: f64,
    /// The part of the cost that is neither toll nor distance.
    pub time: f64,
    /// Sum of the links' lengths.
    pub length: f64,
    /// Sum of the links' tolls.
    pub toll: f64,
}

/// Skims of all pairs of different zones that a path joins, by ascending origin and destination, at the given link costs:
/// the network's generalised costs, such as [`Solution::link_costs`](crate::Solution::link_costs).
///
/// # Errors
/// [`Error::Input`] for another number of costs than of links, or one that is negative or not finite.
pub fn skims(network: &Network, link_costs: &[f64]) -> Result<Vec<Skim>> {
    if link_costs.len() != network.links().len() {
        let expected = format!("{}, one per link", network.links().len());
        return Err(Error::input("link costs", link_costs.len(), expected));
    }
    for (number, &cost) in (1..).zip(link_costs) {
        crate::link::check_not_negative(&format!("link {number}: cost"), cost)?;
    }
    let zones = network.numbering().zones;
    let weights = network.weights();
    let mut tree = ShortestPathTree::new(network);
    let mut links = Vec::new();
    let mut skims = Vec::new();
    for origin in 1..=zones {
        tree.search(network, link_costs, origin - 1, &mut SearchOrder::default());
        for destination in (1..=zones).filter(|&zone| zone != origin) {
            let cost = tree.cost_to(destination - 1);
            if cost == f64::INFINITY {
                continue;
            }
            tree.trace(network, destination - 1, &mut links);
            let mut skim = Skim {
                origin,
                destination,
                cost,
                time: 0.0,
                length: 0.0,
                toll: 0.0,
            };
            for &link in links.iter().rev() {
                let way = &network.links()[link as usize];
                let fixed = weights.toll * way.toll + weights.distance * way.length;
                // Rounding can take a connector that costs nothing but its length below 0.
                skim.time += (link_costs[link as usize] - fixed).max(0.0);
                skim.length += way.length;
                skim.toll += way.toll;
            }
            skims.push(skim);
        }
    }
    Ok(skims)
}

/// Skims as a file, zones by their names.
pub fn format_skims(network: &Network, skims: &[Skim]) -> String {
    let mut text = format!("{HEADER}\n");
    for skim in skims {
        let (origin, destination) = (
            network.zone_name(skim.origin),
            network.zone_name(skim.destination),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{origin},{destination},{},{},{},{}",
            skim.cost, skim.time, skim.length, skim.toll
        );
    }
    text
}

/// Skims as an OMX file with the matrices `cost`, `time`, `length` and `toll`; no number between zones that no path joins, 0
/// within a zone.
///
/// # Errors
/// As [`crate::omx::format`].
#[cfg(feature = "omx")]
pub fn format_omx(network: &Network, skims: &[Skim]) -> Result<Vec<u8>> {
    let count = network.numbering().zones as usize;
    let zones: Vec<String> = (1..=count as u32)
        .map(|zone| network.zone_name(zone).into_owned())
        .collect();
    let matrix = |value: fn(&Skim) -> f64| {
        let mut values = vec![f64::NAN; count * count];
        for zone in 0..count {
            values[zone * count + zone] = 0.0;
        }
        for skim in skims {
            values[(skim.origin as usize - 1) * count + skim.destination as usize - 1] = value(skim);
        }
        values
    };
    let matrices = [
        ("cost", matrix(|skim| skim.cost)),
        ("time", matrix(|skim| skim.time)),
        ("length", matrix(|skim| skim.length)),
        ("toll", matrix(|skim| skim.toll)),
    ];
    crate::omx::format(&zones, &matrices)
}
