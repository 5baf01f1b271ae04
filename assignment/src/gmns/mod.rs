//! Reader and writer for GMNS, the General Modeling Network Specification: a folder with `node.csv`, `link.csv` and more.
//!
//! Columns come in any order and in upper or lower case. Names such as `1.0`, which tables make of whole numbers, are `1`.
//!
//! | file | columns read |
//! |---|---|
//! | `node.csv` | `node_id`; `zone_id` (empty, 0 or -1: no zone; several nodes may have one), `node_type` (`centroid`: may not be passed), `x_coord`, `y_coord` |
//! | `link.csv` | `from_node_id`, `to_node_id`, `length`, `capacity` per hour and lane; `free_speed`; `link_id`, `directed`, `lanes`, `toll`, `allowed_uses`, `facility_type` or `link_type_name`, `geometry` or `geometry_id`; `VDF_fftt1`, `VDF_cap1` (all lanes), `VDF_alpha1`, `VDF_beta1`, or the same without the number of the period |
//! | `config.csv` | `long_length`, `speed`, `short_length` |
//! | `movement.csv` | `node_id`, `ib_link_id`, `ob_link_id`, `penalty` in seconds, `capacity` (0: banned), `allowed_uses` |
//! | `use_group.csv`, `geometry.csv` | what the others refer to |
//! | demand | `o_zone_id`, `d_zone_id`, `volume` |
//!
//! Free-flow time is `VDF_fftt1`, in minutes, or length over speed where that is missing. Units are the options', else those of
//! `config.csv`, else what longitudes and latitudes show. What is empty or missing is put in by the kind of road; the
//! report counts it.

mod defaults;
mod links;
mod movements;
mod nodes;
mod scale;
mod uses;
mod write;

pub use write::{Extras, format_demand, format_network};

use crate::coordinates::{Collected, LengthUnit, NodePlaces};
use crate::csv_table::CsvTable;
use crate::demand::Demand;
use crate::demand_table::Zones;
use crate::formats::ImportOptions;
use crate::link::CostWeights;
use crate::network::Network;
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::{RoadPlan, TurnRules, Turns};
use crate::shapes::Shape;
use crate::units::Length;
use crate::{text, turn_table};
use kit::error::Result;
use kit::files::Text;
use std::path::{Path, PathBuf};

/// The files of a folder that are read, and whether it may do without.
const FILES: [(&str, bool); 6] = [
    ("node.csv", false),
    ("link.csv", false),
    ("config.csv", true),
    ("movement.csv", true),
    ("use_group.csv", true),
    ("geometry.csv", true),
];

/// The name of the demand in a folder.
pub(crate) const DEMAND: &str = "demand.csv";

/// The texts of a folder.
#[derive(Debug, Clone)]
pub struct Folder {
    /// `node.csv`.
    pub nodes: Text,
    /// `link.csv`.
    pub links: Text,
    /// `config.csv`: units.
    pub config: Option<Text>,
    /// `movement.csv`: turns.
    pub movements: Option<Text>,
    /// `use_group.csv`: words of `allowed_uses`.
    pub use_groups: Option<Text>,
    /// `geometry.csv`: how links run.
    pub geometry: Option<Text>,
}

impl Folder {
    /// A folder of nodes and links alone.
    pub const fn new(nodes: Text, links: Text) -> Self {
        Self {
            nodes,
            links,
            config: None,
            movements: None,
            use_groups: None,
            geometry: None,
        }
    }

    /// Reads what there is.
    ///
    /// # Errors
    /// A file that cannot be read; nodes and links must be there.
    pub fn read(folder: &Path) -> Result<Self> {
        let optional = |index: usize| {
            let path = folder.join(FILES[index].0);
            path.exists().then(|| text::read(&path)).transpose()
        };
        Ok(Self {
            nodes: text::read(&folder.join(FILES[0].0))?,
            links: text::read(&folder.join(FILES[1].0))?,
            config: optional(2)?,
            movements: optional(3)?,
            use_groups: optional(4)?,
            geometry: optional(5)?,
        })
    }

    /// The files that [`read`](Self::read) reads.
    pub fn files(folder: &Path) -> Vec<PathBuf> {
        let files = FILES
            .into_iter()
            .map(|(name, optional)| (folder.join(name), optional));
        let there = files.filter(|(path, optional)| !optional || path.exists());
        there.map(|(path, _)| path).collect()
    }
}

