//! Links: `link.csv`.

use super::Folder;
use super::defaults::Kind;
use super::nodes::Nodes;
use super::scale::{Scale, Span};
use super::uses::{CarUses, is_no_road};
use crate::csv_table::{CsvTable, Row, file_name};
use crate::formats::ImportOptions;
use crate::link::{DelayFunction, Link};
use crate::report::{ImportReport, NoteKind};
use crate::shapes::{Shape, parse_wkt};
use crate::units::Length;
use crate::volume_delay::{BPR_B, BPR_POWER};
use kit::error::{Error, Result};
use std::collections::HashMap;

/// Median speeds outside of these are no cars' (chosen).
const USUAL_KM_PER_H: std::ops::RangeInclusive<f64> = 5.0..=200.0;

/// Median capacities an hour and lane outside of these are no lanes' (chosen).
const USUAL_LANE_CAPACITY: std::ops::RangeInclusive<f64> = 50.0..=10_000.0;

/// The links of a folder, both directions of undirected ones.
#[derive(Default)]
pub(super) struct Links {
    pub(super) roads: Vec<Link>,
    /// By road, its row's `link_id`.
    pub(super) ids: Vec<String>,
    pub(super) shapes: Vec<Shape>,
    lanes: Vec<f64>,
}

/// Where a link's attributes stand.
struct Columns {
    id: Option<usize>,
    from: usize,
    to: usize,
    length: usize,
    capacity: Option<usize>,
    /// Minutes.
    free_flow_time: Option<usize>,
    /// Vehicles an hour of all lanes.
    total_capacity: Option<usize>,
    b: Option<usize>,
    power: Option<usize>,
    speed: Option<usize>,
    directed: Option<usize>,
    lanes: Option<usize>,
    toll: Option<usize>,
    kind: Option<usize>,
    uses: Option<usize>,
    geometry: Option<usize>,
    geometry_id: Option<usize>,
}

impl Columns {
    fn find(table: &CsvTable, options: &ImportOptions) -> Result<Self> {
        let period = options.period.unwrap_or(1);
        let vdf = |key: &str| {
            let of_period = table.optional_column(&format!("vdf_{key}{period}"));
            of_period.or_else(|| table.optional_column(&format!("vdf_{key}")))
        };
        let free_flow_time = vdf("fftt");
        let total_capacity = vdf("cap");
        if let Some(period) = options.period
            && table.optional_column(&format!("vdf_alpha{period}")).is_none()
            && table.optional_column(&format!("vdf_cap{period}")).is_none()
        {
            let expected = "a period with columns vdf_cap and vdf_alpha of its number";
            return Err(Error::input("period", period, expected));
        }
        Ok(Self {
            id: table.optional_column("link_id"),
            from: table.column("from_node_id")?,
            to: table.column("to_node_id")?,
            length: table.column("length")?,
            capacity: match total_capacity {
                Some(_) => table.optional_column("capacity"),
                None => Some(table.column("capacity")?),
            },
            speed: match free_flow_time {
                Some(_) => table.optional_column("free_speed"),
                None => Some(table.column("free_speed")?),
            },
            free_flow_time,
            total_capacity,
            b: vdf("alpha"),
            power: vdf("beta"),
            directed: table.optional_column("directed"),
            lanes: table.optional_column("lanes"),
            toll: table.optional_column("toll"),
            kind: table.any_column(&["facility_type", "link_type_name"]),
            uses: table.optional_column("allowed_uses"),
            geometry: table.optional_column("geometry"),
            geometry_id: table.optional_column("geometry_id"),
        })
    }
}

