//! What a slot costs on the chip: instructions counted in an emulator, cycles modelled from them, memories from the image.

pub mod cycles;
mod emulator;
pub mod network;
pub mod whole_slot;

use crate::image::{Footprint, Image, build};
use firmware::link::{Levels, MeasurementFrame, ModemFrame};
use firmware::network::Network;
use firmware::table::Table;
use kit::error::{Error, Result};
use network::PackedNetwork;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use std::path::Path;
use whole_slot::WholeSlot;

/// First word of a job for the measuring image.
const MAGIC: [u8; 4] = *b"FLMJ";
/// Widths in a job's entry.
const JOB_WIDTHS: usize = 5;

/// The two programs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Images {
    deployed: Image,
    measuring: Image,
}

impl Images {
    /// The one that is flashed, and the one that counts instructions in the emulator.
    ///
    /// # Errors
    /// As [`Image::read`], and for a measuring image that does not measure: it would run for ever and say nothing.
    pub fn read(deployed: &Path, measuring: &Path) -> Result<Self> {
        let measuring = Image::read(measuring)?;
        let _ = measuring.address("7measure", "the image `measure` of the package `firmware`")?;
        Ok(Self {
            deployed: Image::read(deployed)?,
            measuring,
        })
    }

    /// Builds both, and says which package is done.
    ///
    /// # Errors
    /// If Cargo is missing or a build fails, with its first error.
    pub fn build(mut done: impl FnMut(&str)) -> Result<Self> {
        Self::read(&build::deployed(&mut done)?, &build::measuring(&mut done)?)
    }
}

/// What to measure with.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Seeds networks, inputs and measurements.
    pub seed: u64,
    /// Slots of the whole path.
    pub slots: u32,
    /// Sub-channels of the cell in them.
    pub sub_channels: u32,
    /// Inputs for each network.
    pub inputs: u32,
}

/// A network and how many random inputs it gets.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The network.
    pub network: PackedNetwork,
    /// Inputs.
    pub inputs: u32,
    /// Bytes, 0 to 3, by which the network misses a word's boundary.
    pub misalignment: usize,
}

/// Least and greatest number of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Least.
    pub min: u64,
    /// Greatest.
    pub max: u64,
}

/// What the image found out about a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetworkCounts {
    /// With the kernel.
    pub kernel: Range,
    /// The same inference by the specification's own Rust.
    pub portable: Range,
    /// Inputs for which the two differ.
    pub mismatches: u64,
    /// CRC-32 of all outputs.
    pub digest: u32,
}

/// A stage of the slot.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// Its instructions.
    pub range: Range,
    /// Their sum over all slots.
    pub sum: u64,
}

/// A shape with its counts and its model.
#[derive(Clone, Debug)]
pub struct NetworkReport {
    /// Widths, as in 7-64-32-4.
    pub name: String,
    /// Counted.
    pub counts: NetworkCounts,
    /// Instructions of the kernel alone, from its text.
    pub kernel_instructions: u64,
    /// Modelled cycles of one inference with the kernel.
    pub cycles: f64,
    /// Bytes of the packed network.
    pub bytes: usize,
}

/// Everything.
#[derive(Clone, Debug)]
pub struct Report {
    /// The shape of the table's network, with the counts of its observations in the slots.
    pub actor: NetworkReport,
    /// 7-64-32-4.
    pub small: NetworkReport,
    /// The paper's 7-1024-512-4.
    pub paper: NetworkReport,
    /// The slot's stages in their order.
    pub stages: Vec<Stage>,
    /// From the first byte of a frame to the last of the answer.
    pub slot: Range,
    /// Modelled cycles of the slot with the most instructions.
    pub slot_cycles: f64,
    /// A whole slot of the deployed image with its built-in table, every interrupt included, where it could be counted.
    pub whole_slot: Option<WholeSlot>,
    /// The deployed image.
    pub footprint: Footprint,
    /// The deployed image's stack over some thousand slots.
    pub stack: u64,
}

/// Slots after which the stack is read (chosen).
const STACK_SLOTS: u32 = 2000;
/// Widths of the networks besides the table's.
const SMALL: [usize; 4] = [7, 64, 32, 4];
const PAPER: [usize; 4] = [7, 1024, 512, 4];
/// A network of more bytes is large, and its share of the inputs: an inference without the kernel takes millions of
/// instructions.
const LARGE: usize = 100_000;
const LARGE_SHARE: u32 = 50;

