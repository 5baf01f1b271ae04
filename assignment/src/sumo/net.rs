//! Edges, lanes and connections: `net.xml`.

use super::Taz;
use crate::report::{ImportReport, NoteKind};
use crate::shapes::{Shape, parse_points};
use crate::xml::{Element, Scan, elements};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::{HashMap, HashSet};

/// Functions of edges on which no trip starts or leads along by choice.
const INNER_FUNCTIONS: [&str; 3] = ["internal", "crossing", "walkingarea"];

/// Who drives.
const VEHICLE_CLASS: &str = "passenger";

/// The roads of a network file.
#[derive(Debug, Clone, Default)]
pub(super) struct Net {
    /// Edges that cars may use, in file order.
    pub(super) edges: Vec<Edge>,
    /// Index of every such edge, by its name.
    pub(super) by_name: HashMap<String, u32>,
    /// Junctions between edges, also those that cars may not use; number 1 is the first.
    pub(super) junctions: Vec<String>,
    /// Number of every junction, by its name.
    pub(super) junction_numbers: HashMap<String, u32>,
    /// From which edge to which cars may turn; none if the file has no connections.
    pub(super) connections: Option<HashSet<(u32, u32)>>,
    /// Zones that the file declares.
    pub(super) taz: Vec<Taz>,
}

/// An edge.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    pub(super) place: String,
    pub(super) id: String,
    /// Numbers of junctions.
    pub(super) from: u32,
    pub(super) to: u32,
    /// Type of road, empty if it has none.
    pub(super) kind: String,
    /// By index of lane, whether cars may use it.
    open: Vec<bool>,
    /// Lanes that cars may use.
    pub(super) lanes: u32,
    /// m.
    pub(super) length: f64,
    /// m/s, of the fastest lane.
    pub(super) speed: f64,
    slowest: f64,
    pub(super) shape: Shape,
}

/// A connection as it stands in the file.
struct Connection {
    from: String,
    to: String,
    lanes: [Option<usize>; 2],
}

impl Net {
    /// Reads a `net.xml` file.
    ///
    /// # Errors
    /// As [`super::read_network`].
    pub(super) fn read(Text { name, text }: &Text, report: &mut ImportReport) -> Result<Self> {
        let mut net = Self::default();
        let mut open: Option<Edge> = None;
        let mut connections: Option<Vec<Connection>> = None;
        let (mut closed, mut signals) = (0, 0);
        elements(name, text, &["net"], &mut |scan| {
            match scan {
                Scan::Open(element) => match element.tag() {
                    "edge" => {
                        let function = element.optional("function")?.unwrap_or_default();
                        open = if INNER_FUNCTIONS.contains(&function.as_str()) {
                            None
                        } else {
                            Some(net.edge(element)?)
                        };
                    }
                    "lane" => {
                        if let Some(edge) = &mut open {
                            edge.add_lane(element)?;
                        }
                    }
                    "connection" => {
                        let found = connections.get_or_insert_default();
                        found.extend(Connection::read(element)?);
                    }
                    "tlLogic" => signals += 1,
                    _ => Taz::scan(&mut net.taz, element)?,
                },
                Scan::Close("edge") => {
                    if let Some(edge) = open.take() {
                        closed += usize::from(edge.lanes == 0);
                        net.add(edge)?;
                    }
                }
                Scan::Close(_) => {}
            }
            Ok(())
        })?;
        if net.edges.is_empty() {
            return Err(Error::input(name, "no edge", "<edge> with a lane for cars"));
        }
        net.connections = connections.map(|found| found.iter().filter_map(|turn| net.turn(turn)).collect());
        net.report(closed, signals, report);
        Ok(net)
    }

    fn edge(&mut self, element: &Element<'_>) -> Result<Edge> {
        Ok(Edge {
            place: element.place(),
            id: element.required("id")?,
            from: self.junction(element.required("from")?),
            to: self.junction(element.required("to")?),
            kind: element.optional("type")?.unwrap_or_default(),
            open: Vec::new(),
            lanes: 0,
            length: 0.0,
            speed: 0.0,
            slowest: f64::INFINITY,
            shape: shape(element)?,
        })
    }

    /// The number of a junction, known or new.
    fn junction(&mut self, id: String) -> u32 {
        *self.junction_numbers.entry(id).or_insert_with_key(|id| {
            self.junctions.push(id.clone());
            self.junctions.len() as u32
        })
    }

