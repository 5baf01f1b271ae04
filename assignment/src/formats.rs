//! A network, its demand and its coordinates, in any of the formats.

use crate::coordinates::NodePlaces;
use crate::demand::Trip;
use crate::demand_table::{UnknownZone, Zones, read_csv};
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::{RoadPlan, Zone};
use crate::shapes::Shape;
use crate::units::{Length, Speed};
use crate::{CostWeights, Demand, Network, gmns, reach, sumo, text, tntp, turn_table};
use kit::choice::Choice;
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// How a TNTP network's file name ends, and how that of its nodes does.
const TNTP_ENDINGS: (&str, &str) = ("_net.tntp", "_node.tntp");

/// So many pairs an error names (chosen: one line of a screen or two).
const NAMED_PAIRS: usize = 12;

/// Why trips cannot be made.
const NO_ZONE: &str = "no zone";

/// See [`NO_ZONE`].
const NO_PATH: &str = "no path";

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

/// What happens to trips that no path serves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unreachable {
    /// They are an error.
    #[default]
    Fail,
    /// They are left out, and counted.
    Drop,
}

impl Choice for Unreachable {
    const ALL: &'static [Self] = &[Self::Fail, Self::Drop];

    fn name(self) -> &'static str {
        match self {
            Self::Fail => "fail",
            Self::Drop => "drop",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Fail => "Trips without a path are an error that names them",
            Self::Drop => "Trips without a path are left out and counted",
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

/// Trips that cannot be made.
#[derive(Debug, Clone, PartialEq)]
pub struct LostTrips {
    /// Names of the zones, or where a zone stands that the network does not have.
    pub origin: String,
    /// See [`origin`](Self::origin).
    pub destination: String,
    /// Vehicles per unit of time.
    pub volume: f64,
    /// Why not.
    pub why: &'static str,
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

/// A network and its demand as files gave them.
#[derive(Debug)]
pub struct Import {
    /// The roads, with what was added for zones and turns.
    pub network: Network,
    /// Who drives on them, trips without a path included.
    pub demand: Demand,
    /// What else is known of the roads.
    pub roads: RoadData,
    /// Trips without a path or without a zone.
    pub lost: Vec<LostTrips>,
    /// What was assumed.
    pub report: ImportReport,
    unreachable: Vec<Trip>,
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
            demand,
            roads: RoadData::unknown(Format::Sumo),
            lost: Vec::new(),
            report: ImportReport::default(),
            unreachable: Vec::new(),
        }
    }

    /// Refuses trips that cannot be made, or leaves them out.
    ///
    /// # Errors
    /// [`Error::Input`] that names them.
    pub fn settle(&mut self, unreachable: Unreachable) -> Result<()> {
        if self.lost.is_empty() {
            return Ok(());
        }
        let volume: f64 = self.lost.iter().map(|lost| lost.volume).sum();
        if unreachable == Unreachable::Fail {
            return Err(self.refusal(volume));
        }
        let pairs: HashSet<(u32, u32)> = self
            .unreachable
            .drain(..)
            .map(|trip| (trip.origin, trip.destination))
            .collect();
        self.demand = self.demand.without(&pairs)?;
        let text = format!("pairs with {volume} vehicles are left out: they have no path or no zone");
        self.report
            .count(NoteKind::Warning, "trips", text, self.lost.len());
        Ok(())
    }

    fn refusal(&self, volume: f64) -> Error {
        if let Some(lost) = self.lost.iter().find(|lost| lost.why == NO_ZONE) {
            let expected = "a zone of the network; --unreachable drop leaves such rows out";
            return Error::input(&lost.origin, format!("`{}`", lost.destination), expected);
        }
        let named = self.lost.iter().take(NAMED_PAIRS);
        let named: Vec<String> = named
            .map(|lost| format!("{} to {}", lost.origin, lost.destination))
            .collect();
        let others = match self.lost.len().saturating_sub(NAMED_PAIRS) {
            0 => String::new(),
            others => format!(" and {others} more"),
        };
        let found = format!(
            "{volume} vehicles without a path, by pairs {}: {}{others}",
            self.lost.len(),
            named.join(", ")
        );
        let expected =
            "a path for every trip; --unreachable drop leaves them out, --unreachable-pairs lists all";
        Error::input("trips", found, expected)
    }
}

/// First line of a file of trips that cannot be made.
pub const LOST_HEADER: &str = "origin,destination,volume,reason";

/// Trips that cannot be made, as CSV.
pub fn format_lost(lost: &[LostTrips]) -> String {
    let mut text = format!("{LOST_HEADER}\n");
    for LostTrips {
        origin,
        destination,
        volume,
        why,
    } in lost
    {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{origin},{destination},{volume},{why}");
    }
    text
}

/// Reads a network and its trips.
///
/// # Errors
/// What is wrong with a file, no trips, or an option that the format has no use for. Trips without a path are none yet.
pub fn import(path: &Path, trips: Option<&Path>, options: &ImportOptions) -> Result<Import> {
    let format = Format::of(path)?;
    options.check(format)?;
    let mut report = ImportReport::default();
    match format {
        Format::Gmns => {
            let folder = gmns::Folder::read(path)?;
            let beside = path.join(gmns::DEMAND);
            let trips = trips.or_else(|| beside.exists().then_some(beside.as_path()));
            let trips = given(
                trips,
                "a table o_zone_id,d_zone_id,volume, or demand.csv in the folder of the network",
            )?;
            let read = gmns::read(&folder, options, &mut report)?;
            let demand = Tabled::read(trips, &read.network, options, &mut report)?;
            let roads = RoadData {
                shapes: read.shapes,
                names: read.road_names,
                length: Some(read.length),
                seconds: format.seconds_per_unit(),
            };
            Ok(finish(read.network, demand, roads, report))
        }
        Format::Sumo => {
            let trips = given(trips, "SUMO trips or routes for the network file")?;
            import_sumo(path, trips, options, report)
        }
        Format::Tntp => {
            let trips = given(trips, "a TNTP trip table for the network file")?;
            let mut network = tntp::read_network(&text::read(path)?, options.weights)?;
            tntp_report(&network, &mut report);
            if let Some(turns) = options.turns.as_deref().filter(|_| !options.without_turns) {
                network = with_turns(&network, &text::read(turns)?, options.weights, &mut report)?;
            }
            let demand = Tabled::read(trips, &network, options, &mut report)?;
            Ok(finish(network, demand, RoadData::unknown(format), report))
        }
    }
}

fn given<'p>(trips: Option<&'p Path>, expected: &str) -> Result<&'p Path> {
    trips.ok_or_else(|| Error::input("trips", "none", expected))
}

