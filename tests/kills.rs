//! Whatever is killed, whenever: the same final bytes, and nothing left over. And equal runs give equal bytes of every file.
//!
//! `KILLS` says how many kills each command takes; `./test kills` lets it be a hundred.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use kit::choice::Choice as _;
use rand_core::Rng as _;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use system_tests::{below, program};
use trainer::configuration::Preset;

/// Kills of each command, and of each preset's training, unless said otherwise (chosen: a second or two).
const KILLS: u32 = 4;
const KILLS_OF_A_PRESET: u32 = 1;

/// Age from which a half-written file counts as left by the dead.
const SWEPT_UP_AFTER: Duration = Duration::from_millis(1_100);

const GRID: &str = "vehicles = [5, 10]\npolicy = [\"clock\", \"aloha\", \"central\"]\nseed = [1, 2, 3, 4]\nworlds = 2\nslots = 100\nwarmup = 10\n";

/// A command that writes below a folder.
struct Job {
    program: &'static str,
    arguments: Vec<String>,
    /// Whether several may work in one folder.
    shared: bool,
}

impl Job {
    fn new(program: &'static str, arguments: &str, shared: bool) -> Self {
        let arguments = arguments.split(' ').map(str::to_owned).collect();
        Self {
            program,
            arguments,
            shared,
        }
    }

    /// The command with `{}` for the folder.
    fn command(&self, folder: &Path) -> Command {
        let folder = folder.to_str().unwrap();
        let mut command = Command::new(program(self.program));
        command.args(
            self.arguments
                .iter()
                .map(|argument| argument.replace("{}", folder)),
        );
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    fn complete(&self, folder: &Path) {
        let Output { status, stderr, .. } = self.command(folder).output().unwrap();
        assert!(
            status.success(),
            "{:?}: {}",
            self.arguments,
            String::from_utf8_lossy(&stderr)
        );
    }
}

/// All files below a folder, by path.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(below) = folders.pop() {
        for entry in std::fs::read_dir(below).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                files.insert(path.strip_prefix(folder).unwrap().to_owned(), bytes);
            }
        }
    }
    files
}

fn assert_same(found: &Path, expected: &BTreeMap<PathBuf, Vec<u8>>, what: &str) {
    let found = files(found);
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(expected), "{what}");
    for (name, bytes) in expected {
        assert!(&found[name] == bytes, "{what}: {} differs", name.display());
    }
}

