//! Static assignment, from its description to its solution: what `host-sim assign` and the points of a sweep solve.

pub mod vehicle_classes;

use crate::capacity::TrafficState;
use assignment::formats::{Import, ImportOptions, RoadData};
use assignment::imported_demand::{ImportedDemand, LostTrips, Unreachable};
use assignment::link::check_not_negative;
use assignment::link_table::{ClassRules, Delay, LinkTable};
use assignment::report::{ImportReport, NoteKind};
use assignment::{
    Algorithm, ClassFlows, ClassSolution, CostWeights, Demand, Network, Objective, Observe, Options,
    PathFlows, Solution, Stop, VehicleClass, assign_classes, assign_from, assign_observed, formats,
    grid::Grid, report, text,
};
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use vehicle_classes::ClassDescription;

/// Iterations to stop at unless said.
pub const MAX_ITERATIONS: usize = 10_000;

/// A road's flow over its capacity that no demand of the capacity's unit of time gives (chosen: published networks stay below 5).
const FULLEST: f64 = 10.0;

/// Seconds of an hour.
const HOUR: f64 = 3600.0;

/// Longest period of a delay function, in hours (chosen: a week).
const MOST_HOURS: f64 = 168.0;

/// What reports call it.
const VOLUME_OVER_CAPACITY: &str = "flow over capacity";

/// Where an assignment comes from. What is left out has a default.
#[derive(Clone, Debug, PartialEq)]
pub struct AssignSource {
    /// The network, in any of the [`formats`]; otherwise the urban grid, which brings its own demand.
    pub net: Option<PathBuf>,
    /// Its trips.
    pub trips: Option<PathBuf>,
    /// Classes of vehicles in a [file](vehicle_classes), each with its own trips, instead of the trips.
    pub classes: Option<PathBuf>,
    /// What else is true of roads, a [table](assignment::link_table).
    pub links: Option<PathBuf>,
    /// Delay function of the roads that congest, unless the table says another.
    pub delay: Delay,
    /// Hours in which demand and capacity count vehicles, for Akcelik's function; one, if it is not said.
    pub period_hours: Option<f64>,
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
            classes: None,
            links: None,
            delay: Delay::default(),
            period_hours: None,
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
    pub fn import(&self) -> Result<AssignInput> {
        check_not_negative("demand_factor", self.demand_factor)?;
        check_not_negative("toll_weight", self.weights.toll)?;
        check_not_negative("distance_weight", self.weights.distance)?;
        let hours = self.period_hours.unwrap_or(1.0);
        if !(hours > 0.0 && hours <= MOST_HOURS) {
            let expected = format!("more than 0 and at most {MOST_HOURS} hours");
            return Err(Error::input("delay_period", hours, expected));
        }
        if self.period_hours.is_some() && self.links.is_none() && !matches!(self.delay, Delay::Akcelik(_)) {
            let expected = "none: it is a part of Akcelik's delay";
            return Err(Error::input("delay_period", hours, expected));
        }
        let options = ImportOptions {
            weights: self.weights,
            ..self.import.clone()
        };
        let mut input = match (&self.net, &self.classes) {
            (None, _) => self.grid()?.into(),
            (Some(net), None) => formats::import(net, self.trips.as_deref(), &options)?.into(),
            (Some(net), Some(classes)) => self.import_classes(net, classes, &options)?,
        };
        let names: Vec<&str> = input.classes.iter().map(|class| class.name.as_str()).collect();
        let table = match &self.links {
            Some(path) => {
                let text = text::read(path)?;
                LinkTable::read(
                    &text,
                    &input.network,
                    &input.roads.names,
                    &names,
                    &mut input.report,
                )?
            }
            None => LinkTable::default(),
        };
        let period = hours * HOUR / input.roads.seconds;
        input.network = table.apply(input.network, self.delay, period)?;
        if let Delay::Akcelik(_) = self.delay {
            let text = format!("a period of {hours} h is {period} units of travel time");
            input.report.say(NoteKind::Unit, "delay", text);
        }
        for (index, class) in input.classes.iter().enumerate() {
            let rules = table.rules().get(index).cloned().unwrap_or_default();
            let weight = class.toll_weight(&input.roads);
            let text = format!("a unit of toll costs {weight} units of travel time");
            let place = format!("class {}", class.name);
            input.report.say(NoteKind::Unit, place, text);
            input
                .demands
                .push(class.demand(&input.network, &rules, &mut input.report)?);
            input.rules.push(rules);
        }
        for demand in &mut input.demands {
            demand.scale(self.demand_factor)?;
        }
        Ok(input)
    }

