//! Static assignment, from its description to its solution: what `host-sim assign` and the points of a sweep solve.

use crate::capacity::TrafficState;
use assignment::link::check_not_negative;
use assignment::{
    Algorithm, CostWeights, Demand, IterationRecord, Network, Objective, Options, PathFlow, Solution, Stop,
    assign_from, assign_observed, formats, grid::Grid,
};
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Iterations to stop at unless said.
pub const MAX_ITERATIONS: usize = 10_000;

/// Where an assignment comes from. What is left out has a default.
#[derive(Clone, Debug, PartialEq)]
pub struct AssignSource {
    /// The network, in any of the [`formats`]; otherwise the urban grid, which brings its own demand.
    pub net: Option<PathBuf>,
    /// Its trips.
    pub trips: Option<PathBuf>,
    /// Factor on all trips.
    pub demand_factor: f64,
    /// What toll and distance cost.
    pub weights: CostWeights,
    /// How the flows are found.
    pub algorithm: Algorithm,
    /// What they minimise.
    pub objective: Objective,
    /// Relative gap to stop at; otherwise what each kind of method reaches without effort.
    pub gap: Option<f64>,
    /// Iterations to stop at even if the gap is larger.
    pub max_iterations: usize,
    /// Threads; 0 takes one per core. The flows do not depend on it.
    pub threads: usize,
}

impl Default for AssignSource {
    fn default() -> Self {
        Self {
            net: None,
            trips: None,
            demand_factor: 1.0,
            weights: CostWeights::default(),
            algorithm: Algorithm::default(),
            objective: Objective::default(),
            gap: None,
            max_iterations: MAX_ITERATIONS,
            threads: 0,
        }
    }
}

impl AssignSource {
    /// Reads and checks all input.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn read(&self) -> Result<Assignment> {
        let gap = self.gap.unwrap_or(match self.algorithm {
            Algorithm::PathBased => 1e-10,
            _ => 1e-4,
        });
        check_not_negative("gap", gap)?;
        check_not_negative("demand_factor", self.demand_factor)?;
        check_not_negative("toll_weight", self.weights.toll)?;
        check_not_negative("distance_weight", self.weights.distance)?;
        let (network, demand) = match &self.net {
            Some(net) => formats::read(net, self.trips.as_deref(), self.weights)?,
            None => self.grid()?,
        };
        Ok(Assignment {
            demand: demand.scaled(self.demand_factor)?,
            network,
            options: Options {
                algorithm: self.algorithm,
                objective: self.objective,
                gap,
                max_iterations: self.max_iterations,
                threads: self.threads,
            },
        })
    }

    /// The grid with its own demand, and without what it has no use for.
    fn grid(&self) -> Result<(Network, Demand)> {
        if let Some(trips) = &self.trips {
            let expected = "none with the grid, which brings its own demand";
            return Err(Error::input("trips", trips.display(), expected));
        }
        for (name, weight) in [
            ("toll_weight", self.weights.toll),
            ("distance_weight", self.weights.distance),
        ] {
            if weight != 0.0 {
                let expected = "none with the grid, whose costs are times alone";
                return Err(Error::input(name, weight, expected));
            }
        }
        let grid = Grid::default();
        Ok((grid.network()?, grid.demand()?))
    }
}

/// A network, its demand, and how to solve it.
#[derive(Clone, Debug)]
pub struct Assignment {
    /// The roads.
    pub network: Network,
    /// Who drives on them.
    pub demand: Demand,
    /// What to solve, how, and when to stop.
    pub options: Options,
}

impl Assignment {
    /// Solves it, from path flows if there are any. `observe` hears of every iteration.
    ///
    /// # Errors
    /// As [`assign_observed`] and [`assign_from`].
    pub fn solve(
        &self,
        start: Option<&[PathFlow]>,
        observe: &mut dyn FnMut(&IterationRecord),
    ) -> Result<Solution> {
        let Self {
            network,
            demand,
            options,
        } = self;
        match start {
            Some(paths) => assign_from(network, demand, options, paths, observe),
            None => assign_observed(network, demand, options, observe),
        }
    }

    /// The JSON object of a solution, without the times that it took.
    pub fn to_json(&self, solution: &Solution) -> Value {
        let Self {
            network,
            demand,
            options,
        } = self;
        let state = TrafficState::of(network, demand, &solution.link_flows);
        json!({
            "relative_gap": solution.relative_gap,
            "gap_asked_for": options.gap,
            "objective": solution.objective,
            "total_travel_time": solution.total_travel_time,
            "mean_v_over_c": state.mean_volume_over_capacity,
            "max_v_over_c": state.max_volume_over_capacity,
            "iterations": solution.iterations,
            "converged": solution.converged,
            "stopped": stop_name(solution.stopped),
            "paths": solution.path_flows.len(),
            "links": network.links().len(),
            "zones": network.numbering().zones,
            "pairs": demand.pairs(),
            "total_demand": demand.total(),
            "intrazonal_demand": demand.intrazonal(),
        })
    }
}

/// Why a solve ended, in a word.
pub fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Gap => "gap",
        Stop::Iterations => "iterations",
        Stop::Stagnation => "stagnation",
    }
}
