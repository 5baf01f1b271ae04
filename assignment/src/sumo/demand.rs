//! Trips, vehicles and flows: routes files, and what SUMO's od2trips writes.

use super::net::Net;
use super::{Place, Taz};
use crate::report::{ImportReport, NoteKind};
use crate::xml::{Element, Scan, elements};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::{BTreeMap, HashMap};

/// Roots of files with trips.
const ROOTS: [&str; 6] = ["routes", "trips", "flows", "additional", "demand", "tazs"];

/// Classes of vehicles that use no road, or one of their own.
const NOT_ON_ROADS: [&str; 9] = [
    "pedestrian",
    "bicycle",
    "tram",
    "rail",
    "rail_urban",
    "rail_electric",
    "rail_fast",
    "ship",
    "aircraft",
];

/// The class that the roads are read for.
const CAR: &str = "passenger";

/// Types that SUMO knows without a file, with their classes.
const OWN_TYPES: [(&str, &str); 3] = [
    ("DEFAULT_BIKETYPE", "bicycle"),
    ("DEFAULT_PEDTYPE", "pedestrian"),
    ("DEFAULT_RAILTYPE", "rail"),
];

/// Seconds that a file's trips are taken for.
const HOUR_S: f64 = 3_600.0;

/// From where to where so many vehicles an hour go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Journey {
    pub(super) origin: Place,
    pub(super) destination: Place,
    pub(super) volume: f64,
}

/// A vehicle or flow that is open.
struct Open {
    place: String,
    tag: String,
    kind: Option<String>,
    volume: f64,
    ends: Vec<([Place; 2], f64)>,
}

/// Everything of a file on the way.
struct Reader<'n> {
    net: &'n Net,
    taz: &'n mut Vec<Taz>,
    taz_numbers: HashMap<String, u32>,
    /// Ends of routes by their names, with shares for distributions.
    routes: HashMap<String, Vec<([Place; 2], f64)>>,
    /// The distribution that is open.
    distribution: Option<String>,
    open: Option<Open>,
    in_person: bool,
    journeys: Vec<(Option<String>, Journey)>,
    classes: HashMap<String, String>,
    times_s: Option<(f64, f64)>,
    seen: BTreeMap<&'static str, usize>,
}

/// Reads all trips of a file, and the zones that it declares. Each vehicle counts one an hour: the file is taken for an
/// hour's.
///
/// # Errors
/// As [`super::SumoNetwork::read_trips`].
pub(super) fn read(
    Text { name, text }: &Text,
    net: &Net,
    taz: &mut Vec<Taz>,
    report: &mut ImportReport,
) -> Result<Vec<Journey>> {
    let mut reader = Reader {
        net,
        taz_numbers: taz.iter().map(|taz| taz.id.clone()).zip(0..).collect(),
        taz,
        routes: HashMap::new(),
        distribution: None,
        open: None,
        in_person: false,
        journeys: Vec::new(),
        classes: HashMap::new(),
        times_s: None,
        seen: BTreeMap::new(),
    };
    elements(name, text, &ROOTS, &mut |scan| match scan {
        Scan::Open(element) => reader.begin(element),
        Scan::Close(tag) => reader.end(tag),
    })?;
    Ok(reader.finish(report))
}

/// The zones that a file declares.
///
/// # Errors
/// [`Error::Input`] for broken XML.
pub(super) fn read_taz(Text { name, text }: &Text) -> Result<Vec<Taz>> {
    let mut taz = Vec::new();
    elements(name, text, &ROOTS, &mut |scan| match scan {
        Scan::Open(element) => Taz::scan(&mut taz, element),
        Scan::Close(_) => Ok(()),
    })?;
    Ok(taz)
}

