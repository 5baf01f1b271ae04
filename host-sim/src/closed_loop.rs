//! The closed loop from slot to street: what travellers lose because the base station does not see every road, sees it late,
//! has to make sure, and is not obeyed by all.
//!
//! Trips, incidents and tastes of a world are the same in every case; a case is an hour with one thing more in the way
//! ([`Loss`]). What is lost to a thing is the mean trip time with it less that without, paired by world.

#[cfg(feature = "program")]
pub mod experiment;

use crate::age::AgeSummary;
use crate::journeys::delays::{Delays, Fixed};
use crate::journeys::hour::{self, Case, Outcome, Sight};
use crate::journeys::incidents::Incidents;
use crate::journeys::queues::Queues;
use crate::journeys::radio_seconds::{self, Moment, RadioSecond, Sampled, Sampler};
use crate::journeys::roads::RoadMap;
use crate::journeys::town::Town;
use crate::journeys::trips::{self, Trip};
use crate::journeys::{OnRoad, TrafficModel};
use crate::policy::Kind;
use crate::scenario::Scenario;
use crate::stream::{Purpose, Role, WorldKey};
use firmware::table::Table;
use kit::error::{Error, Result};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most trips of all worlds together (chosen: they take half a gigabyte).
const MOST_TRIPS: f64 = 20e6;

/// A mean over worlds, and half the width of its 95 % interval where there are several.
pub type Mean = (f64, Option<f64>);

/// What a loop is about.
#[derive(Clone, Copy, Debug)]
pub struct LoopOptions<'o> {
    /// The cell and what happens on the roads.
    pub scenario: &'o Scenario,
    /// Seed of the run.
    pub seed: u64,
    /// Independent hours.
    pub worlds: u32,
    /// Who decides about the radio.
    pub policies: &'o [&'static Kind],
    /// The actor's table.
    pub table: &'o Table<'o>,
    /// Delays of knowledge to look at besides, in s.
    pub delays_s: &'o [f64],
}

/// What traffic is made from.
#[derive(Clone, Copy, Debug)]
pub struct Roads<'r> {
    /// The roads.
    pub map: &'r RoadMap,
    /// What happens on them.
    pub incidents: &'r Incidents,
    /// Of whatever else is random in it.
    pub seed: u64,
}

/// Makes the traffic of an hour; several may run at once.
pub type BuildTraffic<'b> = dyn for<'r> Fn(&Roads<'r>) -> Result<Box<dyn TrafficModel + 'r>> + Sync + 'b;

/// The built-in traffic.
///
/// # Errors
/// None.
pub fn built_in<'r>(roads: &Roads<'r>) -> Result<Box<dyn TrafficModel + 'r>> {
    Ok(Box::new(Queues::new(roads.map, roads.incidents)))
}

/// One case over all worlds.
#[derive(Clone, Debug)]
pub struct CaseResult {
    /// Mean trip time in s.
    pub trip_time_s: Mean,
    /// Vehicles on the roads, mean.
    pub vehicles: f64,
    /// Of them, those in a queue, slower than 5 km/h.
    pub queued: Mean,
    /// Vehicles that found no room to set out yet, mean.
    pub waiting: f64,
    /// Mean time since a road's newest known report, in s.
    pub road_age_s: f64,
    /// Flow over capacity, mean over roads.
    pub v_over_c: f64,
    /// Trips that count, in a world.
    pub trips: f64,
    /// Share of them that had not arrived at the end.
    pub unfinished: f64,
    /// Vehicles that stood for long enough to be let through into a full road, for each trip.
    pub let_through: f64,
    /// Each world's mean trip time in s.
    by_world: Vec<f64>,
}

impl CaseResult {
    fn new(outcomes: &[Outcome]) -> Self {
        let count = outcomes.len() as f64;
        let mean = |value: fn(&Outcome) -> f64| outcomes.iter().map(value).sum::<f64>() / count;
        let queued: Vec<f64> = outcomes.iter().map(|outcome| outcome.queued).collect();
        let by_world: Vec<f64> = outcomes.iter().map(|outcome| outcome.trip_time_s).collect();
        Self {
            trip_time_s: AgeSummary::mean_and_interval(&by_world),
            vehicles: mean(|outcome| outcome.vehicles),
            queued: AgeSummary::mean_and_interval(&queued),
            waiting: mean(|outcome| outcome.waiting),
            trips: mean(|outcome| f64::from(outcome.trips)),
            road_age_s: mean(|outcome| outcome.road_age_s),
            v_over_c: mean(|outcome| outcome.v_over_c),
            unfinished: mean(|outcome| f64::from(outcome.unfinished) / f64::from(outcome.trips)),
            let_through: mean(|outcome| outcome.let_through as f64 / f64::from(outcome.trips)),
            by_world,
        }
    }

    /// Each world's mean trip time in s.
    pub fn by_world_s(&self) -> &[f64] {
        &self.by_world
    }

