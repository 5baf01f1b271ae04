//! A network, its demand and its coordinates, in any of the formats.

use crate::coordinates::NodePlaces;
use crate::{CostWeights, Demand, Network, gmns, sumo, tntp};
use kit::error::{Error, Result};
use kit::files::Text;
use std::path::{Path, PathBuf};

/// How a TNTP network's file name ends, and how that of its nodes does.
const TNTP_ENDINGS: (&str, &str) = ("_net.tntp", "_node.tntp");

/// The files in a GMNS folder.
const NODES: &str = "node.csv";
const LINKS: &str = "link.csv";

/// The format of a network: a folder is GMNS, a name that ends in `.xml` SUMO, any other file TNTP.
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
        Ok(if found.is_dir() {
            Self::Gmns
        } else if path.extension().is_some_and(|extension| extension == "xml") {
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

/// Reads a network and its trips.
///
/// # Errors
/// What is wrong with either file, and no trips.
pub fn read(path: &Path, trips: Option<&Path>, weights: CostWeights) -> Result<(Network, Demand)> {
    let format = Format::of(path)?;
    let trips = |expected: &str| trips.ok_or_else(|| Error::input("trips", "none", expected));
    match format {
        Format::Gmns => {
            let trips = trips("a table o_zone_id,d_zone_id,volume for the GMNS network")?;
            let network = gmns::read_network(
                &Text::read(&path.join(NODES))?,
                &Text::read(&path.join(LINKS))?,
                weights,
            )?;
            let demand = gmns::read_demand(&Text::read(trips)?, &network)?;
            Ok((network, demand))
        }
        Format::Sumo => {
            let trips = trips("SUMO trips or routes for the network file")?;
            let network = sumo::read_network(&Text::read(path)?, &sumo::LaneModel::default(), weights)?;
            let demand = network.read_trips(&Text::read(trips)?)?;
            Ok((network.network, demand))
        }
        Format::Tntp => {
            let trips = trips("a TNTP trip table for the network file")?;
            let network = tntp::read_network(&Text::read(path)?, weights)?;
            let demand = tntp::read_trips(&Text::read(trips)?, network.numbering().zones)?;
            Ok((network, demand))
        }
    }
}

/// Reads where a network's nodes lie: from the network itself, for TNTP from `nodes` or the file of nodes beside it.
///
/// # Errors
/// What is wrong with the file, or that there is none.
pub fn read_places(path: &Path, nodes: Option<&Path>, network: &Network) -> Result<NodePlaces> {
    match (Format::of(path)?, nodes) {
        (Format::Gmns, None) => gmns::read_places(&Text::read(&path.join(NODES))?, network),
        (Format::Sumo, None) => sumo::read_places(&Text::read(path)?, network),
        (Format::Tntp, Some(nodes)) => tntp::read_places(&Text::read(nodes)?, network),
        (Format::Tntp, None) => {
            let beside = nodes_beside(path).ok_or_else(|| {
                let expected = "a TNTP node file with the coordinates of every node";
                Error::input("nodes", "none", expected)
            })?;
            tntp::read_places(&Text::read(&beside)?, network)
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
        Format::Gmns => vec![path.join(NODES), path.join(LINKS)],
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
