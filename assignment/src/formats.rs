//! A network, its demand and its coordinates, in any of the formats.

use crate::coordinates::NodePlaces;
use crate::imported_demand::{ImportedDemand, Unreachable};
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::{RoadPlan, Zone};
use crate::shapes::Shape;
use crate::units::{Length, Speed};
use crate::{CostWeights, Demand, Network, gmns, sumo, text, tntp, turn_table};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// How a TNTP network's file name ends, and how that of its nodes does.
const TNTP_ENDINGS: (&str, &str) = ("_net.tntp", "_node.tntp");

/// The format of a network: a folder is GMNS, a name that ends in `.xml` or `.xml.gz` SUMO, any other file TNTP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A folder with `node.csv` and `link.csv` of the General Modeling Network Specification.
    Gmns,
    /// A SUMO `net.xml`.
    Sumo,
    /// A network file of "Transportation Networks for Research".
    Tntp,
}

impl Format {
    /// The format of what stands at `path`.
    ///
    /// # Errors
    /// [`Error::File`] if nothing does.
    pub fn of(path: &Path) -> Result<Self> {
        let found = std::fs::metadata(path).map_err(|source| Error::file(path, source))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        Ok(if found.is_dir() {
            Self::Gmns
        } else if name.ends_with(".xml") || name.ends_with(".xml.gz") {
            Self::Sumo
        } else {
            Self::Tntp
        })
    }

    /// Seconds for each unit of its travel times; for TNTP, which does not say, a minute.
    pub fn seconds_per_unit(self) -> f64 {
        match self {
            Self::Sumo => 1.0,
            Self::Gmns | Self::Tntp => 60.0,
        }
    }
}

/// What a network's files do not say, or say wrongly.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImportOptions {
    /// What toll and distance cost.
    pub weights: CostWeights,
    /// Unit of lengths, for GMNS.
    pub length_unit: Option<Length>,
    /// Unit of speeds, for GMNS.
    pub speed_unit: Option<Speed>,
    /// Capacities an hour and lane by type of road, which may be its beginning; the last that fits counts. For GMNS where
    /// the files have none.
    pub lane_capacities: Vec<(String, f64)>,
    /// Number of the period whose columns are read, for GMNS; 1 unless said.
    pub period: Option<u32>,
    /// Table of turns, for TNTP and GMNS.
    pub turns: Option<PathBuf>,
    /// File of traffic assignment zones, for SUMO.
    pub taz: Option<PathBuf>,
    /// Name of the matrix of an OMX file; without, it must have one alone.
    pub matrix: Option<String>,
    /// Whether all turns are free whatever the files say; in SUMO's networks every junction is a zone then.
    pub without_turns: bool,
}

impl ImportOptions {
    /// The capacity an hour and lane of a type of road, if an option says one.
    pub(crate) fn lane_capacity(&self, kind: &str) -> Option<f64> {
        let fitting = self
            .lane_capacities
            .iter()
            .filter(|(known, _)| kind.starts_with(known));
        fitting.map(|(_, capacity)| *capacity).next_back()
    }

    /// Refuses options that a format has no use for.
    fn check(&self, format: Format) -> Result<()> {
        let gmns = format == Format::Gmns;
        let useless = [
            (
                "length unit",
                self.length_unit.is_some() && !gmns,
                "none: only GMNS leaves it open",
            ),
            (
                "speed unit",
                self.speed_unit.is_some() && !gmns,
                "none: only GMNS leaves it open",
            ),
            (
                "period",
                self.period.is_some() && !gmns,
                "none: only GMNS has several",
            ),
            (
                "turns",
                self.turns.is_some() && format == Format::Sumo,
                "none: SUMO's networks say which turns there are",
            ),
            (
                "taz",
                self.taz.is_some() && format != Format::Sumo,
                "none: only SUMO has such zones",
            ),
            (
                "lane capacity",
                !self.lane_capacities.is_empty() && format == Format::Tntp,
                "none: TNTP networks state capacities",
            ),
        ];
        match useless.into_iter().find(|(_, useless, _)| *useless) {
            Some((name, _, expected)) => Err(Error::input(name, "one", expected)),
            None => Ok(()),
        }
    }
}

/// What files say of roads that has no part in the assignment.
#[derive(Debug, Clone, PartialEq)]
pub struct RoadData {
    /// By road, how it runs; empty where the format does not say.
    pub shapes: Vec<Shape>,
    /// By road, what its file calls it; empty where the format has no names.
    pub names: Vec<String>,
    /// The unit of lengths, where it is known.
    pub length: Option<Length>,
    /// Seconds of a unit of travel time.
    pub seconds: f64,
}

