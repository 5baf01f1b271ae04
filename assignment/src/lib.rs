//! Static traffic assignment: which roads a given demand takes when every trip picks its cheapest route.
//!
//! A [`Network`] of links with volume-delay functions and a [`Demand`] between zones give link flows:
//! under [`Objective::UserEquilibrium`] nobody can gain by changing route (Wardrop's first principle), under
//! [`Objective::SystemOptimum`] the sum of all travel costs is least (his second).
//!
//! ```
//! use assignment::{Algorithm, Options, Result, assign, grid::Grid};
//!
//! # fn main() -> Result<()> {
//! let grid = Grid::default();
//! let options = Options { gap: 1e-12, ..Options::default() };
//! let solution = assign(&grid.network()?, &grid.demand()?, &options)?;
//! assert!(solution.converged);
//! assert_eq!(options.algorithm, Algorithm::PathBased);
//! # Ok(())
//! # }
//! ```
//!
//! `cargo run -p assignment --example own_network` builds a network of its own: two towns, a bridge and a bypass.
//!
//! # The rooms
//! * [`network`], [`demand`], [`volume_delay`]: the problem, its links in `link_rows`; [`formats`] reads it
//!   from files of [`tntp`], [`gmns`] and [`sumo`], with the help of `csv_table`, `xml`, [`text`] and [`units`], demand by
//!   [`imported_demand`] in `demand_table` and [`omx`], and turns in `turn_table`; `road_plan` makes a network of roads, turns and zones; a
//!   [`report`] says what was assumed, [`reach`] which trips have no path; [`grid`] builds one.
//! * [`coordinates`]: where its nodes lie.
//! * [`shortest_path`] with its `heap`, `all_or_nothing`, `line_search`: what every algorithm stands on.
//! * `frank_wolfe`: link flows only, sensible to a gap of about 1e-4; `path_based`: linear convergence to
//!   1e-12, its Newton steps in `path_shift` and, for all pairs at once, in `newton`; an origin's paths in `path_tree` and
//!   `origin_paths`.
//! * [`classes`]: several kinds of vehicles on the same roads; [`link_table`] says what they pay and where they may not drive,
//!   which vehicles are there anyway, and delay functions; tables find links in `link_names`.
//! * [`path_flows`], [`skims`], [`select_link`], [`convergence`]: results as numbers and as files; path flows are also
//!   where the next solve can start, see [`assign_from`]; an [`Assigner`] keeps more than these and starts faster.
//! * [`check`]: judges any link flows, by other means than the solvers use; [`flow_table`] reads those of other programs.
//! * [`geojson`] with [`shapes`], and the writer in [`gmns`]: roads with flows for other programs.
//!
//! # Determinism
//! Equal input gives equal bytes at any thread count: origins are split into blocks by their number alone, and block results
//! are added in block order. Only [`IterationRecord::seconds`] is a clock reading.

mod all_or_nothing;
mod assigner;
pub mod check;
pub mod classes;
pub mod convergence;
pub mod coordinates;
mod csv_rows;
#[cfg(feature = "formats")]
mod csv_table;
pub mod demand;
#[cfg(feature = "formats")]
mod demand_table;
#[cfg(feature = "formats")]
pub mod flow_table;
#[cfg(feature = "formats")]
pub mod formats;
mod frank_wolfe;
#[cfg(feature = "formats")]
pub mod geojson;
#[cfg(feature = "formats")]
pub mod gmns;
pub mod grid;
mod heap;
mod hyperbola;
#[cfg(feature = "formats")]
pub mod imported_demand;
mod line_search;
pub mod link;
#[cfg(feature = "formats")]
mod link_names;
mod link_rows;
#[cfg(feature = "formats")]
pub mod link_table;
pub mod network;
mod newton;
#[cfg(feature = "omx")]
pub mod omx;
mod origin_paths;
mod path_based;
pub mod path_flows;
mod path_shift;
mod path_tree;
mod problem;
#[cfg(feature = "formats")]
pub mod reach;
pub mod report;
#[cfg(feature = "formats")]
mod road_plan;
pub mod select_link;
#[cfg(feature = "formats")]
pub mod shapes;
pub mod shortest_path;
pub mod skims;
#[cfg(feature = "formats")]
pub mod sumo;
#[cfg(feature = "formats")]
pub mod text;
pub mod tntp;
#[cfg(feature = "formats")]
mod turn_table;
pub mod units;
pub mod volume_delay;
#[cfg(feature = "formats")]
mod xml;

