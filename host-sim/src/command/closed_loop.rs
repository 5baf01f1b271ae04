//! `host-sim loop`: from slot to street and back, for every policy on the same worlds and incidents.

use crate::closed_loop::{LoopResult, LoopSummary, Plan, closed_loop};
use crate::command::options::progress_bar;
use crate::command::run::RunArguments;
use crate::experiment::{Experiment, ExperimentSource};
use crate::mobility::StreetMap;
use crate::report::chart::{Axis, LineChart, Series};
use crate::report::pages;
use crate::report::table::{Column, Table};
use crate::threads::thread_pool;
use crate::traffic::planning_options;
use assignment::CostWeights;
use assignment::formats;
use kit::error::{Error, Result};
use kit::files::{NamedText, check_folder, write_set, written};
use kit::say;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Worlds unless said: plans cost more than slots.
const WORLDS: u32 = 64;

/// Options of `loop`.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct LoopArguments {
    /// What to simulate.
    #[command(flatten)]
    pub run: RunArguments,
    /// Drive on this network instead of the grid: TNTP network file, folder with GMNS node.csv and link.csv, or SUMO
    /// net.xml. Large networks take a while for each plan: fewer --worlds, --slots and --policy go a long way
    #[arg(long, value_name = "FILE|DIR", requires = "trips")]
    pub net: Option<PathBuf>,
    /// Trips in the network's format, as for `assign`; vehicles drive the paths of their equilibrium
    #[arg(long, value_name = "FILE", requires = "net")]
    pub trips: Option<PathBuf>,
    /// TNTP file with the coordinates of the nodes [default: NAME_node.tntp beside NAME_net.tntp]
    #[arg(long, value_name = "FILE", requires = "net")]
    pub nodes: Option<PathBuf>,
    /// Metres for each unit of the network's coordinates, whose centre lies on that of the grid's area [default: 1 with
    /// SUMO; otherwise the network is made to fit the area]
    #[arg(long, value_name = "METRES", requires = "net")]
    pub metres_per_unit: Option<f64>,
    /// Seconds for each unit of the network's travel times [default: 1 with SUMO, otherwise 60]
    #[arg(long, value_name = "SECONDS", requires = "net")]
    pub seconds_per_unit: Option<f64>,
    /// Cost of a unit of toll, in units of free-flow time
    #[arg(long, default_value_t = 0.0, requires = "net")]
    pub toll_weight: f64,
    /// Cost of a unit of length, in units of free-flow time
    #[arg(long, default_value_t = 0.0, requires = "net")]
    pub distance_weight: f64,
}

impl LoopArguments {
    /// Everything the loop needs, read and checked.
    fn prepare(&self) -> Result<Experiment> {
        let options = &self.run.options;
        options.check_typed()?;
        let mut experiment = ExperimentSource {
            worlds: Some(options.worlds.unwrap_or(WORLDS)),
            ..options.source()
        }
        .read()?;
        if let Some(net) = &self.net {
            if !experiment.source.is_grid() {
                let expected = "grid or nothing beside --net, on whose roads vehicles drive";
                return Err(Error::input("--mobility", &options.mobility, expected));
            }
            let map = self.street_map(net, &experiment)?;
            experiment.source = Box::new(map);
            experiment.source.check(&experiment.scenario)?;
        }
        Ok(experiment)
    }