impl Reader<'_> {
    fn begin(&mut self, element: &Element<'_>) -> Result<()> {
        match element.tag() {
            "person" | "personFlow" | "container" | "containerFlow" => {
                self.in_person = true;
                *self.seen.entry("persons and containers").or_default() += 1;
            }
            _ if self.in_person => {}
            "vType" => {
                let class = element.optional("vClass")?.unwrap_or_else(|| CAR.to_owned());
                self.classes.insert(element.required("id")?, class);
                *self.seen.entry("<vType> but for its class").or_default() += 1;
            }
            "routeDistribution" => self.distribution = Some(element.required("id")?),
            "route" => self.route(element)?,
            tag @ ("trip" | "vehicle" | "flow") => self.vehicle(element, tag)?,
            tag => {
                Taz::scan(self.taz, element)?;
                if let ("taz", Some(taz)) = (tag, self.taz.last()) {
                    self.taz_numbers.insert(taz.id.clone(), self.taz.len() as u32 - 1);
                }
            }
        }
        Ok(())
    }

    fn end(&mut self, tag: &str) -> Result<()> {
        match tag {
            "person" | "personFlow" | "container" | "containerFlow" => self.in_person = false,
            "routeDistribution" => self.distribution = None,
            "trip" | "vehicle" | "flow" if !self.in_person => {
                if let Some(open) = self.open.take() {
                    self.depart(open)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn route(&mut self, element: &Element<'_>) -> Result<()> {
        let share = element.optional_amount("probability")?.unwrap_or(1.0);
        let routes = if let Some(id) = element.optional("refId")? {
            self.known_route(element, &id)?
        } else {
            vec![(self.route_ends(element)?, share)]
        };
        if let Some(open) = &mut self.open {
            open.ends.extend(routes);
            return Ok(());
        }
        if let Some(id) = &self.distribution {
            self.routes.entry(id.clone()).or_default().extend(routes.clone());
            if let Some(id) = element.optional("id")? {
                self.routes.insert(id, routes);
            }
            return Ok(());
        }
        self.routes.insert(element.required("id")?, routes);
        Ok(())
    }

    fn known_route(&self, element: &Element<'_>, id: &str) -> Result<Vec<([Place; 2], f64)>> {
        let known = self.routes.get(id).cloned();
        known.ok_or_else(|| element.error(format!("route=\"{id}\""), "a <route> that came before"))
    }

    fn vehicle(&mut self, element: &Element<'_>, tag: &str) -> Result<()> {
        let volume = if tag == "flow" {
            self.flow_volume(element)?
        } else {
            self.depart_time(element, "depart")?;
            1.0
        };
        let ends = match element.optional("route")? {
            Some(id) => self.known_route(element, &id)?,
            None if tag == "vehicle" => Vec::new(),
            None => self
                .trip_ends(element)?
                .map(|ends| (ends, 1.0))
                .into_iter()
                .collect(),
        };
        if element.optional("via")?.is_some() {
            *self
                .seen
                .entry("`via`: edges to pass on the way, of vehicles")
                .or_default() += 1;
        }
        self.open = Some(Open {
            place: element.place(),
            tag: tag.to_owned(),
            kind: element.optional("type")?,
            volume,
            ends,
        });
        Ok(())
    }

    /// Vehicles of a flow: by number, or by rate while it lasts.
    fn flow_volume(&mut self, element: &Element<'_>) -> Result<f64> {
        let begin = self.depart_time(element, "begin")?.unwrap_or(0.0);
        let end = self.depart_time(element, "end")?;
        if let Some(number) = element.optional_amount("number")? {
            return Ok(number);
        }
        let lasts_s = end.map_or(HOUR_S, |end| (end - begin).max(0.0));
        for rate in ["vehsPerHour", "perHour"] {
            if let Some(rate) = element.optional_amount(rate)? {
                return Ok(rate * lasts_s / HOUR_S);
            }
        }
        if let Some(probability) = element.optional_amount("probability")? {
            return Ok(probability * lasts_s);
        }
        let expected = "number, vehsPerHour, period or probability";
        let period = element
            .optional("period")?
            .ok_or_else(|| element.error("<flow> without a number of vehicles", expected))?;
        let found = || format!("period=\"{period}\"");
        // `exp(r)`: r vehicles a second, at random.
        let per_second = match period
            .strip_prefix("exp(")
            .and_then(|rate| rate.strip_suffix(')'))
        {
            Some(rate) => rate.trim().parse::<f64>().ok(),
            None => period.trim().parse::<f64>().ok().map(|period| 1.0 / period),
        };
        let per_second = per_second.filter(|rate| rate.is_finite() && *rate >= 0.0);
        per_second
            .map(|rate| rate * lasts_s)
            .ok_or_else(|| element.error(found(), "seconds, or exp(vehicles a second)"))
    }

    /// A time in seconds or as `hours:minutes:seconds`; words such as `triggered` are none.
    fn depart_time(&mut self, element: &Element<'_>, attribute: &str) -> Result<Option<f64>> {
        let Some(text) = element.optional(attribute)? else {
            return Ok(None);
        };
        let parts: Option<Vec<f64>> = text.split(':').map(|part| part.trim().parse().ok()).collect();
        let time_s = parts.and_then(|parts| match *parts.as_slice() {
            [seconds] => Some(seconds),
            [hours, minutes, seconds] => Some(HOUR_S * hours + 60.0 * minutes + seconds),
            [days, hours, minutes, seconds] => {
                Some(24.0 * HOUR_S * days + HOUR_S * hours + 60.0 * minutes + seconds)
            }
            _ => None,
        });
        if let Some(time_s) = time_s.filter(|time_s| time_s.is_finite()) {
            let (first, last) = self.times_s.unwrap_or((time_s, time_s));
            self.times_s = Some((first.min(time_s), last.max(time_s)));
        }
        Ok(time_s)
    }

    fn edge(&self, element: &Element<'_>, id: &str) -> Result<Place> {
        let edge = self.net.by_name.get(id).copied().map(Place::Edge);
        edge.ok_or_else(|| element.error(format!("edge `{id}`"), "an edge of the network that cars may use"))
    }

    fn route_ends(&self, element: &Element<'_>) -> Result<[Place; 2]> {
        let edges = element.required("edges")?;
        let mut ends: Option<[Place; 2]> = None;
        for id in edges.split_whitespace() {
            let edge = self.edge(element, id)?;
            ends = Some([ends.map_or(edge, |[first, _]| first), edge]);
        }
        ends.ok_or_else(|| element.error("edges=\"\"", "at least one edge"))
    }

    /// None for a flow whose route follows within it.
    fn trip_ends(&self, element: &Element<'_>) -> Result<Option<[Place; 2]>> {
        let place = |edge: &str| -> Result<Option<Place>> {
            if let Some(id) = element.optional(edge)? {
                return self.edge(element, &id).map(Some);
            }
            let junction = format!("{edge}Junction");
            if let Some(id) = element.optional(&junction)? {
                let number = self.net.junction_numbers.get(&id).copied();
                let number = number.ok_or_else(|| {
                    element.error(format!("{junction}=\"{id}\""), "a junction of the network")
                })?;
                return Ok(Some(Place::Junction(number)));
            }
            let zone = format!("{edge}Taz");
            if let Some(id) = element.optional(&zone)? {
                let number = self.taz_numbers.get(&id).copied();
                let number = number.ok_or_else(|| {
                    element.error(
                        format!("{zone}=\"{id}\""),
                        "a <taz> that came before, or of --taz",
                    )
                })?;
                return Ok(Some(Place::Taz(number)));
            }
            Ok(None)
        };
        match (place("from")?, place("to")?) {
            (Some(from), Some(to)) => Ok(Some([from, to])),
            (None, None) if element.tag() == "flow" => Ok(None),
            (from, _) => {
                let missing = if from.is_none() { "from" } else { "to" };
                let found = format!("<{}> without '{missing}'", element.tag());
                let expected = format!("an attribute '{missing}', '{missing}Junction' or '{missing}Taz'");
                Err(element.error(found, expected))
            }
        }
    }

    /// Counts what was open.
    fn depart(&mut self, open: Open) -> Result<()> {
        let shares: f64 = open.ends.iter().map(|(_, share)| share).sum();
        if open.ends.is_empty() || shares <= 0.0 {
            let found = format!("<{}> without a route", open.tag);
            return Err(Error::input(
                open.place,
                found,
                "a <route> within it, or its name",
            ));
        }
        for ([origin, destination], share) in open.ends {
            let journey = Journey {
                origin,
                destination,
                volume: open.volume * share / shares,
            };
            self.journeys.push((open.kind.clone(), journey));
        }
        Ok(())
    }

    /// The class of a type of vehicles.
    fn class_of(&self, kind: &str) -> Option<&str> {
        let own = OWN_TYPES.iter().find(|(name, _)| *name == kind);
        let declared = self.classes.get(kind).map(String::as_str);
        declared.or(own.map(|(_, class)| *class))
    }

    /// Leaves out what uses no road, and says what was seen.
    fn finish(self, report: &mut ImportReport) -> Vec<Journey> {
        const FILE: &str = "trips";
        let mut kept = Vec::with_capacity(self.journeys.len());
        let mut others: BTreeMap<(String, bool), f64> = BTreeMap::new();
        for (kind, journey) in &self.journeys {
            let class = kind
                .as_deref()
                .and_then(|kind| self.class_of(kind))
                .unwrap_or(CAR);
            let on_road = !NOT_ON_ROADS.contains(&class);
            if class != CAR {
                *others.entry((class.to_owned(), on_road)).or_default() += journey.volume;
            }
            if on_road {
                kept.push(*journey);
            }
        }
        let vehicles: f64 = kept.iter().map(|journey| journey.volume).sum();
        let text = "vehicles, each of which counts one an hour";
        report.count(NoteKind::Read, FILE, text, vehicles.round() as usize);
        for ((class, on_road), volume) in others {
            let (kind, text) = if on_road {
                (
                    NoteKind::Default,
                    format!("vehicles of class {class} count as a car each"),
                )
            } else {
                (NoteKind::Unused, format!("vehicles of class {class}"))
            };
            report.count(kind, FILE, text, volume.round() as usize);
        }
        for (what, times) in self.seen {
            report.count(NoteKind::Unused, FILE, what, times);
        }
        if let Some((first, last)) = self.times_s
            && last - first > HOUR_S
        {
            let hours = (last - first) / HOUR_S;
            let text = format!(
                "departures span {hours:.1} h and count as one hour's: --demand-factor {:.3} makes them vehicles an hour",
                1.0 / hours
            );
            report.say(NoteKind::Warning, FILE, text);
        }
        kept
    }
}
