//! `bench`: how many slots a second the simulator makes on this machine.

use super::options::ScenarioArguments;
use crate::decisions::{Decisions, SILENT};
use crate::environment::Environment;
use crate::lanes::{LANES, Vectors};
use crate::mobility::Grid;
use crate::policy::{Decider, Scheduler, Setup, actor};
use crate::report::table::{Column, Table};
use crate::scenario::Scenario;
use crate::simulation::run_slot;
use crate::stream::Purpose;
use crate::threads::thread_pool;
use crate::truth::Knowledge;
use crate::weight_table::WeightTable;
use kit::error::Result;
use kit::say;
use rayon::prelude::*;
use serde_json::json;
use std::time::Instant;

/// Slots before the clock starts.
const WARMUP_SLOTS: u32 = 100;

/// Options of `bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct BenchArguments {
    #[command(flatten)]
    scenario: ScenarioArguments,
    /// Vehicles in a cell
    #[arg(long)]
    vehicles: Option<u32>,
    /// Sub-channels of a cell; the actor is measured on 3
    #[arg(long)]
    sub_channels: Option<u32>,
    /// Worlds at once; two rows of worlds for each thread without it
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    worlds: Option<u32>,
    /// Slots of each world; without it as many as take about a second
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    slots: Option<u32>,
    /// Threads
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: u16,
    /// Seed of the worlds
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
}

/// One measurement.
struct Speed {
    slots_per_second: f64,
    /// Over the threads' own processor time, which other programs do not touch; `None` where the system does not tell it.
    slots_per_processor_second: Option<f64>,
}

/// Everybody in turn, by the vehicles' numbers: a scheduler that costs next to nothing and uses the whole loop.
struct Turns {
    /// In 1/256 dBm.
    full_power: i16,
}

impl Scheduler for Turns {
    fn decide(&mut self, known: &Knowledge<'_>, decisions: &mut Decisions) {
        let (vehicles, sub_channels) = (known.presence.vehicles(), known.sub_channels);
        let now = known.elapsed as usize % vehicles.len().div_ceil(sub_channels);
        for (index, &vehicle) in vehicles.iter().enumerate() {
            let sub_channel = (index / sub_channels == now).then_some((index % sub_channels) as u8);
            for block in 0..known.ages.blocks() {
                let row = decisions.of(block, vehicle);
                *row.sub_channel = [sub_channel.unwrap_or(SILENT); LANES];
                *row.power = [self.full_power; LANES];
            }
        }
    }
}

/// This thread's processor time in seconds (Linux), which may count in ticks.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(nanoseconds * 1e-9)
}

/// Runs batches of worlds side by side on the current pool.
fn measure<'p>(
    scenario: &Scenario,
    seed: u64,
    worlds: u32,
    slots: u32,
    build: impl Fn(&Setup<'_>) -> Decider<'p> + Sync,
) -> Speed {
    let source = Grid;
    let batch = u64::from(worlds)
        .div_ceil(rayon::current_num_threads() as u64)
        .clamp(1, LANES as u64);
    let worlds = u64::from(worlds);
    let times: Vec<(f64, Option<f64>)> = (0..worlds.div_ceil(batch))
        .into_par_iter()
        .map(|index| {
            let worlds = index * batch..worlds.min((index + 1) * batch);
            let mut environment = Environment::new(scenario, &source, seed, Purpose::Evaluation, worlds);
            let mut decider = build(&environment.setup());
            let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
            for _ in 0..WARMUP_SLOTS.min(slots) {
                run_slot(&mut environment, &mut decider, &mut decisions);
            }
            let (start, before) = (Instant::now(), processor_seconds());
            for _ in 0..slots {
                run_slot(&mut environment, &mut decider, &mut decisions);
            }
            let processor = processor_seconds().zip(before).map(|(now, before)| now - before);
            (start.elapsed().as_secs_f64(), processor)
        })
        .collect();
    // The threads' speeds add up; each works on as many batches as the others.
    let threads = rayon::current_num_threads().min(times.len()) as f64;
    let all_slots = worlds as f64 * f64::from(slots);
    let seconds: f64 = times.iter().map(|time| time.0).sum();
    let processor: Option<f64> = times.iter().map(|time| time.1).sum();
    Speed {
        slots_per_second: all_slots * threads / seconds,
        slots_per_processor_second: processor
            .filter(|&seconds| seconds > 0.0)
            .map(|seconds| all_slots / seconds),
    }
}

