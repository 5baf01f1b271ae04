//! Reader for SUMO networks (`net.xml`) and the trips or routes that go with them.
//!
//! Every edge that cars may use is a road: time in seconds, length in metres, capacity by the number of its lanes. SUMO
//! knows no capacities, so [`LaneModel`] states one per lane. A car turns from edge to edge where the file has a connection
//! between lanes that cars may use. Signals, priorities and time within junctions do not enter.
//!
//! Trips lead from edge to edge, from junction to junction or between traffic assignment zones (`<taz>`); each such place
//! is a zone. Vehicles of all classes that use roads count alike, one an hour each. [`read_network`] is coarser: there
//! every junction is a zone, a trip leads from the junction where its first edge begins to the one where its last edge
//! ends, and all turns are free.

mod demand;
mod net;

use crate::coordinates::{Collected, LengthUnit, NodePlaces};
use crate::demand::{Demand, Trip};
use crate::demand_table::{Zones, read_csv};
use crate::formats::ImportOptions;
use crate::imported_demand::read_matrix;
use crate::link::{CostWeights, DelayFunction, Link};
use crate::network::Network;
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::{Access, RoadPlan, Turn, Turns, Zone};
use crate::shapes::Shape;
use crate::text;
use crate::volume_delay::{BPR_B, BPR_POWER};
use crate::xml::{Element, Scan, elements};
use demand::Journey;
use kit::error::{Error, Result};
use kit::files::Text;
use net::{Edge, Net};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

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

impl LaneModel {
    fn link(&self, edge: &Edge, lane_capacity: Option<f64>) -> Link {
        Link {
            init_node: edge.from,
            term_node: edge.to,
            capacity: lane_capacity.unwrap_or(self.capacity) * f64::from(edge.lanes),
            length: edge.length,
            free_flow_time: edge.length / edge.speed,
            b: self.b,
            power: self.power,
            toll: 0.0,
        }
    }
}

/// Where a trip begins or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Place {
    /// Index of an edge.
    Edge(u32),
    /// The same, for trips that begin on it, too: to a zone from itself nobody drives.
    End(u32),
    /// Number of a junction.
    Junction(u32),
    /// Index of a traffic assignment zone.
    Taz(u32),
}

/// A traffic assignment zone: names of edges.
#[derive(Debug, Clone, Default)]
struct Taz {
    id: String,
    sources: Vec<String>,
    sinks: Vec<String>,
}

