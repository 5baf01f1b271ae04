//! `host-sim assign`: static traffic assignment on a TNTP, GMNS or SUMO network or on the urban grid.

mod flow_files;
mod import;
mod limits;
mod outputs;
mod page;
mod progress;

pub use flow_files::read as read_flows;

use crate::assign::{AssignSource, Assignment, ClassTotals, MAX_ITERATIONS, stop_name};
use crate::command::options::choice;
use crate::report::answers;
use crate::report::table::{Column, Table};
use assignment::check::{self, Evaluation};
use assignment::coordinates::{LengthUnit, NodePlaces};
use assignment::grid::Grid;
use assignment::link_table::Delay;
use assignment::{
    Algorithm, ClassSolution, CostWeights, IterationRecord, Network, Objective, Solution, Stop, formats,
};
use kit::error::Result;
use kit::say;
use limits::Limits;
use progress::Progress;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

pub use import::ImportArguments;
pub(in crate::command) use import::print_warnings;

/// The name that takes the place of a network file: the urban grid, which brings its own demand.
const GRID: &str = "grid";

/// Rows of the table of the convergence (chosen: it fits a screen).
const CONVERGENCE_ROWS: usize = 12;

/// Assign demand to a road network: user equilibrium or system optimum.
#[derive(Debug, Clone, clap::Args)]
pub struct AssignArguments {
    /// TNTP network file, folder with GMNS node.csv and link.csv, SUMO net.xml or net.xml.gz, or `grid` for the urban grid of
    /// 4x4 intersections
    #[arg(long, value_name = "FILE|DIR|grid")]
    pub net: String,
    /// Trips: TNTP trip table, CSV of pairs such as o_zone_id,d_zone_id,volume, CSV matrix, OMX, or for SUMO's networks trips, flows
    /// or routes (a vehicle counts one per hour); [default: demand.csv in a GMNS folder]; none with `grid`, which brings one
    /// vehicle per hour and pair of intersections
    #[arg(long, value_name = "FILE")]
    pub trips: Option<PathBuf>,
    /// Several classes of vehicles instead: TOML with a table `class` for each, with its name, its trips, and if need be matrix,
    /// demand_factor, passenger_car_equivalent, value_of_time (money an hour) or toll_weight, and distance_weight
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["trips", "check"])]
    pub classes: Option<PathBuf>,
    /// What else is true of roads: CSV with from_node_id,to_node_id or link_id, and any of preload (passenger cars that are there
    /// anyway), delay (as --delay), toll_CLASS and banned_CLASS (1 where a class may not drive)
    #[arg(long, value_name = "FILE.csv")]
    pub link_table: Option<PathBuf>,
    /// Delay function of the roads that congest: bpr, conical (its alpha each road's power), conical=ALPHA or akcelik=J
    #[arg(long, value_name = "FUNCTION", value_parser = delay, default_value = "bpr")]
    pub delay: Delay,
    /// Hours in which demand and capacity count vehicles, for Akcelik's function [default: 1]
    #[arg(long, value_name = "HOURS", allow_negative_numbers = true)]
    pub delay_period: Option<f64>,
    /// Factor on all trips
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    pub demand_factor: f64,
    /// Solve nothing: judge the flows of this CSV or Parquet file as --flows writes them, of a published *_flow.tntp, of
    /// AequilibraE's results, or of any CSV with the nodes or names of links and their volumes. The exit code is 1 if they do
    /// not carry the demand, or are further from equilibrium than a --gap that is given
    #[arg(long, value_name = "FLOWS")]
    pub check: Option<PathBuf>,
    /// fw, cfw, bfw: (conjugate, bi-conjugate) Frank-Wolfe; path: gradient projection on path flows
    #[arg(long, value_parser = choice::<Algorithm>(), default_value = "path")]
    pub algorithm: Algorithm,
    /// ue: user equilibrium; so: system optimum
    #[arg(long, value_parser = choice::<Objective>(), default_value = "ue")]
    pub objective: Objective,
    /// Relative gap (TSTT - SPTT) / TSTT to stop at [default: 1e-10 with path, 1e-4 with the others]
    #[arg(long, allow_negative_numbers = true)]
    pub gap: Option<f64>,
    /// Iterations to stop at even if the gap is larger
    #[arg(long, default_value_t = MAX_ITERATIONS)]
    pub max_iterations: usize,
    /// Seconds of solving after which to end with what there is: files are written whole, and the exit code is 3, as it is
    /// after SIGTERM or the first Ctrl-C
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub max_seconds: Option<f64>,
    /// Cost of a unit of toll, in units of free-flow time
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub toll_weight: f64,
    /// Cost of a unit of length, in units of free-flow time
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub distance_weight: f64,
    /// Write the link flows to this file, CSV or by its name Parquet (init_node,term_node,volume,cost; one row per link: roads in
    /// file order, then connectors and turns)
    #[arg(long, value_name = "FILE.csv|FILE.parquet")]
    pub flows: Option<PathBuf>,
    /// Write the path flows to this CSV (origin,destination,volume,cost,links; links by number in file order)
    #[arg(long, value_name = "FILE.csv")]
    pub paths: Option<PathBuf>,
    /// Start from the path flows of this CSV, as --paths wrote it for the same links: other capacities, another demand
    #[arg(long, visible_alias = "resume", value_name = "PATHS")]
    pub warm: Option<PathBuf>,
    /// Write cost, time, length and toll of the cheapest way between every two zones to this file, CSV or by its name OMX
    #[arg(long, value_name = "FILE.csv|FILE.omx")]
    pub skims: Option<PathBuf>,
    /// Link from one node to another whose trips --selected shall list (repeatable)
    #[arg(long, value_name = "FROM,TO")]
    pub select_link: Vec<String>,
    /// Write the roads with flow, cost and flow over capacity to this GeoJSON, in the network's coordinates
    #[arg(long, value_name = "FILE.geojson")]
    pub geojson: Option<PathBuf>,
    /// Write a report with a map of flow over capacity to this page
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write network, flows and trips as GMNS into this folder: node.csv, link.csv, demand.csv, and config.csv where units are
    /// known
    #[arg(long, value_name = "DIR")]
    pub gmns: Option<PathBuf>,
    /// Write which pairs of zones use the links of --select-link, and how much of each, to this CSV
    #[arg(long, value_name = "FILE.csv")]
    pub selected: Option<PathBuf>,
    /// Write the record of all iterations to this CSV (iteration,relative_gap,objective,seconds)
    #[arg(long, value_name = "FILE.csv")]
    pub convergence: Option<PathBuf>,
    /// Threads; 0 takes one per core. The flows do not depend on it
    #[arg(long, default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(0..=1024))]
    pub threads: u16,
    /// Accepted as by every sub-command, and without effect: the solver draws nothing at random
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub json: bool,
    /// What the files do not say.
    #[command(flatten)]
    pub import: ImportArguments,
}