    fn street_map(&self, net: &Path, experiment: &Experiment) -> Result<StreetMap> {
        let weights = CostWeights {
            toll: self.toll_weight,
            distance: self.distance_weight,
        };
        let (network, demand) = formats::read(net, self.trips.as_deref(), weights)?;
        let places = formats::read_places(net, self.nodes.as_deref(), &network)?;
        let seconds = match self.seconds_per_unit {
            Some(seconds) => seconds,
            None => formats::Format::of(net)?.seconds_per_unit(),
        };
        StreetMap::new(
            network,
            demand,
            &places,
            &experiment.scenario,
            (self.metres_per_unit, seconds),
            &planning_options(),
        )
    }
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit; nothing is written then.
pub fn run(arguments: &LoopArguments) -> Result<()> {
    let (options, out) = (&arguments.run.options, arguments.run.out());
    let experiment = arguments.prepare()?;
    if !options.json {
        check_folder(out)?;
    }
    let template = "closed loop {bar:40} {pos}/{len} worlds, {eta} left";
    let progress = progress_bar(u64::from(experiment.extent.worlds), template, options.json);
    let actor_table = experiment.table.parse()?;
    let summary = thread_pool(options.threads)?.install(|| {
        closed_loop(
            &experiment.simulation(),
            &experiment.policies,
            &actor_table,
            || progress.inc(1),
        )
    })?;
    progress.finish_and_clear();
    let object = to_json(&experiment, &summary);
    if options.json {
        say!("{object}");
        return Ok(());
    }
    let table = table(&experiment, &summary)?;
    let mut set = vec![("loop.csv".to_owned(), table.to_csv())];
    set.extend(figures(&experiment, &summary)?);
    set.push(("loop.json".to_owned(), format!("{object:#}\n")));
    set.push((
        "loop.html".to_owned(),
        pages::closed_loop(&experiment, &table, &set)?.render(),
    ));
    write_set(out, &set)?;
    say!("{table}\n{}", written(out, "loop.html", &set));
    Ok(())
}

fn name(result: &LoopResult) -> &'static str {
    result.policy.map_or("full-knowledge", |policy| policy.name)
}

/// Full knowledge has no age.
fn mean_age(result: &LoopResult) -> Option<f64> {
    result.ages.as_ref().map(|ages| ages.mean_ms)
}

/// The table, also as data: means over plans, the regret with its interval, and beyond the freshest.
fn table(experiment: &Experiment, summary: &LoopSummary) -> Result<Table> {
    let results = || summary.results.iter();
    let number = |name, value: fn(&LoopResult) -> Option<f64>| Column::number(name, results().map(value));
    let mean =
        |name, value: fn(&Plan) -> f64| Column::number(name, results().map(|result| value(&result.mean)));
    let mut table = Table::new(vec![
        Column::text("policy", results().map(|result| name(result).to_owned())),
        number("mean_age_ms", mean_age).shown("mean age", "ms", 2),
        mean("road_age_ms", |plan| plan.road_age_ms).shown("road age", "ms", 0),
        mean("capacity_error_veh_per_h", |plan| plan.capacity_error_veh_per_h).shown(
            "capacity error",
            "veh/h",
            3,
        ),
        mean("mean_v_over_c", |plan| plan.v_over_c).shown("V/C", "", 3),
        mean("mean_travel_time_s", |plan| plan.trip_time_s).shown("trip time", "s", 3),
        mean("regret_s_per_trip", |plan| plan.regret_s_per_trip).shown("regret", "s/trip", 3),
        number("regret_ci95_s_per_trip", |result| result.regret_ci95_s_per_trip).shown("+-95 %", "s/trip", 3),
        number("beyond_freshest_s_per_trip", |result| {
            Some(result.beyond_freshest_s_per_trip?.0)
        })
        .shown("beyond freshest", "s/trip", 4),
        number("beyond_freshest_ci95_s_per_trip", |result| {
            result.beyond_freshest_s_per_trip?.1
        })
        .shown("+-95 %", "s/trip", 4),
    ])?
    .titled("From slot to street");
    let planning = &experiment.scenario.planning;
    table.note(&format!(
        "{}; {} plans a world.",
        experiment.description(),
        summary.plan_slots.len()
    ));
    table.note(&format!(
        "On each block an incident takes {:.0} % of the capacity for {} s on average, {} s after the last one.",
        100.0 * planning.incident_capacity_loss,
        planning.incident_duration_s,
        planning.incident_interval_s,
    ));
    if let Some(map) = experiment.source.streets() {
        table.note(&format!(
            "Vehicles drive the paths of the equilibrium, {} m for each unit of the network's coordinates; its unit of time is {} s.",
            map.scale().metres_per_unit,
            map.scale().seconds_per_unit,
        ));
    }
    table.note("Beyond freshest: regret less that of the policy with the least age, paired by world.");
    table.note("Road age: since the last report of a block; blocks without a vehicle stay unreported under every policy.");
    if let Some((cost, interval)) = summary.cost_s_per_trip_and_ms {
        let interval = interval
            .map(|half| format!(" +- {:.3}", 1000.0 * half))
            .unwrap_or_default();
        table.note(&format!(
            "Each ms of mean age costs a trip {:.3}{interval} ms (95 %, over worlds).",
            1000.0 * cost
        ));
    }
    Ok(table)
}

