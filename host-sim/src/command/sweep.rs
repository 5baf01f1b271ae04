//! `host-sim sweep`: a grid of scenarios, policies and seeds, whole or one shard of it.

use crate::command::options::progress_bar;
use crate::shard::Shard;
use crate::sweep::{Grid, Kept, Outcome, Point, Store};
use crate::threads::thread_pool;
use kit::error::{Error, Result};
use kit::{remark, say};
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use std::sync::{Mutex, OnceLock};
use std::time::Instant;

/// Points that `--plan` times at most, evenly spread over the grid (chosen).
const PLAN_POINTS: usize = 16;

/// Threads that wait for the disk (chosen: one write takes some ten milliseconds until it outlives the power, and several take as long).
const WRITERS: usize = 8;

/// Which grid.
#[derive(Clone, Debug, clap::Args)]
pub struct GridArguments {
    /// TOML file: options of `run`, `loop` or `assign`, and a scenario, in which any value may be a list
    #[arg(long, value_name = "FILE")]
    pub grid: PathBuf,
    /// Seeds instead of the grid's, such as 1,2,10-19; `merge` takes the same
    #[arg(long, value_name = "LIST", value_parser = parse_seeds)]
    pub seeds: Option<SeedList>,
}

/// Seeds as the command line gives them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeedList(Vec<u64>);

impl GridArguments {
    /// Reads the grid.
    ///
    /// # Errors
    /// What is wrong with the grid.
    pub fn read(&self) -> Result<Grid> {
        Grid::read(&self.grid, self.seeds.as_ref().map(|seeds| seeds.0.as_slice()))
    }
}

/// Options of `sweep`.
#[derive(Clone, Debug, clap::Args)]
pub struct SweepArguments {
    /// The grid.
    #[command(flatten)]
    pub grid: GridArguments,
    /// Only every N-th point from the i-th on, i from 0 to N - 1
    #[arg(long, value_name = "i/N", conflicts_with = "plan")]
    pub shard: Option<Shard>,
    /// Folder of the results; what is there is not computed again
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Compute a few points only, and say into how many shards to split the rest so that each takes about this long
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub plan: Option<u32>,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print one JSON object and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

/// Computes what is missing.
///
/// # Errors
/// The first input that does not fit, before anything is written; a folder that cannot be written.
pub fn run(arguments: &SweepArguments) -> Result<()> {
    let grid = arguments.grid.read()?;
    let store = Store::new(&arguments.out, &grid)?;
    let shard = arguments.shard.unwrap_or(Shard::WHOLE);
    let mut waiting = Vec::new();
    let mut done = 0;
    for index in shard.of(grid.points()) {
        let point = grid.point(index);
        drop(grid.task(&point)?);
        match store.kept(index)? {
            Kept::Outcome(_) => done += 1,
            Kept::Nothing => waiting.push(point),
            Kept::Damaged(error) => {
                remark!("{error}; it is computed again");
                waiting.push(point);
            }
        }
    }
    store.begin()?;
    let mut object = json!({
        "grid": store.fingerprint(),
        "points": grid.points(),
        "shard": shard.index,
        "shards": shard.count,
        "skipped": done,
        "out": arguments.out,
    });
    let pool = thread_pool(arguments.threads)?;
    let timed = match arguments.plan {
        None => waiting.len(),
        Some(_) => waiting.len().min(PLAN_POINTS),
    };
    let start = Instant::now();
    // Evenly spread, which without --plan is every one.
    let chosen: Vec<&Point> = (0..timed).map(|k| &waiting[k * waiting.len() / timed]).collect();
    pool.install(|| compute(&grid, &store, &chosen, arguments.json))?;
    let seconds = start.elapsed().as_secs_f64();
    object["computed"] = json!(timed);
    object["seconds"] = json!(seconds);
    let mut text = format!(
        "Shard {} of {}: {timed} points computed in {seconds:.1} s, {done} were there already. Results in {}.",
        shard.index,
        shard.count,
        arguments.out.display()
    );
    if let Some(wanted) = arguments.plan {
        let left = waiting.len() - timed;
        let total = seconds * left as f64 / (timed.max(1) as f64);
        let shards = ((total / f64::from(wanted)) as usize).clamp(1, grid.points());
        object["seconds_left"] = json!(total);
        object["plan_shards"] = json!(shards);
        text = format!(
            "{timed} points computed in {seconds:.1} s, {left} left for about {total:.0} s on this machine: split into \
             {shards} shards."
        );
    }
    if arguments.json {
        say!("{object}");
    } else {
        say!("{text}");
    }
    Ok(())
}

/// Computes points in parallel, and keeps each as soon as it is there, while the next are computed.
fn compute(grid: &Grid, store: &Store, points: &[&Point], hide_progress: bool) -> Result<()> {
    let template = "{bar:40} {pos}/{len} points, {elapsed} so far, {left} left";
    let progress = progress_bar(points.len() as u64, template, hide_progress);
    let (sender, receiver) = sync_channel(WRITERS);
    let (receiver, failure) = (Mutex::new(receiver), OnceLock::new());
    let write = || {
        // Also after a failure, so that nobody waits for ever to hand over.
        while let Some((point, outcome)) = receiver.lock().ok().and_then(|receiver| receiver.recv().ok()) {
            match store.keep(point, outcome) {
                Ok(()) => progress.inc(1),
                Err(error) => drop(failure.set(error)),
            }
        }
    };
    let computed = std::thread::scope(|scope| {
        for _ in 0..WRITERS.min(points.len()) {
            let _joined_at_the_end = scope.spawn(write);
        }
        let computed = points.par_iter().with_max_len(1).try_for_each(|point| {
            if failure.get().is_none() {
                let object = grid.task(point)?()?;
                let outcome = Outcome::of(grid.command(), &object)?;
                // The other end is there as long as this one.
                let _sent = sender.send((point.index, outcome));
            }
            Ok::<(), Error>(())
        });
        drop(sender);
        computed
    });
    progress.finish_and_clear();
    failure.into_inner().map_or(computed, Err)
}

/// Reads `1,2,10-19`.
fn parse_seeds(text: &str) -> std::result::Result<SeedList, String> {
    /// Most seeds of one range (chosen).
    const MOST: u64 = 100_000;
    let number = |text: &str| {
        text.trim()
            .parse::<u64>()
            .ok()
            .filter(|&seed| seed <= i64::MAX as u64)
    };
    let mut seeds = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (number(first), number(last)) {
            (Some(first), Some(last)) if first <= last && last - first < MOST => seeds.extend(first..=last),
            _ => {
                return Err(format!(
                    "found \"{part}\", expected seeds and ranges such as 1,2,10-19"
                ));
            }
        }
    }
    Ok(SeedList(seeds))
}
