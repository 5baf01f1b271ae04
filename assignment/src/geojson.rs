//! Roads with their flows as GeoJSON (RFC 7946), for maps.
//!
//! Coordinates are the network's own: longitudes and latitudes are what the standard asks for, and metres on a plane want
//! a program that can be told their projection.

use crate::coordinates::NodePlaces;
use crate::formats::RoadData;
use crate::network::Network;
use std::fmt::Write as _;

/// A feature for each road: how it runs, its name, its nodes, volume, preload, cost, capacity, what it carries over
/// capacity, length and
/// free-flow time, in the network's units.
pub fn format_roads(
    network: &Network,
    data: &RoadData,
    places: &NodePlaces,
    (flows, costs): (&[f64], &[f64]),
) -> String {
    let ratios = network.volume_over_capacity(flows);
    let mut text = String::from("{\"type\":\"FeatureCollection\",\"features\":[");
    for (index, road) in network.roads().iter().enumerate() {
        let separator = if index > 0 { "," } else { "" };
        let name = data.names.get(index).filter(|name| !name.is_empty());
        let name = name.cloned().unwrap_or_else(|| (index + 1).to_string());
        let [from, to] = [road.init_node, road.term_node].map(|node| escaped(&network.node_name(node)));
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{separator}\n{{\"type\":\"Feature\",\"properties\":{{\"link\":{},\"init_node\":{from},\"term_node\":{to},\
             \"volume\":{},\"preload\":{},\"cost\":{},\"capacity\":{},\"v_over_c\":{},\"length\":{},\"free_flow_time\":{}}},\
             \"geometry\":{{\"type\":\"LineString\",\"coordinates\":[",
            escaped(&name),
            flows[index],
            network.preload(index),
            costs[index],
            road.capacity,
            ratios[index],
            road.length,
            road.free_flow_time,
        );
        for (point, (x, y)) in data.line(network, places, index).into_iter().enumerate() {
            let _ = write!(text, "{}[{x},{y}]", if point > 0 { "," } else { "" });
        }
        text.push_str("]}}");
    }
    text.push_str("\n]}\n");
    text
}

impl RoadData {
    /// The points of a road: its shape, else its ends.
    pub fn line(&self, network: &Network, places: &NodePlaces, road: usize) -> Vec<(f64, f64)> {
        match self.shapes.get(road) {
            Some(shape) if !shape.is_empty() => shape.clone(),
            _ => {
                let link = &network.links()[road];
                let ends = [link.init_node, link.term_node];
                ends.map(|node| places.places[node as usize - 1]).to_vec()
            }
        }
    }
}

/// A text as a JSON string.
fn escaped(text: &str) -> String {
    let mut escaped = String::from("\"");
    for character in text.chars() {
        match character {
            '"' | '\\' => escaped.extend(['\\', character]),
            control if control.is_control() => {
                let _ = write!(escaped, "\\u{:04x}", u32::from(control));
            }
            other => escaped.push(other),
        }
    }
    escaped + "\""
}
