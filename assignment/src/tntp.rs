//! Reader for TNTP, the text format of the "Transportation Networks for Research" collection.
//!
//! A file starts with metadata, `<KEY> value` per line up to `<END OF METADATA>`; `~` starts a comment. A network has one
//! line per link with ten columns and a closing `;`. A trip table has an `Origin N` line per origin, followed by
//! `destination : volume;` entries. Nothing is guessed: what does not fit is an error that names the line.

use crate::coordinates::{Collected, LengthUnit, NodePlaces};
use crate::demand::{Demand, Trip};
use crate::link::{CostWeights, DelayFunction, Link, NodeNumbering, check_not_negative};
use crate::network::Network;
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::HashMap;
use std::str::FromStr;

/// Columns of a link. `speed` and `link_type` do not enter an assignment and are not read; the last may be missing.
const LINK_COLUMNS: &str = "init_node term_node capacity length free_flow_time b power speed toll link_type";

/// How far the sum of all trips may lie from the stated total, as a share of it, besides what the digits of the total leave
/// open (chosen: files round the trips, too).
const TOTAL_TOLERANCE: f64 = 1e-6;

const ZONES: &str = "NUMBER OF ZONES";
const NODES: &str = "NUMBER OF NODES";
const FIRST_THRU_NODE: &str = "FIRST THRU NODE";
const LINKS: &str = "NUMBER OF LINKS";
const TOTAL_FLOW: &str = "TOTAL OD FLOW";
const END: &str = "END OF METADATA";

/// Reads a network file.
///
/// # Errors
/// [`Error::Input`] naming the line for metadata that is missing or not a number,
/// a missing column, a number that is no number, negative or infinite, a node that does not exist, or another number of
/// links than stated.
pub fn read_network(Text { name, text }: &Text, weights: CostWeights) -> Result<Network> {
    let (metadata, body) = Metadata::parse(name, text)?;
    let numbering = NodeNumbering {
        zones: metadata.number(ZONES)?,
        nodes: metadata.number(NODES)?,
        first_thru_node: metadata.number(FIRST_THRU_NODE)?,
    };
    let stated_links: usize = metadata.number(LINKS)?;
    numbering.check(name)?;
    // Each node takes memory, which a number alone is not worth.
    if numbering.nodes as usize > text.len() {
        let expected = format!("fewer: the file has {} bytes", text.len());
        return Err(Error::input(
            format!("{name}: <{NODES}>"),
            numbering.nodes,
            expected,
        ));
    }
    let mut links = Vec::new();
    // Each row has as many columns as the longest: one column less is no hole in the middle then.
    let columns = body
        .lines(name)
        .map(|(_, line)| split_columns(line).count())
        .max();
    for (place, line) in body.lines(name) {
        let link = parse_link(&place, line, columns.unwrap_or_default())?;
        numbering.check_node(&place, "init_node", link.init_node)?;
        numbering.check_node(&place, "term_node", link.term_node)?;
        link.volume_delay(DelayFunction::Bpr, weights, &place)?;
        links.push(link);
    }
    if links.len() != stated_links {
        return Err(Error::input(
            name,
            format!("{} links", links.len()),
            format!("{stated_links}, as <{LINKS}> states"),
        ));
    }
    Network::new(numbering, links, weights)
}

/// The columns of a link.
fn split_columns(line: &str) -> impl Iterator<Item = &str> {
    line.trim_end_matches(';').split_whitespace()
}

/// One line of a network file whose lines have so many columns.
fn parse_link(place: &str, line: &str, expected: usize) -> Result<Link> {
    let columns: Vec<&str> = split_columns(line).collect();
    let names: Vec<&str> = LINK_COLUMNS.split(' ').collect();
    if columns.len() != expected || ![names.len() - 1, names.len()].contains(&expected) {
        return Err(Error::input(
            place,
            format!("{} columns", columns.len()),
            format!("{}: {LINK_COLUMNS}", names.len()),
        ));
    }
    let amount = |index: usize| parse::<f64>(place, names[index], columns[index], "a number");
    let node = |index: usize| parse::<u32>(place, names[index], columns[index], "a node number");
    Ok(Link {
        init_node: node(0)?,
        term_node: node(1)?,
        capacity: amount(2)?,
        length: amount(3)?,
        free_flow_time: amount(4)?,
        b: amount(5)?,
        power: amount(6)?,
        toll: amount(8)?,
    })
}

