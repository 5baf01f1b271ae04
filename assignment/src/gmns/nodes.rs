//! Nodes and zones: `node.csv`.

use crate::csv_table::{CsvTable, file_name};
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::{Access, Zone};
use kit::error::{Error, Result};
use std::collections::HashMap;

/// The node type that may not be passed.
pub(super) const CENTROID: &str = "centroid";

/// What stands for "no zone" besides an empty field.
const NO_ZONE: [&str; 2] = ["0", "-1"];

/// Nodes by name, and the zones that they make.
pub(super) struct Nodes {
    /// In file order; number 1 is the first.
    pub(super) names: Vec<String>,
    pub(super) numbers: HashMap<String, u32>,
    /// Zones of centroids first, then those of several nodes, then the rest.
    pub(super) zones: Vec<(String, Zone)>,
    /// Centroids among the nodes of a zone that has several: nothing passes them.
    pub(super) closed: Vec<u32>,
    /// Coordinates, where the file has them.
    pub(super) places: Vec<Option<(f64, f64)>>,
}

/// The nodes of a zone, on the way.
#[derive(Default)]
struct Members {
    centroids: Vec<u32>,
    others: Vec<u32>,
}

impl Nodes {
    pub(super) fn read(table: &CsvTable, report: &mut ImportReport) -> Result<Self> {
        let id = table.column("node_id")?;
        let zone = table.optional_column("zone_id");
        let node_type = table.optional_column("node_type");
        let [x, y] = ["x_coord", "y_coord"].map(|column| table.optional_column(column));
        let mut nodes = Self {
            names: Vec::new(),
            numbers: HashMap::new(),
            zones: Vec::new(),
            closed: Vec::new(),
            places: Vec::new(),
        };
        let mut order: Vec<&str> = Vec::new();
        let mut members: HashMap<&str, Members> = HashMap::new();
        let mut none = 0;
        for row in table.rows() {
            let (name, zone_name) = (row.id(Some(id)), row.id(zone));
            if name.is_empty() {
                return Err(row.refuse(id, "a name or number"));
            }
            let number = nodes.names.len() as u32 + 1;
            if nodes.numbers.insert(name.to_owned(), number).is_some() {
                return Err(row.refuse(id, "each node once"));
            }
            nodes.names.push(name.to_owned());
            let coordinate = |column| row.text(column).parse::<f64>().ok().filter(|x| x.is_finite());
            nodes.places.push(coordinate(x).zip(coordinate(y)));
            let is_centroid = row.text(node_type) == CENTROID;
            if zone_name.is_empty() {
                if is_centroid {
                    let found = format!("`{name}`, a {CENTROID} without a zone_id");
                    return Err(Error::input(row.place(), found, "a zone_id"));
                }
                continue;
            }
            if NO_ZONE.contains(&zone_name) {
                none += 1;
                continue;
            }
            let zone = members.entry(zone_name).or_insert_with(|| {
                order.push(zone_name);
                Members::default()
            });
            let block = if is_centroid {
                &mut zone.centroids
            } else {
                &mut zone.others
            };
            block.push(number);
        }
        if none > 0 {
            let place = format!("{}: zone_id", file_name(table.name()));
            report.count(NoteKind::Default, place, "0 and -1 mean no zone: nodes", none);
        }
        nodes.set_zones(table, &order, members, report);
        Ok(nodes)
    }
}

impl Nodes {
    /// A zone of one node is that node. One of several is a place of its own, joined to all of them.
    fn set_zones<'t>(
        &mut self,
        table: &CsvTable,
        order: &[&'t str],
        mut members: HashMap<&'t str, Members>,
        report: &mut ImportReport,
    ) {
        let (mut closed, mut apart, mut open) = (Vec::new(), Vec::new(), Vec::new());
        for name in order {
            let Some(Members { centroids, others }) = members.remove(name) else {
                continue;
            };
            let zone = (*name).to_owned();
            match (centroids.as_slice(), others.as_slice()) {
                (&[centroid], []) => closed.push((zone, Zone::Closed(centroid))),
                ([], &[node]) => open.push((zone, Zone::Open(node))),
                _ => {
                    self.closed.extend(&centroids);
                    let nodes = centroids.into_iter().chain(others);
                    let access: Vec<Access> = nodes.map(Access::Junction).collect();
                    let (from, to) = (access.clone(), access);
                    apart.push((zone, Zone::Apart { from, to }));
                }
            }
        }
        if !apart.is_empty() {
            let place = format!("{}: zone_id", file_name(table.name()));
            let text =
                "zones of several nodes, each joined to all of them by connectors without length and time";
            report.count(NoteKind::Default, place, text, apart.len());
        }
        self.zones = closed;
        self.zones.append(&mut apart);
        self.zones.append(&mut open);
    }
}
