//! Skims: what the cheapest way between each two zones costs, and what of it is time, length and toll.

use crate::classes::VehicleClass;
use crate::link::CostWeights;
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
    let tolls = network.links().iter().map(|link| link.toll).collect();
    check_costs(network, link_costs)?;
    Ok(cheapest(network, link_costs, tolls, network.weights()))
}

/// The same for a class: at its own costs and tolls, without its banned links.
///
/// # Errors
/// As [`skims`].
pub fn class_skims(network: &Network, class: &VehicleClass, link_costs: &[f64]) -> Result<Vec<Skim>> {
    check_costs(network, link_costs)?;
    let mut costs = link_costs.to_vec();
    for &link in &class.banned_links {
        costs[link as usize] = f64::INFINITY;
    }
    let own = || network.links().iter().map(|link| link.toll).collect();
    let tolls = class.tolls.clone().unwrap_or_else(own);
    Ok(cheapest(network, &costs, tolls, class.weights))
}

fn check_costs(network: &Network, link_costs: &[f64]) -> Result<()> {
    if link_costs.len() != network.links().len() {
        let expected = format!("{}, one per link", network.links().len());
        return Err(Error::input("link costs", link_costs.len(), expected));
    }
    (1..).zip(link_costs).try_for_each(|(number, &cost)| {
        crate::link::check_not_negative(&format!("link {number}: cost"), cost)
    })
}

/// The cheapest ways at checked costs; links of infinite cost are closed.
fn cheapest(network: &Network, link_costs: &[f64], tolls: Vec<f64>, weights: CostWeights) -> Vec<Skim> {
    let zones = network.numbering().zones;
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
                let length = network.links()[link as usize].length;
                let toll = tolls[link as usize];
                let fixed = weights.toll * toll + weights.distance * length;
                // Rounding can take a connector that costs nothing but its length below 0.
                skim.time += (link_costs[link as usize] - fixed).max(0.0);
                skim.length += length;
                skim.toll += toll;
            }
            skims.push(skim);
        }
    }
    skims
}

/// Skims as a file, zones by their names.
pub fn format_skims(network: &Network, skims: &[Skim]) -> String {
    let mut text = format!("{HEADER}\n");
    push_skims(&mut text, network, "", skims);
    text
}

/// Skims of several classes, by name, as a file: each row has its class first.
pub fn format_class_skims(network: &Network, classes: &[(&str, Vec<Skim>)]) -> String {
    let mut text = format!("class,{HEADER}\n");
    for (class, skims) in classes {
        push_skims(&mut text, network, &format!("{class},"), skims);
    }
    text
}

/// Appends a row for each, which begins with `first`.
fn push_skims(text: &mut String, network: &Network, first: &str, skims: &[Skim]) {
    for skim in skims {
        let (origin, destination) = (
            network.zone_name(skim.origin),
            network.zone_name(skim.destination),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{first}{origin},{destination},{},{},{},{}",
            skim.cost, skim.time, skim.length, skim.toll
        );
    }
}

/// Skims as an OMX file with the matrices `cost`, `time`, `length` and `toll`; no number between zones that no path joins, 0
/// within a zone. Those of several classes come with their names: `cost_lorry`.
///
/// # Errors
/// As [`crate::omx::format`].
#[cfg(feature = "omx")]
pub fn format_omx(network: &Network, classes: &[(&str, Vec<Skim>)]) -> Result<Vec<u8>> {
    let count = network.numbering().zones as usize;
    let zones: Vec<String> = (1..=count as u32)
        .map(|zone| network.zone_name(zone).into_owned())
        .collect();
    let matrix = |skims: &[Skim], value: fn(&Skim) -> f64| {
        let mut values = vec![f64::NAN; count * count];
        for zone in 0..count {
            values[zone * count + zone] = 0.0;
        }
        for skim in skims {
            values[(skim.origin as usize - 1) * count + skim.destination as usize - 1] = value(skim);
        }
        values
    };
    let mut matrices = Vec::new();
    for (class, skims) in classes {
        let ending = if class.is_empty() {
            String::new()
        } else {
            format!("_{class}")
        };
        let mut push = |name: &str, value| matrices.push((format!("{name}{ending}"), matrix(skims, value)));
        push("cost", |skim| skim.cost);
        push("time", |skim| skim.time);
        push("length", |skim| skim.length);
        push("toll", |skim| skim.toll);
    }
    crate::omx::format(&zones, &matrices)
}