/// Most bytes of a table, beside the few other words of its job: the measuring image leaves 768 KiB of flash.
const MOST_TABLE: usize = (768 << 10) - 64;

/// How many steps [`report`] says before it takes them.
pub const STEPS: u64 = 6;

/// Measures everything, with this table in the slots, and says each step before it takes it.
///
/// # Errors
/// A missing emulator, an image that is none, and measurements that contradict each other.
pub fn report(
    images: &Images,
    extent: &Extent,
    table: &Table<'_>,
    mut step: impl FnMut(&str),
) -> Result<Report> {
    let length = table.bytes().len();
    if length > MOST_TABLE {
        let expected = format!("at most {MOST_TABLE}, which fit the chip's flash beside the image");
        return Err(Error::input("table", format!("{length} bytes"), expected));
    }
    let random = |widths: &[usize]| PackedNetwork::random(extent.seed, widths);
    // One job each: two large networks have no room beside each other.
    let mut measured = |network: PackedNetwork| {
        step(&format!("inferences of {}", network.name()));
        let large = network.bytes.len() > LARGE;
        let subject = Subject {
            inputs: extent.inputs.div_ceil(if large { LARGE_SHARE } else { 1 }),
            network,
            misalignment: 0,
        };
        let counts = measure_networks(images, extent.seed, std::slice::from_ref(&subject))?;
        let counts = counts.first().ok_or_else(|| contradiction("no network"))?;
        network_report(&subject, *counts)
    };
    let mut actor = measured(PackedNetwork::of_table(table))?;
    let small = measured(random(&SMALL)?)?;
    let paper = measured(random(&PAPER)?)?;
    step(&format!("{} slots", extent.slots));
    let stages = measure_slots(images, extent.seed, extent.slots, extent.sub_channels, table)?;
    let stage = |name: &str| stages.iter().find(|stage| stage.name == name);
    let (Some(infer), Some(slot)) = (stage("infer"), stage("slot")) else {
        return Err(contradiction("too few stages"));
    };
    actor.counts.kernel = infer.range;
    actor.cycles = cycles::inference_cycles(table.network(), infer.range.max);
    let slot = slot.range;
    let around = slot.max.saturating_sub(actor.counts.kernel.max);
    let slot_cycles = actor.cycles + cycles::compiled_cycles(around);
    step("the stack");
    let footprint = images.deployed.footprint().clone();
    let stack = emulator::stack(images.deployed.path(), &footprint.stack, &frames(extent.seed))?;
    step("a whole slot, in another emulator");
    let whole_slot = whole_slot::count(images.deployed.path())?;
    Ok(Report {
        slot_cycles,
        stack,
        whole_slot,
        stages: stages
            .iter()
            .filter(|stage| stage.name != "slot")
            .cloned()
            .collect(),
        actor,
        small,
        paper,
        slot,
        footprint,
    })
}

fn contradiction(found: &str) -> Error {
    Error::input(
        "the measuring image",
        found,
        "the image of this program's own sources",
    )
}

fn network_report(subject: &Subject, counts: NetworkCounts) -> Result<NetworkReport> {
    let PackedNetwork { widths, bytes } = &subject.network;
    let network = Network::parse(widths, bytes)
        .map_err(|error| Error::input("random network", error, "one for the firmware"))?;
    if counts.mismatches > 0 {
        return Err(Error::input(
            "the kernel",
            format!("{} other outputs than the specification's", counts.mismatches),
            "the same bits",
        ));
    }
    Ok(NetworkReport {
        name: subject.network.name(),
        counts,
        kernel_instructions: cycles::kernel_cost(&network).instructions,
        cycles: cycles::inference_cycles(&network, counts.kernel.max),
        bytes: bytes.len(),
    })
}

/// Counts for each network, from the measuring image. All of them must fit its flash.
///
/// # Errors
/// A missing emulator or a run that breaks off, with its last words.
pub fn measure_networks(images: &Images, seed: u64, subjects: &[Subject]) -> Result<Vec<NetworkCounts>> {
    let (networks, _) = measure(images, &job(seed, None, subjects))?;
    if networks.len() == subjects.len() {
        Ok(networks)
    } else {
        Err(contradiction("another number of networks"))
    }
}