fn import_sumo(
    path: &Path,
    trips: &Path,
    options: &ImportOptions,
    mut report: ImportReport,
) -> Result<Import> {
    let net = text::read(path)?;
    let taz = options.taz.as_deref().map(text::read).transpose()?;
    if options.without_turns {
        let read = sumo::read_junctions(&net, &sumo::LaneModel::default(), options, &mut report)?;
        let demand = read.trips_between_junctions(&text::read(trips)?, &mut report)?;
        let demand = Tabled {
            demand,
            unknown: Vec::new(),
        };
        let roads = RoadData::unknown(Format::Sumo);
        return Ok(finish(read.network, demand, roads, report));
    }
    let read = sumo::read(&net, trips, taz.as_ref(), options, &mut report)?;
    let demand = Tabled {
        demand: Demand::new(read.network.numbering().zones, &read.trips)?,
        unknown: Vec::new(),
    };
    let roads = RoadData {
        shapes: read.shapes,
        names: read.road_names,
        length: Some(Length::Metre),
        seconds: Format::Sumo.seconds_per_unit(),
    };
    Ok(finish(read.network, demand, roads, report))
}

/// A demand by names of zones.
struct Tabled {
    demand: Demand,
    unknown: Vec<UnknownZone>,
}

impl Tabled {
    /// Reads a demand in any format of tables: the content decides.
    fn read(
        path: &Path,
        network: &Network,
        options: &ImportOptions,
        report: &mut ImportReport,
    ) -> Result<Self> {
        let count = network.numbering().zones;
        let mut zones = Zones::of(network);
        if let Some(trips) = read_matrix(path, options, &mut zones, report)? {
            return Ok(Self {
                demand: Demand::new(count, &trips)?,
                unknown: zones.unknown().to_vec(),
            });
        }
        let text = text::read(path)?;
        if !tntp::is_tntp(&text.text) {
            let trips = read_csv(&text, &mut zones, report)?;
            return Ok(Self {
                demand: Demand::new(count, &trips)?,
                unknown: zones.unknown().to_vec(),
            });
        }
        let numbers_are_names = (1..=count).all(|zone| network.zone_name(zone) == zone.to_string());
        if numbers_are_names {
            return Ok(Self {
                demand: tntp::read_trips(&text, count)?,
                unknown: Vec::new(),
            });
        }
        let trips = tntp::read_trips_by_name(&text, &mut zones)?;
        Ok(Self {
            demand: Demand::new(count, &trips)?,
            unknown: zones.unknown().to_vec(),
        })
    }
}

/// The trips of an OMX file; none if it is another one.
///
/// # Errors
/// What is wrong with it, and a name of a matrix beside a file that has none.
pub(crate) fn read_matrix(
    path: &Path,
    options: &ImportOptions,
    zones: &mut Zones<'_>,
    report: &mut ImportReport,
) -> Result<Option<Vec<Trip>>> {
    #[cfg(feature = "omx")]
    if crate::omx::is_omx(path)? {
        let trips = crate::omx::read(path, options.matrix.as_deref(), zones, report)?;
        return Ok(Some(trips));
    }
    let _unused = (path, zones, report);
    match &options.matrix {
        Some(name) => Err(Error::input(
            "matrix",
            format!("`{name}`"),
            "none beside trips that are no OMX file",
        )),
        None => Ok(None),
    }
}

/// Finds the trips that cannot be made.
fn finish(
    network: Network,
    Tabled { demand, unknown }: Tabled,
    roads: RoadData,
    report: ImportReport,
) -> Import {
    let unreachable = reach::unreachable(&network, &demand);
    let no_path = unreachable.iter().map(|trip| LostTrips {
        origin: network.zone_name(trip.origin).into_owned(),
        destination: network.zone_name(trip.destination).into_owned(),
        volume: trip.volume,
        why: NO_PATH,
    });
    let no_zone = unknown.into_iter().map(|unknown| LostTrips {
        origin: unknown.place,
        destination: unknown.zone,
        volume: unknown.volume,
        why: NO_ZONE,
    });
    Import {
        lost: no_path.chain(no_zone).collect(),
        network,
        demand,
        roads,
        report,
        unreachable,
    }
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