/// A delay function by its name.
fn delay(text: &str) -> std::result::Result<Delay, String> {
    text.parse()
        .map_err(|failure: kit::error::Error| failure.to_string())
}

impl AssignArguments {
    /// The assignment that the options describe.
    ///
    /// # Errors
    /// An option of the readers that makes no sense.
    pub fn source(&self) -> Result<AssignSource> {
        Ok(AssignSource {
            net: (self.net != GRID).then(|| PathBuf::from(&self.net)),
            trips: self.trips.clone(),
            classes: self.classes.clone(),
            links: self.link_table.clone(),
            delay: self.delay,
            period_hours: self.delay_period,
            demand_factor: self.demand_factor,
            weights: CostWeights {
                toll: self.toll_weight,
                distance: self.distance_weight,
            },
            algorithm: self.algorithm,
            objective: self.objective,
            gap: self.gap,
            max_iterations: self.max_iterations,
            threads: usize::from(self.threads),
            import: self.import.options()?,
            unreachable: self.import.unreachable,
            strict: self.import.strict,
        })
    }
}

impl AssignArguments {
    /// Where the nodes lie.
    fn places(&self, network: &Network) -> Result<NodePlaces> {
        if self.net == GRID {
            let grid = Grid::default();
            let nodes = 0..network.numbering().nodes;
            let place = |node: u32| {
                let (column, row) = (f64::from(node % grid.columns), f64::from(node / grid.columns));
                (column * grid.block_length_x, row * grid.block_length_y)
            };
            return Ok(NodePlaces {
                places: nodes.map(place).collect(),
                unit: LengthUnit::Metre,
            });
        }
        formats::read_places(Path::new(&self.net), self.import.nodes.as_deref(), network)
    }
}

/// Solves or judges, and reports.
///
/// # Errors
/// An option, network, trip table, flow or path file that makes no sense; a file that cannot be read or written. Not reaching the
/// gap is none: the report says so.
pub fn run(arguments: &AssignArguments) -> Result<ExitCode> {
    let start = Instant::now();
    outputs::check_options(arguments)?;
    let source = arguments.source()?;
    let input = source.import()?;
    arguments.import.write_lost(&input)?;
    let assignment = source.assignment(input)?;
    match &arguments.check {
        Some(path) => judge(arguments, &assignment, path, start),
        None => solve(arguments, &assignment, start),
    }
}