/// A network as files gave it.
#[derive(Debug)]
pub struct ImportedNetwork {
    /// The roads, with what was added for zones and turns.
    pub network: Network,
    /// What else is known of the roads.
    pub roads: RoadData,
    /// What was assumed.
    pub report: ImportReport,
}

/// A network and its demand as files gave them.
#[derive(Debug)]
pub struct Import {
    /// The roads, with what was added for zones and turns.
    pub network: Network,
    /// Who drives on them.
    pub trips: ImportedDemand,
    /// What else is known of the roads.
    pub roads: RoadData,
    /// What was assumed.
    pub report: ImportReport,
}

impl RoadData {
    /// Nothing but the unit of time that goes with a format.
    fn unknown(format: Format) -> Self {
        Self {
            shapes: Vec::new(),
            names: Vec::new(),
            length: None,
            seconds: format.seconds_per_unit(),
        }
    }
}

impl Import {
    /// A network and a demand that no file gave, all of whose trips have a path; times are in seconds.
    pub fn built(network: Network, demand: Demand) -> Self {
        Self {
            network,
            trips: ImportedDemand::built(demand),
            roads: RoadData::unknown(Format::Sumo),
            report: ImportReport::default(),
        }
    }

    /// The trips that can be made.
    ///
    /// # Errors
    /// As [`ImportedDemand::settle`].
    pub fn settle(&mut self, unreachable: Unreachable) -> Result<()> {
        self.trips.settle("trips", unreachable, &mut self.report)
    }
}

/// Reads a network and its trips.
///
/// # Errors
/// What is wrong with a file, no trips, or an option that the format has no use for. Trips without a path are none yet.
pub fn import(path: &Path, trips: Option<&Path>, options: &ImportOptions) -> Result<Import> {
    let beside = path.join(gmns::DEMAND);
    let (beside, expected) = match Format::of(path)? {
        Format::Sumo => {
            let trips = given(trips, "SUMO trips or routes for the network file")?;
            return import_sumo(path, trips, options);
        }
        Format::Gmns => (
            beside.exists().then_some(beside.as_path()),
            "a table o_zone_id,d_zone_id,volume, or demand.csv in the folder of the network",
        ),
        Format::Tntp => (None, "a TNTP trip table for the network file"),
    };
    let trips = given(trips.or(beside), expected)?;
    let ImportedNetwork {
        network,
        roads,
        mut report,
    } = import_network(path, options)?;
    let matrix = options.matrix.as_deref();
    Ok(Import {
        trips: ImportedDemand::read(trips, &network, &[], matrix, &mut report)?,
        network,
        roads,
        report,
    })
}

/// Reads a network for demands that are read [beside it](ImportedDemand::read).
///
/// # Errors
/// What is wrong with a file, an option that the format has no use for, and a SUMO network, whose zones are what its trips name.
pub fn import_network(path: &Path, options: &ImportOptions) -> Result<ImportedNetwork> {
    let format = Format::of(path)?;
    options.check(format)?;
    let mut report = ImportReport::default();
    match format {
        Format::Sumo => Err(Error::input(
            path.display(),
            "a SUMO network",
            "a TNTP or GMNS network: SUMO's zones are what its trips name",
        )),
        Format::Gmns => {
            let folder = gmns::Folder::read(path)?;
            let read = gmns::read(&folder, options, &mut report)?;
            let roads = RoadData {
                shapes: read.shapes,
                names: read.road_names,
                length: Some(read.length),
                seconds: format.seconds_per_unit(),
            };
            Ok(ImportedNetwork {
                network: read.network,
                roads,
                report,
            })
        }
        Format::Tntp => {
            let mut network = tntp::read_network(&text::read(path)?, options.weights)?;
            tntp_report(&network, &mut report);
            if let Some(turns) = options.turns.as_deref().filter(|_| !options.without_turns) {
                network = with_turns(&network, &text::read(turns)?, options.weights, &mut report)?;
            }
            Ok(ImportedNetwork {
                network,
                roads: RoadData::unknown(format),
                report,
            })
        }
    }
}

fn given<'p>(trips: Option<&'p Path>, expected: &str) -> Result<&'p Path> {
    trips.ok_or_else(|| Error::input("trips", "none", expected))
}

