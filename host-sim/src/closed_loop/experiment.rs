//! A loop from its description to its JSON object: what `host-sim loop` and the points of a sweep run.

use super::{CaseResult, LoopOptions, LoopSummary, PolicyResult, Progress, Roads, built_in, closed_loop};
use crate::journeys::TrafficModel;
use crate::journeys::sumo::{Programs, SumoTraffic};
use crate::journeys::town::{Town, Units};
use crate::policy::{KINDS, Kind, actor, age_threshold, assigned, central};
use crate::scenario::{Scenario, ScenarioSource};
use crate::weight_table::WeightTable;
use assignment::coordinates::NodePlaces;
use assignment::formats::{Import, ImportOptions};
use assignment::imported_demand::Unreachable;
use assignment::report::ImportReport;
use assignment::{CostWeights, Demand, Network, formats};
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// How many hours a loop may have (chosen).
pub const WORLDS: RangeInclusive<u32> = 1..=100_000;

/// Hours unless said (chosen: under a minute on two cores).
pub const DEFAULT_WORLDS: u32 = 12;

/// Policies unless said: the bound, the network, what a timetable does, and random access by age.
pub static POLICIES: [&Kind; 4] = [
    &central::KIND,
    &actor::KIND,
    &assigned::KIND,
    &age_threshold::KIND,
];

/// Delays of knowledge unless said, in s.
const DELAYS_S: [f64; 4] = [1.0, 10.0, 60.0, 300.0];

/// Longest delay that can be asked for, in s.
const MOST_DELAY_S: f64 = 86_400.0;

/// Keys of a cell that moves its own vehicles; here trips and traffic do.
const WITHOUT_EFFECT: [&str; 12] = [
    "cell.vehicles",
    "traffic.trips_per_pair_veh_per_h",
    "mobility.min_speed_m_per_s",
    "mobility.max_speed_m_per_s",
    "mobility.turns",
    "mobility.turn_probability",
    "mobility.left_turn_share",
    "mobility.right_turn_share",
    "mobility.signal_cycle_s",
    "mobility.signal_red_share",
    "mobility.queue_spacing_m",
    "mobility.standing_share",
];

/// Keys of loaded networks.
const WITHOUT_NETWORK: [&str; 1] = ["planning.station_spacing_m"];

/// Keys of the grid.
const WITHOUT_GRID: [&str; 2] = [
    "planning.lane_capacity_veh_per_h",
    "planning.trips_per_pair_veh_per_h",
];

kit::choices! {
    /// Who moves the vehicles of a loop.
    pub enum Traffic {
        /// Queues with storage and spill-back; nothing to install
        BuiltIn = "built-in",
        /// SUMO, a process for each hour at a time
        Sumo = "sumo",
    }
}

/// Where a loop comes from. What is left out has a default.
#[derive(Clone, Debug)]
pub struct LoopSource {
    /// The cell and what happens on the roads.
    pub scenario: ScenarioSource,
    /// Which policies, in the order of [`KINDS`]; otherwise four.
    pub policies: Vec<&'static Kind>,
    /// The actor's table; otherwise the one that is built into the firmware.
    pub table: Option<PathBuf>,
    /// Independent hours.
    pub worlds: u32,
    /// Delays of knowledge to look at besides, in s; otherwise four.
    pub delays_s: Option<Vec<f64>>,
    /// Who moves the vehicles.
    pub traffic: Traffic,
    /// A network in any of the [`formats`]; otherwise the scenario's grid.
    pub net: Option<PathBuf>,
    /// The network's trips an hour.
    pub trips: Option<PathBuf>,
    /// Where the nodes of a TNTP network lie, if not in the file beside it.
    pub nodes: Option<PathBuf>,
    /// Metres for each unit of the network's coordinates.
    pub metres_per_unit: Option<f64>,
    /// Seconds for each unit of the network's travel times.
    pub seconds_per_unit: Option<f64>,
    /// What toll and distance cost.
    pub weights: CostWeights,
    /// What happens to trips that no path serves.
    pub unreachable: Unreachable,
    /// Seed of the hours.
    pub seed: u64,
}

