//! Several classes of vehicles on the same roads: cars, vans and lorries, each with its own demand, tolls, value of time and bans.
//!
//! All meet the same travel times, which depend on their flows together, in passenger cars. What a link costs one class beyond
//! that time, toll and distance at its own value of time, depends on no flow. The equilibrium, in which no vehicle of any class
//! gains by changing route, then minimises the sum of the integrals of the travel times and of these surcharges, each class
//! weighed by its passenger-car equivalent (Dafermos, "The Traffic Assignment Problem for Multiclass-User Transportation
//! Networks", Transportation Science 6, 1972). The minimum determines link flows of all classes together, and the time of every
//! link; where two classes could swap routes, it does not determine who takes which.

use crate::demand::Demand;
use crate::network::Network;
use crate::path_flows::PathFlows;
use crate::problem::{Class, Problem, Progress};
use crate::volume_delay::VolumeDelay;
use crate::{Algorithm, CostWeights, Observe, Options, Solution, path_based};
use kit::error::{Error, Result};

/// Vehicles that are alike.
#[derive(Debug, Clone)]
pub struct VehicleClass {
    /// What results and errors call it.
    pub name: String,
    /// Its trips, in vehicles.
    pub demand: Demand,
    /// As how many passenger cars one of its vehicles counts on the road.
    pub passenger_car_equivalent: f64,
    /// What toll and distance cost it, in units of time: the first is one over its value of time.
    pub weights: CostWeights,
    /// What it pays per link, in file order; otherwise the links' own tolls.
    pub tolls: Option<Vec<f64>>,
    /// Links, as indices from 0, that it may not use.
    pub banned_links: Vec<u32>,
}

/// How a class drives.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassFlows {
    /// The class's name.
    pub name: String,
    /// Its vehicles per unit of time on each link, in file order.
    pub link_flows: Vec<f64>,
    /// What a link costs one of its vehicles: time, toll and distance, also where it is banned.
    pub link_costs: Vec<f64>,
    /// The paths that its trips take.
    pub path_flows: PathFlows,
}

/// Flows of all classes.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassSolution {
    /// All together: flows in passenger cars, costs as travel times alone, no paths. Gap, objective and total count every
    /// class's own costs, weighed by its passenger-car equivalent.
    pub total: Solution,
    /// Each class, in the order given.
    pub classes: Vec<ClassFlows>,
}

impl VehicleClass {
    fn check(&self, network: &Network) -> Result<()> {
        let place = |what: &str| format!("class {}: {what}", self.name);
        let equivalent = self.passenger_car_equivalent;
        if !(equivalent.is_finite() && equivalent > 0.0) {
            let expected = "a positive number";
            return Err(Error::input(
                place("passenger_car_equivalent"),
                equivalent,
                expected,
            ));
        }
        if self.demand.total() == 0.0 {
            let expected = "trips between zones of the network";
            return Err(Error::input(place("demand"), "no trips", expected));
        }
        for (what, weight) in [
            ("toll weight", self.weights.toll),
            ("distance weight", self.weights.distance),
        ] {
            crate::link::check_not_negative(&place(what), weight)?;
        }
        let links = network.links().len();
        if let Some(tolls) = &self.tolls {
            if tolls.len() != links {
                let expected = format!("{links}, one per link");
                return Err(Error::input(place("tolls"), tolls.len(), expected));
            }
            for (number, &toll) in (1..).zip(tolls) {
                crate::link::check_not_negative(&place(&format!("toll of link {number}")), toll)?;
            }
        }
        let dearest: f64 = self.surcharges(network).iter().sum();
        if !(dearest * self.demand.total() * self.passenger_car_equivalent).is_finite() {
            let expected = "tolls of a usual size";
            return Err(Error::input(place("tolls"), "costs that overflow", expected));
        }
        if let Some(link) = self.banned_links.iter().find(|&&link| link as usize >= links) {
            let expected = format!("a link below {links}");
            return Err(Error::input(place("banned links"), link, expected));
        }
        Ok(())
    }

    /// Per link, what it pays beyond the travel time.
    fn surcharges(&self, network: &Network) -> Vec<f64> {
        let links = network.links().iter().enumerate();
        links
            .map(|(index, link)| {
                let toll = self.tolls.as_ref().map_or(link.toll, |tolls| tolls[index]);
                self.weights.toll * toll + self.weights.distance * link.length
            })
            .collect()
    }