pub use assigner::Assigner;
pub use classes::{ClassFlows, ClassSolution, VehicleClass, assign_classes};
pub use demand::{Demand, Trip};
pub use kit::error::{Error, Result};
pub use kit::files::Text;
pub use link::{CostWeights, DelayFunction, Link, NodeNumbering};
pub use network::{Names, Network};
pub use path_flows::{PathFlow, PathFlows};
pub use volume_delay::VolumeDelay;

use kit::choice::Choice;
use problem::Problem;
use std::ops::ControlFlow;

/// How the flows are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Algorithm {
    /// Frank-Wolfe: move towards the all-or-nothing flows. Stalls near a gap of 1e-4.
    FrankWolfe,
    /// Frank-Wolfe with directions conjugate to the previous one.
    ConjugateFrankWolfe,
    /// Frank-Wolfe with directions conjugate to the two previous ones: the best of the link-based family.
    BiconjugateFrankWolfe,
    /// Gradient projection on path flows: converges linearly, to 1e-12 and below.
    #[default]
    PathBased,
}

/// What the flows minimise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Objective {
    /// Nobody gains by changing route: the Beckmann function, the sum of the integrals of the travel costs.
    #[default]
    UserEquilibrium,
    /// The sum of everybody's travel cost is least.
    SystemOptimum,
}

impl Choice for Algorithm {
    const ALL: &'static [Self] = &[
        Self::FrankWolfe,
        Self::ConjugateFrankWolfe,
        Self::BiconjugateFrankWolfe,
        Self::PathBased,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::FrankWolfe => "fw",
            Self::ConjugateFrankWolfe => "cfw",
            Self::BiconjugateFrankWolfe => "bfw",
            Self::PathBased => "path",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::FrankWolfe => "Frank-Wolfe: move towards the all-or-nothing flows",
            Self::ConjugateFrankWolfe => "Frank-Wolfe with conjugate directions",
            Self::BiconjugateFrankWolfe => "Frank-Wolfe with bi-conjugate directions",
            Self::PathBased => "Gradient projection on path flows",
        }
    }
}

impl Choice for Objective {
    const ALL: &'static [Self] = &[Self::UserEquilibrium, Self::SystemOptimum];

    fn name(self) -> &'static str {
        match self {
            Self::UserEquilibrium => "ue",
            Self::SystemOptimum => "so",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::UserEquilibrium => "User equilibrium: nobody gains by changing route",
            Self::SystemOptimum => "System optimum: the sum of everybody's travel cost is least",
        }
    }
}

/// What to solve, how, and when to stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How the flows are found.
    pub algorithm: Algorithm,
    /// What they minimise.
    pub objective: Objective,
    /// Stop at this relative gap: not negative, finite.
    pub gap: f64,
    /// Stop after this many iterations even if the gap is larger; 0 gives all-or-nothing flows.
    pub max_iterations: usize,
    /// Threads for the shortest paths; 0 takes one per core. The result does not depend on it.
    pub threads: usize,
}

impl Options {
    /// Refuses a gap that is negative or not finite.
    fn check(&self) -> Result<()> {
        if self.gap.is_finite() && self.gap >= 0.0 {
            return Ok(());
        }
        let expected = "a finite number, not negative";
        Err(Error::input("relative gap", self.gap, expected))
    }
}

impl Default for Options {
    /// Path-based user equilibrium to a gap of 1e-6, one thread per core.
    fn default() -> Self {
        Self {
            algorithm: Algorithm::default(),
            objective: Objective::default(),
            gap: 1e-6,
            max_iterations: 10_000,
            threads: 0,
        }
    }
}

/// Why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The relative gap asked for is reached.
    Gap,
    /// [`Options::max_iterations`] are used up.
    Iterations,
    /// Neither gap nor objective improve any more: double precision, or the method, gives no more.
    Stagnation,
    /// Whoever [observed](Observe) the solve had no more time for it.
    Time,
    /// Whoever [observed](Observe) the solve was told to end it.
    Interrupted,
}

/// Hears of every iteration as it ends, and may end the solve there: its flows are then those of that iteration, which has the
/// least objective so far.
pub type Observe<'o> = dyn FnMut(&IterationRecord) -> ControlFlow<Stop> + 'o;