/// Kills a job as often as asked for, now and then lets it end, and compares. `prepare` makes a folder that it can begin in.
fn kill(job: &Job, seed: u64, kills: u32, prepare: impl Fn(&Path)) {
    let kills = std::env::var("KILLS").map_or(kills, |kills| kills.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    prepare(&whole);
    let start = Instant::now();
    job.complete(&whole);
    let took = start.elapsed();
    let expected = files(&whole);
    let mut rng = Pcg64Mcg::new(seed.into());
    let (mut killed, mut round, mut partial) = (0, 0, 0);
    while killed < kills {
        round += 1;
        let disturbed = folder.path().join(round.to_string());
        prepare(&disturbed);
        // So few in a folder that also the beginning is met often.
        for _ in 0..1 + below(&mut rng, 6) {
            let together = if job.shared { 1 + below(&mut rng, 3) } else { 1 };
            let children: Vec<Child> = (0..together)
                .map(|_| job.command(&disturbed).spawn().unwrap())
                .collect();
            let after = took.mul_f64(f64::from(rng.next_u32()) / f64::from(u32::MAX) * 1.2);
            std::thread::sleep(after);
            for mut child in children {
                child.kill().unwrap();
                let Output { status, stderr, .. } = child.wait_with_output().unwrap();
                let stderr = String::from_utf8_lossy(&stderr);
                assert!(
                    status.success() || status.code().is_none(),
                    "{:?}: {stderr}",
                    job.arguments
                );
                killed += u32::from(status.code().is_none());
            }
            let is_partial = |path: &PathBuf| path.to_string_lossy().ends_with(".partial");
            partial += files(&disturbed).keys().filter(|path| is_partial(path)).count();
        }
        std::thread::sleep(SWEPT_UP_AFTER);
        job.complete(&disturbed);
        assert_same(
            &disturbed,
            &expected,
            &format!("{:?} after {killed} kills", job.arguments),
        );
        std::fs::remove_dir_all(disturbed).unwrap();
    }
    println!(
        "{} {:?}: {killed} kills in {round} folders, {partial} half-written files were swept up, {} files as they were",
        job.program,
        &job.arguments[..job.arguments.len().min(3)],
        expected.len()
    );
}

fn empty(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
}

fn with_grid(folder: &Path) {
    empty(folder);
    std::fs::write(folder.join("grid.toml"), GRID).unwrap();
}

fn sweep() -> Job {
    Job::new(
        "host-sim",
        "sweep --grid {}/grid.toml --out {}/points --threads 1",
        true,
    )
}

fn merge() -> Job {
    Job::new(
        "host-sim",
        "merge --grid {}/grid.toml --out {}/points --figure vehicles",
        true,
    )
}

fn run() -> Job {
    Job::new(
        "host-sim",
        "run --worlds 4 --slots 100 --warmup 50 --policy clock --policy aloha --threads 1 --out {}/report",
        true,
    )
}

fn train() -> Job {
    Job::new(
        "trainer",
        "train --preset evolution --set evolution.episodes=60 --set evolution.population=8 --set evolution.elite=2 --set evolution.worlds=1 \
         --set evolution.slots=60 --seed 3 --threads 1 --checkpoint-every 0 --resume --out {}/run",
        false,
    )
}

#[test]
fn killed_sweeps_end_in_the_same_bytes() {
    kill(&sweep(), 1, KILLS, with_grid);
}

#[test]
fn killed_merges_end_in_the_same_bytes() {
    kill(&merge(), 2, KILLS, |folder| {
        with_grid(folder);
        sweep().complete(folder);
    });
}

#[test]
fn killed_runs_end_in_the_same_bytes() {
    kill(&run(), 3, KILLS, empty);
}

#[test]
fn killed_trainings_end_in_the_same_bytes() {
    kill(&train(), 4, KILLS, empty);
}

/// Every preset, at a size of a second; whatever a first actor is for begins with another run's.
#[test]
fn killed_trainings_of_every_preset_end_in_the_same_bytes() {
    let first = tempfile::tempdir().unwrap();
    let train = |preset: Preset| {
        let size = match preset {
            Preset::Evolution => {
                "evolution.episodes=20 evolution.population=8 evolution.elite=2 evolution.worlds=1 evolution.slots=60"
            }
            Preset::Paper | Preset::Companion | Preset::CompanionCode | Preset::Freshlane => {
                "scenario.cell.vehicles=3 maddpg.episodes=8 maddpg.worlds=2 maddpg.slots=20 maddpg.actor_hidden=[8] \
                 maddpg.local_critic_hidden=[8] maddpg.global_critic_hidden=[8,8] maddpg.batch=8 maddpg.actor_batch=8 maddpg.replay=160 \
                 maddpg.warm_up_slots=16"
            }
            Preset::Ppo | Preset::FineTune | Preset::Mappo | Preset::Ippo => {
                "ppo.episodes=6 ppo.critic_first_episodes=0 ppo.batches=2 ppo.updates=2 ppo.slots=8 ppo.hidden=[8] ppo.critic_hidden=[8] \
                 ppo.max_vehicles=6"
            }
            Preset::Vdn => {
                "scenario.cell.vehicles=3 vdn.episodes=8 vdn.worlds=2 vdn.slots=20 vdn.hidden=[8] vdn.batch=8 vdn.replay=160 vdn.warm_up_slots=16"
            }
        };
        let sets: String = size
            .split_whitespace()
            .map(|set| format!("--set {set} "))
            .collect();
        let from = match preset {
            Preset::FineTune => format!("--set ppo.first_actor={}/run ", first.path().display()),
            _ => String::new(),
        };
        let arguments = format!(
            "train --preset {} {sets}{from}--seed 3 --threads 1 --checkpoint-every 0 --resume --out {{}}/run",
            preset.name()
        );
        Job::new("trainer", &arguments, false)
    };
    train(Preset::Ppo).complete(first.path());
    for (seed, &preset) in (5..).zip(Preset::ALL) {
        kill(&train(preset), seed, KILLS_OF_A_PRESET, empty);
    }
}

#[test]
fn equal_runs_give_equal_bytes_of_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let fixtures = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../assignment/tests/fixtures/SiouxFalls_"
    );
    let assign = format!(
        "assign --net {fixtures}net.tntp --trips {fixtures}trips.tntp --gap 1e-4 --flows {{}}/f.parquet --paths {{}}/p.csv \
         --geojson {{}}/roads.geojson --report {{}}/assign.html --skims {{}}/skims.omx"
    );
    let jobs = [
        sweep(),
        merge(),
        run(),
        train(),
        Job::new("host-sim", &assign, false),
        Job::new("host-sim", "loop --worlds 2 --policy clock --out {}/loop", false),
        Job::new(
            "trainer",
            "distil --seed 9 --hidden 4 --threads 1 --out {}/distil",
            false,
        ),
    ];
    let both = ["one", "other"].map(|name| folder.path().join(name));
    for folder in &both {
        with_grid(folder);
        jobs.iter().for_each(|job| job.complete(folder));
    }
    let expected = files(&both[0]);
    assert!(expected.len() > 40, "{:?}", expected.keys());
    assert_same(&both[1], &expected, "two equal runs");
}

#[test]
fn whatever_is_cut_off_a_sweep_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    with_grid(&out);
    let again = || {
        sweep().complete(&out);
        merge().complete(&out);
    };
    again();
    let expected = files(&out);
    for (name, bytes) in expected.iter().filter(|(name, _)| name.starts_with("points")) {
        for left in [
            bytes.len() - 1,
            bytes.len() - bytes.len().min(20),
            bytes.len() / 2,
            0,
        ] {
            std::fs::write(out.join(name), &bytes[..left]).unwrap();
            again();
            assert_same(
                &out,
                &expected,
                &format!("{} cut to {left} bytes", name.display()),
            );
        }
    }
}
