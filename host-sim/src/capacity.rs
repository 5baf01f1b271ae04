//! From age to capacity error, and from capacity error to lost time.
//!
//! The base station plans with the capacities it believes. What it has heard of a road is old, so the road really has
//! less: `Ca = Ca_hat - (A / A_max) dm`, with A the age of what is known, A_max the largest age there is, and dm the
//! capacity lost at that age.

use assignment::{Algorithm, Demand, Network, Options, Solution, assign, assign_from, uninterrupted};
use kit::error::{Error, Result};

/// How capacity error grows with age.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapacityError {
    /// dm: vehicles per unit of time lost at the largest age.
    pub at_max_age: f64,
    /// A_max, in the unit of the ages.
    pub max_age: f64,
}

impl CapacityError {
    /// True capacity of a road that is believed to have `believed`, after `age`.
    ///
    /// # Errors
    /// [`Error::Input`] if `at_max_age` is negative or not finite, `max_age` not positive, the age outside 0 to
    /// `max_age`, or no positive capacity is left.
    pub fn true_capacity(&self, believed: f64, age: f64) -> Result<f64> {
        if !(self.at_max_age.is_finite() && self.at_max_age >= 0.0) {
            let expected = "a finite number, not negative";
            return Err(Error::input("dm", self.at_max_age, expected));
        }
        if !(self.max_age.is_finite() && self.max_age > 0.0) {
            return Err(Error::input("largest age", self.max_age, "a positive number"));
        }
        if !(0.0..=self.max_age).contains(&age) {
            return Err(Error::input("age", age, format!("0 to {}", self.max_age)));
        }
        let capacity = believed - age / self.max_age * self.at_max_age;
        if capacity.is_finite() && capacity > 0.0 {
            return Ok(capacity);
        }
        Err(Error::input(
            "dm",
            self.at_max_age,
            format!(
                "a loss that leaves a positive capacity of {believed} at age {age} of {}",
                self.max_age
            ),
        ))
    }

    /// True capacities where all roads have the same age.
    ///
    /// # Errors
    /// As [`true_capacity`](Self::true_capacity).
    pub fn uniform(&self, believed: &[f64], age: f64) -> Result<Vec<f64>> {
        believed
            .iter()
            .map(|&capacity| self.true_capacity(capacity, age))
            .collect()
    }

    /// True capacities where each road has an age of its own.
    ///
    /// # Errors
    /// As [`true_capacity`](Self::true_capacity), and for another number of ages than of roads.
    pub fn per_road(&self, believed: &[f64], ages: &[f64]) -> Result<Vec<f64>> {
        if ages.len() != believed.len() {
            let expected = format!("{}, one per road", believed.len());
            return Err(Error::input("ages", ages.len(), expected));
        }
        let roads = believed.iter().zip(ages);
        roads
            .map(|(&capacity, &age)| self.true_capacity(capacity, age))
            .collect()
    }
}

/// What traffic is like on a network: plain means over roads, and one over trips.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrafficState {
    /// Flow over true capacity, mean over roads.
    pub mean_volume_over_capacity: f64,
    /// Flow over true capacity of the fullest road.
    pub max_volume_over_capacity: f64,
    /// Travel time of a road, mean over roads.
    pub mean_link_time: f64,
    /// Travel time of a trip: total travel time over vehicles. 0 without demand.
    pub mean_trip_time: f64,
}

impl TrafficState {
    /// What `link_flows` are like on `network`, whose capacities are the true ones.
    pub fn of(network: &Network, demand: &Demand, link_flows: &[f64]) -> Self {
        let link_costs = network.link_costs(link_flows);
        let ratios = network.volume_over_capacity(link_flows);
        let roads = network.roads().len();
        let total: f64 = link_flows.iter().zip(&link_costs).map(|(x, c)| x * c).sum();
        Self {
            mean_volume_over_capacity: quotient(ratios.iter().sum(), roads as f64),
            max_volume_over_capacity: ratios.into_iter().fold(0.0, f64::max),
            mean_link_time: quotient(link_costs[..roads].iter().sum(), roads as f64),
            mean_trip_time: quotient(total, demand.total()),
        }
    }
}

/// A mean that is 0 where there is nothing to take it of.
fn quotient(sum: f64, count: f64) -> f64 {
    if count > 0.0 { sum / count } else { 0.0 }
}

/// What it costs to plan with capacities that are no longer true.
#[derive(Debug, Clone, PartialEq)]
pub struct Staleness {
    /// Flows planned with the believed capacities, on roads with the true ones.
    pub stale: TrafficState,
    /// Flows planned with the true capacities.
    pub informed: TrafficState,
    /// Stale less informed mean trip time: what ignorance costs each trip. Congestion games have their paradoxes, so it
    /// can be negative.
    pub regret_per_trip: f64,
}

/// A base station with its belief of the network, and the flows it plans with it: compares planning on what is believed with
/// planning on what is true.
#[derive(Debug, Clone)]
pub struct Planner {
    network: Network,
    demand: Demand,
    options: Options,
    believed: Vec<f64>,
    planned: Solution,
}

impl Planner {
    /// Plans with the capacities of `network`.
    ///
    /// # Errors
    /// As [`assign`].
    pub fn new(network: Network, demand: Demand, options: Options) -> Result<Self> {
        Ok(Self {
            believed: network.links().iter().map(|link| link.capacity).collect(),
            planned: assign(&network, &demand, &options)?,
            network,
            demand,
            options,
        })
    }

    /// What the planned flows meet where what is known of every road has this age.
    ///
    /// # Errors
    /// As [`CapacityError::uniform`].
    pub fn uniform(&self, age: f64, error: &CapacityError) -> Result<TrafficState> {
        let capacities = error.uniform(&self.believed, age)?;
        let truth = self.network.with_capacities(&capacities)?;
        Ok(TrafficState::of(&truth, &self.demand, &self.planned.link_flows))
    }

    /// The flows planned with the believed capacities.
    pub fn planned(&self) -> &Solution {
        &self.planned
    }

    /// What the planned flows meet, and what informed ones would, when what is known of each road has the given age.
    ///
    /// # Errors
    /// As [`CapacityError::per_road`] and [`assign`].
    pub fn staleness(&self, ages: &[f64], error: &CapacityError) -> Result<Staleness> {
        let capacities = error.per_road(&self.believed, ages)?;
        let truth = self.network.with_capacities(&capacities)?;
        let informed_flows = self.informed(&truth)?.link_flows;
        let stale = TrafficState::of(&truth, &self.demand, &self.planned.link_flows);
        let informed = TrafficState::of(&truth, &self.demand, &informed_flows);
        Ok(Staleness {
            stale,
            informed,
            regret_per_trip: stale.mean_trip_time - informed.mean_trip_time,
        })
    }

    /// Plans with the true capacities, from the flows planned with the believed ones where the algorithm can.
    fn informed(&self, truth: &Network) -> Result<Solution> {
        if self.options.algorithm != Algorithm::PathBased {
            return assign(truth, &self.demand, &self.options);
        }
        let start = &self.planned.path_flows;
        assign_from(truth, &self.demand, &self.options, start, &mut uninterrupted)
    }
}