/// Measures and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &BenchArguments) -> Result<()> {
    for (option, value, key) in [
        ("--vehicles", arguments.vehicles, "cell.vehicles"),
        ("--sub-channels", arguments.sub_channels, "radio.sub_channels"),
    ] {
        if value.is_some() {
            arguments.scenario.check_not_set(option, key)?;
        }
    }
    let mut source = arguments.scenario.source();
    let vehicles = arguments.vehicles.map(|n| ("cell.vehicles", n));
    let sub_channels = arguments.sub_channels.map(|n| ("radio.sub_channels", n));
    for (key, number) in vehicles.into_iter().chain(sub_channels) {
        source.set(key, number);
    }
    let scenario = source.read()?;
    let table = WeightTable::read_or_built_in(None)?;
    let table = table.parse()?;
    let (vehicles, sub_channels) = (scenario.cell.vehicles, scenario.radio.sub_channels);
    let worlds = arguments
        .worlds
        .unwrap_or(2 * LANES as u32 * u32::from(arguments.threads));
    let pairs = u64::from(vehicles) * u64::from(sub_channels);
    // About a second at 5 ns for a vehicle on a sub-channel.
    let slots = arguments.slots.unwrap_or(
        (200_000_000 / (pairs * u64::from(worlds.div_ceil(arguments.threads.into())))).max(20) as u32,
    );
    let (environment, actor) = thread_pool(Some(arguments.threads))?.install(|| {
        let environment = measure(&scenario, arguments.seed, worlds, slots, |_| {
            Decider::Scheduler(Box::new(Turns {
                full_power: (scenario.radio.max_power_dbm * 256.0) as i16,
            }))
        });
        let serves = actor::KIND.check(&scenario, vehicles as usize, &table).is_ok();
        let with_actor = serves.then(|| {
            measure(&scenario, arguments.seed, worlds, slots, |setup| {
                (actor::KIND.build)(setup, &table)
            })
        });
        (environment, with_actor)
    });
    let vectors = Vectors::widest().name();
    if arguments.json {
        let object = json!({
            "vehicles": vehicles,
            "sub_channels": sub_channels,
            "worlds": worlds,
            "slots": slots,
            "threads": arguments.threads,
            "vectors": vectors,
            "environment_slots_per_second": environment.slots_per_second,
            "environment_slots_per_processor_second": environment.slots_per_processor_second,
            "actor_slots_per_second": actor.as_ref().map(|speed| speed.slots_per_second),
            "actor_slots_per_processor_second": actor.as_ref().and_then(|speed| speed.slots_per_processor_second),
        });
        say!("{object}");
        return Ok(());
    }
    let title = format!(
        "{vehicles} vehicles on {sub_channels} sub-channels, {worlds} worlds x {slots} slots, {} threads, vectors: {vectors}",
        arguments.threads
    );
    let speeds = [Some(&environment), actor.as_ref()];
    let own = speeds.map(|speed| speed.and_then(|speed| speed.slots_per_processor_second));
    let mut table = Table::new(vec![
        Column::text("loop", ["environment", "with the actor"].map(str::to_owned)),
        Column::number(
            "speed",
            speeds.map(|speed| speed.map(|speed| speed.slots_per_second)),
        )
        .shown("speed", "slots/s", 0),
        Column::number("processor", own).shown("on the processor", "slots/s", 0),
        Column::number("each", own.map(|own| own.map(|own| 1e9 / own / pairs as f64))).shown(
            "vehicle and sub-channel",
            "ns",
            2,
        ),
    ])?
    .titled(&title);
    table.note(
        "On the processor: over the threads' own processor time, summed. The last column is made of it.",
    );
    say!("{table}");
    Ok(())
}
