//! An experiment: policies on the same worlds, from its description to its results.

use crate::age::AgeSummary;
use crate::environment::Environment;
use crate::mobility::{MobilitySource, check_slots};
use crate::policy::{KINDS, Kind};
use crate::scenario::{Scenario, ScenarioSource};
use crate::simulation::{Extent, Simulation};
use crate::traffic::{TrafficModel, TrafficSummary};
use crate::weight_table::WeightTable;
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Instant;

/// How many worlds an experiment may have (chosen).
pub const WORLDS: RangeInclusive<u32> = 1..=1_000_000;

/// How many slots of each may count (chosen: a day and more).
pub const SLOTS: RangeInclusive<u32> = 1..=100_000_000;

/// How many slots may come before them (chosen).
pub const WARMUP: RangeInclusive<u32> = 0..=100_000_000;

/// Where an experiment comes from. What is left out has a default.
#[derive(Clone, Debug)]
pub struct ExperimentSource {
    /// The cell.
    pub scenario: ScenarioSource,
    /// Vehicles in the cell; otherwise the scenario's.
    pub vehicles: Option<u32>,
    /// What moves the vehicles: `grid`, or a file of SUMO floating-car data.
    pub mobility: String,
    /// Which policies; all if there is none.
    pub policies: Vec<&'static Kind>,
    /// The actor's table; otherwise the one that is built into the firmware.
    pub table: Option<PathBuf>,
    /// Independent worlds; otherwise 256, and 8 with a trace.
    pub worlds: Option<u32>,
    /// Slots that count; otherwise 2,000, and with a trace those to its end.
    pub slots: Option<u32>,
    /// Slots before them.
    pub warmup: u32,
    /// Seed of the worlds.
    pub seed: u64,
}

impl Default for ExperimentSource {
    fn default() -> Self {
        Self {
            scenario: ScenarioSource::default(),
            vehicles: None,
            mobility: "grid".to_owned(),
            policies: Vec::new(),
            table: None,
            worlds: None,
            slots: None,
            warmup: 500,
            seed: 1,
        }
    }
}

impl ExperimentSource {
    /// Reads and checks all input.
    ///
    /// # Errors
    /// The first that does not fit.
    #[cfg(feature = "program")]
    pub fn read(&self) -> Result<Experiment> {
        self.read_with(crate::mobility::read_source(&self.mobility)?)
    }

    /// The same with a source of vehicles that is there already; [`mobility`](Self::mobility) counts for nothing.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn read_with(&self, source: Box<dyn MobilitySource>) -> Result<Experiment> {
        let slots = match source.duration_slots() {
            None => 2000,
            Some(slots) => slots.saturating_sub(self.warmup),
        };
        let mut scenario = self.scenario.clone();
        if let Some(vehicles) = self.vehicles {
            if source.duration_slots().is_some() {
                let expected = "no number with a trace, which brings its own vehicles";
                return Err(Error::input("vehicles", vehicles, expected));
            }
            scenario.set("cell.vehicles", vehicles);
        }
        let worlds = self.worlds.unwrap_or_else(|| source.default_worlds());
        let slots = self.slots.unwrap_or(slots);
        if slots == 0 && self.slots.is_none() {
            let expected = "less than the length of the trace in slots";
            return Err(Error::input("warmup", self.warmup, expected));
        }
        for (name, value, range) in [
            ("worlds", worlds, WORLDS),
            ("slots", slots, SLOTS),
            ("warmup", self.warmup, WARMUP),
        ] {
            if !range.contains(&value) {
                let expected = format!("{} to {}", range.start(), range.end());
                return Err(Error::input(name, value, expected));
            }
        }
        let asked = |policy: &&'static Kind| self.policies.is_empty() || self.policies.contains(policy);
        let experiment = Experiment {
            scenario: scenario.read()?,
            source,
            extent: Extent {
                seed: self.seed,
                worlds,
                slots,
                warmup: self.warmup,
            },
            policies: KINDS.iter().copied().filter(asked).collect(),
            table: WeightTable::read_or_built_in(self.table.as_deref())?,
        };
        experiment.check()?;
        Ok(experiment)
    }
}

/// Policies on the same worlds.
#[derive(Debug)]
pub struct Experiment {
    /// The cell.
    pub scenario: Scenario,
    /// What moves its vehicles.
    pub source: Box<dyn MobilitySource>,
    /// How much is simulated.
    pub extent: Extent,
    /// Which policies, in the order of their results.
    pub policies: Vec<&'static Kind>,
    /// The actor's table.
    pub table: WeightTable,
}

/// One policy's result.
pub struct PolicyResult {
    /// Its name.
    pub name: &'static str,
    /// Its ages.
    pub ages: AgeSummary,
    /// What they do to the road; `None` with a trace.
    pub traffic: Option<TrafficSummary>,
    /// Simulated slots (all worlds, warm-up included) per second of wall time.
    pub slots_per_second: f64,
}