    /// How much longer a trip takes than in another case, in s, paired by world.
    pub fn beyond(&self, other: &Self) -> Mean {
        let worlds = self.by_world.iter().zip(&other.by_world);
        let differences: Vec<f64> = worlds.map(|(own, other)| own - other).collect();
        AgeSummary::mean_and_interval(&differences)
    }
}

/// What a trip loses to one thing, each beyond the ones before, in s.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Not everybody follows advice.
    pub obedience: Mean,
    /// Roads without a connected vehicle are not seen.
    pub coverage: Mean,
    /// A vehicle tells its own speed, and the detector waits for several.
    pub detection: Mean,
    /// Reports come as late as under the policy of the least age.
    pub radio: Mean,
    /// Reports come as late as under this policy.
    pub protocol: Mean,
}

/// A policy's result.
#[derive(Clone, Debug)]
pub struct PolicyResult {
    /// The policy.
    pub policy: &'static Kind,
    /// Its ages in the played seconds; `None` if nobody was ever connected.
    pub ages: Option<AgeSummary>,
    /// Traffic under it.
    pub result: CaseResult,
}

/// All cases on the same worlds.
#[derive(Clone, Debug)]
pub struct LoopSummary {
    /// Everything is known at once and everybody follows advice.
    pub all_obey: CaseResult,
    /// Everything is known at once.
    pub full_knowledge: CaseResult,
    /// The true speed of every road that a connected vehicle drives on is known at once.
    pub covered: CaseResult,
    /// Reports are heard at once.
    pub detected: CaseResult,
    /// By policy.
    pub policies: Vec<PolicyResult>,
    /// Nobody is advised.
    pub no_information: CaseResult,
    /// By delay in s.
    pub delayed: Vec<(f64, CaseResult)>,
    /// Connected vehicles in a cell at the samples: mean over cells with any, and most.
    pub connected_in_cell: (f64, usize),
}

impl LoopSummary {
    /// The policy of the least mean age.
    pub fn freshest(&self) -> Option<&PolicyResult> {
        let age = |result: &&PolicyResult| {
            let ages = result.ages.as_ref();
            ages.map_or(f64::INFINITY, |ages| ages.uncapped_mean_ms)
        };
        self.policies.iter().min_by(|a, b| age(a).total_cmp(&age(b)))
    }

    /// What trips lose under a policy, thing by thing.
    pub fn loss(&self, policy: &PolicyResult) -> Loss {
        let freshest = self.freshest().unwrap_or(policy);
        Loss {
            obedience: self.full_knowledge.beyond(&self.all_obey),
            coverage: self.covered.beyond(&self.full_knowledge),
            detection: self.detected.beyond(&self.covered),
            radio: freshest.result.beyond(&self.detected),
            protocol: policy.result.beyond(&freshest.result),
        }
    }
}

/// How far a loop has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Parts of the work that are done.
    pub done: u64,
    /// All of it.
    pub total: u64,
}

/// One world's trips and incidents.
struct Hours {
    key: WorldKey,
    trips: Vec<Trip>,
    incidents: Incidents,
}