impl Default for LoopSource {
    fn default() -> Self {
        Self {
            scenario: ScenarioSource::default(),
            policies: Vec::new(),
            table: None,
            worlds: DEFAULT_WORLDS,
            delays_s: None,
            traffic: Traffic::BuiltIn,
            net: None,
            trips: None,
            nodes: None,
            metres_per_unit: None,
            seconds_per_unit: None,
            weights: CostWeights::default(),
            unreachable: Unreachable::Fail,
            seed: 1,
        }
    }
}

impl LoopSource {
    /// Reads and checks all input; [`LoopExperiment::town`] solves the rest.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn read(&self) -> Result<LoopExperiment> {
        let policies: Vec<&'static Kind> = if self.policies.is_empty() {
            POLICIES.to_vec()
        } else {
            let asked = |policy: &&'static Kind| self.policies.contains(policy);
            KINDS.iter().copied().filter(asked).collect()
        };
        let scenario = self.scenario.read()?;
        if !WORLDS.contains(&self.worlds) {
            let expected = format!("{} to {}", WORLDS.start(), WORLDS.end());
            return Err(Error::input("worlds", self.worlds, expected));
        }
        let delays_s = self.delays_s.clone().unwrap_or(DELAYS_S.to_vec());
        let too_long = |delay: &&f64| !(0.0..=MOST_DELAY_S).contains(*delay);
        if let Some(delay) = delays_s.iter().find(too_long) {
            return Err(Error::input("delay", delay, format!("0 to {MOST_DELAY_S} s")));
        }
        let twice = |&(n, delay): &(usize, &f64)| delays_s[..n].contains(delay);
        if let Some((_, delay)) = delays_s.iter().enumerate().find(twice) {
            return Err(Error::input("delay", format!("{delay} twice"), "each once"));
        }
        let of_the_other = match self.net {
            None => &WITHOUT_NETWORK[..],
            Some(_) => &WITHOUT_GRID,
        };
        let useless = WITHOUT_EFFECT.iter().chain(of_the_other);
        if let Some(key) = useless.copied().find(|key| self.scenario.sets_alone(key)) {
            let expected = "a key that the loop has a use for here: its vehicles move as traffic moves them";
            return Err(Error::input("setting", key, expected));
        }
        let table = WeightTable::read_or_built_in(self.table.as_deref())?;
        for policy in &policies {
            // How many vehicles a cell will have turns out on the road.
            policy.check(&scenario, 1, &table.parse()?)?;
        }
        Ok(LoopExperiment {
            loaded: self.loaded()?,
            programs: match self.traffic {
                Traffic::BuiltIn => None,
                Traffic::Sumo => Some(Programs::find()?),
            },
            scenario,
            policies,
            table,
            worlds: self.worlds,
            delays_s,
            traffic: self.traffic,
            seed: self.seed,
        })
    }

    /// The network, if there is one; what only it has a use for is refused without it.
    fn loaded(&self) -> Result<Option<LoadedNetwork>> {
        let Some(net) = &self.net else {
            let useless = [
                ("trips", self.trips.is_some()),
                ("nodes", self.nodes.is_some()),
                ("metres_per_unit", self.metres_per_unit.is_some()),
                ("seconds_per_unit", self.seconds_per_unit.is_some()),
                ("toll_weight", self.weights.toll != 0.0),
                ("distance_weight", self.weights.distance != 0.0),
            ];
            return match useless.iter().find(|(_, given)| *given) {
                Some((name, _)) => Err(Error::input(
                    name,
                    "no net beside it",
                    "both, or none with the grid",
                )),
                None => Ok(None),
            };
        };
        let options = ImportOptions {
            weights: self.weights,
            // Its crossings hold nobody up, and its zones are places where vehicles set out.
            without_turns: true,
            ..ImportOptions::default()
        };
        let mut import = formats::import(net, self.trips.as_deref(), &options)?;
        import.settle(self.unreachable)?;
        let Import {
            network,
            trips,
            report,
            ..
        } = import;
        Ok(Some(LoadedNetwork {
            net: net.clone(),
            trips: self.trips.clone(),
            report,
            nodes: formats::read_places(net, self.nodes.as_deref(), &network)?,
            units: Units {
                metres_per_coordinate: self.metres_per_unit,
                seconds_per_time: match self.seconds_per_unit {
                    Some(seconds) => seconds,
                    None => formats::Format::of(net)?.seconds_per_unit(),
                },
            },
            network,
            demand: trips.demand,
        }))
    }
}