fn solve(arguments: &AssignArguments, assignment: &Assignment, start: Instant) -> Result<ExitCode> {
    let Assignment { network, options, .. } = assignment;
    let selection = outputs::Selection::new(arguments, network)?;
    let start_paths = outputs::start(arguments, assignment)?;
    let limits = Limits::new(arguments.max_seconds)?;
    let mut progress = Progress::new(arguments.json);
    let solve_start = Instant::now();
    let mut observe = |record: &IterationRecord| {
        progress.show(record.iteration, record.relative_gap);
        limits.check(solve_start)
    };
    let solved = assignment.solve(&start_paths, &mut observe)?;
    let solution = &solved.total;
    let seconds = solve_start.elapsed().as_secs_f64();
    progress.finish();
    let report = assignment.report_with(&solution.link_flows, solution.converged)?;
    let seconds_total = start.elapsed().as_secs_f64();
    // Before anything is written: a full disk takes the files, not the numbers.
    import::print_report(&report, arguments.json);
    if arguments.json {
        let mut object = timed(assignment.to_json(&solved), seconds, seconds_total);
        object["unreachable_pairs"] = json!(assignment.lost.len());
        object["import"] = import::report_json(&report);
        say!("{object}");
    } else {
        print_problem(assignment);
        print_solution(assignment, solution, seconds, seconds_total);
        if !assignment.classes.is_empty() {
            say!("");
            say!("{}", class_table(assignment, &solved)?.to_string().trim_end());
        }
        if let Some(answer) = answers::of_assign(assignment, solution) {
            say!("\n{answer}");
        }
    }
    outputs::write(arguments, assignment, &selection, &solved, &report)?;
    if !arguments.json {
        let mut written = outputs::written(arguments).peekable();
        if written.peek().is_some() {
            say!("");
        }
        for (word, path) in written {
            say!("{word:<21}{}", path.display());
        }
    }
    let mut code = ExitCode::SUCCESS;
    if !solution.converged {
        let why = match solution.stopped {
            Stop::Stagnation => "stagnated, as far as this method and double precision go",
            Stop::Gap | Stop::Iterations => "not converged",
            Stop::Time | Stop::Interrupted => {
                code = ExitCode::from(limits::STOPPED_EARLY);
                "ended early with the best flows so far"
            }
        };
        kit::remark!(
            "{why}: relative gap {:.3e} after {} iterations, {:e} was asked for",
            solution.relative_gap,
            solution.iterations,
            options.gap
        );
    }
    Ok(code)
}

/// Exit code of a judgement that finds less than was asked for.
const NOT_AS_GOOD: u8 = 1;

fn judge(
    arguments: &AssignArguments,
    assignment: &Assignment,
    path: &Path,
    start: Instant,
) -> Result<ExitCode> {
    let Assignment {
        network,
        demand,
        options,
        ..
    } = assignment;
    let link_flows = flow_files::read(path, network, &assignment.roads.names)?;
    let check_start = Instant::now();
    let evaluation = check::evaluate(network, demand, options.objective, &link_flows)?;
    let seconds = check_start.elapsed().as_secs_f64();
    let seconds_total = start.elapsed().as_secs_f64();
    if evaluation.is_short {
        kit::remark!(
            "the flows do not carry the demand: they cost less than it would on its cheapest paths; their gap means nothing"
        );
    } else if !evaluation.conserves_demand {
        kit::remark!(
            "the flows do not carry the demand: {} vehicles too many or too few at node {}; their gap means nothing",
            evaluation.largest_imbalance,
            network.node_name(evaluation.worst_node)
        );
    }
    let report = assignment.report_with(&link_flows, true)?;
    import::print_report(&report, arguments.json);
    if arguments.json {
        let mut object = timed(evaluation_json(options.gap, &evaluation), seconds, seconds_total);
        object["import"] = import::report_json(&report);
        say!("{object}");
    } else {
        print_problem(assignment);
        print_evaluation(assignment, &evaluation);
    }
    // Flows from elsewhere may be as far from equilibrium as they are, unless a gap is asked for.
    let close = arguments.gap.is_none_or(|gap| evaluation.relative_gap <= gap);
    if !close {
        kit::remark!(
            "relative gap {:.3e}, {:e} was asked for",
            evaluation.relative_gap,
            options.gap
        );
    }
    Ok(if close && evaluation.conserves_demand {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(NOT_AS_GOOD)
    })
}