/// Runs the loop on the current rayon pool; the result does not depend on its size. `progress` is called from any thread.
///
/// # Errors
/// What [`Kind::check`] refuses, and what stops the traffic.
pub fn closed_loop(
    town: &Town,
    options: &LoopOptions<'_>,
    build: &BuildTraffic<'_>,
    progress: impl Fn(Progress) + Sync,
) -> Result<LoopSummary> {
    let planning = &options.scenario.planning;
    let trips = town.trips_per_h() * planning.horizon_s / 3600.0 * f64::from(options.worlds);
    if trips > MOST_TRIPS {
        let expected =
            format!("at most {MOST_TRIPS:e} in all worlds: planning.demand_factor is a factor on them");
        return Err(Error::input("trips", format!("{trips:.3e}"), expected));
    }
    let worlds: Vec<Hours> = (0..u64::from(options.worlds))
        .map(|world| {
            let key = WorldKey {
                seed: options.seed,
                purpose: Purpose::Evaluation,
                world,
            };
            let blocks = 0..town.map().block_count();
            Hours {
                trips: trips::draw(town.paths(), planning.horizon_s, &key),
                incidents: Incidents::draw(
                    (planning.incident_duration_s, planning.incident_interval_s),
                    1.0 - planning.incident_capacity_loss,
                    2.0 * planning.horizon_s,
                    blocks.map(|block| key.stream(Role::Incidents, block)),
                ),
                key,
            }
        })
        .collect();
    for world in &worlds {
        if world
            .trips
            .last()
            .is_none_or(|last| last.departs_s < planning.warmup_s)
        {
            let found = format!("no trip after it in world {}", world.key.world);
            return Err(Error::input(
                "planning.warmup_s",
                found,
                "trips that count, in every world",
            ));
        }
    }
    let usual_speeds = usual_speeds(town, options, build)?;
    // The played seconds of a policy count as one of its hours.
    let cases = 5 + options.delays_s.len() + 2 * options.policies.len();
    let total = u64::from(options.worlds) * cases as u64;
    let done = AtomicU64::new(0);
    let advance = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(Progress { done, total });
    };
    let case = |sight, obeying_share| Case {
        sight,
        connected_share: planning.connected_share,
        obeying_share,
        fade_s: planning.belief_fade_s,
    };
    let run = |world: &Hours, case: Case, delays: &mut dyn Delays, watch: &mut dyn FnMut(f64, &[OnRoad])| {
        let mut traffic = build(&Roads {
            map: town.map(),
            incidents: &world.incidents,
            seed: options.seed.wrapping_add(world.key.world),
        })?;
        let roads = town.world(world.key, &world.trips, &world.incidents, &usual_speeds, planning);
        let outcome = hour::run(roads, case, traffic.as_mut(), delays, watch);
        advance();
        outcome
    };
    let all = |case: Case, delay_s: f64| {
        let hours = worlds
            .par_iter()
            .map(|world| run(world, case, &mut Fixed(delay_s), &mut |_, _| ()));
        hours.collect::<Result<Vec<Outcome>>>()
    };

    let obeying = planning.obeying_share;
    let own_speeds = case(Sight::OwnSpeeds(planning.detector_memory_s), obeying);
    let all_obey = all(case(Sight::Everything, 1.0), 0.0)?;
    let full_knowledge = all(case(Sight::Everything, obeying), 0.0)?;
    let covered = all(case(Sight::ConnectedRoads, obeying), 0.0)?;
    let no_information = all(case(Sight::Blind, obeying), 0.0)?;
    let (detected, moments): (Vec<Outcome>, Vec<Vec<Moment>>) = worlds
        .par_iter()
        .map(|world| {
            let mut sampler = Sampler::new(town, &world.trips, planning);
            let outcome = run(world, own_speeds, &mut Fixed(0.0), &mut |time_s, now| {
                sampler.look(time_s, now);
            })?;
            Ok((outcome, sampler.moments()))
        })
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .unzip();
    let in_cells = || moments.iter().flatten().map(Vec::len).filter(|&count| count > 0);
    let connected_in_cell = (
        in_cells().sum::<usize>() as f64 / in_cells().count().max(1) as f64,
        in_cells().max().unwrap_or(0),
    );
    let lengths: Vec<usize> = moments.iter().map(Vec::len).collect();
    let moments: Vec<Moment> = moments.into_iter().flatten().collect();

    let mut policies = Vec::new();
    for policy in options.policies {
        let (seconds, ages) =
            radio_seconds::play(options.scenario, options.seed, policy, options.table, &moments)?;
        for _ in &worlds {
            advance();
        }
        let mut rest = seconds.as_slice();
        let by_world: Vec<&[RadioSecond]> = lengths
            .iter()
            .map(|&length| {
                let (own, others) = rest.split_at(length);
                rest = others;
                own
            })
            .collect();
        let outcomes = worlds
            .par_iter()
            .zip(by_world)
            .map(|(world, seconds)| {
                let mut delays = Sampled::new(town, seconds, planning.radio_sample_s);
                run(world, own_speeds, &mut delays, &mut |_, _| ())
            })
            .collect::<Result<Vec<Outcome>>>()?;
        policies.push(PolicyResult {
            policy,
            ages,
            result: CaseResult::new(&outcomes),
        });
    }
    let mut delayed = Vec::new();
    for &delay_s in options.delays_s {
        delayed.push((delay_s, CaseResult::new(&all(own_speeds, delay_s)?)));
    }
    Ok(LoopSummary {
        all_obey: CaseResult::new(&all_obey),
        full_knowledge: CaseResult::new(&full_knowledge),
        covered: CaseResult::new(&covered),
        detected: CaseResult::new(&detected),
        policies,
        no_information: CaseResult::new(&no_information),
        delayed,
        connected_in_cell,
    })
}

/// Speeds by road of an hour without incidents and advice, in a world that no result comes from; where nobody drove, the free
/// ones. In m/s.
///
/// # Errors
/// What stops the traffic.
pub fn usual_speeds(town: &Town, options: &LoopOptions<'_>, build: &BuildTraffic<'_>) -> Result<Vec<f64>> {
    let planning = &options.scenario.planning;
    let key = WorldKey {
        seed: options.seed,
        purpose: Purpose::Training,
        world: 0,
    };
    let incidents = Incidents::none(town.map().block_count());
    let trips = trips::draw(town.paths(), planning.horizon_s, &key);
    let free = town.free_speeds_m_per_s();
    let world = town.world(key, &trips, &incidents, &free, planning);
    let blind = Case {
        sight: Sight::Blind,
        connected_share: 0.0,
        obeying_share: 0.0,
        fade_s: planning.belief_fade_s,
    };
    let mut traffic = build(&Roads {
        map: town.map(),
        incidents: &incidents,
        seed: options.seed,
    })?;
    let outcome = hour::run(world, blind, traffic.as_mut(), &mut Fixed(0.0), |_, _| ())?;
    let speeds = outcome.speeds_m_per_s.iter().zip(&free);
    Ok(speeds
        .map(|(&speed, &free)| if speed > 0.0 { speed } else { free })
        .collect())
}