/// A network from files.
#[derive(Debug)]
struct LoadedNetwork {
    net: PathBuf,
    trips: Option<PathBuf>,
    report: ImportReport,
    network: Network,
    demand: Demand,
    nodes: NodePlaces,
    units: Units,
}

/// Everything that a loop needs, read and checked.
#[derive(Debug)]
pub struct LoopExperiment {
    /// The cell and what happens on the roads.
    pub scenario: Scenario,
    /// Which policies, in the order of their results.
    pub policies: Vec<&'static Kind>,
    /// The actor's table.
    pub table: WeightTable,
    /// Independent hours.
    pub worlds: u32,
    /// Delays of knowledge to look at besides, in s.
    pub delays_s: Vec<f64>,
    /// Who moves the vehicles.
    pub traffic: Traffic,
    /// Seed of the hours.
    pub seed: u64,
    /// SUMO, if it moves the vehicles.
    programs: Option<Programs>,
    loaded: Option<LoadedNetwork>,
}

impl LoopExperiment {
    /// The files that the roads come from, and what one of their units of time is in seconds.
    pub fn files(&self) -> Option<(&Path, Option<&Path>, f64)> {
        let loaded = self.loaded.as_ref()?;
        Some((
            &loaded.net,
            loaded.trips.as_deref(),
            loaded.units.seconds_per_time,
        ))
    }

    /// What was assumed of the network's files; nothing of the grid.
    pub fn report(&self) -> Option<&ImportReport> {
        self.loaded.as_ref().map(|loaded| &loaded.report)
    }

    /// The roads with their usual ways, whose equilibrium is solved here.
    ///
    /// # Errors
    /// As [`Town::of_grid`] and [`Town::of_network`].
    pub fn town(&self) -> Result<Town> {
        match &self.loaded {
            None => Town::of_grid(&self.scenario),
            Some(loaded) => Town::of_network(
                loaded.network.clone(),
                &loaded.demand,
                &loaded.nodes,
                loaded.units,
                &self.scenario.planning,
            ),
        }
    }

    /// Runs all hours of a [town](Self::town) on the current rayon pool. `progress` is called from any thread.
    ///
    /// # Errors
    /// As [`closed_loop`].
    pub fn summary(&self, town: &Town, progress: impl Fn(Progress) + Sync) -> Result<LoopSummary> {
        let table = self.table.parse()?;
        let options = LoopOptions {
            scenario: &self.scenario,
            seed: self.seed,
            worlds: self.worlds,
            policies: &self.policies,
            table: &table,
            delays_s: &self.delays_s,
        };
        match &self.programs {
            None => closed_loop(town, &options, &built_in, progress),
            Some(programs) => closed_loop(town, &options, &|roads| sumo(programs, roads), progress),
        }
    }

