//! Reader for SUMO networks (`net.xml`) and the trips or routes that go with them.
//!
//! Every junction is a node and a zone, every edge that cars may use a link: time in seconds, length in metres, capacity
//! by the number of its lanes. SUMO knows no capacities, so [`LaneModel`] states one per lane. A trip goes from the
//! junction where its first edge begins to the one where its last edge ends. Turn restrictions and signals do not enter.

use crate::coordinates::{Collected, LengthUnit, NodePlaces};
use crate::demand::{Demand, Trip};
use crate::link::{CostWeights, Link, NodeNumbering};
use crate::network::{Names, Network};
use crate::volume_delay::{BPR_B, BPR_POWER};
use crate::xml::{Element, Scan, elements};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::HashMap;

/// Functions of edges on which no trip starts or leads along by choice.
const INNER_FUNCTIONS: [&str; 3] = ["internal", "crossing", "walkingarea"];

/// Who drives.
const VEHICLE_CLASS: &str = "passenger";

/// What a lane carries, because the network file does not say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneModel {
    /// Vehicles per hour and lane.
    pub capacity: f64,
    /// BPR's B.
    pub b: f64,
    /// BPR's power.
    pub power: f64,
}

impl Default for LaneModel {
    /// 1,800 vehicles per hour and lane, B = 0.15 and power 4 (chosen: a lane's saturation flow, and the values of the
    /// Bureau of Public Roads).
    fn default() -> Self {
        Self {
            capacity: 1_800.0,
            b: BPR_B,
            power: BPR_POWER,
        }
    }
}

/// A network with the names of its edges, by which routes refer to it.
#[derive(Debug, Clone)]
pub struct SumoNetwork {
    /// The network; its links are the edges, in file order.
    pub network: Network,
    /// Index from 0 of the link of every edge that cars may use.
    pub edges: HashMap<String, u32>,
}

/// Reads a `net.xml` file.
///
/// # Errors
/// [`Error::Input`] naming the line for broken XML, another root than `<net>`, an
/// attribute that is missing or no number, an edge given twice, or one with a speed of 0.
pub fn read_network(
    Text { name, text }: &Text,
    model: &LaneModel,
    weights: CostWeights,
) -> Result<SumoNetwork> {
    let mut edges: Vec<Edge> = Vec::new();
    let mut inside = false;
    elements(name, text, "net", &mut |scan| {
        match scan {
            Scan::Open(element) if element.tag() == "edge" => {
                let function = element.optional("function")?.unwrap_or_default();
                inside = !INNER_FUNCTIONS.contains(&function.as_str());
                if inside {
                    edges.push(Edge::new(element)?);
                }
            }
            Scan::Open(element) if inside && element.tag() == "lane" => {
                if let Some(edge) = edges.last_mut() {
                    edge.add_lane(element)?;
                }
            }
            Scan::Close("edge") => inside = false,
            _ => {}
        }
        Ok(())
    })?;
    build(name, edges, model, weights)
}

/// An edge on the way.
struct Edge {
    place: String,
    id: String,
    from: String,
    to: String,
    lanes: u32,
    length: f64,
    speed: f64,
}

impl Edge {
    fn new(element: &Element<'_>) -> Result<Self> {
        Ok(Self {
            place: element.place(),
            id: element.required("id")?,
            from: element.required("from")?,
            to: element.required("to")?,
            lanes: 0,
            length: 0.0,
            speed: 0.0,
        })
    }

    /// Counts a lane if cars may use it; the fastest one sets the speed.
    fn add_lane(&mut self, element: &Element<'_>) -> Result<()> {
        let names = |list: &str, class: &str| list.split_whitespace().any(|name| name == class);
        let allowed = element.optional("allow")?;
        let disallowed = element.optional("disallow")?.unwrap_or_default();
        let closed = names(&disallowed, VEHICLE_CLASS) || names(&disallowed, "all");
        let open = allowed.is_none_or(|list| list.is_empty() || names(&list, VEHICLE_CLASS) || list == "all");
        let length = element.positive("length")?;
        let speed = element.positive("speed")?;
        if open && !closed {
            self.lanes += 1;
            self.length = self.length.max(length);
            self.speed = self.speed.max(speed);
        }
        Ok(())
    }
}

fn build(name: &str, edges: Vec<Edge>, model: &LaneModel, weights: CostWeights) -> Result<SumoNetwork> {
    let mut numbers: HashMap<String, u32> = HashMap::new();
    let mut names = Vec::new();
    let mut number_of = |junction: &str| {
        *numbers.entry(junction.to_owned()).or_insert_with(|| {
            names.push(junction.to_owned());
            names.len() as u32
        })
    };
    let mut links = Vec::new();
    let mut by_name = HashMap::new();
    for edge in edges {
        let (init_node, term_node) = (number_of(&edge.from), number_of(&edge.to));
        if edge.lanes == 0 {
            continue;
        }
        let link = Link {
            init_node,
            term_node,
            capacity: model.capacity * f64::from(edge.lanes),
            length: edge.length,
            free_flow_time: edge.length / edge.speed,
            b: model.b,
            power: model.power,
            toll: 0.0,
        };
        link.volume_delay(weights, &edge.place)?;
        if by_name.insert(edge.id.clone(), links.len() as u32).is_some() {
            let found = format!("a second edge `{}`", edge.id);
            return Err(Error::input(edge.place, found, "each edge once"));
        }
        links.push(link);
    }
    if links.is_empty() {
        return Err(Error::input(name, "no edge", "<edge> with a lane for cars"));
    }
    let numbering = NodeNumbering {
        zones: names.len() as u32,
        nodes: names.len() as u32,
        first_thru_node: 1,
    };
    let names = Names {
        nodes: names.clone(),
        zones: names,
    };
    Ok(SumoNetwork {
        network: Network::new(numbering, links, weights)?.with_names(names)?,
        edges: by_name,
    })
}

