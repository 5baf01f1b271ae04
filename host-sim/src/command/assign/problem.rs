//! What `assign` solves: a network and its demand, in any of the formats.

use super::AssignArguments;
use crate::assignment::grid::Grid;
use crate::assignment::{CostWeights, Demand, Network, gmns, sumo, tntp};
use crate::error::{Error, Result};
use std::path::Path;

/// The name that takes the place of a network file.
const GRID: &str = "grid";

/// Reads the problem: a folder is GMNS, a name that ends in `.xml` SUMO, any other file TNTP.
pub(super) fn read(arguments: &AssignArguments) -> Result<(Network, Demand)> {
    if arguments.net == GRID {
        if let Some(trips) = &arguments.trips {
            let expected = "none with `--net grid`, which brings its own demand";
            return Err(Error::input("--trips", trips.display(), expected));
        }
        let grid = Grid::default();
        return Ok((grid.network()?, grid.demand()?));
    }
    let path = Path::new(&arguments.net);
    let weights = CostWeights {
        toll: arguments.toll_weight,
        distance: arguments.distance_weight,
    };
    let trips = |expected: &str| {
        let trips = arguments.trips.as_deref();
        trips.ok_or_else(|| Error::input("--trips", "none", expected))
    };
    if path.is_dir() {
        let trips = trips("a table o_zone_id,d_zone_id,volume for the GMNS network")?;
        let network = gmns::read_network(path, weights)?;
        let demand = gmns::read_demand(trips, &network)?;
        return Ok((network, demand));
    }
    if path.extension().is_some_and(|extension| extension == "xml") {
        let trips = trips("SUMO trips or routes for the network file")?;
        let network = sumo::read_network(path, &sumo::LaneModel::default(), weights)?;
        let demand = network.read_trips(trips)?;
        return Ok((network.network, demand));
    }
    let trips = trips("a TNTP trip table for the network file")?;
    let network = tntp::read_network(path, weights)?;
    let demand = tntp::read_trips(trips, network.numbering().zones)?;
    Ok((network, demand))
}