fn to_json(experiment: &Experiment, summary: &LoopSummary) -> Value {
    let policies: Vec<Value> = summary
        .results
        .iter()
        .map(|result| {
            json!({
                "policy": name(result),
                "mean_age_ms": mean_age(result),
                "mean_age_ci95_ms": result.ages.as_ref().and_then(|ages| ages.ci95_ms),
                "road_age_ms": result.mean.road_age_ms,
                "capacity_error_veh_per_h": result.mean.capacity_error_veh_per_h,
                "mean_v_over_c": result.mean.v_over_c,
                "mean_travel_time_s": result.mean.trip_time_s,
                "regret_s_per_trip": result.mean.regret_s_per_trip,
                "regret_ci95_s_per_trip": result.regret_ci95_s_per_trip,
                "beyond_freshest_s_per_trip": result.beyond_freshest_s_per_trip.map(|(mean, _)| mean),
                "beyond_freshest_ci95_s_per_trip": result.beyond_freshest_s_per_trip.and_then(|(_, interval)| interval),
            })
        })
        .collect();
    json!({
        "seed": experiment.extent.seed,
        "worlds": experiment.extent.worlds,
        "slots": experiment.extent.slots,
        "warmup": experiment.extent.warmup,
        "plans": summary.plan_slots.len(),
        "cost_s_per_trip_and_ms": summary.cost_s_per_trip_and_ms.map(|(cost, _)| cost),
        "cost_ci95_s_per_trip_and_ms": summary.cost_s_per_trip_and_ms.and_then(|(_, interval)| interval),
        "scale": experiment.source.streets().map(|map| json!({
            "metres_per_unit": map.scale().metres_per_unit,
            "seconds_per_unit": map.scale().seconds_per_unit,
        })),
        "scenario": experiment.scenario,
        "policies": policies,
    })
}

fn figures(experiment: &Experiment, summary: &LoopSummary) -> Result<Vec<NamedText>> {
    let over_time = |value: fn(&Plan) -> f64| -> Vec<Series> {
        let of = |result: &LoopResult| Series {
            name: name(result).to_owned(),
            points: summary
                .plan_slots
                .iter()
                .zip(&result.over_time)
                .map(|(&slot, plan)| (f64::from(slot), value(plan)).into())
                .collect(),
        };
        summary.results.iter().map(of).collect()
    };
    let figure = |title: &str, quantity: &str, series: Vec<Series>| LineChart {
        title: title.to_owned(),
        note: format!("{}. Means over worlds.", experiment.description()),
        horizontal: Axis::linear("slot (ms)"),
        vertical: Axis::linear(quantity),
        series,
        references: Vec::new(),
    };
    let regret = figure(
        "What planning on stale knowledge costs",
        "regret (s per trip)",
        over_time(|plan| plan.regret_s_per_trip),
    );
    let error = figure(
        "How wrong the base station's capacities are",
        "capacity error (veh/h)",
        over_time(|plan| plan.capacity_error_veh_per_h),
    );
    let mut set = Vec::from(regret.files("loop_regret", ["policy", "slot", "regret_s_per_trip"])?);
    set.extend(error.files(
        "loop_capacity_error",
        ["policy", "slot", "capacity_error_veh_per_h"],
    )?);
    Ok(set)
}