/// The stages of this many slots in a cell of so many sub-channels, in which the table decides and, as `slot`, their total, from the measuring image.
///
/// # Errors
/// As [`measure_networks`].
pub fn measure_slots(
    images: &Images,
    seed: u64,
    slots: u32,
    sub_channels: u32,
    table: &Table<'_>,
) -> Result<Vec<Stage>> {
    let (_, stages) = measure(images, &job(seed, Some((slots, sub_channels, table)), &[]))?;
    Ok(stages)
}

fn measure(images: &Images, job: &[u8]) -> Result<(Vec<NetworkCounts>, Vec<Stage>)> {
    let lines = emulator::measure(images.measuring.path(), job)?;
    let (mut networks, mut stages) = (Vec::new(), Vec::new());
    for line in &lines {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |index: usize| -> Result<u64> {
            let word = words.get(index).copied().unwrap_or_default();
            word.parse().map_err(|_| contradiction(line))
        };
        let range = |index: usize| -> Result<Range> {
            Ok(Range {
                min: number(index)?,
                max: number(index + 1)?,
            })
        };
        match words.first().copied() {
            Some("network") => networks.push(NetworkCounts {
                kernel: range(3)?,
                portable: range(6)?,
                mismatches: number(9)?,
                digest: words
                    .get(11)
                    .and_then(|word| u32::from_str_radix(word, 16).ok())
                    .ok_or_else(|| contradiction(line))?,
            }),
            Some("stage") => stages.push(Stage {
                name: words.get(1).copied().unwrap_or_default().to_owned(),
                range: range(2)?,
                sum: number(4)?,
            }),
            _ => {}
        }
    }
    Ok((networks, stages))
}

fn job(seed: u64, slots: Option<(u32, u32, &Table<'_>)>, subjects: &[Subject]) -> Vec<u8> {
    let mut job = MAGIC.to_vec();
    let none = (0, 1, &[][..]);
    let (slots, sub_channels, table) = slots.map_or(none, |(slots, sub_channels, table)| {
        (slots, sub_channels, table.bytes())
    });
    for word in [fold(seed), slots, sub_channels, table.len() as u32] {
        job.extend(word.to_le_bytes());
    }
    job.extend(table);
    job.resize(job.len().next_multiple_of(4), 0);
    job.extend((subjects.len() as u32).to_le_bytes());
    for Subject {
        network,
        inputs,
        misalignment,
    } in subjects
    {
        let mut word = |value: usize| job.extend((value as u32).to_le_bytes());
        word(*inputs as usize);
        word(network.widths.len());
        let padded = network.widths.iter().copied().chain(std::iter::repeat(0));
        padded.take(JOB_WIDTHS).for_each(&mut word);
        word(network.bytes.len());
        word(*misalignment);
        job.resize(job.len() + misalignment, 0);
        job.extend(&network.bytes);
        job.resize(job.len().next_multiple_of(4), 0);
    }
    job
}

/// The seed as the image takes it.
pub fn fold(seed: u64) -> u32 {
    (seed ^ (seed >> 32)) as u32
}

/// What a modem sends: measurements, and now and then none.
fn frames(seed: u64) -> Vec<ModemFrame> {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 1 | 1);
    let mut below = |limit: u32| ((u64::from(rng.next_u32()) * u64::from(limit)) >> 32) as u32;
    let levels = |most: u32, below: &mut dyn FnMut(u32) -> u32| -> Levels {
        (0..3).map(|_| below(most) as i16).collect()
    };
    // Behind the questions with which the unit was woken.
    let first = 1_000_000;
    (first..first + STACK_SLOTS)
        .map(|slot| match below(8) {
            0 => ModemFrame::Missed { slot },
            _ => ModemFrame::Measurement(MeasurementFrame {
                slot,
                gain: levels(18_000, &mut below),
                interference: levels(9_000, &mut below),
                last_acknowledged: (below(10) > 0).then(|| slot - 1 - below(100)),
                place: (below(4) > 0).then(|| (below(20) as u16, below(2) > 0)),
                awaits_acknowledgement: below(4) == 0,
                places: 20 + below(20) as u16,
                open: below(1 << 16) as u16,
                threshold: below(1 << 28),
                salt: below(256) as u8,
                gains_hold: below(2) == 0,
                weight: below(256) as u8,
                max_power: 30 << 8,
            }),
        })
        .collect()
}
