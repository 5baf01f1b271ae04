//! The closed loop from slot to street: incidents take capacity, vehicles report it, the base station plans routes on what
//! it last heard, traffic meets what is true.
//!
//! Vehicles drive on the grid or on a loaded network ([`Roads`]). In every slot in which one is received, the base station
//! learns the true capacity of the block that it drives on, in both directions. Of a block without a report it believes what it last heard, at first the full capacity.
//! Every planning period it assigns all trips anew (user equilibrium on believed capacities). The regret is what those
//! routes cost a trip on the true capacities beyond what routes planned on the truth would.

use crate::age::{AgeSummary, WorldAges};
use crate::capacity::TrafficState;
use crate::environment::Environment;
use crate::policy::Kind;
use crate::roads::Roads;
use crate::scenario::PlanningScenario;
use crate::simulation::{Simulation, run_worlds};
use crate::stream::{Purpose, Role, Stream, WorldKey};
use assignment::Network;
use firmware::table::Table;
use kit::error::{Error, Result};
use rayon::prelude::*;

/// What a plan is made on and what comes of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plan {
    /// Slots since the last report of a block, mean over blocks; a block never reported counts from the start.
    pub road_age_ms: f64,
    /// Believed less true capacity, mean of magnitudes over roads, in vehicles per hour.
    pub capacity_error_veh_per_h: f64,
    /// Flow over true capacity, mean over roads.
    pub v_over_c: f64,
    /// Mean time of a trip in s.
    pub trip_time_s: f64,
    /// Beyond what routes planned on the truth take, in s.
    pub regret_s_per_trip: f64,
}

/// One policy over all worlds.
#[derive(Clone, Debug)]
pub struct LoopResult {
    /// The policy; `None` is full knowledge, which plans on the truth.
    pub policy: Option<&'static Kind>,
    /// Its ages; `None` for full knowledge.
    pub ages: Option<AgeSummary>,
    /// Means over worlds and plans.
    pub mean: Plan,
    /// Half the width of the 95 % interval of the mean regret over worlds.
    pub regret_ci95_s_per_trip: Option<f64>,
    /// Regret beyond that of the policy with the least mean age, on the same worlds: mean and half width of its 95 %
    /// interval. Most regret is common to all policies, so this is what tells them apart. `None` for full knowledge.
    pub beyond_freshest_s_per_trip: Option<(f64, Option<f64>)>,
    /// Means over worlds, plan by plan.
    pub over_time: Vec<Plan>,
}

/// All policies on the same worlds and incidents.
#[derive(Clone, Debug)]
pub struct LoopSummary {
    /// Slots after the start at which plans were made.
    pub plan_slots: Vec<u32>,
    /// By policy; full knowledge comes last.
    pub results: Vec<LoopResult>,
    /// What one ms of mean age costs a trip, in s: slope of regret over mean age across policies, mean over worlds.
    /// `None` for fewer than two policies.
    pub cost_s_per_trip_and_ms: Option<(f64, Option<f64>)>,
}

/// Capacity lost on one block over time: alternating exponential times without and with an incident.
struct Incidents {
    /// First slot and the one after the last, ascending.
    spans: Vec<(f64, f64)>,
}

impl Incidents {
    fn draw(planning: &PlanningScenario, slots: u32, mut stream: Stream) -> Self {
        let mut spans = Vec::new();
        let mut time = 0.0;
        while time < f64::from(slots) {
            let start = time + 1000.0 * planning.incident_interval_s * f64::from(stream.exponential());
            time = start + 1000.0 * planning.incident_duration_s * f64::from(stream.exponential());
            spans.push((start, time));
        }
        Self { spans }
    }

    fn active(&self, slot: u32) -> bool {
        let slot = f64::from(slot);
        let begun = self.spans.partition_point(|&(start, _)| start <= slot);
        begun > 0 && slot < self.spans[begun - 1].1
    }
}

/// The true state of one world's roads, the same for every policy.
struct Street<'m> {
    roads: &'m Roads<'m>,
    loss: f64,
    /// By block.
    incidents: Vec<Incidents>,
}

impl Street<'_> {
    /// Fraction of its capacity that a block has.
    fn factor(&self, block: usize, slot: u32) -> f64 {
        if self.incidents[block].active(slot) {
            1.0 - self.loss
        } else {
            1.0
        }
    }

    fn factors(&self, slot: u32) -> Vec<f64> {
        (0..self.incidents.len())
            .map(|block| self.factor(block, slot))
            .collect()
    }

    /// The network with these fractions of each block's capacity.
    fn network(&self, factors: &[f64]) -> Result<Network> {
        let network = self.roads.network();
        let capacities: Vec<f64> = network
            .links()
            .iter()
            .enumerate()
            .map(|(road, link)| link.capacity * factors[self.roads.block(road)])
            .collect();
        network.with_capacities(&capacities)
    }

    /// Equilibrium flows planned on one network, met on another; the time of a trip is in s.
    fn experienced(&self, believed: &Network, truth: &Network) -> Result<TrafficState> {
        let flows = self.roads.plan(believed)?;
        let mut state = TrafficState::of(truth, self.roads.demand(), &flows);
        state.mean_trip_time *= self.roads.seconds_per_unit();
        Ok(state)
    }
}

