//! Mutated files and frames against every parser and everything behind it: no panic, no answer of several lines, no hang, no memory
//! without a bound.
//!
//! Each [target](targets::TARGETS) has a corpus: what it reads in `scene/`, what `corpus/TARGET/` keeps, and what the product writes.
//! Inputs are mutations of these; one that is answered as none was before becomes a part of the corpus while the test runs, so that
//! later mutations reach deeper. It runs a fixed number of mutations, or as many as `FUZZ_MUTATIONS` says, or as fit into
//! `FUZZ_SECONDS` for each target; `FUZZ_SEED` draws others. What fails lies in `target/fuzz/`; mended, it belongs into `corpus/TARGET/`.

#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

mod frames;
mod mutation;
mod scene;
mod targets;
mod watch;

use mutation::Mutator;
use peak_alloc::PeakAlloc;
use scene::Scene;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use targets::{TARGETS, Target};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Mutations of each target, unless said otherwise (chosen: a few seconds for all).
const MUTATIONS: u64 = 200;

/// Longest processor time for an input.
const LONGEST: Duration = Duration::from_secs(1);

/// Most memory for an input, beyond what was in use before.
const MOST_MEMORY: usize = 256 << 20;

/// Inputs that a corpus grows to (chosen).
const MOST_KEPT: usize = 300;

/// Longest message (chosen: a line that people read).
const LONGEST_MESSAGE: usize = 2_000;

/// Targets have their turns: memory is counted for the whole program.
static TURN: Mutex<()> = Mutex::new(());

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok().map(|text| text.parse().unwrap())
}

/// Runs a target on its corpus and its mutations.
fn attack(name: &str) {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    let scene = Scene::new();
    let mut corpus = scene.corpus(target);
    let seed = number("FUZZ_SEED").unwrap_or(1);
    let end = number("FUZZ_SECONDS").map(|seconds| Instant::now() + Duration::from_secs(seconds));
    let most = match end {
        Some(_) => u64::MAX,
        None => number("FUZZ_MUTATIONS").unwrap_or(MUTATIONS),
    };
    let mut tally = Tally::default();
    for input in &corpus {
        let _kind = tally.judge(target, &scene, input);
    }
    assert!(tally.accepted > 0, "{name}: nothing in the corpus is accepted");
    let mut mutator = Mutator::new(seed, name, &corpus);
    while tally.inputs < most && end.is_none_or(|end| Instant::now() < end) {
        let input = mutator.mutate(&corpus);
        if tally.judge(target, &scene, &input) && corpus.len() < MOST_KEPT {
            corpus.push(input);
        }
    }
    println!("{name}: {tally}");
}

/// What became of a target's inputs.
#[derive(Default)]
struct Tally {
    inputs: u64,
    accepted: u64,
    /// Messages without what differs between inputs.
    kinds: BTreeSet<String>,
    slowest: Duration,
    most_memory: usize,
}

impl std::fmt::Display for Tally {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            formatter,
            "{} inputs, {} accepted, {} kinds of answers, at most {:.3} s and {:.1} MB",
            self.inputs,
            self.accepted,
            self.kinds.len(),
            self.slowest.as_secs_f64(),
            self.most_memory as f64 / f64::from(1 << 20)
        )
    }
}

impl Tally {
    /// Runs an input, which may do nothing that none may; whether it is answered as none was before.
    fn judge(&mut self, target: &Target, scene: &Scene, input: &[u8]) -> bool {
        self.inputs += 1;
        let (answer, time, memory) = measured(target, scene, input);
        self.slowest = self.slowest.max(time);
        self.most_memory = self.most_memory.max(memory);
        if time > LONGEST {
            fail(target, input, &format!("{time:?}"));
        }
        if memory > MOST_MEMORY {
            fail(target, input, &format!("{memory} bytes of memory"));
        }
        let kind = match answer {
            Ok(Ok(())) => {
                self.accepted += 1;
                String::new()
            }
            Ok(Err(message)) => {
                if message.contains('\n') || message.len() > LONGEST_MESSAGE {
                    fail(target, input, &format!("a message that is no line: {message:?}"));
                }
                kind(&message)
            }
            Err(()) => fail(target, input, "a panic, see above"),
        };
        self.kinds.insert(kind)
    }
}

/// What a target says to an input, or that it panics; its time and its memory.
fn measured(
    target: &Target,
    scene: &Scene,
    input: &[u8],
) -> (Result<Result<(), String>, ()>, Duration, usize) {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let (answer, time) = watch::timed(target.name, input, || {
        scene.put(target, input);
        (target.run)(scene.path()).map_err(|error| error.to_string())
    });
    let memory = MEMORY.peak_usage().saturating_sub(before);
    (answer, time, memory)
}

/// What a message expected, without numbers and quotations: what was found is the input's, and new each time.
fn kind(message: &str) -> String {
    let expected = message.rsplit(", expected ").next().unwrap_or(message);
    let mut quoted = false;
    let kept = expected.chars().filter(|letter| {
        let quotes = "`\"'".contains(*letter);
        quoted ^= quotes;
        !(quotes || quoted || letter.is_ascii_digit())
    });
    kept.take(100).collect()
}

/// Ends the test, and keeps the input.
fn fail(target: &Target, input: &[u8], what: &str) -> ! {
    panic!(
        "{}: {what}; the input is {}",
        target.name,
        keep(target.name, input).display()
    );
}

/// Keeps an input that failed.
fn keep(name: &str, input: &[u8]) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("../fuzz");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder
        .canonicalize()
        .unwrap()
        .join(format!("{name}-{}", input.len()));
    std::fs::write(&path, input).unwrap();
    path
}

/// A test for each target.
macro_rules! targets {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            attack(stringify!($name));
        })*

        #[test]
        fn every_target_has_a_test() {
            let names = [$(stringify!($name)),*];
            assert!(TARGETS.iter().map(|target| target.name).eq(names));
        }
    };
}

targets! {
    tntp_network tntp_trips tntp_nodes gmns_nodes gmns_links gmns_config gmns_movements gmns_groups gmns_geometry gmns_demand
    sumo_network sumo_routes sumo_zones pairs matrix omx packed_network turns link_table classes flows published_flows
    parquet_flows paths trace packed_trace scenario grid configuration plan weight_table sealed_table checkpoint replay_part actor identity
    session
}