impl Taz {
    /// Takes what an element says of zones.
    fn scan(all: &mut Vec<Self>, element: &Element<'_>) -> Result<()> {
        match element.tag() {
            "taz" => {
                let edges = element.optional("edges")?.unwrap_or_default();
                let edges: Vec<String> = edges.split_whitespace().map(str::to_owned).collect();
                all.push(Self {
                    id: element.required("id")?,
                    sources: edges.clone(),
                    sinks: edges,
                });
            }
            "tazSource" | "tazSink" => {
                if let Some(taz) = all.last_mut() {
                    let edges = match element.tag() {
                        "tazSource" => &mut taz.sources,
                        _ => &mut taz.sinks,
                    };
                    edges.push(element.required("id")?);
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// A network with the names of its edges, by which routes refer to it.
#[derive(Debug, Clone)]
pub struct SumoNetwork {
    /// The network; its links are the edges, in file order.
    pub network: Network,
    /// Index from 0 of the link of every edge that cars may use.
    pub edges: HashMap<String, u32>,
    net: Net,
}

/// Reads a `net.xml` file with every junction as a zone, all turns free.
///
/// # Errors
/// [`Error::Input`] naming the line for broken XML, another root than `<net>`, an
/// attribute that is missing or no number, an edge given twice, or one with a speed of 0.
pub fn read_network(text: &Text, model: &LaneModel, weights: CostWeights) -> Result<SumoNetwork> {
    let options = ImportOptions {
        weights,
        ..ImportOptions::default()
    };
    read_junctions(text, model, &options, &mut ImportReport::default())
}

/// [`read_network`] with options.
pub(crate) fn read_junctions(
    text: &Text,
    model: &LaneModel,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<SumoNetwork> {
    let net = Net::read(text, report)?;
    let junctions = (1..).zip(&net.junctions);
    let plan = RoadPlan {
        zones: junctions
            .map(|(number, name)| (name.clone(), Zone::Open(number)))
            .collect(),
        roads: roads(&net, model, options, report)?,
        junctions: net.junctions.clone(),
        turns: Turns::new(),
    };
    Ok(SumoNetwork {
        network: plan.network(options.weights)?,
        edges: net.by_name.clone(),
        net,
    })
}

fn roads(
    net: &Net,
    model: &LaneModel,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Vec<Link>> {
    let mut counted: BTreeMap<String, usize> = BTreeMap::new();
    let mut roads = Vec::with_capacity(net.edges.len());
    for edge in &net.edges {
        let given = options.lane_capacity(&edge.kind);
        let text = match given {
            Some(capacity) if edge.kind.is_empty() => format!("{capacity} an hour and lane"),
            Some(capacity) => format!("{capacity} an hour and lane of {}", edge.kind),
            None => format!("{} an hour and lane", model.capacity),
        };
        *counted.entry(text).or_default() += 1;
        let link = model.link(edge, given);
        link.volume_delay(DelayFunction::Bpr, options.weights, &edge.place)?;
        roads.push(link);
    }
    for (text, times) in counted {
        report.count(NoteKind::Default, "net.xml: capacity", text, times);
    }
    Ok(roads)
}

impl SumoNetwork {
    /// Reads trips between junctions: `<trip>` and `<flow>` with `from` and `to` edges or `fromJunction` and `toJunction`,
    /// `<vehicle>` and `<flow>` with a route of their own or the name of one. Each vehicle counts one per hour: a file is
    /// taken for an hour's trips.
    ///
    /// # Errors
    /// [`Error::Input`] naming the line for broken XML, another root than `<routes>`, an edge, junction, zone or route that
    /// is not known, a vehicle without a route, or trips between `<taz>`.
    pub fn read_trips(&self, text: &Text) -> Result<Demand> {
        self.trips_between_junctions(text, &mut ImportReport::default())
    }

    /// [`read_trips`](Self::read_trips) with a report.
    pub(crate) fn trips_between_junctions(&self, text: &Text, report: &mut ImportReport) -> Result<Demand> {
        let mut taz = self.net.taz.clone();
        let journeys = demand::read(text, &self.net, &mut taz, report)?;
        let junction = |place: Place, of_edge: fn(&Edge) -> u32| match place {
            Place::Junction(number) => Ok(number),
            Place::Edge(edge) | Place::End(edge) => Ok(of_edge(&self.net.edges[edge as usize])),
            Place::Taz(number) => {
                let found = format!("trips of taz `{}`", taz[number as usize].id);
                Err(Error::input(
                    &text.name,
                    found,
                    "edges or junctions, where junctions are the zones",
                ))
            }
        };
        let mut trips = Vec::new();
        for journey in journeys {
            trips.push(Trip {
                origin: junction(journey.origin, |edge| edge.from)?,
                destination: junction(journey.destination, |edge| edge.to)?,
                volume: journey.volume,
            });
        }
        Demand::new(self.network.numbering().zones, &trips)
    }
}

/// A network that cars can drive as it is, its demand, and how its roads run.
#[derive(Debug)]
pub(crate) struct Imported {
    pub(crate) network: Network,
    pub(crate) trips: Vec<Trip>,
    pub(crate) shapes: Vec<Shape>,
    pub(crate) road_names: Vec<String>,
}

/// Reads a network with its turns, and the zones that the demand names.
pub(crate) fn read(
    net_text: &Text,
    demand_path: &Path,
    taz_text: Option<&Text>,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Imported> {
    let net = Net::read(net_text, report)?;
    let mut taz = net.taz.clone();
    if let Some(text) = taz_text {
        taz.extend(demand::read_taz(text)?);
    }
    let journeys = match read_table(demand_path, &net, &taz, options, report)? {
        Some(journeys) => journeys,
        None => {
            let text = text::read(demand_path)?;
            demand::read(&text, &net, &mut taz, report)?
        }
    };
    let mut numbers: HashMap<Place, u32> = HashMap::new();
    let mut places: Vec<Place> = Vec::new();
    let mut number = |place: Place| {
        *numbers.entry(place).or_insert_with(|| {
            places.push(place);
            places.len() as u32
        })
    };
    let trips = journeys.iter().map(|journey| Trip {
        origin: number(journey.origin),
        destination: number(match journey.destination {
            Place::Edge(edge) if journey.origin == Place::Edge(edge) => Place::End(edge),
            other => other,
        }),
        volume: journey.volume,
    });
    let trips: Vec<Trip> = trips.collect();
    if places.is_empty() {
        return Err(Error::input("trips", "none", "a trip that uses the roads"));
    }
    if !taz.is_empty() && places.iter().any(|place| matches!(place, Place::Taz(_))) {
        let text = "trips of a zone begin and end on whichever of its edges is best: weights of edges";
        report.say(NoteKind::Unused, "taz", text);
    }
    let mut names = HashSet::new();
    let zones = places.iter().map(|&place| zone(&net, &taz, place, &mut names));
    let plan = RoadPlan {
        zones: zones.collect::<Result<_>>()?,
        roads: roads(&net, &LaneModel::default(), options, report)?,
        turns: turns(&net),
        junctions: net.junctions.clone(),
    };
    Ok(Imported {
        network: plan.network(options.weights)?,
        trips,
        road_names: net.edges.iter().map(|edge| edge.id.clone()).collect(),
        shapes: net.edges.into_iter().map(|edge| edge.shape).collect(),
    })
}

/// A demand by names of zones, edges or junctions; none if the file has trips, vehicles or flows.
fn read_table(
    path: &Path,
    net: &Net,
    taz: &[Taz],
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Option<Vec<Journey>>> {
    let by_id: HashMap<&str, u32> = taz.iter().map(|taz| taz.id.as_str()).zip(0..).collect();
    // The table's reader wants numbers: places in the order in which they are first named.
    let mut numbers: HashMap<String, u32> = HashMap::new();
    let mut places = Vec::new();
    let mut zones = Zones::by(|name| {
        if let Some(number) = numbers.get(name) {
            return Some(*number);
        }
        let zone = by_id.get(name).map(|&taz| Place::Taz(taz));
        let edge = || net.by_name.get(name).map(|&edge| Place::Edge(edge));
        let junction = || {
            net.junction_numbers
                .get(name)
                .map(|&number| Place::Junction(number))
        };
        places.push(zone.or_else(edge).or_else(junction)?);
        numbers.insert(name.to_owned(), places.len() as u32);
        Some(places.len() as u32)
    });
    let trips = match read_matrix(path, options.matrix.as_deref(), &mut zones, report)? {
        Some(trips) => trips,
        None => {
            let text = text::read(path)?;
            if text.text.trim_start().starts_with('<') {
                return Ok(None);
            }
            read_csv(&text, &mut zones, report)?
        }
    };
    zones.refuse_unknown()?;
    drop(zones);
    let journeys = trips.into_iter().map(|trip| Journey {
        origin: places[trip.origin as usize - 1],
        destination: places[trip.destination as usize - 1],
        volume: trip.volume,
    });
    Ok(Some(journeys.collect()))
}

/// The zone of a place, under a name that no other has.
fn zone(net: &Net, taz: &[Taz], place: Place, names: &mut HashSet<String>) -> Result<(String, Zone)> {
    let (name, kind, zone) = match place {
        Place::Edge(edge) => {
            let access = vec![Access::Road(edge)];
            let zone = Zone::Apart {
                from: access.clone(),
                to: access,
            };
            (&net.edges[edge as usize].id, "edge", zone)
        }
        Place::End(edge) => {
            let zone = Zone::Apart {
                from: Vec::new(),
                to: vec![Access::Road(edge)],
            };
            (&net.edges[edge as usize].id, "end", zone)
        }
        Place::Junction(number) => {
            let access = vec![Access::Junction(number)];
            let zone = Zone::Apart {
                from: access.clone(),
                to: access,
            };
            (&net.junctions[number as usize - 1], "junction", zone)
        }
        Place::Taz(taz_index) => {
            let taz = &taz[taz_index as usize];
            let roads = |edges: &[String]| {
                let known = edges.iter().filter_map(|edge| net.by_name.get(edge).copied());
                known.map(Access::Road).collect::<Vec<_>>()
            };
            let (from, to) = (roads(&taz.sources), roads(&taz.sinks));
            if from.is_empty() && to.is_empty() {
                let found = "no edge that cars may use";
                return Err(Error::input(format!("taz `{}`", taz.id), found, "at least one"));
            }
            (&taz.id, "taz", Zone::Apart { from, to })
        }
    };
    let name = if names.insert(name.clone()) {
        name.clone()
    } else {
        format!("{kind}:{name}")
    };
    Ok((name, zone))
}

/// The turns of every junction where not each edge leads to each other.
fn turns(net: &Net) -> Turns {
    let Some(connections) = &net.connections else {
        return Turns::new();
    };
    let (mut entering, mut leaving) = (HashMap::<u32, usize>::new(), HashMap::<u32, usize>::new());
    let mut turns = Turns::new();
    for edge in &net.edges {
        *entering.entry(edge.to).or_default() += 1;
        *leaving.entry(edge.from).or_default() += 1;
        turns.insert(edge.to, Vec::new());
    }
    let mut sorted: Vec<(u32, u32)> = connections.iter().copied().collect();
    sorted.sort_unstable();
    for (from, to) in sorted {
        let junction = net.edges[from as usize].to;
        turns.entry(junction).or_default().push(Turn {
            from,
            to,
            penalty: 0.0,
        });
    }
    turns.retain(|junction, turns| {
        let ways = entering.get(junction).unwrap_or(&0) * leaving.get(junction).unwrap_or(&0);
        turns.len() < ways
    });
    turns
}

/// Reads the junctions of a SUMO `net.xml`; junctions that are no node of `network` are passed over.
///
/// # Errors
/// As [`crate::tntp::read_places`], and for broken XML.
pub fn read_places(Text { name, text }: &Text, network: &Network) -> Result<NodePlaces> {
    let mut collected = Collected::new(network, LengthUnit::Metre);
    elements(name, text, &["net"], &mut |scan| match scan {
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