    /// The JSON object of a loop.
    pub fn to_json(&self, town: &Town, summary: &LoopSummary) -> Value {
        let no_information = summary.no_information.beyond(&summary.detected);
        json!({
            "traffic": self.traffic.name(),
            "seed": self.seed,
            "worlds": self.worlds,
            "roads": town.map().roads().len(),
            "base_stations": town.stations_m().len(),
            "network": self.files().map(|(net, trips, seconds)| json!({
                "net": net,
                "trips": trips,
                "seconds_per_unit": seconds,
            })),
            "metres_per_unit": town.metres_per_coordinate(),
            "max_v_over_c_of_usual_ways": town.most_v_over_c(),
            "vehicles": summary.detected.vehicles,
            "connected_in_cell": summary.connected_in_cell.0,
            "most_connected_in_cell": summary.connected_in_cell.1,
            "cases": {
                "all_obey": case_json(&summary.all_obey),
                "full_knowledge": case_json(&summary.full_knowledge),
                "covered": case_json(&summary.covered),
                "detected": case_json(&summary.detected),
                "no_information": with(
                    case_json(&summary.no_information),
                    json!({"trip_loss_s": no_information.0, "trip_loss_ci95_s": no_information.1}),
                ),
            },
            "delayed": summary.delayed.iter().map(|(delay_s, result)| {
                let loss = result.beyond(&summary.detected);
                with(
                    case_json(result),
                    json!({"delay_s": delay_s, "trip_loss_s": loss.0, "trip_loss_ci95_s": loss.1}),
                )
            }).collect::<Vec<Value>>(),
            "scenario": self.scenario,
            "policies": summary.policies.iter().map(|policy| policy_json(summary, policy)).collect::<Vec<Value>>(),
        })
    }
}

/// A SUMO of its own for an hour.
fn sumo<'r>(programs: &Programs, roads: &Roads<'r>) -> Result<Box<dyn TrafficModel + 'r>> {
    let traffic = SumoTraffic::start(programs, roads.map, roads.incidents.clone(), roads.seed)?;
    Ok(Box::new(traffic))
}

fn case_json(result: &CaseResult) -> Value {
    json!({
        "mean_travel_time_s": result.trip_time_s.0,
        "mean_travel_time_ci95_s": result.trip_time_s.1,
        "world_mean_travel_time_s": result.by_world_s(),
        "vehicles": result.vehicles,
        "waiting_vehicles": result.waiting,
        "trips": result.trips,
        "queued_vehicles": result.queued.0,
        "queued_vehicles_ci95": result.queued.1,
        "road_age_s": result.road_age_s,
        "mean_v_over_c": result.v_over_c,
        "unfinished_share": result.unfinished,
        "let_through_per_trip": result.let_through,
    })
}

fn policy_json(summary: &LoopSummary, policy: &PolicyResult) -> Value {
    let loss = summary.loss(policy);
    let ages = policy.ages.as_ref();
    let regret = policy.result.beyond(&summary.full_knowledge);
    with(
        case_json(&policy.result),
        json!({
            "policy": policy.policy.name,
            "mean_age_ms": ages.map(|ages| ages.mean_ms),
            "mean_age_ci95_ms": ages.and_then(|ages| ages.ci95_ms),
            "uncapped_mean_age_ms": ages.map(|ages| ages.uncapped_mean_ms),
            "p99_age_ms": ages.map(|ages| ages.p99_ms),
            "regret_s_per_trip": regret.0,
            "regret_ci95_s_per_trip": regret.1,
            "trip_loss_s": {
                "obedience": loss.obedience.0,
                "obedience_ci95": loss.obedience.1,
                "coverage": loss.coverage.0,
                "coverage_ci95": loss.coverage.1,
                "detection": loss.detection.0,
                "detection_ci95": loss.detection.1,
                "radio": loss.radio.0,
                "radio_ci95": loss.radio.1,
                "protocol": loss.protocol.0,
                "protocol_ci95": loss.protocol.1,
            },
        }),
    )
}

/// One object with more keys.
fn with(mut object: Value, more: Value) -> Value {
    if let (Value::Object(object), Value::Object(more)) = (&mut object, more) {
        object.extend(more);
    }
    object
}
