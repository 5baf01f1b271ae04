//! `host-sim run`: ages of all policies on the same worlds, and what they do to the road.

use crate::command::options::choice;
use crate::command::options::{ScenarioArguments, parse_table, progress_bar, table_bytes, thread_pool};
use crate::mobility::{MobilitySource, check_slots, read_source};
use crate::policy::{KINDS, Kind, actor};
use crate::report::{PolicyResult, ages, cell_figures, pages, traffic};
use crate::scenario::Scenario;
use crate::simulation::{Extent, Simulation};
use crate::traffic::TrafficModel;
use firmware::table::Table;
use kit::error::{Error, Result};
use kit::files;
use kit::say;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of `run` and `loop`.
#[derive(Clone, Debug, clap::Args)]
pub struct RunArguments {
    /// What to simulate.
    #[command(flatten)]
    pub options: RunOptions,
    /// Folder for figures and data [default: out]
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    pub out: Option<PathBuf>,
}

impl RunArguments {
    /// The folder for figures and data.
    pub fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new("out"))
    }
}

/// What to simulate.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct RunOptions {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Policy to run (repeatable) [default: all]
    #[arg(long, value_parser = choice::<&'static Kind>(), value_name = "NAME")]
    pub policy: Vec<&'static Kind>,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Vehicles in the cell [default: the scenario's]
    #[arg(long)]
    pub vehicles: Option<u32>,
    /// Independent worlds [default: 256; 8 with a trace]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub worlds: Option<u32>,
    /// Slots of 1 ms that count [default: 2000; to the end of a trace]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub slots: Option<u32>,
    /// Slots before them
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(0..=100_000_000))]
    pub warmup: u32,
    /// What moves the vehicles: the urban grid, or a file of SUMO floating-car data (.xml, .xml.gz), in whose coordinates
    /// the base station stands at cell.base_station_x_m and _y_m
    #[arg(long, value_name = "grid|FILE", default_value = "grid")]
    pub mobility: String,
    /// Seed of the worlds; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object and nothing else; write no files
    #[arg(long)]
    pub json: bool,
}

/// Everything a run needs, read and checked.
pub struct PreparedRun {
    /// The cell.
    pub scenario: Scenario,
    /// What moves its vehicles.
    pub source: Box<dyn MobilitySource>,
    /// How much is simulated.
    pub extent: Extent,
    /// Which policies, in a fixed order.
    pub policies: Vec<&'static Kind>,
    /// The actor's table.
    pub table: Vec<u8>,
    /// Where the table was read, if not built in.
    pub table_path: Option<PathBuf>,
}

impl RunOptions {
    /// Refuses what contradicts itself, or has no effect, as a person typed it. [`RunOptions::prepare`] does not: its callers
    /// may lay settings of their own below the typed options, and a point of a sweep has the whole grid's table.
    ///
    /// # Errors
    /// The first contradiction.
    pub fn check_typed(&self) -> Result<()> {
        if self.vehicles.is_some() {
            self.scenario.check_not_set("--vehicles", "cell.vehicles")?;
        }
        if self.table.is_some()
            && !self.policy.is_empty()
            && !self.policy.iter().any(|policy| policy.uses_table())
        {
            let expected = format!("--policy {}, which alone uses a table", actor::KIND.name);
            let names: Vec<_> = self.policy.iter().map(|policy| policy.name).collect();
            let found = format!("only --policy {} beside it", names.join(", "));
            return Err(Error::input("--table", found, expected));
        }
        Ok(())
    }

    /// Reads and checks all input.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn prepare(&self) -> Result<PreparedRun> {
        let source = read_source(&self.mobility)?;
        if let (Some(_), Some(vehicles)) = (source.duration_slots(), self.vehicles) {
            return Err(Error::input(
                "--vehicles",
                vehicles,
                "no number with a trace, which brings its own vehicles",
            ));
        }
        let scenario = self
            .scenario
            .read(self.vehicles.map(|vehicles| format!("cell.vehicles={vehicles}")))?;
        let (worlds, slots) = match source.duration_slots() {
            None => (256, 2000),
            Some(slots) => (8, slots.saturating_sub(self.warmup)),
        };
        let extent = Extent {
            seed: self.seed,
            worlds: self.worlds.unwrap_or(worlds),
            slots: self.slots.unwrap_or(slots),
            warmup: self.warmup,
        };
        check_slots(source.as_ref(), extent.slots_per_world())?;
        source.check(&scenario)?;
        if extent.slots == 0 {
            return Err(Error::input(
                "--warmup",
                self.warmup,
                "less than the length of the trace in slots",
            ));
        }
        let table = table_bytes(self.table.as_deref())?;
        let asked = |kind: &&'static Kind| self.policy.is_empty() || self.policy.contains(kind);
        let policies = KINDS.iter().copied().filter(asked).collect();
        let prepared = PreparedRun {
            scenario,
            source,
            extent,
            policies,
            table,
            table_path: self.table.clone(),
        };
        let table = prepared.table()?;
        for policy in &prepared.policies {
            let most = prepared.source.most_vehicles(&prepared.scenario);
            policy.check(&prepared.scenario, most, &table)?;
        }
        drop(table);
        Ok(prepared)
    }
}