    /// The network for a file of classes.
    fn import_classes(&self, net: &Path, classes: &Path, options: &ImportOptions) -> Result<AssignInput> {
        let one = [
            (
                "trips",
                self.trips.as_ref().map(|trips| trips.display().to_string()),
            ),
            ("matrix", options.matrix.clone()),
        ];
        if let Some((name, Some(found))) = one.into_iter().find(|(_, given)| given.is_some()) {
            let expected = "none with classes, which have trips of their own";
            return Err(Error::input(name, found, expected));
        }
        if self.weights != CostWeights::default() {
            let expected = "none with classes, which have weights of their own";
            return Err(Error::input("toll and distance weights", "some", expected));
        }
        let read = formats::import_network(net, options)?;
        Ok(AssignInput {
            network: read.network,
            roads: read.roads,
            report: read.report,
            classes: vehicle_classes::read(classes)?,
            demands: Vec::new(),
            rules: Vec::new(),
        })
    }

    /// The assignment of what was read.
    ///
    /// # Errors
    /// Trips without a path, unless they are to be left out; with [`strict`](Self::strict) a warning.
    pub fn assignment(&self, input: AssignInput) -> Result<Assignment> {
        let gap = self.gap.unwrap_or(match self.algorithm {
            Algorithm::PathBased => 1e-10,
            _ => 1e-4,
        });
        check_not_negative("gap", gap)?;
        let AssignInput {
            network,
            roads,
            mut report,
            classes,
            mut demands,
            rules,
        } = input;
        for (index, demand) in demands.iter_mut().enumerate() {
            let place = match classes.get(index) {
                Some(class) => format!("trips of class {}", class.name),
                None => "trips".to_owned(),
            };
            demand.settle(&place, self.unreachable, &mut report)?;
        }
        if self.strict {
            report.refuse_warnings()?;
        }
        let described = classes.iter().zip(&demands).zip(&rules);
        let classes: Vec<VehicleClass> = described
            .map(|((class, demand), rules)| class.class(demand, rules, &roads))
            .collect();
        let demand = match demands.first() {
            Some(read) if classes.is_empty() => read.demand.clone(),
            _ => {
                let in_cars = classes
                    .iter()
                    .map(|class| class.demand.scaled(class.passenger_car_equivalent));
                Demand::merged(&in_cars.collect::<Result<Vec<_>>>()?)?
            }
        };
        Ok(Assignment {
            network,
            demand,
            classes,
            roads,
            lost: demands.into_iter().flat_map(|read| read.lost).collect(),
            report,
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
        for (name, path) in [("trips", &self.trips), ("classes", &self.classes)] {
            if let Some(path) = path {
                let expected = "none with the grid, which brings its own demand";
                return Err(Error::input(name, path.display(), expected));
            }
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

/// What files said, trips without a path included.
#[derive(Debug)]
pub struct AssignInput {
    network: Network,
    roads: RoadData,
    report: ImportReport,
    /// Empty where all vehicles are alike.
    classes: Vec<ClassDescription>,
    /// That of each class, or the only one.
    demands: Vec<ImportedDemand>,
    /// Of each class.
    rules: Vec<ClassRules>,
}

impl AssignInput {
    /// Trips without a path or without a zone, with the names of their classes, which are empty where all vehicles are alike.
    pub fn lost(&self) -> impl Iterator<Item = (&str, &LostTrips)> {
        let demands = self.demands.iter().enumerate();
        demands.flat_map(|(index, read)| {
            let class = self.classes.get(index).map_or("", |class| class.name.as_str());
            read.lost.iter().map(move |lost| (class, lost))
        })
    }
}

impl From<Import> for AssignInput {
    fn from(import: Import) -> Self {
        Self {
            network: import.network,
            roads: import.roads,
            report: import.report,
            classes: Vec::new(),
            demands: vec![import.trips],
            rules: Vec::new(),
        }
    }
}

/// A network, its demand, and how to solve it.
#[derive(Clone, Debug)]
pub struct Assignment {
    /// The roads.
    pub network: Network,
    /// Who drives on them, in passenger cars.
    pub demand: Demand,
    /// The classes of vehicles; empty where all are alike.
    pub classes: Vec<VehicleClass>,
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
    /// Solves it, from path flows if there are any: those of each class, or the only ones. `observe` hears of every iteration.
    /// Where all vehicles are alike, all that there is stands under `total`.
    ///
    /// # Errors
    /// As [`assign_observed`], [`assign_from`] and [`assign_classes`].
    pub fn solve(&self, start: &[PathFlows], observe: &mut Observe<'_>) -> Result<ClassSolution> {
        let Self {
            network,
            demand,
            classes,
            options,
            ..
        } = self;
        if !classes.is_empty() {
            let start: Vec<&PathFlows> = start.iter().collect();
            return assign_classes(network, classes, options, &start, observe);
        }
        let total = match start {
            [paths, ..] => assign_from(network, demand, options, paths, observe)?,
            [] => assign_observed(network, demand, options, observe)?,
        };
        Ok(ClassSolution {
            total,
            classes: Vec::new(),
        })
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
    pub fn to_json(&self, ClassSolution { total, classes }: &ClassSolution) -> Value {
        let mut object = self.total_json(total, classes);
        if !classes.is_empty() {
            let classes = self.classes.iter().zip(classes);
            object["classes"] = classes
                .map(|(class, flows)| self.class_json(class, flows))
                .collect();
        }
        object
    }

    /// What a class does.
    fn class_json(&self, class: &VehicleClass, flows: &ClassFlows) -> Value {
        let totals = self.totals(class, flows);
        json!({
            "name": flows.name,
            "passenger_car_equivalent": class.passenger_car_equivalent,
            "pairs": class.demand.pairs(),
            "total_demand": class.demand.total(),
            "intrazonal_demand": class.demand.intrazonal(),
            "paths": flows.path_flows.len(),
            "total_time": totals.time,
            "total_toll": totals.toll,
            "total_distance": totals.distance,
            "total_cost": totals.cost,
        })
    }

    /// What the vehicles of a class spend.
    pub fn totals(&self, class: &VehicleClass, flows: &ClassFlows) -> ClassTotals {
        let mut totals = ClassTotals::default();
        for (index, link) in self.network.links().iter().enumerate() {
            let (flow, cost) = (flows.link_flows[index], flows.link_costs[index]);
            let toll = class.tolls.as_ref().map_or(link.toll, |tolls| tolls[index]);
            let surcharge = class.weights.toll * toll + class.weights.distance * link.length;
            totals.time += flow * (cost - surcharge);
            totals.toll += flow * toll;
            totals.distance += flow * link.length;
            totals.cost += flow * cost;
        }
        totals
    }

    /// Travel time of all vehicles in passenger cars, without what tolls and distance cost them.
    pub fn total_time(&self, solution: &Solution) -> f64 {
        let times = solution.link_flows.iter().zip(self.link_times(solution));
        times.map(|(flow, time)| flow * time).sum()
    }

    /// Travel time on each link, in file order, without what tolls and distance cost.
    pub fn link_times(&self, solution: &Solution) -> impl Iterator<Item = f64> {
        let weights = if self.classes.is_empty() {
            self.network.weights()
        } else {
            CostWeights::default()
        };
        let links = self.network.links().iter().zip(&solution.link_costs);
        links.map(move |(link, cost)| cost - weights.toll * link.toll - weights.distance * link.length)
    }

    /// What the demand counts.
    pub fn unit_of_demand(&self) -> &'static str {
        if self.classes.is_empty() {
            "vehicles"
        } else {
            "passenger cars"
        }
    }

    /// What flows times costs add up to: time alone where neither tolls nor distance weigh.
    pub fn name_of_total(&self) -> &'static str {
        let of_classes = self.classes.iter().map(|class| class.weights);
        let mut weights = of_classes.chain([self.network.weights()]);
        if weights.all(|weights| weights == CostWeights::default()) {
            "total travel time"
        } else {
            "total cost"
        }
    }

    fn total_json(&self, solution: &Solution, classes: &[ClassFlows]) -> Value {
        let Self {
            network,
            demand,
            options,
            ..
        } = self;
        let state = TrafficState::of(network, demand, &solution.link_flows);
        let of_classes: usize = classes.iter().map(|class| class.path_flows.len()).sum();
        let paths = solution.path_flows.len() + of_classes;
        json!({
            "relative_gap": solution.relative_gap,
            "gap_asked_for": options.gap,
            "objective": solution.objective,
            "total_travel_time": solution.total_travel_time,
            "total_time": self.total_time(solution),
            "mean_v_over_c": state.mean_volume_over_capacity,
            "max_v_over_c": state.max_volume_over_capacity,
            "iterations": solution.iterations,
            "converged": solution.converged,
            "stopped": stop_name(solution.stopped),
            "paths": paths,
            "links": network.links().len(),
            "zones": network.numbering().zones,
            "pairs": demand.pairs(),
            "total_demand": demand.total(),
            "intrazonal_demand": demand.intrazonal(),
        })
    }
}

/// Sums over all vehicles of a class.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClassTotals {
    /// Travel time.
    pub time: f64,
    /// What it pays.
    pub toll: f64,
    /// How far it drives.
    pub distance: f64,
    /// Time, toll and distance at its own weights, in units of time.
    pub cost: f64,
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