/// What the base station knows of each block.
#[derive(Clone)]
struct Belief {
    factors: Vec<f64>,
    reported: Vec<u32>,
}

/// One world: by policy its ages and plans, and the plans of full knowledge.
struct WorldLoop {
    policies: Vec<(WorldAges, Vec<Plan>)>,
    full_knowledge: Vec<Plan>,
}

/// Runs the closed loop for all policies on the current rayon pool; the result does not depend on its size. `finished` is
/// called after each world.
///
/// # Errors
/// [`Error::Input`] for vehicles of a trace, a run without a plan, and what
/// [`Kind::check`] refuses.
pub fn closed_loop(
    simulation: &Simulation<'_>,
    policies: &[&'static Kind],
    table: &Table<'_>,
    finished: impl Fn() + Sync,
) -> Result<LoopSummary> {
    let scenario = simulation.scenario;
    let roads = Roads::new(scenario, simulation.source)?;
    for policy in policies {
        policy.check(scenario, simulation.source.most_vehicles(scenario), table)?;
    }
    let (warmup, slots) = (simulation.extent.warmup, simulation.extent.slots_per_world());
    let period = scenario.planning.period_slots;
    let plan_slots: Vec<u32> = (1..=slots / period)
        .map(|plan| plan * period)
        .filter(|&slot| slot > warmup)
        .collect();
    if plan_slots.is_empty() {
        let expected = format!("less than the {} slots after warm-up", simulation.extent.slots);
        return Err(Error::input("planning.period_slots", period, expected));
    }
    let worlds = (0..u64::from(simulation.extent.worlds))
        .into_par_iter()
        .map(|world| {
            let key = WorldKey {
                seed: simulation.extent.seed,
                purpose: Purpose::Evaluation,
                world,
            };
            let result = run_loop(simulation, &roads, policies, table, &plan_slots, &key);
            finished();
            result
        })
        .collect::<Result<Vec<WorldLoop>>>()?;
    Ok(summary(policies, plan_slots, &worlds))
}

fn run_loop(
    simulation: &Simulation<'_>,
    roads: &Roads<'_>,
    policies: &[&'static Kind],
    table: &Table<'_>,
    plan_slots: &[u32],
    key: &WorldKey,
) -> Result<WorldLoop> {
    let planning = &simulation.scenario.planning;
    let slots = simulation.extent.slots_per_world();
    let blocks = roads.block_count();
    let incidents = (0..blocks)
        .map(|block| Incidents::draw(planning, slots, key.stream(Role::Incidents, block as u32)))
        .collect();
    let street = Street {
        roads,
        loss: planning.incident_capacity_loss,
        incidents,
    };
    let truths = plan_slots
        .iter()
        .map(|&slot| street.network(&street.factors(slot)))
        .collect::<Result<Vec<Network>>>()?;
    let informed = truths
        .iter()
        .map(|truth| street.experienced(truth, truth))
        .collect::<Result<Vec<TrafficState>>>()?;

    let mut results = Vec::new();
    for policy in policies {
        let mut environment = Environment::new(
            simulation.scenario,
            simulation.source,
            key.seed,
            key.purpose,
            key.world..key.world + 1,
        );
        let mut decider = (policy.build)(&environment.setup(), table);
        let mut belief = Belief {
            factors: vec![1.0; blocks],
            reported: vec![0; blocks],
        };
        let mut beliefs = Vec::new();
        let mut ages = run_worlds(
            &mut environment,
            &mut decider,
            &simulation.extent,
            |environment| {
                hear(environment, &street, &mut belief);
                if plan_slots.binary_search(&environment.elapsed()).is_ok() {
                    beliefs.push(belief.clone());
                }
            },
        )?;
        let plans = plan_slots
            .iter()
            .zip(&beliefs)
            .zip(truths.iter().zip(&informed))
            .map(|((&slot, belief), (truth, informed))| {
                let state = street.experienced(&street.network(&belief.factors)?, truth)?;
                Ok(plan(slot, belief, &street, &state, informed))
            });
        results.push((ages.remove(0), plans.collect::<Result<Vec<Plan>>>()?));
    }
    let full_knowledge = informed.iter().map(|state| Plan {
        v_over_c: state.mean_volume_over_capacity,
        trip_time_s: state.mean_trip_time,
        ..Plan::default()
    });
    Ok(WorldLoop {
        policies: results,
        full_knowledge: full_knowledge.collect(),
    })
}

/// Takes in the reports of the slot before.
fn hear(environment: &Environment<'_>, street: &Street<'_>, belief: &mut Belief) {
    let sent = environment.elapsed() - 1;
    for (vehicle, place) in environment.places(0) {
        if !environment.received(0, *vehicle) {
            continue;
        }
        let road = environment.mobility(0).road(*vehicle);
        if let Some(block) = road.and_then(|road| street.roads.block_of(road, place)) {
            belief.factors[block] = street.factor(block, sent);
            belief.reported[block] = sent;
        }
    }
}

fn plan(
    slot: u32,
    belief: &Belief,
    street: &Street<'_>,
    state: &TrafficState,
    informed: &TrafficState,
) -> Plan {
    let blocks = belief.factors.len() as f64;
    let age: f64 = belief
        .reported
        .iter()
        .map(|&reported| f64::from(slot - reported))
        .sum();
    let links = street.roads.network().links();
    let error: f64 = links
        .iter()
        .enumerate()
        .map(|(road, link)| {
            let block = street.roads.block(road);
            link.capacity * (belief.factors[block] - street.factor(block, slot)).abs()
        })
        .sum();
    Plan {
        road_age_ms: age / blocks,
        capacity_error_veh_per_h: error / links.len() as f64,
        v_over_c: state.mean_volume_over_capacity,
        trip_time_s: state.mean_trip_time,
        regret_s_per_trip: state.mean_trip_time - informed.mean_trip_time,
    }
}

fn mean_plan<'p>(plans: impl Iterator<Item = &'p Plan> + Clone) -> Plan {
    let count = plans.clone().count() as f64;
    let mean = |value: fn(&Plan) -> f64| plans.clone().map(value).sum::<f64>() / count;
    Plan {
        road_age_ms: mean(|plan| plan.road_age_ms),
        capacity_error_veh_per_h: mean(|plan| plan.capacity_error_veh_per_h),
        v_over_c: mean(|plan| plan.v_over_c),
        trip_time_s: mean(|plan| plan.trip_time_s),
        regret_s_per_trip: mean(|plan| plan.regret_s_per_trip),
    }
}

/// Each world's mean regret.
fn regrets(worlds: &[&[Plan]]) -> Vec<f64> {
    let means = worlds.iter().map(|plans| mean_plan(plans.iter()));
    means.map(|plan| plan.regret_s_per_trip).collect()
}

/// One policy's result from its plans in every world.
fn result(policy: Option<&'static Kind>, ages: Option<AgeSummary>, worlds: &[&[Plan]]) -> LoopResult {
    let plans = 0..worlds.first().map_or(0, |plans| plans.len());
    LoopResult {
        policy,
        ages,
        mean: mean_plan(worlds.iter().copied().flatten()),
        regret_ci95_s_per_trip: AgeSummary::mean_and_interval(&regrets(worlds)).1,
        beyond_freshest_s_per_trip: None,
        over_time: plans
            .map(|n| mean_plan(worlds.iter().map(|plans| &plans[n])))
            .collect(),
    }
}

fn summary(policies: &[&'static Kind], plan_slots: Vec<u32>, worlds: &[WorldLoop]) -> LoopSummary {
    let mut results: Vec<LoopResult> = Vec::new();
    let mut by_world: Vec<Vec<f64>> = Vec::new();
    for (index, &policy) in policies.iter().enumerate() {
        let each = worlds.iter().map(|world| &world.policies[index]);
        let ages: Vec<WorldAges> = each.clone().map(|(ages, _)| ages.clone()).collect();
        let plans: Vec<&[Plan]> = each.map(|(_, plans)| plans.as_slice()).collect();
        by_world.push(regrets(&plans));
        results.push(result(Some(policy), AgeSummary::new(&ages), &plans));
    }
    let age = |result: &LoopResult| result.ages.as_ref().map_or(f64::INFINITY, |ages| ages.mean_ms);
    let freshest = (0..results.len()).min_by(|&a, &b| age(&results[a]).total_cmp(&age(&results[b])));
    if let Some(freshest) = freshest {
        for (result, regrets) in results.iter_mut().zip(&by_world) {
            let beyond: Vec<f64> = regrets
                .iter()
                .zip(&by_world[freshest])
                .map(|(own, least)| own - least)
                .collect();
            result.beyond_freshest_s_per_trip = Some(AgeSummary::mean_and_interval(&beyond));
        }
    }
    let full_knowledge: Vec<&[Plan]> = worlds.iter().map(|world| &*world.full_knowledge).collect();
    results.push(result(None, None, &full_knowledge));
    let slopes: Vec<f64> = worlds.iter().filter_map(slope).collect();
    LoopSummary {
        plan_slots,
        results,
        cost_s_per_trip_and_ms: (slopes.len() == worlds.len())
            .then(|| AgeSummary::mean_and_interval(&slopes)),
    }
}

/// Least-squares slope of regret over mean age across a world's policies.
fn slope(world: &WorldLoop) -> Option<f64> {
    let points: Vec<(f64, f64)> = world
        .policies
        .iter()
        .filter_map(|(ages, plans)| Some((ages.mean()?, mean_plan(plans.iter()).regret_s_per_trip)))
        .collect();
    let count = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), point| {
        (x + point.0 / count, y + point.1 / count)
    });
    let (xy, xx) = points.iter().fold((0.0, 0.0), |(xy, xx), point| {
        (
            xy + (point.0 - x) * (point.1 - y),
            xx + (point.0 - x) * (point.0 - x),
        )
    });
    (xx > 0.0).then(|| xy / xx)
}