    /// Refuses paths on which it may not drive.
    fn check_start(&self, network: &Network, start: &PathFlows) -> Result<()> {
        start.check(network)?;
        let banned = |link: &u32| self.banned_links.contains(link);
        match start
            .iter()
            .find_map(|path| path.links.iter().copied().find(banned))
        {
            None => Ok(()),
            Some(link) => {
                let place = format!("class {}: start", self.name);
                let found = format!("a path on link {}", link + 1);
                Err(Error::input(place, found, "no path on a banned link"))
            }
        }
    }
}

/// Assigns the demands of all `classes` together: to [`Objective::UserEquilibrium`](crate::Objective), in which no vehicle of
/// any class gains by changing route, or to the system optimum of costs weighed by passenger-car equivalents. The network's own
/// [weights](Network::weights) count for nothing. `start` is empty, or has for each class the paths of an earlier solution.
///
/// # Errors
/// As [`assign`](crate::assign()) and [`assign_from`](crate::assign_from); and [`Error::Input`], naming the class, for one without
/// demand, a passenger-car equivalent that is not positive, tolls for other links than the network's, an unknown banned link, an
/// algorithm that is not path-based, or a `start` for another number of classes.
pub fn assign_classes(
    network: &Network,
    classes: &[VehicleClass],
    options: &Options,
    start: &[&PathFlows],
    observe: &mut Observe<'_>,
) -> Result<ClassSolution> {
    options.check()?;
    if options.algorithm != Algorithm::PathBased {
        let expected = "the path-based one: the others know one class";
        return Err(Error::input("algorithm for classes", "Frank-Wolfe", expected));
    }
    if classes.is_empty() {
        return Err(Error::input("classes", "none", "at least one"));
    }
    if !start.is_empty() && start.len() != classes.len() {
        let expected = format!("paths of {} classes", classes.len());
        return Err(Error::input(
            "start",
            format!("paths of {}", start.len()),
            expected,
        ));
    }
    for class in classes {
        class.check(network)?;
    }
    for (class, start) in classes.iter().zip(start) {
        class.check_start(network, start)?;
    }
    let times: Vec<VolumeDelay> = network.times()?;
    let in_cars = |class: &VehicleClass| class.demand.scaled(class.passenger_car_equivalent);
    let demands: Vec<Demand> = classes.iter().map(in_cars).collect::<Result<_>>()?;
    let drivers = classes.iter().zip(&demands).map(|(class, demand)| Class {
        name: &class.name,
        demand,
        surcharges: class.surcharges(network),
        banned_links: &class.banned_links,
    });
    let problem = Problem::with_classes(network, &times, drivers.collect(), options)?;
    let mut progress = Progress::new(options, observe);
    let start = if start.is_empty() {
        path_based::Start::Nothing
    } else {
        path_based::Start::Paths(start)
    };
    let (class_flows, mut blocks) = path_based::solve(&problem, start, &mut progress)?;
    let mut link_flows = vec![0.0; network.links().len()];
    for flows in &class_flows {
        for (total, flow) in link_flows.iter_mut().zip(flows) {
            *total += flow;
        }
    }
    let surcharges = problem.surcharges(&class_flows);
    let link_times = network.costs(&times, &link_flows);
    let mut total = progress.into_solution(link_times, link_flows, PathFlows::default());
    total.total_travel_time += surcharges;
    let mut results = Vec::with_capacity(classes.len());
    for (index, (class, flows)) in classes.iter().zip(class_flows).enumerate() {
        let others = blocks
            .iter()
            .position(|block| block.class != index)
            .unwrap_or(blocks.len());
        let own = blocks.drain(..others);
        let equivalent = class.passenger_car_equivalent;
        let costs = total.link_costs.iter().zip(&problem.classes[index].surcharges);
        results.push(ClassFlows {
            name: class.name.clone(),
            path_flows: path_based::path_flows(&demands[index], own, equivalent),
            link_flows: flows.iter().map(|flow| flow / equivalent).collect(),
            link_costs: costs.map(|(time, surcharge)| time + surcharge).collect(),
        });
    }
    Ok(ClassSolution {
        total,
        classes: results,
    })
}
