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
    /// Number of every node from 1, by its name.
    numbers: HashMap<String, u32>,
    places: Vec<Option<(f64, f64)>>,
    unit: LengthUnit,
}

impl<'n> Collected<'n> {
    /// Of no node yet.
    pub(crate) fn new(network: &'n Network, unit: LengthUnit) -> Self {
        let nodes = network.numbering().nodes;
        Self {
            network,
            numbers: (1..=nodes)
                .map(|number| (network.node_name(number).into_owned(), number))
                .collect(),
            places: vec![None; nodes as usize],
            unit,
        }
    }

    /// Whether the network has a node of this name.
    #[cfg(feature = "formats")]
    pub(crate) fn has_node(&self, name: &str) -> bool {
        self.numbers.contains_key(name)
    }

    /// Takes the coordinates of a node; `place` is where they stand in the file.
    pub(crate) fn put(&mut self, place: &str, node: &str, (x, y): (&str, &str)) -> Result<()> {
        let number = self.numbers.get(node).copied().ok_or_else(|| {
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
        if self.places[number as usize - 1].replace(coordinates).is_some() {
            let found = format!("`{node}` again");
            return Err(Error::input(format!("{place}: node"), found, "each node once"));
        }
        Ok(())
    }

    /// The coordinates of all nodes.
    pub(crate) fn finish(self, name: &str) -> Result<NodePlaces> {
        let mut places = Vec::with_capacity(self.places.len());
        for (number, place) in (1..).zip(self.places) {
            places.push(place.ok_or_else(|| {
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
