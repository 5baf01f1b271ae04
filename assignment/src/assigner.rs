//! One solve after the other on the same roads: for whoever plans again whenever capacities change.

use crate::path_based::{self, Block, Start};
use crate::problem::{Problem, Progress};
use crate::{Algorithm, Demand, Network, NodeNumbering, Options, PathFlows, Solution};
use kit::error::{Error, Result};

/// Solves one demand again and again, each time from where the last solve ended: on networks with the same links, whose
/// capacities and costs may differ. It keeps paths, their flows and the trees of cheapest paths.
#[derive(Clone)]
pub struct Assigner {
    demand: Demand,
    options: Options,
    last: Option<Last>,
}

/// Where the last solve ended.
#[derive(Clone)]
struct Last {
    numbering: NodeNumbering,
    /// Nodes that each link joins.
    ends: Vec<(u32, u32)>,
    blocks: Vec<Block>,
}

impl Assigner {
    /// One that has solved nothing yet.
    ///
    /// # Errors
    /// [`Error::Input`] for an algorithm that is not path-based, or a gap that is negative or not finite.
    pub fn new(demand: Demand, options: Options) -> Result<Self> {
        options.check()?;
        if options.algorithm != Algorithm::PathBased {
            let expected = "the path-based one: the others keep nothing to start from";
            return Err(Error::input("algorithm", "Frank-Wolfe", expected));
        }
        Ok(Self {
            demand,
            options,
            last: None,
        })
    }

    /// The demand that is assigned.
    pub fn demand(&self) -> &Demand {
        &self.demand
    }

    /// Assigns the demand. The solution's path flows stay empty: [`path_flows`](Self::path_flows) gives them.
    ///
    /// # Errors
    /// As [`assign`](crate::assign()), and for a network with other links than the last one; the next solve then starts
    /// from nothing.
    pub fn assign(&mut self, network: &Network) -> Result<Solution> {
        let ends = || {
            network
                .links()
                .iter()
                .map(|link| (link.init_node, link.term_node))
        };
        let problem = Problem::new(network, &self.demand, &self.options)?;
        let last = self.last.take();
        if let Some(last) = &last
            && (last.numbering != network.numbering() || !ends().eq(last.ends.iter().copied()))
        {
            return Err(Error::input(
                "network",
                "other links than those of the last one",
                "the same links",
            ));
        }
        let (kept_ends, start) = match last {
            None => (ends().collect(), Start::Nothing),
            Some(last) => (last.ends, Start::End(last.blocks)),
        };
        let mut observe = crate::uninterrupted;
        let mut progress = Progress::new(&self.options, &mut observe);
        let (class_flows, blocks) = path_based::solve(&problem, start, &mut progress)?;
        self.last = Some(Last {
            numbering: network.numbering(),
            ends: kept_ends,
            blocks,
        });
        let link_flows = class_flows.concat();
        let costs = network.link_costs(&link_flows);
        Ok(progress.into_solution(costs, link_flows, PathFlows::default()))
    }

    /// The paths that the trips take in the last solution; empty before the first.
    pub fn path_flows(&self) -> PathFlows {
        let last = self.last.as_ref();
        last.map_or_else(PathFlows::default, |last| {
            path_based::path_flows(&self.demand, last.blocks.clone(), 1.0)
        })
    }
}