/// Reads a trip table for a network with `zones` zones.
///
/// # Errors
/// [`Error::Input`] naming the line for metadata that is missing, another number of
/// zones, a zone out of range, an entry that is not `destination : volume`, a volume that is negative or infinite, or
/// trips whose sum is not the stated total.
pub fn read_trips(Text { name, text }: &Text, zones: u32) -> Result<Demand> {
    let (metadata, body) = Metadata::parse(name, text)?;
    let stated_zones: u32 = metadata.number(ZONES)?;
    if stated_zones != zones {
        return Err(Error::input(
            format!("{name}: <{ZONES}>"),
            stated_zones,
            format!("{zones}, as the network has"),
        ));
    }
    let trips = parse_trips(name, &body, zones)?;
    check_total(name, &metadata, &trips)?;
    Demand::new(zones, &trips)
}

/// The entries behind the metadata.
fn parse_trips(name: &str, body: &Body<'_>, zones: u32) -> Result<Vec<Trip>> {
    let mut trips = Vec::new();
    let mut origin = None;
    for (place, line) in body.lines(name) {
        if let Some(number) = line.strip_prefix("Origin") {
            origin = Some(parse_zone(&place, "origin", number.trim(), zones)?);
            continue;
        }
        for entry in line.split(';').map(str::trim).filter(|entry| !entry.is_empty()) {
            let Some(origin) = origin else {
                return Err(Error::input(place, entry, "an `Origin` line before any trips"));
            };
            trips.push(parse_trip(&place, entry, origin, zones)?);
        }
    }
    Ok(trips)
}

/// Reads a trip table for a network whose zones have names: the table's numbers are taken for these.
///
/// # Errors
/// As [`read_trips`], but for the number of zones, which may be another.
#[cfg(feature = "formats")]
pub(crate) fn read_trips_by_name(
    Text { name, text }: &Text,
    zones: &mut crate::demand_table::Zones<'_>,
) -> Result<Vec<Trip>> {
    let (metadata, body) = Metadata::parse(name, text)?;
    let numbered = parse_trips(name, &body, metadata.number(ZONES)?)?;
    check_total(name, &metadata, &numbered)?;
    let mut trips = Vec::with_capacity(numbered.len());
    for trip in numbered {
        let mut zone = |number: u32| zones.number(&number.to_string(), trip.volume, || name.clone());
        if let (Some(origin), Some(destination)) = (zone(trip.origin), zone(trip.destination)) {
            trips.push(Trip {
                origin,
                destination,
                ..trip
            });
        }
    }
    Ok(trips)
}

/// Whether a text is in this format.
#[cfg(feature = "formats")]
pub(crate) fn is_tntp(text: &str) -> bool {
    text.trim_start_matches(['\u{feff}', ' ', '\t', '\r', '\n'])
        .starts_with('<')
        && text.contains(&format!("<{END}>"))
}

/// Refuses trips that do not add up to the stated total, as far as its digits tell.
fn check_total(name: &str, metadata: &Metadata<'_>, trips: &[Trip]) -> Result<()> {
    let stated: f64 = metadata.number(TOTAL_FLOW)?;
    let (digits, line) = metadata.entry(TOTAL_FLOW)?;
    check_not_negative(&format!("{name}:{line}: <{TOTAL_FLOW}>"), stated)?;
    let total: f64 = trips.iter().map(|trip| trip.volume).sum();
    let open = TOTAL_TOLERANCE * stated + 0.5 * last_digit(digits);
    if (total - stated).abs() <= open {
        return Ok(());
    }
    Err(Error::input(
        name,
        format!("trips that add up to {total}"),
        format!("{stated}, as <{TOTAL_FLOW}> states"),
    ))
}

/// What one in the last printed digit of a number is worth: 100 in `2.52257e+007`.
fn last_digit(number: &str) -> f64 {
    let (digits, exponent) = number.split_once(['e', 'E']).unwrap_or((number, "0"));
    let decimals = digits.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    // A zero's exponent says nothing, or `0e300` would be any total.
    let zero = digits
        .bytes()
        .all(|digit| !digit.is_ascii_digit() || digit == b'0');
    let exponent: i32 = if zero { 0 } else { exponent.parse().unwrap_or(0) };
    libm::exp10(f64::from(exponent) - decimals as f64)
}

/// One `destination : volume` entry.
fn parse_trip(place: &str, entry: &str, origin: u32, zones: u32) -> Result<Trip> {
    let Some((destination, volume)) = entry.split_once(':') else {
        return Err(Error::input(
            place,
            format!("`{entry}`"),
            "`destination : volume`",
        ));
    };
    let destination = parse_zone(place, "destination", destination.trim(), zones)?;
    let volume = parse(place, "volume", volume.trim(), "a number")?;
    check_not_negative(&format!("{place}: volume"), volume)?;
    Ok(Trip {
        origin,
        destination,
        volume,
    })
}