impl Experiment {
    /// Checks that the parts fit each other: the source lasts as long as is simulated and passes the base station, and every
    /// policy can serve the cell.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn check(&self) -> Result<()> {
        check_slots(self.source.as_ref(), self.extent.slots_per_world())?;
        self.source.check(&self.scenario)?;
        let table = self.table.parse()?;
        let most = self.source.most_vehicles(&self.scenario);
        let mut policies = self.policies.iter();
        policies.try_for_each(|policy| policy.check(&self.scenario, most, &table))
    }

    /// The worlds.
    pub fn simulation(&self) -> Simulation<'_> {
        Simulation {
            scenario: &self.scenario,
            source: self.source.as_ref(),
            extent: self.extent,
        }
    }

    /// Runs the policies one after the other on the current rayon pool, each on the same worlds. `after_world` hears of every
    /// world that is done, by the name of its policy.
    ///
    /// # Errors
    /// As [`Simulation::run`].
    pub fn results(&self, after_world: impl Fn(&'static str) + Sync) -> Result<Vec<PolicyResult>> {
        let table = self.table.parse()?;
        let traffic = TrafficModel::new(&self.scenario)?;
        let slots = f64::from(self.extent.worlds) * f64::from(self.extent.slots_per_world());
        let result = |policy: &&'static Kind| {
            let start = Instant::now();
            let at_end = |environment: &Environment<'_>, world| {
                after_world(policy.name);
                traffic.road_ages(environment, world)
            };
            let (ages, roads) = self.simulation().run_policy(policy, &table, at_end)?;
            let slots_per_second = slots / start.elapsed().as_secs_f64();
            let roads: Option<Vec<_>> = roads.into_iter().collect();
            let traffic = roads
                .map(|roads| traffic.summary(ages.mean_ms, &roads))
                .transpose()?;
            Ok(PolicyResult {
                name: policy.name,
                ages,
                traffic,
                slots_per_second,
            })
        };
        self.policies.iter().map(result).collect()
    }

    /// The JSON object of a run, the same whenever it is run.
    pub fn to_json(&self, results: &[PolicyResult]) -> Value {
        let vehicles = self.source.vehicles(&self.scenario);
        let policies: Vec<Value> = results
            .iter()
            .map(|result| self.policy_json(vehicles, result))
            .collect();
        json!({
            "seed": self.extent.seed,
            "warmup": self.extent.warmup,
            "bound_age_ms": self.simulation().bound_age_ms(),
            "scenario": self.scenario,
            "policies": policies,
        })
    }

    fn policy_json(&self, vehicles: usize, result: &PolicyResult) -> Value {
        let PolicyResult {
            name,
            ages,
            traffic,
            slots_per_second: _,
        } = result;
        let per_vehicle: Vec<Value> = ages
            .by_vehicle
            .iter()
            .enumerate()
            .map(|(vehicle, mean)| {
                json!({
                    "vehicle": self.source.vehicle_name(vehicle),
                    "slots": mean.count(),
                    "mean_age_ms": mean.value(),
                })
            })
            .collect();
        json!({
            "policy": name,
            "vehicles": vehicles,
            "worlds": self.extent.worlds,
            "slots": self.extent.slots,
            "mean_age_ms": ages.mean_ms,
            "mean_age_ci95_ms": ages.ci95_ms,
            "world_mean_age_ms": ages.by_world_ms,
            "median_world_age_ms": ages.median_world_ms,
            "p99_age_ms": ages.p99_ms,
            "first100_age_ms": ages.first100_ms,
            "success_per_slot": ages.success_per_slot,
            "peak_age_ms": ages.peak_ms,
            "age_above_10_ms": ages.share_above(10),
            "age_above_20_ms": ages.share_above(20),
            "age_above_50_ms": ages.share_above(50),
            "worst_vehicles_ms": ages.worst_vehicles_ms,
            "uncapped_mean_age_ms": ages.uncapped_mean_ms,
            "uncapped_mean_age_ci95_ms": ages.uncapped_ci95_ms,
            "uncapped_worst_vehicles_ms": ages.uncapped_worst_vehicles_ms,
            "transmissions_per_vehicle_slot": ages.transmissions_per_vehicle_slot,
            "energy_mj_per_vehicle_slot": ages.energy_mj_per_vehicle_slot,
            "joiners": ages.joiners.map(|joiners| joiners.count),
            "joiner_first_success_median_slots": ages.joiners.and_then(|joiners| joiners.median_slots),
            "joiner_first_success_p90_slots": ages.joiners.and_then(|joiners| joiners.p90_slots),
            "traffic": traffic.as_ref().map(TrafficSummary::to_json),
            "per_vehicle": per_vehicle,
        })
    }

    /// What moves the vehicles, in a few words.
    pub fn mobility_name(&self) -> String {
        self.source.describe(&self.scenario)
    }

    /// One line on what was simulated.
    pub fn description(&self) -> String {
        let Extent {
            seed,
            worlds,
            slots,
            warmup,
        } = self.extent;
        let who = self.source.describe_vehicles(&self.scenario);
        let sub_channels = self.scenario.radio.sub_channels;
        format!(
            "{who} on {sub_channels} sub-channels, {worlds} worlds x {slots} slots after {warmup}, seed {seed}"
        )
    }
}