/// A network with what its folder says besides.
#[derive(Debug)]
pub struct GmnsNetwork {
    /// The network; its roads are the links that cars may use, both directions of undirected ones.
    pub network: Network,
    /// By road, how it runs.
    pub shapes: Vec<Shape>,
    /// By road, its `link_id`.
    pub road_names: Vec<String>,
    /// The unit of lengths.
    pub length: Length,
}

/// Reads a folder's network.
///
/// # Errors
/// [`Error::Input`](kit::error::Error::Input) naming file, line and column for a column that is missing, a field that does not
/// fit, a node given twice, a centroid without a zone, a link or turn between unknown nodes, or a unit that the coordinates
/// contradict.
pub fn read(folder: &Folder, options: &ImportOptions, report: &mut ImportReport) -> Result<GmnsNetwork> {
    let table = CsvTable::parse(&folder.nodes)?;
    let nodes = nodes::Nodes::read(&table, report)?;
    let (links, length) = links::Links::read(folder, &nodes, options, report)?;
    table.report(report);
    let junctions = nodes.names.len() as u32;
    let mut turns = match rules(folder, &nodes, &links, options, report)? {
        Some(rules) => rules.turns(&links.roads, junctions),
        None => Turns::new(),
    };
    for &centroid in &nodes.closed {
        turns.insert(centroid, Vec::new());
    }
    let plan = RoadPlan {
        junctions: nodes.names,
        roads: links.roads,
        zones: nodes.zones,
        turns,
    };
    Ok(GmnsNetwork {
        network: plan.network(options.weights)?,
        shapes: links.shapes,
        road_names: links.ids,
        length,
    })
}

/// What `movement.csv` and the table of turns say.
fn rules(
    folder: &Folder,
    nodes: &nodes::Nodes,
    links: &links::Links,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Option<TurnRules>> {
    if options.without_turns {
        if folder.movements.is_some() {
            report.say(NoteKind::Unused, "movement.csv", "turns");
        }
        return Ok(None);
    }
    let mut rules = None;
    if let Some(text) = &folder.movements {
        let uses = uses::CarUses::new(folder.use_groups.as_ref())?;
        rules = Some(movements::read(text, nodes, links, &uses, report)?);
    }
    if let Some(path) = &options.turns {
        let table = turn_table::read(&text::read(path)?, &links.roads, &nodes.numbers, report)?;
        let TurnRules { penalties, .. } = rules.get_or_insert_default();
        penalties.extend(table.penalties);
    }
    Ok(rules)
}

/// Reads a `node.csv` and a `link.csv`.
///
/// # Errors
/// As [`read`].
pub fn read_network(nodes: &Text, links: &Text, weights: CostWeights) -> Result<Network> {
    let folder = Folder::new(nodes.clone(), links.clone());
    let options = ImportOptions {
        weights,
        ..ImportOptions::default()
    };
    read(&folder, &options, &mut ImportReport::default()).map(|read| read.network)
}

/// Reads a demand table for `network`, by the names of its zones.
///
/// # Errors
/// [`Error::Input`](kit::error::Error::Input) naming file, line and column for a column that is missing, an unknown zone, or a
/// volume that is negative or no number.
pub fn read_demand(text: &Text, network: &Network) -> Result<Demand> {
    let mut zones = Zones::of(network);
    let trips = crate::demand_table::read_csv(text, &mut zones, &mut ImportReport::default())?;
    zones.refuse_unknown()?;
    Demand::new(network.numbering().zones, &trips)
}

/// Reads the coordinates in a `node.csv`.
///
/// # Errors
/// [`Error::Input`](kit::error::Error::Input) for missing columns `x_coord` and `y_coord`, and otherwise as
/// [`crate::tntp::read_places`].
pub fn read_places(text: &Text, network: &Network) -> Result<NodePlaces> {
    let table = CsvTable::parse(text)?;
    let [id, x, y] = [
        table.column("node_id")?,
        table.column("x_coord")?,
        table.column("y_coord")?,
    ];
    let mut collected = Collected::new(network, LengthUnit::Unknown);
    for row in table.rows() {
        let coordinates = (row.text(Some(x)), row.text(Some(y)));
        collected.put(&row.place(), row.id(Some(id)), coordinates)?;
    }
    collected.finish(&text.name)
}
