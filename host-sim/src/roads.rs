//! The roads that the closed loop plans on: those of the scenario's grid, or of a loaded network.

use crate::mobility::{MobilitySource, Place, Road, StreetMap};
use crate::scenario::Scenario;
use crate::traffic::{TrafficModel, planning_options};
use assignment::{Assigner, Demand, Network};
use kit::error::{Error, Result};

/// Roads, by the blocks that reports are about: both directions between two nodes are one block.
pub struct Roads<'s> {
    place: RoadPlace<'s>,
    /// Index of the block of every road.
    blocks: Vec<usize>,
    block_count: usize,
    /// Has planned at full capacity; every plan starts from there.
    planner: Assigner,
}

enum RoadPlace<'s> {
    Grid(Box<TrafficModel>),
    Streets(&'s StreetMap),
}

impl RoadPlace<'_> {
    fn problem(&self) -> (&Network, &Demand) {
        match self {
            Self::Grid(model) => (model.network(), model.demand()),
            Self::Streets(map) => (map.network(), map.demand()),
        }
    }
}

impl<'s> Roads<'s> {
    /// The roads that a source's vehicles drive on.
    ///
    /// # Errors
    /// [`Error::Input`] for a trace, whose roads are not known; what [`Assigner::assign`] refuses.
    pub fn new(scenario: &Scenario, source: &'s dyn MobilitySource) -> Result<Self> {
        let place = match source.streets() {
            Some(map) => RoadPlace::Streets(map),
            None if source.is_grid() => RoadPlace::Grid(Box::new(TrafficModel::new(scenario)?)),
            None => {
                return Err(Error::input(
                    "--mobility",
                    source.describe(scenario),
                    "grid, on whose roads the trips are, or --net",
                ));
            }
        };
        let (network, demand) = place.problem();
        let (blocks, block_count) = pair_directions(network);
        let mut planner = Assigner::new(demand.clone(), planning_options())?;
        planner.assign(network)?;
        Ok(Self {
            place,
            blocks,
            block_count,
            planner,
        })
    }

    /// The roads at full capacity.
    pub fn network(&self) -> &Network {
        self.place.problem().0
    }

    /// The demand for trips.
    pub fn demand(&self) -> &Demand {
        self.planner.demand()
    }

    /// Seconds for each unit of the roads' travel times.
    pub fn seconds_per_unit(&self) -> f64 {
        match &self.place {
            RoadPlace::Grid(_) => 1.0,
            RoadPlace::Streets(map) => map.scale().seconds_per_unit,
        }
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.block_count
    }

    /// The block that a road belongs to.
    pub fn block(&self, road: usize) -> usize {
        self.blocks[road]
    }

    /// The block that a vehicle at a place on a road drives on.
    pub fn block_of(&self, road: Road, place: &Place) -> Option<usize> {
        let road = match (&self.place, road) {
            (RoadPlace::Grid(model), Road::Street(heading)) => model.road(heading, place)?,
            (RoadPlace::Streets(_), Road::Link(link)) => link as usize,
            _ => return None,
        };
        Some(self.block(road))
    }

    /// Equilibrium flows on a network of these roads with other capacities.
    ///
    /// # Errors
    /// As [`Assigner::assign`].
    pub fn plan(&self, network: &Network) -> Result<Vec<f64>> {
        // A copy, so that no plan depends on which others were made before it.
        Ok(self.planner.clone().assign(network)?.link_flows)
    }
}

/// Block of every link, in the order in which they come: a link shares the block of the first link back that is still
/// alone. Also how many there are.
fn pair_directions(network: &Network) -> (Vec<usize>, usize) {
    let mut alone = std::collections::HashMap::<(u32, u32), Vec<usize>>::new();
    let mut count = 0;
    let blocks = network.links().iter().map(|link| {
        let back = alone.get_mut(&(link.term_node, link.init_node));
        if let Some(block) = back.and_then(|blocks| (!blocks.is_empty()).then(|| blocks.remove(0))) {
            return block;
        }
        let ends = (link.init_node, link.term_node);
        alone.entry(ends).or_default().push(count);
        count += 1;
        count - 1
    });
    let blocks = blocks.collect();
    (blocks, count)
}