    fn add(&mut self, edge: Edge) -> Result<()> {
        if edge.lanes == 0 {
            return Ok(());
        }
        let index = self.edges.len() as u32;
        if self.by_name.insert(edge.id.clone(), index).is_some() {
            let found = format!("a second edge `{}`", edge.id);
            return Err(Error::input(edge.place, found, "each edge once"));
        }
        self.edges.push(edge);
        Ok(())
    }

    /// The edges of a connection that joins lanes which cars may use.
    fn turn(&self, connection: &Connection) -> Option<(u32, u32)> {
        let [from, to] = [&connection.from, &connection.to].map(|id| self.by_name.get(id).copied());
        let (from, to) = (from?, to?);
        let open = |edge: u32, lane: Option<usize>| {
            let open = &self.edges[edge as usize].open;
            lane.is_none_or(|lane| open.get(lane).copied().unwrap_or(false))
        };
        (open(from, connection.lanes[0]) && open(to, connection.lanes[1])).then_some((from, to))
    }

    fn report(&self, closed: usize, signals: usize, report: &mut ImportReport) {
        const FILE: &str = "net.xml";
        report.count(NoteKind::Read, FILE, "edges that cars may use", self.edges.len());
        report.say(NoteKind::Unit, FILE, "lengths in m, times in s");
        let mixed = self.edges.iter().filter(|edge| edge.slowest < edge.speed).count();
        if mixed > 0 {
            let text = "speed of the fastest lane, on edges whose lanes differ";
            report.count(NoteKind::Default, FILE, text, mixed);
        }
        if closed > 0 {
            report.count(NoteKind::Unused, FILE, "edges that cars may not use", closed);
        }
        if signals > 0 {
            let text = "signals: nobody waits at them, and within junctions no time passes";
            report.count(NoteKind::Unused, FILE, text, signals);
        }
        match &self.connections {
            Some(turns) => report.count(NoteKind::Read, FILE, "turns from edge to edge", turns.len()),
            None => report.say(
                NoteKind::Warning,
                FILE,
                "no connections: every turn is taken for possible",
            ),
        }
        let speeds = self.edges.iter().map(|edge| 3.6 * edge.speed);
        report.range(
            format!("{FILE}: free-flow speed in km/h"),
            speeds.collect(),
            Some(5.0..=200.0),
        );
    }
}

impl Edge {
    /// Counts a lane if cars may use it; the fastest one sets the speed.
    fn add_lane(&mut self, element: &Element<'_>) -> Result<()> {
        let open = is_open(element)?;
        let length = element.positive("length")?;
        let speed = element.positive("speed")?;
        self.open.push(open);
        if self.shape.is_empty() {
            self.shape = shape(element)?;
        }
        if open {
            self.lanes += 1;
            self.length = self.length.max(length);
            self.speed = self.speed.max(speed);
            self.slowest = self.slowest.min(speed);
        }
        Ok(())
    }
}

impl Connection {
    /// None within a junction, and none that cars may not use.
    fn read(element: &Element<'_>) -> Result<Option<Self>> {
        let (from, to) = (element.required("from")?, element.required("to")?);
        if from.starts_with(':') || !is_open(element)? {
            return Ok(None);
        }
        let lane = |attribute: &str| {
            let text = element.optional(attribute)?;
            Ok::<_, Error>(text.and_then(|lane| lane.parse().ok()))
        };
        Ok(Some(Self {
            from,
            to,
            lanes: [lane("fromLane")?, lane("toLane")?],
        }))
    }
}

/// Whether cars are among those that an element allows and not among those that it does not.
fn is_open(element: &Element<'_>) -> Result<bool> {
    let names = |list: &str, class: &str| list.split_whitespace().any(|name| name == class);
    let allowed = element.optional("allow")?;
    let disallowed = element.optional("disallow")?.unwrap_or_default();
    let closed = names(&disallowed, VEHICLE_CLASS) || names(&disallowed, "all");
    let open = allowed.is_none_or(|list| list.is_empty() || names(&list, VEHICLE_CLASS) || list == "all");
    Ok(open && !closed)
}

fn shape(element: &Element<'_>) -> Result<Shape> {
    let text = element.optional("shape")?;
    Ok(text
        .and_then(|text| parse_points(text.trim(), ' '))
        .unwrap_or_default())
}