fn parse_zone(place: &str, name: &str, text: &str, zones: u32) -> Result<u32> {
    let zone: u32 = parse(place, name, text, "a zone number")?;
    if (1..=zones).contains(&zone) {
        return Ok(zone);
    }
    let expected = format!("a zone from 1 to {zones}");
    Err(Error::input(format!("{place}: {name}"), zone, expected))
}

fn parse<T: FromStr>(place: &str, name: &str, text: &str, expected: &str) -> Result<T> {
    text.parse()
        .map_err(|_| Error::input(format!("{place}: {name}"), format!("`{text}`"), expected))
}

/// The `<KEY> value` lines at the head of a file.
struct Metadata<'a> {
    name: &'a str,
    /// By key, value and number of the line.
    entries: HashMap<&'a str, (&'a str, usize)>,
}

/// What follows the metadata.
struct Body<'a> {
    text: &'a str,
    first_line: usize,
}

impl<'a> Metadata<'a> {
    fn parse(name: &'a str, text: &'a str) -> Result<(Self, Body<'a>)> {
        let mut entries = HashMap::new();
        let mut rest = text.trim_start_matches('\u{feff}');
        let mut number = 0;
        while !rest.is_empty() {
            let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
            rest = after;
            number += 1;
            let line = line.trim();
            if line.is_empty() || line.starts_with('~') {
                continue;
            }
            let Some((key, value)) = line.strip_prefix('<').and_then(|line| line.split_once('>')) else {
                let expected = format!("`<KEY> value` up to <{END}>");
                return Err(Error::input(
                    format!("{name}:{number}"),
                    format!("`{}`", shortened(line)),
                    expected,
                ));
            };
            let key = key.trim();
            if key == END {
                let first_line = number + 1;
                return Ok((
                    Self { name, entries },
                    Body {
                        text: rest,
                        first_line,
                    },
                ));
            }
            if entries.insert(key, (value.trim(), number)).is_some() {
                return Err(Error::input(
                    format!("{name}:{number}"),
                    format!("a second <{key}>"),
                    "each key once",
                ));
            }
        }
        Err(Error::input(
            name,
            "the end of the file",
            format!("<{END}> after the metadata"),
        ))
    }

    /// The text of a key that must be there, and its line.
    fn entry(&self, key: &str) -> Result<(&'a str, usize)> {
        let found = self.entries.get(key).copied();
        found.ok_or_else(|| Error::input(self.name, format!("no <{key}>"), "it among the metadata"))
    }

    /// The value of a key that must be there.
    fn number<T: FromStr>(&self, key: &str) -> Result<T> {
        let (value, line) = self.entry(key)?;
        let place = format!("{}:{line}", self.name);
        parse(&place, &format!("<{key}>"), value, "a number")
    }
}

impl<'a> Body<'a> {
    /// Lines with content, trimmed, each with its `FILE:LINE`.
    fn lines(&self, name: &str) -> impl Iterator<Item = (String, &'a str)> {
        let first = self.first_line;
        self.text
            .lines()
            .enumerate()
            .map(move |(index, line)| (index + first, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('~'))
            .map(move |(number, line)| (format!("{name}:{number}"), line))
    }
}

/// The start of a line, enough to find it.
fn shortened(line: &str) -> &str {
    let end = line.char_indices().nth(40).map_or(line.len(), |(index, _)| index);
    &line[..end]
}

/// Reads a TNTP node file: a heading, then a node's number and coordinates on each line, with a closing `;`.
///
/// # Errors
/// [`Error::Input`] naming the line for another number of columns, a node that does
/// not exist or comes twice, or a coordinate that is no finite number; or naming a node that the file leaves out.
pub fn read_places(Text { name, text }: &Text, network: &Network) -> Result<NodePlaces> {
    let mut collected = Collected::new(network, LengthUnit::Unknown);
    let lines = (1..).zip(text.lines().map(|line| line.trim().trim_end_matches(';').trim()));
    let content = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('~'));
    // The first line is the heading.
    for (number, line) in content.skip(1) {
        let place = format!("{name}:{number}");
        let columns: Vec<&str> = line.split_whitespace().collect();
        let &[node, x, y] = columns.as_slice() else {
            let found = format!("{} columns", columns.len());
            return Err(Error::input(place, found, "3: node X Y"));
        };
        collected.put(&place, node, (x, y))?;
    }
    collected.finish(name)
}