impl PreparedRun {
    /// The worlds.
    pub fn simulation(&self) -> Simulation<'_> {
        Simulation {
            scenario: &self.scenario,
            source: self.source.as_ref(),
            extent: self.extent,
        }
    }

    /// The actor's table.
    ///
    /// # Errors
    /// As [`parse_table`]; never after [`RunOptions::prepare`].
    pub fn table(&self) -> Result<Table<'_>> {
        parse_table(self.table_path.as_deref(), &self.table)
    }

    /// Runs the policies one after the other on the current rayon pool, each on the same worlds.
    ///
    /// # Errors
    /// As [`Simulation::run`].
    pub fn results(&self, hide_progress: bool) -> Result<Vec<PolicyResult>> {
        let table = self.table()?;
        let traffic = TrafficModel::new(&self.scenario)?;
        let worlds = self.policies.len() as u64 * u64::from(self.extent.worlds);
        let template = "{msg:14} {bar:40} {pos}/{len} worlds, {per_sec}, {eta} left";
        let progress = progress_bar(worlds, template, hide_progress);
        let mut results = Vec::new();
        for policy in &self.policies {
            progress.set_message(policy.name);
            let start = Instant::now();
            let (ages, roads) = self
                .simulation()
                .run_policy(policy, &table, |environment, world| {
                    progress.inc(1);
                    traffic.road_ages(environment, world)
                })?;
            let slots = f64::from(self.extent.worlds) * f64::from(self.extent.slots_per_world());
            let slots_per_second = slots / start.elapsed().as_secs_f64();
            let roads: Option<Vec<_>> = roads.into_iter().collect();
            let traffic = roads
                .map(|roads| traffic.summary(ages.mean_ms, &roads))
                .transpose()?;
            results.push(PolicyResult {
                name: policy.name,
                ages,
                traffic,
                slots_per_second,
            });
        }
        progress.finish_and_clear();
        Ok(results)
    }

    /// The JSON object of a run.
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
            slots_per_second,
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
            "median_world_age_ms": ages.median_world_ms,
            "p99_age_ms": ages.p99_ms,
            "first100_age_ms": ages.first100_ms,
            "success_per_slot": ages.success_per_slot,
            "joiners": ages.joiners.map(|joiners| joiners.count),
            "joiner_first_success_median_slots": ages.joiners.and_then(|joiners| joiners.median_slots),
            "joiner_first_success_p90_slots": ages.joiners.and_then(|joiners| joiners.p90_slots),
            "slots_per_second": slots_per_second,
            "traffic": traffic.as_ref().map(traffic::to_json),
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

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit; nothing is written then.
pub fn run(arguments: &RunArguments) -> Result<()> {
    let (options, out) = (&arguments.options, arguments.out());
    options.check_typed()?;
    let prepared = options.prepare()?;
    if !options.json {
        files::check_folder(out)?;
    }
    let results = thread_pool(options.threads)?.install(|| prepared.results(options.json))?;
    let object = prepared.to_json(&results);
    if options.json {
        say!("{object}");
        return Ok(());
    }
    let (description, bound_ms) = (prepared.description(), prepared.simulation().bound_age_ms());
    let age_table = ages::table(&results, &description, bound_ms);
    say!("{age_table}");
    let mut set = ages::files(&results, &description, bound_ms)?;
    let table = prepared.table()?;
    set.extend(cell_figures::files(
        &prepared.simulation(),
        &prepared.policies,
        &table,
    )?);
    let has_traffic = results.iter().any(|result| result.traffic.is_some());
    let traffic_table = has_traffic.then(|| traffic::table(&results, &prepared.scenario));
    if let Some(table) = &traffic_table {
        say!("{table}");
        set.push(traffic::csv(&results));
        set.extend(traffic::paper_figures(&prepared.scenario)?);
    }
    set.push(("run.json".to_owned(), format!("{object:#}\n")));
    let page = pages::run(&prepared, &results, &age_table, traffic_table.as_ref(), &set)?;
    set.push(("report.html".to_owned(), page.render()));
    files::write_set(out, &set)?;
    say!("{}", files::written(out, "report.html", &set));
    Ok(())
}