/// An observer that lets every solve come to its own end.
pub fn uninterrupted(_: &IterationRecord) -> ControlFlow<Stop> {
    ControlFlow::Continue(())
}

/// The state after one iteration; record 0 is the initial loading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IterationRecord {
    /// Iterations so far.
    pub iteration: usize,
    /// (TSTT - SPTT) / TSTT of the flows at this point, see [`Solution::relative_gap`].
    pub relative_gap: f64,
    /// The objective of the flows at this point.
    pub objective: f64,
    /// Wall time since the solve began.
    pub seconds: f64,
}

/// Flows and how good they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Vehicles per unit of time on each link, in file order, without [those that are there anyway](Network::with_preloads).
    pub link_flows: Vec<f64>,
    /// Generalised travel cost that a vehicle meets on each link (not the marginal cost, whatever the objective).
    pub link_costs: Vec<f64>,
    /// (TSTT - SPTT) / TSTT, never negative. TSTT is the sum of flow times cost, SPTT the same if everybody took the
    /// cheapest route at these costs; with [`Objective::SystemOptimum`] both use marginal costs.
    pub relative_gap: f64,
    /// What was minimised: the Beckmann function or the total travel cost.
    pub objective: f64,
    /// Sum over links of flow times generalised travel cost.
    pub total_travel_time: f64,
    /// Iterations after the initial loading.
    pub iterations: usize,
    /// Whether the relative gap asked for was reached.
    pub converged: bool,
    /// Why it ended.
    pub stopped: Stop,
    /// The paths that the trips take; empty with the Frank-Wolfe family, which knows link flows only. They are a start for
    /// [`assign_from`].
    pub path_flows: PathFlows,
    /// One record per iteration, the initial loading first.
    pub convergence: Vec<IterationRecord>,
}

/// Assigns `demand` to `network`.
///
/// # Errors
/// [`Error::Input`] for a gap that is negative or not finite, a demand for other zones than the network's, an origin
/// and destination with demand but no path, or costs that overflow when the whole demand takes one link.
pub fn assign(network: &Network, demand: &Demand, options: &Options) -> Result<Solution> {
    assign_observed(network, demand, options, &mut uninterrupted)
}

/// [`assign`], calling `observe` with the record of every iteration as it ends, the initial loading first.
///
/// # Errors
/// As [`assign`].
pub fn assign_observed(
    network: &Network,
    demand: &Demand,
    options: &Options,
    observe: &mut Observe<'_>,
) -> Result<Solution> {
    solve(network, demand, options, path_based::Start::Nothing, observe)
}

/// [`assign_observed`] from the [path flows](Solution::path_flows) of an earlier solution: on the same links with other
/// capacities, or for another demand. Each pair's trips start in the same shares on the same paths; pairs that had none
/// start on their cheapest path.
///
/// # Errors
/// As [`assign`], and for an algorithm that is not path-based, or paths that are none in this network.
pub fn assign_from(
    network: &Network,
    demand: &Demand,
    options: &Options,
    start: &PathFlows,
    observe: &mut Observe<'_>,
) -> Result<Solution> {
    if options.algorithm != Algorithm::PathBased {
        let expected = "the path-based one: the others know link flows only, which fit no other demand";
        return Err(Error::input(
            "algorithm for a warm start",
            "Frank-Wolfe",
            expected,
        ));
    }
    start.check(network)?;
    solve(
        network,
        demand,
        options,
        path_based::Start::Paths(&[start]),
        observe,
    )
}

fn solve(
    network: &Network,
    demand: &Demand,
    options: &Options,
    start: path_based::Start<'_>,
    observe: &mut Observe<'_>,
) -> Result<Solution> {
    options.check()?;
    let problem = Problem::new(network, demand, options)?;
    let mut progress = problem::Progress::new(options, observe);
    let (link_flows, path_flows) = match options.algorithm {
        Algorithm::FrankWolfe | Algorithm::ConjugateFrankWolfe | Algorithm::BiconjugateFrankWolfe => (
            frank_wolfe::solve(&problem, options.algorithm, &mut progress)?,
            PathFlows::default(),
        ),
        Algorithm::PathBased => {
            let (class_flows, blocks) = path_based::solve(&problem, start, &mut progress)?;
            (class_flows.concat(), path_based::path_flows(demand, blocks, 1.0))
        }
    };
    let link_costs = network.link_costs(&link_flows);
    Ok(progress.into_solution(link_costs, link_flows, path_flows))
}
