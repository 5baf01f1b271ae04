//! Where the nodes of a network lie. Each format reads its own: [`crate::tntp`], [`crate::gmns`], [`crate::sumo`].

use crate::network::Network;
use kit::error::{Error, Result};
use std::collections::HashMap;

/// The unit of coordinates, as far as the format says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Metres.
    Metre,
    /// Degrees, feet or anything else.
    Unknown,
}

/// Coordinates of every node, in the order of node numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct NodePlaces {
    /// Eastwards and northwards.
    pub places: Vec<(f64, f64)>,
    /// In which unit.
    pub unit: LengthUnit,
}

/// Coordinates of some nodes, on the way to all of them.
pub(crate) struct Collected<'n> {
    network: &'n Network,
    /// Coordinates by the names of nodes, of which several may have one name.
    places: HashMap<String, Option<(f64, f64)>>,
    unit: LengthUnit,
}

impl<'n> Collected<'n> {
    /// Of no node yet.
    pub(crate) fn new(network: &'n Network, unit: LengthUnit) -> Self {
        let nodes = 1..=network.numbering().nodes;
        Self {
            network,
            places: nodes
                .map(|number| (network.node_name(number).into_owned(), None))
                .collect(),
            unit,
        }
    }

    /// Whether the network has a node of this name.
    #[cfg(feature = "formats")]
    pub(crate) fn has_node(&self, name: &str) -> bool {
        self.places.contains_key(name)
    }

    /// Takes the coordinates of a node; `place` is where they stand in the file.
    pub(crate) fn put(&mut self, place: &str, node: &str, (x, y): (&str, &str)) -> Result<()> {
        let known = self.places.get_mut(node).ok_or_else(|| {
            Error::input(
                format!("{place}: node"),
                format!("`{node}`"),
                "a node of the network",
            )
        })?;
        let coordinate = |name: &str, text: &str| {
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| {
                Error::input(format!("{place}: {name}"), format!("`{text}`"), "a finite number")
            })
        };
        let coordinates = (coordinate("X", x)?, coordinate("Y", y)?);
        if known.replace(coordinates).is_some() {
            let found = format!("`{node}` again");
            return Err(Error::input(format!("{place}: node"), found, "each node once"));
        }
        Ok(())
    }

    /// The coordinates of all nodes. A zone on no road lies amid the nodes that its connectors lead to and come from.
    pub(crate) fn finish(self, name: &str) -> Result<NodePlaces> {
        let numbers = 1..=self.network.numbering().nodes;
        let known: Vec<Option<(f64, f64)>> = numbers
            .map(|number| {
                self.places
                    .get(&*self.network.node_name(number))
                    .copied()
                    .flatten()
            })
            .collect();
        let mut amid = vec![(0.0, 0.0, 0_u32); known.len()];
        for link in &self.network.links()[self.network.roads().len()..] {
            let ends = [link.init_node, link.term_node].map(|node| node as usize - 1);
            for (node, other) in [(ends[0], ends[1]), (ends[1], ends[0])] {
                if let Some((x, y)) = known[other] {
                    let (sum_x, sum_y, count) = amid[node];
                    amid[node] = (sum_x + x, sum_y + y, count + 1);
                }
            }
        }
        let mut on_road = vec![false; known.len()];
        for link in self.network.roads() {
            for node in [link.init_node, link.term_node] {
                on_road[node as usize - 1] = true;
            }
        }
        let mut places = Vec::with_capacity(known.len());
        for (number, ((place, (x, y, count)), on_road)) in (1..).zip(known.into_iter().zip(amid).zip(on_road))
        {
            let amid = (!on_road && count > 0).then(|| (x / f64::from(count), y / f64::from(count)));
            places.push(place.or(amid).ok_or_else(|| {
                let found = format!("no coordinates of node {}", self.network.node_name(number));
                Error::input(name, found, "coordinates of every node")
            })?);
        }
        Ok(NodePlaces {
            places,
            unit: self.unit,
        })
    }
}