impl SumoNetwork {
    /// Reads trips: `<trip>` with `from` and `to` edges or `fromJunction` and `toJunction`, `<vehicle>` with a route of
    /// its own or the name of one. Each counts one vehicle per hour: a file is taken for an hour's trips.
    ///
    /// # Errors
    /// [`Error::Input`] naming the line for broken XML, another root than
    /// `<routes>`, an edge, junction or route that is not known, a vehicle without a route, or a `<flow>`, which is not
    /// read.
    pub fn read_trips(&self, Text { name, text }: &Text) -> Result<Demand> {
        let junctions = self.network.zone_numbers();
        let mut routes: HashMap<String, (u32, u32)> = HashMap::new();
        let mut trips = Vec::new();
        // Where the vehicle that is open begins, and where it goes once that is known.
        let mut vehicle: Option<(String, Option<(u32, u32)>)> = None;
        elements(name, text, "routes", &mut |scan| {
            match scan {
                Scan::Open(element) => match element.tag() {
                    "trip" => trips.push(one_vehicle(self.trip_ends(element, &junctions)?)),
                    "vehicle" => {
                        let ends = match element.optional("route")? {
                            None => None,
                            Some(id) => {
                                let known = routes.get(&id).copied();
                                let found = format!("route=\"{id}\"");
                                Some(
                                    known
                                        .ok_or_else(|| element.error(found, "a <route> that came before"))?,
                                )
                            }
                        };
                        vehicle = Some((element.place(), ends));
                    }
                    "route" => {
                        let ends = self.route_ends(element)?;
                        match &mut vehicle {
                            Some((_, open)) => *open = Some(ends),
                            None => {
                                routes.insert(element.required("id")?, ends);
                            }
                        }
                    }
                    "flow" => return Err(element.error("<flow>", "<vehicle> or <trip>")),
                    _ => {}
                },
                Scan::Close("vehicle") => {
                    if let Some((place, ends)) = vehicle.take() {
                        let expected = "a <route> within it, or its name";
                        let ends =
                            ends.ok_or_else(|| Error::input(place, "<vehicle> without a route", expected))?;
                        trips.push(one_vehicle(ends));
                    }
                }
                Scan::Close(_) => {}
            }
            Ok(())
        })?;
        Demand::new(self.network.numbering().zones, &trips)
    }

    fn edge(&self, element: &Element<'_>, id: &str) -> Result<&Link> {
        let link = self
            .edges
            .get(id)
            .map(|&link| &self.network.links()[link as usize]);
        link.ok_or_else(|| element.error(format!("edge `{id}`"), "an edge of the network that cars may use"))
    }

    fn route_ends(&self, element: &Element<'_>) -> Result<(u32, u32)> {
        let edges = element.required("edges")?;
        let mut ends: Option<(u32, u32)> = None;
        for id in edges.split_whitespace() {
            let link = self.edge(element, id)?;
            ends = Some((ends.map_or(link.init_node, |(origin, _)| origin), link.term_node));
        }
        ends.ok_or_else(|| element.error("edges=\"\"", "at least one edge"))
    }

    fn trip_ends(&self, element: &Element<'_>, junctions: &HashMap<String, u32>) -> Result<(u32, u32)> {
        let junction = |name: &str| match element.optional(name)? {
            None => Ok(None),
            Some(id) => match junctions.get(&id) {
                Some(&number) => Ok(Some(number)),
                None => Err(element.error(format!("{name}=\"{id}\""), "a junction of the network")),
            },
        };
        let origin = match junction("fromJunction")? {
            Some(number) => number,
            None => self.edge(element, &element.required("from")?)?.init_node,
        };
        let destination = match junction("toJunction")? {
            Some(number) => number,
            None => self.edge(element, &element.required("to")?)?.term_node,
        };
        Ok((origin, destination))
    }
}

fn one_vehicle((origin, destination): (u32, u32)) -> Trip {
    Trip {
        origin,
        destination,
        volume: 1.0,
    }
}

/// Reads the junctions of a SUMO `net.xml`; junctions that are no node of `network` are passed over.
///
/// # Errors
/// As [`crate::tntp::read_places`], and for broken XML.
pub fn read_places(Text { name, text }: &Text, network: &Network) -> Result<NodePlaces> {
    let mut collected = Collected::new(network, LengthUnit::Metre);
    elements(name, text, "net", &mut |scan| match scan {
        Scan::Open(element) if element.tag() == "junction" => put_junction(&mut collected, element),
        _ => Ok(()),
    })?;
    collected.finish(name)
}

fn put_junction(collected: &mut Collected<'_>, element: &Element<'_>) -> Result<()> {
    let id = element.required("id")?;
    if !collected.has_node(&id) {
        return Ok(());
    }
    let (x, y) = (element.required("x")?, element.required("y")?);
    collected.put(&element.place(), &id, (&x, &y))
}