/// How often what was put in for a kind of road.
#[derive(Default)]
struct Defaults {
    used: HashMap<(&'static str, String), usize>,
}

impl Defaults {
    fn count(&mut self, column: &'static str, value: String) {
        *self.used.entry((column, value)).or_default() += 1;
    }
}

impl Links {
    pub(super) fn read(
        folder: &Folder,
        nodes: &Nodes,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<(Self, Length)> {
        let table = CsvTable::parse(&folder.links)?;
        let columns = Columns::find(&table, options)?;
        let uses = CarUses::new(folder.use_groups.as_ref())?;
        let geometries = geometries(folder)?;
        let scale = scale(folder, &table, &columns, nodes, options, report)?;
        let file = file_name(&folder.links.name).into_owned();
        let mut links = Self::default();
        let mut defaults = Defaults::default();
        let mut shapeless = 0;
        for row in table.rows() {
            let (allowed, kind) = (row.text(columns.uses), row.text(columns.kind));
            let by_kind = allowed.is_empty() && is_no_road(kind);
            if by_kind || !uses.allow(allowed) {
                let (column, what) = if by_kind {
                    ("type", kind)
                } else {
                    ("allowed_uses", allowed)
                };
                let text = format!("links for {} alone", what.to_ascii_lowercase());
                report.count(NoteKind::Unused, format!("{file}: {column}"), text, 1);
                continue;
            }
            let (link, lanes) = link(row, &columns, nodes, scale, options, &mut defaults)?;
            link.volume_delay(DelayFunction::Bpr, options.weights, &row.place())?;
            let wkt = match row.text(columns.geometry) {
                "" => geometries
                    .get(row.id(columns.geometry_id))
                    .map_or("", String::as_str),
                wkt => wkt,
            };
            let shape = parse_wkt(wkt).unwrap_or_default();
            shapeless += usize::from(!wkt.is_empty() && shape.is_empty());
            let id = row.id(columns.id).to_owned();
            if !is_directed(row, columns.directed)? {
                let back = Link {
                    init_node: link.term_node,
                    term_node: link.init_node,
                    ..link.clone()
                };
                links.push(link, &id, shape.clone(), lanes);
                links.push(back, &id, shape.into_iter().rev().collect(), lanes);
            } else {
                links.push(link, &id, shape, lanes);
            }
        }
        table.report(report);
        for ((column, value), times) in defaults.used {
            report.count(NoteKind::Default, format!("{file}: {column}"), value, times);
        }
        if shapeless > 0 {
            let text = "no lines in well-known text: drawn straight";
            report.count(NoteKind::Unused, format!("{file}: geometry"), text, shapeless);
        }
        links.judge(scale, &file, report);
        Ok((links, scale.length))
    }

    fn push(&mut self, road: Link, id: &str, shape: Shape, lanes: f64) {
        self.roads.push(road);
        self.ids.push(id.to_owned());
        self.shapes.push(shape);
        self.lanes.push(lanes);
    }

    /// Says what speeds and capacities the links imply, and warns where no road is like that.
    fn judge(&self, scale: Scale, file: &str, report: &mut ImportReport) {
        let moving = self
            .roads
            .iter()
            .filter(|road| road.length > 0.0 && road.free_flow_time > 0.0);
        let speeds = moving.map(|road| scale.km_per_h(road.length, road.free_flow_time));
        // Connectors may have any capacity: nothing fills them.
        let filling = self.roads.iter().zip(&self.lanes);
        let filling = filling.filter(|(road, _)| road.b > 0.0 && road.free_flow_time > 0.0);
        let capacities = filling.map(|(road, lanes)| road.capacity / lanes);
        report.range(
            format!("{file}: free-flow speed in km/h"),
            speeds.collect(),
            Some(USUAL_KM_PER_H),
        );
        report.range(
            format!("{file}: capacity an hour and lane"),
            capacities.collect(),
            Some(USUAL_LANE_CAPACITY),
        );
    }
}

/// The units, from all lengths and the places of their ends.
fn scale(
    folder: &Folder,
    table: &CsvTable,
    columns: &Columns,
    nodes: &Nodes,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scale> {
    let spans = table.rows().filter_map(|row| {
        let place = |column| {
            let number = nodes.numbers.get(row.id(Some(column)))?;
            nodes.places[*number as usize - 1]
        };
        let number = |column| row.text(column).parse::<f64>().ok();
        let length = number(Some(columns.length))?;
        let driven = number(columns.free_flow_time).zip(number(columns.speed));
        let driven = driven.map(|(minutes, speed)| minutes * speed / length);
        Some(Span {
            length,
            driven: driven.filter(|driven| driven.is_finite() && *driven > 0.0),
            ends: place(columns.from)
                .zip(place(columns.to))
                .map(|(from, to)| [from, to]),
        })
    });
    Scale::find(folder, options, &spans.collect::<Vec<_>>(), report)
}

/// A row's link, and its lanes.
fn link(
    row: Row<'_>,
    columns: &Columns,
    nodes: &Nodes,
    scale: Scale,
    options: &ImportOptions,
    defaults: &mut Defaults,
) -> Result<(Link, f64)> {
    let node = |column: usize| {
        let number = nodes.numbers.get(row.id(Some(column))).copied();
        number.ok_or_else(|| row.refuse(column, "a node of node.csv"))
    };
    let kind_name = row.text(columns.kind);
    let kind = Kind::of(kind_name);
    let described = |value: String| match kind_name {
        "" => value,
        name => format!("{value} for {}", name.to_ascii_lowercase()),
    };
    let free_flow_time = row.optional_amount(columns.free_flow_time)?;
    let length = match row.optional_amount(Some(columns.length))? {
        Some(length) => length,
        None if free_flow_time.is_some() => {
            defaults.count("length", "0 where only the time is given".to_owned());
            0.0
        }
        None => return Err(row.refuse(columns.length, "a finite number, not negative")),
    };
    let free_flow_time = match free_flow_time {
        Some(minutes) => minutes,
        None => {
            let speed = match row.optional_amount(columns.speed)? {
                Some(speed) => speed,
                None => {
                    let text = format!("{} km/h", kind.speed_km_per_h);
                    defaults.count("free_speed", described(text));
                    kind.speed(scale.speed)
                }
            };
            match columns.speed {
                Some(column) if speed == 0.0 => return Err(row.refuse(column, "a positive number")),
                _ => scale.minutes(length, speed),
            }
        }
    };
    let lanes = match row.optional_amount(columns.lanes)? {
        Some(lanes) if lanes > 0.0 => lanes,
        _ => {
            defaults.count("lanes", "1".to_owned());
            1.0
        }
    };
    let capacity = match (
        row.optional_amount(columns.total_capacity)?,
        row.optional_amount(columns.capacity)?,
    ) {
        (Some(total), _) => total,
        (None, Some(of_lane)) => of_lane * lanes,
        (None, None) => {
            let of_lane = options.lane_capacity(kind_name).unwrap_or(kind.lane_capacity);
            defaults.count("capacity", described(format!("{of_lane} an hour and lane")));
            of_lane * lanes
        }
    };
    let mut or_default = |column: Option<usize>, name: &'static str, value: f64| {
        let given = row.optional_amount(column)?;
        if given.is_none() {
            defaults.count(name, value.to_string());
        }
        Ok::<f64, Error>(given.unwrap_or(value))
    };
    let link = Link {
        init_node: node(columns.from)?,
        term_node: node(columns.to)?,
        capacity,
        length,
        free_flow_time,
        b: or_default(columns.b, "vdf_alpha", BPR_B)?,
        power: or_default(columns.power, "vdf_beta", BPR_POWER)?,
        toll: row.optional_amount(columns.toll)?.unwrap_or(0.0),
    };
    Ok((link, lanes))
}

fn is_directed(row: Row<'_>, column: Option<usize>) -> Result<bool> {
    let Some(column) = column else {
        return Ok(true);
    };
    match row.id(Some(column)).to_ascii_lowercase().as_str() {
        "" | "1" | "true" => Ok(true),
        "0" | "false" => Ok(false),
        _ => Err(row.refuse(column, "true or false")),
    }
}

/// `geometry.csv`: lines by `geometry_id`.
fn geometries(folder: &Folder) -> Result<HashMap<String, String>> {
    let Some(text) = &folder.geometry else {
        return Ok(HashMap::new());
    };
    let table = CsvTable::parse(text)?;
    let (id, geometry) = (table.column("geometry_id")?, table.column("geometry")?);
    let rows = table.rows();
    Ok(rows
        .map(|row| (row.id(Some(id)).to_owned(), row.text(Some(geometry)).to_owned()))
        .collect())
}