fn import_sumo(path: &Path, trips: &Path, options: &ImportOptions) -> Result<Import> {
    options.check(Format::Sumo)?;
    let mut report = ImportReport::default();
    let net = text::read(path)?;
    let taz = options.taz.as_deref().map(text::read).transpose()?;
    let (network, demand, roads) = if options.without_turns {
        let read = sumo::read_junctions(&net, &sumo::LaneModel::default(), options, &mut report)?;
        let demand = read.trips_between_junctions(&text::read(trips)?, &mut report)?;
        (read.network, demand, RoadData::unknown(Format::Sumo))
    } else {
        let read = sumo::read(&net, trips, taz.as_ref(), options, &mut report)?;
        let demand = Demand::new(read.network.numbering().zones, &read.trips)?;
        let roads = RoadData {
            shapes: read.shapes,
            names: read.road_names,
            length: Some(Length::Metre),
            seconds: Format::Sumo.seconds_per_unit(),
        };
        (read.network, demand, roads)
    };
    Ok(Import {
        trips: ImportedDemand::new(&network, demand, Vec::new(), &[]),
        network,
        roads,
        report,
    })
}

fn tntp_report(network: &Network, report: &mut ImportReport) {
    const FILE: &str = "network";
    report.count(NoteKind::Read, FILE, "links", network.links().len());
    report.say(NoteKind::Unused, FILE, "columns speed, link_type");
    report.say(
        NoteKind::Unit,
        FILE,
        "as the file has them: costs in those of free_flow_time, demand in those of capacity",
    );
    let moving = network.links().iter().filter(|link| link.free_flow_time > 0.0);
    let speeds = moving.map(|link| link.length / link.free_flow_time);
    report.range(
        format!("{FILE}: length over free_flow_time"),
        speeds.collect(),
        None,
    );
    let capacities = network.links().iter().map(|link| link.capacity);
    report.range(format!("{FILE}: capacity"), capacities.collect(), None);
}

/// A network of numbered nodes with turns that are banned or cost time.
fn with_turns(
    network: &Network,
    turns: &Text,
    weights: CostWeights,
    report: &mut ImportReport,
) -> Result<Network> {
    let numbering = network.numbering();
    let junctions: Vec<String> = (1..=numbering.nodes)
        .map(|number| network.node_name(number).into_owned())
        .collect();
    let numbers: HashMap<String, u32> = junctions.iter().cloned().zip(1..).collect();
    let rules = turn_table::read(turns, network.links(), &numbers, report)?;
    let zones = (1..=numbering.zones).map(|number| {
        let zone = if number < numbering.first_thru_node {
            Zone::Closed(number)
        } else {
            Zone::Open(number)
        };
        (number.to_string(), zone)
    });
    RoadPlan {
        turns: rules.turns(network.links(), numbering.nodes),
        zones: zones.collect(),
        roads: network.links().to_vec(),
        junctions,
    }
    .network(weights)
}

/// Reads where a network's nodes lie: from the network itself, for TNTP from `nodes` or the file of nodes beside it.
///
/// # Errors
/// What is wrong with the file, or that there is none.
pub fn read_places(path: &Path, nodes: Option<&Path>, network: &Network) -> Result<NodePlaces> {
    match (Format::of(path)?, nodes) {
        (Format::Gmns, None) => {
            let folder = gmns::Folder::read(path)?;
            gmns::read_places(&folder.nodes, network)
        }
        (Format::Sumo, None) => sumo::read_places(&text::read(path)?, network),
        (Format::Tntp, Some(nodes)) => tntp::read_places(&text::read(nodes)?, network),
        (Format::Tntp, None) => {
            let beside = nodes_beside(path).ok_or_else(|| {
                let expected = "a TNTP node file with the coordinates of every node";
                Error::input("nodes", "none", expected)
            })?;
            tntp::read_places(&text::read(&beside)?, network)
        }
        (_, Some(nodes)) => {
            let expected = "none: this network has its coordinates in itself";
            Err(Error::input("nodes", nodes.display(), expected))
        }
    }
}

/// The files that a network consists of: those of a GMNS folder, any other file itself, with the nodes beside a TNTP network.
///
/// # Errors
/// [`Error::File`] if nothing stands at `path`.
pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
    Ok(match Format::of(path)? {
        Format::Gmns => gmns::Folder::files(path),
        Format::Sumo => vec![path.to_owned()],
        Format::Tntp => [path.to_owned()].into_iter().chain(nodes_beside(path)).collect(),
    })
}

/// `Name_node.tntp` beside `Name_net.tntp`, if it exists.
fn nodes_beside(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?.strip_suffix(TNTP_ENDINGS.0)?;
    let beside = path.with_file_name(format!("{name}{}", TNTP_ENDINGS.1));
    beside.exists().then_some(beside)
}
