//! Static assignment, from its description to its solution: what `host-sim assign` and the points of a sweep solve.

use crate::capacity::TrafficState;
use assignment::formats::{Import, ImportOptions, LostTrips, RoadData, Unreachable};
use assignment::link::check_not_negative;
use assignment::report::{ImportReport, NoteKind};
use assignment::{
    Algorithm, CostWeights, Demand, Network, Objective, Observe, Options, PathFlows, Solution, Stop,
    assign_from, assign_observed, formats, grid::Grid, report,
};
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Iterations to stop at unless said.
pub const MAX_ITERATIONS: usize = 10_000;

/// A road's flow over its capacity that no demand of the capacity's unit of time gives (chosen: published networks stay below 5).
const FULLEST: f64 = 10.0;

/// What reports call it.
const VOLUME_OVER_CAPACITY: &str = "flow over capacity";

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
    /// What the files do not say. Its weights are those above.
    pub import: ImportOptions,
    /// What happens to trips without a path.
    pub unreachable: Unreachable,
    /// Whether what is likely to be wrong is an error.
    pub strict: bool,
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
            import: ImportOptions::default(),
            unreachable: Unreachable::default(),
            strict: false,
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
        self.assignment(self.import()?)
    }

    /// Reads network and demand, trips without a path included.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn import(&self) -> Result<Import> {
        check_not_negative("demand_factor", self.demand_factor)?;
        check_not_negative("toll_weight", self.weights.toll)?;
        check_not_negative("distance_weight", self.weights.distance)?;
        let Some(net) = &self.net else {
            return self.grid();
        };
        let options = ImportOptions {
            weights: self.weights,
            ..self.import.clone()
        };
        formats::import(net, self.trips.as_deref(), &options)
    }

    /// The assignment of what was read.
    ///
    /// # Errors
    /// Trips without a path, unless they are to be left out; with [`strict`](Self::strict) a warning.
    pub fn assignment(&self, mut import: Import) -> Result<Assignment> {
        let gap = self.gap.unwrap_or(match self.algorithm {
            Algorithm::PathBased => 1e-10,
            _ => 1e-4,
        });
        check_not_negative("gap", gap)?;
        import.settle(self.unreachable)?;
        if self.strict {
            import.report.refuse_warnings()?;
        }
        Ok(Assignment {
            demand: import.demand.scaled(self.demand_factor)?,
            network: import.network,
            roads: import.roads,
            lost: import.lost,
            report: import.report,
            strict: self.strict,
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
    fn grid(&self) -> Result<Import> {
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
        Ok(Import::built(grid.network()?, grid.demand()?))
    }
}

/// A network, its demand, and how to solve it.
#[derive(Clone, Debug)]
pub struct Assignment {
    /// The roads.
    pub network: Network,
    /// Who drives on them.
    pub demand: Demand,
    /// What else is known of the roads.
    pub roads: RoadData,
    /// Trips that were left out, as the files have them.
    pub lost: Vec<LostTrips>,
    /// What the readers assumed.
    pub report: ImportReport,
    /// Whether a warning is an error.
    pub strict: bool,
    /// What to solve, how, and when to stop.
    pub options: Options,
}

impl Assignment {
    /// Solves it, from path flows if there are any. `observe` hears of every iteration.
    ///
    /// # Errors
    /// As [`assign_observed`] and [`assign_from`].
    pub fn solve(&self, start: Option<&PathFlows>, observe: &mut Observe<'_>) -> Result<Solution> {
        let Self {
            network,
            demand,
            options,
            ..
        } = self;
        match start {
            Some(paths) => assign_from(network, demand, options, paths, observe),
            None => assign_observed(network, demand, options, observe),
        }
    }

    /// The readers' report with what flows say: how full the roads are. Flows that are no equilibrium yet may fill some beyond
    /// any sense; they raise no warning.
    ///
    /// # Errors
    /// With [`strict`](Self::strict), if that is too full to be true.
    pub fn report_with(&self, link_flows: &[f64], settled: bool) -> Result<ImportReport> {
        let mut report = self.report.clone();
        let state = TrafficState::of(&self.network, &self.demand, link_flows);
        let (mean, most) = (state.mean_volume_over_capacity, state.max_volume_over_capacity);
        let text = format!("{} to {}, mean {}", 0, report::short(most), report::short(mean));
        if settled && most > FULLEST {
            let text = format!("{text}: are demand and capacity of the same time? below {FULLEST} is usual");
            report.say(NoteKind::Warning, VOLUME_OVER_CAPACITY, text);
        } else {
            report.say(NoteKind::Plausible, VOLUME_OVER_CAPACITY, text);
        }
        if self.strict {
            report.refuse_warnings()?;
        }
        Ok(report)
    }

    /// The JSON object of a solution, without the times that it took.
    pub fn to_json(&self, solution: &Solution) -> Value {
        let Self {
            network,
            demand,
            options,
            ..
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
        Stop::Time => "time",
        Stop::Interrupted => "signal",
    }
}