/// A result with the times that it took: the solve's, and with reading.
fn timed(mut object: Value, seconds: f64, seconds_total: f64) -> Value {
    object["seconds"] = json!(seconds);
    object["seconds_total"] = json!(seconds_total);
    object
}

fn evaluation_json(gap: f64, evaluation: &Evaluation) -> Value {
    json!({
        "relative_gap": evaluation.relative_gap,
        "objective": evaluation.objective,
        "total_travel_time": evaluation.total_travel_time,
        "iterations": 0,
        "converged": evaluation.relative_gap <= gap && evaluation.conserves_demand,
        "conserves_demand": evaluation.conserves_demand,
        "largest_imbalance": evaluation.largest_imbalance,
        "worst_node": evaluation.worst_node,
    })
}

fn print_problem(assignment: &Assignment) {
    let Assignment { network, demand, .. } = assignment;
    let numbering = network.numbering();
    say!("nodes, zones         {}, {}", numbering.nodes, numbering.zones);
    say!("links                {}", network.links().len());
    say!("pairs with demand    {}", demand.pairs());
    say!("{:<21}{}", assignment.unit_of_demand(), demand.total());
    say!("  within zones       {} (not assigned)", demand.intrazonal());
}

fn print_solution(assignment: &Assignment, solution: &Solution, seconds: f64, seconds_total: f64) {
    say!("");
    say!("iteration   relative gap             objective    seconds");
    // All, or evenly spaced ones: always the first and the last.
    let last = solution.convergence.len().saturating_sub(1);
    let rows = last.clamp(1, CONVERGENCE_ROWS - 1);
    let mut shown = None;
    for row in 0..=rows {
        let index = row * last / rows;
        if let Some(record) = solution.convergence.get(index)
            && shown.replace(index) != Some(index)
        {
            say!(
                "{:>9}   {:>12.4e}   {:>19.8}   {:>8.3}",
                record.iteration,
                record.relative_gap,
                record.objective,
                record.seconds
            );
        }
    }
    say!("");
    say!(
        "converged            {}",
        if solution.converged { "yes" } else { "NO" }
    );
    say!("stopped by           {}", stop_name(solution.stopped));
    say!(
        "relative gap         {:.4e} ({:e} was asked for)",
        solution.relative_gap,
        assignment.options.gap
    );
    say!("objective            {}", solution.objective);
    say!("{:<21}{}", assignment.name_of_total(), solution.total_travel_time);
    say!("iterations           {}", solution.iterations);
    say!("seconds              {seconds:.3} ({seconds_total:.3} with reading)");
}

/// What each class does.
fn class_table(assignment: &Assignment, solved: &ClassSolution) -> Result<Table> {
    let classes = || assignment.classes.iter().zip(&solved.classes);
    let total = |value: fn(&ClassTotals) -> f64| -> Vec<f64> {
        classes()
            .map(|(class, flows)| value(&assignment.totals(class, flows)))
            .collect()
    };
    Table::new(vec![
        Column::text("name", classes().map(|(class, _)| class.name.clone())).shown("class", "", 0),
        Column::number("vehicles", classes().map(|(class, _)| class.demand.total())).shown("vehicles", "", 1),
        Column::number(
            "passenger_car_equivalent",
            classes().map(|(class, _)| class.passenger_car_equivalent),
        )
        .shown("cars each", "", 2),
        Column::number("time", total(|totals| totals.time)).shown("time", "", 1),
        Column::number("toll", total(|totals| totals.toll)).shown("toll", "", 1),
        Column::number("distance", total(|totals| totals.distance)).shown("distance", "", 1),
        Column::number("cost", total(|totals| totals.cost)).shown("cost", "", 1),
    ])
}

fn print_evaluation(assignment: &Assignment, evaluation: &Evaluation) {
    say!("");
    say!("relative gap         {:.4e}", evaluation.relative_gap);
    say!("objective            {}", evaluation.objective);
    say!(
        "{:<21}{}",
        assignment.name_of_total(),
        evaluation.total_travel_time
    );
    say!(
        "largest imbalance    {:.4e} vehicles at node {}",
        evaluation.largest_imbalance,
        assignment.network.node_name(evaluation.worst_node)
    );
    say!(
        "carries the demand   {}",
        if evaluation.conserves_demand { "yes" } else { "NO" }
    );
}
