//! `host-sim deadline`: what a slot costs on the chip.

use crate::command::options::progress_spinner;
use crate::deadline::cycles::{CORE_HZ, SLOT_CYCLES};
use crate::deadline::{Extent, Images, NetworkReport, Report, STEPS, report};
use crate::hil::emulator::check_installed;
use crate::image::build;
use crate::report::table::{Column, Table};
use crate::weight_table::WeightTable;
use kit::error::{Error, Result};
use kit::say;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Options of `deadline`.
#[derive(Clone, Debug, clap::Args)]
pub struct DeadlineArguments {
    /// Measuring image to run instead of building one
    #[arg(long, value_name = "ELF", requires = "deployed")]
    pub measuring: Option<PathBuf>,
    /// Deployed image to look at instead of building one
    #[arg(long, value_name = "ELF", requires = "measuring")]
    pub deployed: Option<PathBuf>,
    /// Weight table whose slot to measure [default: the one in the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Slots of the whole path, one in 16 of them without a measurement
    #[arg(long, default_value_t = 110_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub slots: u32,
    /// Sub-channels of the cell in which these slots are
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub sub_channels: u32,
    /// Random inputs for each network
    #[arg(long, default_value_t = 2_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub inputs: u32,
    /// Seed of networks, inputs and measurements
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Builds, measures and reports.
///
/// # Errors
/// [`Error`] for an image that does not build or is none, and for a missing emulator.
pub fn run(arguments: &DeadlineArguments) -> Result<()> {
    let table = WeightTable::read_or_built_in(arguments.table.as_deref())?;
    let table = table.parse()?;
    let progress = progress_spinner();
    progress.set_message("building the images");
    let images = match (&arguments.measuring, &arguments.deployed) {
        (Some(measuring), Some(deployed)) => Images::read(deployed, measuring)?,
        _ => {
            // What is missing is said before minutes of compiling.
            let _clone = build::needed_clone()?;
            check_installed()?;
            Images::build(|package| progress.set_message(format!("building the images: {package}")))?
        }
    };
    let extent = Extent {
        seed: arguments.seed,
        slots: arguments.slots,
        sub_channels: arguments.sub_channels,
        inputs: arguments.inputs,
    };
    let mut steps = 0;
    let report = report(&images, &extent, &table, |step| {
        steps += 1;
        progress.set_message(format!(
            "{steps} of {STEPS}: counting instructions in QEMU, {step}"
        ));
    })?;
    progress.finish_and_clear();
    if report.actor.counts.kernel.min != report.actor.counts.kernel.max {
        return Err(Error::input(
            "the actor's inference",
            format!(
                "{} to {} instructions",
                report.actor.counts.kernel.min, report.actor.counts.kernel.max
            ),
            "the same number for every input",
        ));
    }
    if arguments.json {
        say!("{}", as_json(&report, &extent));
    } else {
        let text = as_text(&report, &extent, arguments.table.as_deref())?;
        say!("{}", text.trim_end());
    }
    Ok(())
}

/// The report's JSON object.
pub fn as_json(report: &Report, extent: &Extent) -> Value {
    let network = |network: &NetworkReport| {
        json!({
            "min_instructions": network.counts.kernel.min,
            "max_instructions": network.counts.kernel.max,
            "portable_min_instructions": network.counts.portable.min,
            "portable_max_instructions": network.counts.portable.max,
            "modelled_cycles": network.cycles.round(),
            "bytes": network.bytes,
        })
    };
    let stages = report.stages.iter().map(|stage| {
        let counts = json!({ "min_instructions": stage.range.min, "max_instructions": stage.range.max });
        (stage.name.clone(), counts)
    });
    json!({
        "seed": extent.seed,
        "slots": extent.slots,
        "inference_min_instructions": report.actor.counts.kernel.min,
        "inference_max_instructions": report.actor.counts.kernel.max,
        "slot_min_instructions": report.slot.min,
        "slot_max_instructions": report.slot.max,
        "slot_modelled_cycles": report.slot_cycles.round(),
        "slot_with_interrupts_max_instructions": report.whole_slot.map(|slot| slot.instructions),
        "slot_with_interrupts_exceptions": report.whole_slot.map(|slot| slot.exceptions),
        "slot_with_interrupts_max_cycles": report.whole_slot.map(|slot| slot.cycles),
        "net_7_64_32_4_instructions": report.small.counts.kernel.max,
        "net_7_1024_512_4_instructions": report.paper.counts.kernel.max,
        "net_7_1024_512_4_period_slots": period(&report.paper),
        "networks": {
            &report.actor.name: network(&report.actor),
            &report.small.name: network(&report.small),
            &report.paper.name: network(&report.paper),
        },
        "stages": serde_json::Map::from_iter(stages),
        "flash_bytes": report.footprint.flash,
        "ram_bytes": report.footprint.ram,
        "stack_bytes": report.stack,
    })
}

/// The shortest period in whole slots that a network can meet.
fn period(network: &NetworkReport) -> f64 {
    (network.cycles / SLOT_CYCLES).ceil()
}

fn as_text(report: &Report, extent: &Extent, table: Option<&Path>) -> Result<String> {
    let origin = table.map_or("shipped".to_owned(), |table| table.display().to_string());
    let each = [&report.actor, &report.small, &report.paper];
    let names = [format!(" ({origin})"), String::new(), " (the paper's)".to_owned()];
    let names = each
        .iter()
        .zip(names)
        .map(|(network, note)| format!("{}{note}", network.name));
    let counts = |name, of: fn(&NetworkReport) -> u64| {
        Column::unsigned(name, each.map(of)).shown(name, "instructions", 0)
    };
    let cycles = each.map(|network| network.cycles);
    let mut networks = Table::new(vec![
        Column::text("network", names),
        counts("kernel min", |network| network.counts.kernel.min),
        counts("max", |network| network.counts.kernel.max),
        counts("portable max", |network| network.counts.portable.max),
        Column::number("cycles", cycles).shown("cycles", "modelled", 0),
        Column::number("slot", cycles.map(|cycles| 100.0 * cycles / SLOT_CYCLES)).shown("slot", "%", 1),
    ])?
    .titled("One inference");
    let paper = &report.paper;
    networks.note(&format!(
        "The paper's actor takes {:.1} ms: it cannot decide every slot on this chip, but every {} slots at best.",
        1000.0 * paper.cycles / CORE_HZ,
        period(paper)
    ));
    let names = report.stages.iter().map(|stage| match stage.name.as_str() {
        "observe" | "infer" | "decide" => format!("  {}", stage.name),
        name => name.replace('_', " "),
    });
    let ranges = || {
        report
            .stages
            .iter()
            .map(|stage| &stage.range)
            .chain([&report.slot])
    };
    let mut stages = Table::new(vec![
        Column::text("stage", names.chain(["slot".to_owned()])),
        Column::unsigned("min", ranges().map(|range| range.min)).shown("min", "instructions", 0),
        Column::unsigned("max", ranges().map(|range| range.max)).shown("max", "instructions", 0),
    ])?
    .titled("One slot, from the frame's first byte to the answer's last");
    stages.note("Observe, infer and decide are measured alone; in the slot they are parts of the unit. Activation comes once an update.");
    let whole = match report.whole_slot {
        Some(slot) => format!(
            "A whole slot of the image with its built-in table, every interrupt included: at most {} instructions, {} exceptions\n\
             and {} modelled cycles, {:.1} % of a slot of 1 ms at 168 MHz, of the tests' recorded frames of up to 3 sub-channels.\n",
            slot.instructions,
            slot.exceptions,
            slot.cycles,
            100.0 * slot.cycles as f64 / SLOT_CYCLES
        ),
        None => "A whole slot with every interrupt: not counted; `./test slot` installs what that takes.\n"
            .to_owned(),
    };
    Ok(format!(
        "{networks}\n{stages}\n{whole}\
         Its stages, of the slot of this table with most instructions: {:.0} modelled cycles.\n\
         Deployed image with its built-in table: {} bytes of flash, {} of static RAM, {} of stack at most.\n\n\
         Instructions: counted in QEMU (-icount), seed {}, {} slots; emulated, not timed on a chip.\n\
         Cycles: a model. Kernel: Cortex-M4 TRM table 3-1 (LDM 1 + n, taken branch 3, multiply-accumulate 1), and 5 wait\n\
         states for each 16 bytes of weights, and once for its code. Other code: 1.6 cycles an instruction and every 16 bytes\n\
         of it fetched anew from flash (assumed, pessimistic). The whole slot: every instruction's by that manual, and caches as the flash has them.\n",
        report.slot_cycles,
        report.footprint.flash,
        report.footprint.ram,
        report.stack,
        extent.seed,
        extent.slots,
    ))
}
