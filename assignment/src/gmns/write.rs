//! Networks, demands and flows as a GMNS folder.

use super::nodes::CENTROID;
use crate::coordinates::NodePlaces;
use crate::demand::Demand;
use crate::network::Network;
use crate::shapes::{Shape, format_wkt};
use crate::units::Length;
use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Write as _;

/// What is known of a network besides its links.
#[derive(Debug, Clone, Copy)]
pub struct Extras<'a> {
    /// Where the nodes lie.
    pub places: Option<&'a NodePlaces>,
    /// How the roads run; fewer than there are roads where nothing is known.
    pub shapes: &'a [Shape],
    /// Flow and cost of every link.
    pub flows: Option<(&'a [f64], &'a [f64])>,
    /// Minutes of a unit of travel time.
    pub minutes: f64,
    /// The unit of lengths.
    pub length: Option<Length>,
}

impl Default for Extras<'_> {
    /// Nothing, and times in minutes.
    fn default() -> Self {
        Self {
            places: None,
            shapes: &[],
            flows: None,
            minutes: 1.0,
            length: None,
        }
    }
}

/// A folder with a network as it is solved: `node.csv`, `link.csv` and, where units are known, `config.csv`. Junctions that
/// were taken apart for their turns are several nodes, and what a reader added is a link of its own.
pub fn format_network(network: &Network, extras: &Extras<'_>) -> Vec<(String, String)> {
    let names = unique_names(network);
    let mut files = vec![
        (
            "node.csv".to_owned(),
            format_nodes(network, &names, extras.places),
        ),
        ("link.csv".to_owned(), format_links(network, &names, extras)),
    ];
    if let Some(length) = extras.length {
        files.push(("config.csv".to_owned(), format_config(length)));
    }
    files
}

/// Names of nodes that files can tell apart: the second of a name gets a number.
fn unique_names(network: &Network) -> Vec<String> {
    let mut seen: HashMap<Cow<'_, str>, u32> = HashMap::new();
    (1..=network.numbering().nodes)
        .map(|number| {
            let name = network.node_name(number);
            let times = seen.entry(name.clone()).or_default();
            *times += 1;
            if *times == 1 {
                name.into_owned()
            } else {
                format!("{name}~{times}")
            }
        })
        .collect()
}

/// A field of a CSV, quoted where it has to be.
fn field(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) {
        Cow::Owned(format!("\"{}\"", text.replace('"', "\"\"")))
    } else {
        Cow::Borrowed(text)
    }
}

fn format_nodes(network: &Network, names: &[String], places: Option<&NodePlaces>) -> String {
    let numbering = network.numbering();
    let mut text = String::from("node_id,zone_id,node_type,x_coord,y_coord\n");
    for (number, name) in (1..).zip(names) {
        let zone = if number <= numbering.zones {
            network.zone_name(number)
        } else {
            "".into()
        };
        let node_type = if number < numbering.first_thru_node {
            CENTROID
        } else {
            ""
        };
        // Writing to a string cannot fail.
        let _ = write!(text, "{},{},{node_type},", field(name), field(&zone));
        let _ = match places.and_then(|places| places.places.get(number as usize - 1)) {
            Some((x, y)) => writeln!(text, "{x},{y}"),
            None => writeln!(text, ","),
        };
    }
    text
}

/// Links with times in minutes, and one lane that has all capacity.
fn format_links(network: &Network, names: &[String], extras: &Extras<'_>) -> String {
    let mut text = String::from(
        "link_id,from_node_id,to_node_id,directed,facility_type,length,free_speed,capacity,lanes,toll,\
         VDF_fftt1,VDF_cap1,VDF_alpha1,VDF_beta1,volume,travel_cost,geometry\n",
    );
    let roads = network.roads().len();
    for (index, link) in network.links().iter().enumerate() {
        let [from, to] = [link.init_node, link.term_node].map(|node| field(&names[node as usize - 1]));
        let kind = if index < roads { "" } else { "connector" };
        let minutes = extras.minutes * link.free_flow_time;
        // Writing to a string cannot fail.
        let _ = write!(text, "{},{from},{to},1,{kind},{},", index + 1, link.length);
        if minutes > 0.0 && link.length > 0.0 {
            let per_hour = extras.length.map_or(1.0, length_per_speed);
            let _ = write!(text, "{}", 60.0 * link.length * per_hour / minutes);
        }
        let _ = write!(
            text,
            ",{},1,{},{minutes},{},{},{},",
            link.capacity, link.toll, link.capacity, link.b, link.power
        );
        let _ = match extras.flows {
            Some((flows, costs)) => write!(text, "{},{},", flows[index], extras.minutes * costs[index]),
            None => write!(text, ",,"),
        };
        let shape = extras.shapes.get(index).filter(|shape| !shape.is_empty());
        let line = shape.map(|shape| format_wkt(shape)).or_else(|| {
            let places = &extras.places?.places;
            let ends = [link.init_node, link.term_node].map(|node| places[node as usize - 1]);
            Some(format_wkt(&ends))
        });
        let _ = writeln!(text, "{}", field(line.as_deref().unwrap_or("")));
    }
    text
}

/// How many of the unit of length that its usual speed counts an hour it is.
fn length_per_speed(length: Length) -> f64 {
    let counted = length.usual_speed().length_per_hour();
    counted.map_or(1.0, |unit| length.metres() / unit.metres())
}

fn format_config(length: Length) -> String {
    let (length, short, speed) = match length {
        Length::Metre => ("meter", "meter", "kph"),
        Length::Kilometre => ("kilometer", "meter", "kph"),
        Length::Foot => ("foot", "foot", "mph"),
        Length::Mile => ("mile", "foot", "mph"),
    };
    format!(
        "dataset_name,short_length,long_length,speed,geometry_field_format,version_number\n\
         network,{short},{length},{speed},wkt,0.96\n"
    )
}

/// A demand as a table for `network`, without trips within a zone.
pub fn format_demand(network: &Network, demand: &Demand) -> String {
    let mut text = String::from("o_zone_id,d_zone_id,volume\n");
    for trip in demand.trips() {
        let [origin, destination] = [trip.origin, trip.destination].map(|zone| network.zone_name(zone));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{},{}", field(&origin), field(&destination), trip.volume);
    }
    text
}
