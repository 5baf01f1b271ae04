//! `host-sim hil`: images in QEMU as vehicles of the simulated cell.

use crate::command::options::{ScenarioArguments, progress_bar, progress_spinner};
use crate::hil::emulator::check_installed;
use crate::hil::fleet::{ANSWER_LIMIT, Fleet, FleetResult, INSTRUCTION_SHIFT};
use crate::image::{Image, build};
use crate::mobility::Grid;
use crate::policy::actor;
use crate::scenario::Scenario;
use crate::simulation::{Extent, Simulation};
use firmware::table::Table;
use kit::error::{Error, Result};
use kit::say;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

/// Options of `hil`.
#[derive(Clone, Debug, clap::Args)]
pub struct HilArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Vehicles that are images in QEMU; the rest are the library's
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub units: u32,
    /// Slots of 1 ms
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub slots: u32,
    /// Vehicles in the cell [default: the scenario's]
    #[arg(long)]
    pub vehicles: Option<u32>,
    /// Seed of the world; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The image [default: the release image, built if it is not]
    #[arg(long, value_name = "FILE")]
    pub elf: Option<PathBuf>,
    /// First port of the units' serial lines on 127.0.0.1, one a unit [default: free ones]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub port: Option<u16>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Runs and reports.
///
/// # Errors
/// Input that does not fit, QEMU missing, an image that is none or that ends before its time.
pub fn run(arguments: &HilArguments) -> Result<()> {
    if arguments.vehicles.is_some() {
        arguments.scenario.check_not_set("--vehicles", "cell.vehicles")?;
    }
    let mut source = arguments.scenario.source();
    if let Some(vehicles) = arguments.vehicles {
        source.set("cell.vehicles", vehicles);
    }
    let scenario = source.read()?;
    if arguments.units > scenario.cell.vehicles {
        let expected = format!("at most {}, the vehicles of the cell", scenario.cell.vehicles);
        return Err(Error::input("--units", arguments.units, expected));
    }
    if arguments.elf.is_none() {
        let _clone = build::needed_clone()?;
    }
    check_installed()?;
    let built = || {
        let progress = progress_spinner();
        let path = build::deployed(|package| progress.set_message(format!("building the image: {package}")));
        progress.finish_and_clear();
        path
    };
    let image = match &arguments.elf {
        Some(path) => Image::read(path)?,
        None => Image::read(&built()?)?,
    };
    let library_mean_ms = library_mean_age_ms(arguments, &scenario)?;
    let fleet = Fleet {
        scenario: &scenario,
        image: &image,
        units: arguments.units,
        slots: arguments.slots,
        seed: arguments.seed,
        port: arguments.port,
        answer_limit: ANSWER_LIMIT,
    };
    let template = "{bar:40} {pos}/{len} slots, {per_sec}, {left} left";
    let progress = progress_bar(u64::from(arguments.slots), template, arguments.json);
    let start = Instant::now();
    let result = fleet.run(|| progress.inc(1))?;
    progress.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    if arguments.json {
        say!(
            "{}",
            to_json(arguments, &scenario, &result, library_mean_ms, seconds)
        );
    } else {
        print_report(arguments, &scenario, &result, library_mean_ms, seconds);
    }
    if result.mismatches + result.deadline_misses == 0 {
        return Ok(());
    }
    let found = format!(
        "{} mismatches and {} missed deadlines",
        result.mismatches, result.deadline_misses
    );
    Err(Error::input("images", found, "none"))
}

/// The same world with the library's units alone.
fn library_mean_age_ms(arguments: &HilArguments, scenario: &Scenario) -> Result<f64> {
    let simulation = Simulation {
        scenario,
        source: &Grid,
        extent: Extent {
            seed: arguments.seed,
            worlds: 1,
            slots: arguments.slots,
            warmup: 0,
        },
    };
    let table = Table::parse(firmware::tables::DISTILLED)
        .map_err(|error| Error::input("built-in table", error, "a table"))?;
    let (ages, _) = simulation.run_policy(&actor::KIND, &table, |_, _| ())?;
    Ok(ages.mean_ms)
}

fn to_json(
    arguments: &HilArguments,
    scenario: &Scenario,
    result: &FleetResult,
    library_mean_ms: f64,
    seconds: f64,
) -> Value {
    json!({
        "units": arguments.units,
        "vehicles": scenario.cell.vehicles,
        "slots": arguments.slots,
        "seed": arguments.seed,
        "answers": result.answers,
        "mismatches": result.mismatches,
        "deadline_misses": result.deadline_misses,
        "min_instructions": result.min_instructions,
        "max_instructions": result.max_instructions,
        "nanoseconds_per_instruction": 1 << INSTRUCTION_SHIFT,
        "mean_age_ms": result.ages.mean_ms,
        "library_mean_age_ms": library_mean_ms,
        "p99_age_ms": result.ages.p99_ms,
        "seconds": seconds,
    })
}

fn print_report(
    arguments: &HilArguments,
    scenario: &Scenario,
    result: &FleetResult,
    library_mean_ms: f64,
    seconds: f64,
) {
    let (units, slots, vehicles) = (arguments.units, arguments.slots, scenario.cell.vehicles);
    say!(
        "{units} of {vehicles} vehicles are images in QEMU, {slots} slots, seed {}",
        arguments.seed
    );
    say!(
        "decisions           {} answered, {} not the library's",
        result.answers,
        result.mismatches
    );
    say!(
        "slot                {} to {} instructions from a frame's last byte to its answer, {} deadlines missed",
        result.min_instructions,
        result.max_instructions,
        result.deadline_misses
    );
    say!(
        "mean age            {:.3} ms, {library_mean_ms:.3} with the library alone",
        result.ages.mean_ms
    );
    say!("wall time           {seconds:.1} s");
}
