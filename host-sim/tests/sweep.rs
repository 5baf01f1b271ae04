//! Sweeps: the same merged bytes however the grid is split, killed and repeated; bad input is one line and exit code 2.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// 2 x 5 x 100 = 1,000 points, as small as they get: four roads too.
const THOUSAND: &str = "
worlds = 1
slots = 3
warmup = 0
vehicles = [2, 4]
policy = [\"actor\", \"central\", \"clock\", \"aloha\", \"always\"]
seed = { from = 1, to = 100 }
[mobility]
blocks_x = 1
blocks_y = 1
";

/// 12 points of two worlds.
const SMALL: &str = "
worlds = 2
slots = 30
warmup = 10
policy = [\"actor\", \"aloha\"]
seed = [3, 4]
[cell]
vehicles = [4, 8, 12]
";

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new(grid: &str) -> Self {
        let bench = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        bench.write(grid);
        bench
    }

    fn write(&self, grid: &str) {
        std::fs::write(self.grid(), grid).unwrap();
    }

    fn grid(&self) -> PathBuf {
        self.folder.path().join("grid.toml")
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, name: &str, out: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        let _same = command.arg(name).arg("--grid").arg(self.grid());
        let _same = command.arg("--out").arg(self.path(out)).args(more);
        command
    }

    fn output(&self, name: &str, out: &str, more: &[&str]) -> Output {
        self.command(name, out, more).output().unwrap()
    }

    fn json(&self, name: &str, out: &str, more: &[&str]) -> Value {
        let output = self.output(name, out, &[&["--json"], more].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name} {more:?}: {message}");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Fails with one line on stderr and exit code 2; the folder's name is left out.
    fn refusal(&self, name: &str, out: &str, more: &[&str]) -> String {
        let output = self.output(name, out, more);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{name} {more:?}: {message}");
        assert!(output.stdout.is_empty(), "{name} {more:?} printed to stdout");
        assert_eq!(message.lines().count(), 1, "{message}");
        let folder = format!("{}/", self.folder.path().display());
        message.trim_end().replace(&folder, "")
    }

    fn merged(&self, out: &str) -> (Vec<u8>, Vec<u8>) {
        let object = self.json("merge", out, &[]);
        assert_eq!(object["merged"], object["points"]);
        let read = |name: &str| std::fs::read(self.path(out).join(name)).unwrap();
        (read("merged.parquet"), read("merged.csv"))
    }

    /// Runs a shard to its end.
    fn shard(&self, out: &str, shard: &str) {
        let _object = self.json("sweep", out, &["--shard", shard]);
    }

    /// Runs a shard, and kills it as soon as it has kept so many points. Whether it came to that.
    fn kill_midway(&self, out: &str, shard: &str, after: usize) -> bool {
        let folder = self.path(out);
        let before = files(&folder);
        let mut command = self.command("sweep", out, &["--shard", shard, "--json"]);
        let mut child = command.stdout(Stdio::null()).spawn().unwrap();
        loop {
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success());
                return false;
            }
            if files(&folder) >= before + after {
                child.kill().unwrap();
                return !child.wait().unwrap().success();
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn files(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    entries
        .map(|entry| {
            let path = entry.unwrap().path();
            if path.is_dir() {
                files(&path)
            } else {
                usize::from(path.extension().is_some_and(|e| e == "json"))
            }
        })
        .sum()
}

/// With far more points than are on their way to the disk at a time: nobody waits for ever to hand over.
#[cfg(unix)]
#[test]
fn a_disk_that_takes_nothing_ends_the_sweep() {
    let bench = Bench::new(THOUSAND);
    std::fs::create_dir_all(bench.path("out/points")).unwrap();
    std::os::unix::fs::symlink("nowhere", bench.path("out/points/000")).unwrap();
    let refusal = bench.refusal("sweep", "out", &["--threads", "2"]);
    assert!(refusal.starts_with("error: out/points/000: "), "{refusal}");
}

#[test]
fn a_thousand_points_merge_to_the_same_bytes_however_split_killed_and_repeated() {
    let bench = Bench::new(THOUSAND);
    let object = bench.json("sweep", "whole", &[]);
    assert_eq!(object["computed"], 1000);
    let expected = bench.merged("whole");
    let mut random = 2026_u64;
    let mut next = |below: u64| {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) % below
    };
    for count in [1, 7, 50] {
        let out = format!("in {count}");
        let mut order: Vec<u64> = (0..count).collect();
        for last in (1..order.len()).rev() {
            order.swap(last, next(last as u64 + 1) as usize);
        }
        let mut killed = 0;
        for index in order {
            let shard = format!("{index}/{count}");
            for _ in 0..next(3) + u64::from(count == 1) {
                let after = next(1000 / count / 2) as usize;
                killed += usize::from(bench.kill_midway(&out, &shard, after));
            }
            bench.shard(&out, &shard);
        }
        assert!(killed > 0, "no shard of {count} was killed midway");
        // Once more with another split: nothing is left to do.
        let again = bench.json("sweep", &out, &["--shard", "2/3"]);
        assert_eq!(
            (again["computed"].as_u64(), again["skipped"].as_u64()),
            (Some(0), Some(333))
        );
        assert!(bench.merged(&out) == expected, "{count} shards");
    }
    // Halves in different folders, one of them whole: repeated points agree.
    bench.shard("half", "1/2");
    let more = [
        "--results",
        bench.path("whole").to_str().unwrap(),
        "--results",
        bench.path("half").to_str().unwrap(),
    ]
    .map(str::to_owned);
    let more: Vec<&str> = more.iter().map(String::as_str).collect();
    let _object = bench.json("merge", "both", &more);
    assert!(std::fs::read(bench.path("both/merged.parquet")).unwrap() == expected.0);
}

#[test]
fn a_point_is_what_run_says_and_the_figure_pools_seeds() {
    let bench = Bench::new(SMALL);
    let plan = bench.json("sweep", "out", &["--plan", "1"]);
    assert_eq!(
        (plan["points"].as_u64(), plan["computed"].as_u64()),
        (Some(12), Some(12))
    );
    assert_eq!(plan["plan_shards"], 1);
    let object = bench.json("merge", "out", &["--figure", "vehicles"]);
    assert_eq!(object["files"].as_array().unwrap().len(), 5);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(
        rows[0][..9],
        [
            "point",
            "policy",
            "seed",
            "vehicles",
            "worlds",
            "slots",
            "warmup",
            "bound_age_ms",
            "mean_age_ms"
        ]
    );
    // The last group changes fastest: vehicles, then policy, then seed.
    assert_eq!(rows[7][..7], ["6", "aloha", "3", "8", "2", "30", "10"]);
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args([
            "run",
            "--json",
            "--policy",
            "aloha",
            "--seed",
            "3",
            "--vehicles",
            "8",
        ])
        .args(["--worlds", "2", "--slots", "30", "--warmup", "10"])
        .output()
        .unwrap();
    let run: Value = serde_json::from_slice(&output.stdout).unwrap();
    let policy = &run["policies"][0];
    let number = |text: &str| Value::from(text.parse::<f64>().unwrap());
    let of_policy = |column: &usize| (8..14).contains(column) || *column >= 19;
    for column in (0..rows[0].len()).filter(of_policy) {
        let name = rows[0][column];
        assert_eq!(number(rows[7][column]), policy[name], "{name}");
    }
    assert_eq!(number(rows[7][14]), policy["traffic"]["uniform_mean_v_over_c"]);
    let figure = std::fs::read_to_string(bench.path("out/mean_age_by_vehicles.csv")).unwrap();
    let line = figure.lines().find(|line| line.starts_with("aloha,8,")).unwrap();
    let fields: Vec<f64> = line
        .split(',')
        .skip(1)
        .map(|field| field.parse().unwrap())
        .collect();
    let of =
        |column: usize| -> Vec<f64> { [7, 8].map(|row: usize| rows[row][column].parse().unwrap()).into() };
    let (means, halves) = (of(8), of(9));
    assert_eq!(fields[1], (means[0] + means[1]) / 2.0);
    assert_eq!(
        fields[2],
        libm::sqrt(halves[0] * halves[0] + halves[1] * halves[1]) / 2.0
    );
    // No age of so short a run is beyond 140 ms, so some are beyond T.
    assert!(fields[3] > fields[1] && fields[4] > 0.0, "{fields:?}");
    assert_eq!(fields[5], 2.0);
}

#[test]
fn missing_points_are_named_and_merged_only_if_asked() {
    let bench = Bench::new(SMALL);
    assert!(
        bench
            .refusal("merge", "out", &[])
            .starts_with("error: out: found no grid.json, expected results of")
    );
    bench.shard("out", "0/3");
    let message = bench.refusal("merge", "out", &[]);
    assert!(
        message.starts_with(
            "error: out: found 8 of 12 points missing: 1 to 2, 4 to 5, 7 to 8, 10 to 11, expected every point"
        ),
        "{message}"
    );
    assert!(!bench.path("out/merged.csv").exists());
    let output = bench.output("merge", "out", &["--json"]);
    assert_eq!(output.status.code(), Some(2));
    let object: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["missing"], serde_json::json!([1, 2, 4, 5, 7, 8, 10, 11]));
    let object = bench.json("merge", "out", &["--allow-missing"]);
    assert_eq!(object["merged"], 4);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    let points: Vec<&str> = csv
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').unwrap().0)
        .collect();
    assert_eq!(points, ["0", "3", "6", "9"]);
}

#[test]
fn zipped_axes_and_seeds_of_the_command_line() {
    let bench = Bench::new(
        "
worlds = [1, 2]
vehicles = [4, 8]
slots = 5
warmup = 0
policy = \"always\"
zip = [[\"vehicles\", \"worlds\"]]
radio.noise_power_dbm = [-114, -110.5]
",
    );
    let _object = bench.json("sweep", "out", &["--seeds", "7,9-10"]);
    let _object = bench.json("merge", "out", &["--seeds", "7,9-10"]);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    let rows: Vec<String> = csv
        .lines()
        .map(|line| line.split(',').take(6).collect::<Vec<_>>().join(","))
        .collect();
    assert_eq!(rows.len(), 13);
    assert_eq!(rows[0], "point,radio.noise_power_dbm,policy,seed,vehicles,worlds");
    assert_eq!(rows[1], "0,-114,always,7,4,1");
    assert_eq!(rows[6], "5,-114,always,10,8,2");
    assert_eq!(rows[12], "11,-110.5,always,10,8,2");
    assert!(
        bench
            .refusal("merge", "out", &[])
            .contains("found results of another grid")
    );
}

#[test]
fn flags_and_names_of_a_scenario_may_be_lists_too() {
    let bench = Bench::new(
        "
worlds = 1
slots = 5
warmup = 0
policy = \"assigned\"
fading.follows_speed = [false, true]
mobility.turns = [\"per-lane\", \"per-crossing\"]
",
    );
    let _object = bench.json("sweep", "out", &[]);
    let _object = bench.json("merge", "out", &[]);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    assert!(
        csv.starts_with("point,fading.follows_speed,mobility.turns,"),
        "{csv}"
    );
    assert!(csv.contains("\n2,true,per-lane,"), "{csv}");
    bench.write("fading.follows_speed = 1\n");
    let message = bench.refusal("sweep", "other", &[]);
    assert!(message.ends_with("found 1, expected true or false"), "{message}");
}

#[test]
fn bad_grids_and_shards_are_one_line_each() {
    let bench = Bench::new(SMALL);
    let with = |grid: &str| {
        bench.write(grid);
        let message = bench.refusal("sweep", "out", &[]);
        assert!(!bench.path("out").exists(), "{message}");
        message
    };
    assert_eq!(
        with("[radio]\nmax_powr_dbm = 3\n"),
        "error: grid.toml: key radio.max_powr_dbm: found an unknown key, expected a key of run or of the scenario, such \
         as radio.max_power_dbm"
    );
    assert!(with("polcy = \"actor\"\n").ends_with("such as policy"));
    assert!(with("max_power_dbm = 3\n").ends_with("such as radio.max_power_dbm"));
    assert_eq!(
        with("seed = []\n"),
        "error: grid.toml: key seed: found no value, expected at least one"
    );
    assert!(with("seed = { from = 2, to = 1 }\n").contains("key seed: found no value"));
    assert!(with("seed = { from = 1 }\n").contains("expected { from = 1, to = 8 }"));
    assert_eq!(
        with("seed = [1, 1]\n"),
        "error: grid.toml: key seed: found 1 twice, expected every value once"
    );
    assert!(
        with("vehicles = [\"many\"]\n")
            .contains("key vehicles: found \"many\", expected whole numbers from 0")
    );
    assert!(with("vehicles = 4\n[cell]\nvehicles = 4\n").contains("both vehicles and cell.vehicles"));
    assert!(with("vehicles = [[1]]\n").contains("key vehicles: found [1], expected"));
    assert_eq!(
        with("seed = { from = 1, to = 60000 }\npolicy = [\"actor\", \"clock\"]\n"),
        "error: grid.toml: found 120000 points, expected at most 100000"
    );
    assert!(with("seed = [1\n").starts_with("error: grid.toml:"));
    assert!(
        with("seed = [1, 2]\nvehicles = 4\nzip = [[\"seed\", \"vehicles\"]]\n").contains("key zip: found")
    );
    assert!(with("zip = [[\"seed\", \"speed\"]]\n").contains("key zip: found \"speed\""));
    // What `run` refuses, with the point.
    assert_eq!(
        with("policy = [\"aloha\", \"actor\"]\n[radio]\nsub_channels = [3, 9]\n"),
        "error: grid.toml: point 3 (radio.sub_channels=9, policy=actor): radio.sub_channels: found 9, expected 1 to 8, \
         which the table serves"
    );
    assert!(with("worlds = 0\n").ends_with("worlds: found 0, expected 1 to 1000000"));
    assert!(with("policy = \"oracle\"\n").contains("policy: found \"oracle\", expected \"actor\", "));
    assert!(with("slots = 5000000000\n").ends_with("slots: found 5000000000, expected 0 to 4294967295"));
    assert_eq!(
        with("table = \"no.bin\"\n"),
        "error: no.bin: No such file or directory (os error 2)"
    );
    bench.write(SMALL);
    assert!(
        bench
            .refusal("sweep", "out", &["--shard", "7/7"])
            .contains("found 7/7, expected an index from 0 to 6")
    );
    assert!(
        bench
            .refusal("sweep", "out", &["--shard", "x"])
            .contains("expected i/N")
    );
    assert!(
        bench
            .refusal("sweep", "out", &["--seeds", "3-1"])
            .contains("found \"3-1\"")
    );
    assert!(!bench.path("out").exists());
}

#[test]
fn other_grids_are_refused_and_damaged_results_computed_again() {
    let bench = Bench::new(SMALL);
    let _object = bench.json("sweep", "out", &[]);
    bench.write(&SMALL.replace("slots = 30", "slots = 31"));
    for command in ["sweep", "merge"] {
        let message = bench.refusal(command, "out", &[]);
        assert!(
            message.starts_with("error: out: found results of another grid ("),
            "{message}"
        );
    }
    // The same grid in another order of lines is the same.
    bench.write(&SMALL.replace("\nworlds = 2\nslots = 30", "\nslots = 30\nworlds = 2"));
    assert_eq!(bench.json("sweep", "out", &[])["skipped"], 12);

    let file = bench.path("out/points/000/000005.json");
    let whole = std::fs::read(&file).unwrap();
    let damaged = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        let merged = bench.output("merge", "out", &[]);
        assert_eq!(merged.status.code(), Some(2));
        let message = String::from_utf8(merged.stderr).unwrap();
        let lines: Vec<&str> = message.lines().collect();
        assert!(
            lines[0].contains("out/points/000/000005.json: found "),
            "{message}"
        );
        assert!(lines[0].ends_with("it counts as missing"), "{message}");
        assert!(lines[1].contains("1 of 12 points missing: 5"), "{message}");
        assert!(!bench.path("out/merged.csv").exists());
        let swept = bench.output("sweep", "out", &["--json"]);
        let message = String::from_utf8(swept.stderr).unwrap();
        assert!(message.trim_end().ends_with("it is computed again"), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert_eq!(std::fs::read(&file).unwrap(), whole);
    };
    for position in [10, whole.len() / 2, whole.len() - 3] {
        let mut flipped = whole.clone();
        flipped[position] ^= 1;
        damaged(&flipped);
    }
    damaged(&whole[..whole.len() / 2]);
    damaged(&whole[..whole.len() - 1]);
    damaged(&[]);
    // A whole result in the wrong place.
    damaged(&std::fs::read(bench.path("out/points/000/000006.json")).unwrap());
    // A manifest that is no more is written anew.
    let manifest = bench.path("out/grid.json");
    let said = std::fs::read(&manifest).unwrap();
    std::fs::write(&manifest, []).unwrap();
    assert_eq!(bench.json("sweep", "out", &[])["skipped"], 12);
    assert_eq!(std::fs::read(&manifest).unwrap(), said);
}

/// 6 points of two short hours on four blocks.
const LOOP: &str = "
command = \"loop\"
worlds = 2
policy = [\"clock\", \"aloha\"]
seed = [3, 4, 5]
delay = 60
zip = [[\"seed\", \"planning.connected_share\"]]
[planning]
connected_share = [0, 0.2, 0.5]
horizon_s = 400
warmup_s = 100
[mobility]
blocks_x = 1
blocks_y = 1
";

/// A file of the assignment's fixtures.
fn fixture(name: &str) -> String {
    let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../assignment/tests/fixtures");
    format!("{fixtures}/{name}")
}

/// 6 points of Sioux Falls, whose files lie beside the grid.
fn sioux_falls() -> (Bench, String) {
    let grid = "
command = \"assign\"
net = \"net.tntp\"
trips = \"trips.tntp\"
objective = [\"ue\", \"so\"]
demand_factor = [0.25, 0.5, 1]
";
    let bench = Bench::new(grid);
    for (name, fixture_name) in [("net", "SiouxFalls_net"), ("trips", "SiouxFalls_trips")] {
        let to = bench.path(&format!("{name}.tntp"));
        let _bytes = std::fs::copy(fixture(&format!("{fixture_name}.tntp")), to).unwrap();
    }
    (bench, grid.to_owned())
}

/// A row of a merged table, by column.
fn row(csv: &str, point: usize) -> Vec<(&str, &str)> {
    let mut lines = csv.lines();
    let names = lines.next().unwrap().split(',');
    names.zip(lines.nth(point).unwrap().split(',')).collect()
}

fn value<'r>(row: &[(&'r str, &'r str)], name: &str) -> &'r str {
    row.iter().find(|(column, _)| *column == name).unwrap().1
}

/// The JSON object of a command.
fn object(arguments: &[&str]) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    let output = command.args(arguments).arg("--json").output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn loops_and_assignments_merge_to_the_same_bytes_in_shards() {
    for (bench, key, figures) in [
        (
            Bench::new(LOOP),
            "planning.connected_share",
            &["trip_loss", "radio_loss", "delay_loss"][..],
        ),
        (
            sioux_falls().0,
            "demand_factor",
            &["total_travel_time", "v_over_c"],
        ),
    ] {
        assert_eq!(bench.json("sweep", "whole", &[])["computed"], 6);
        for shard in ["2/3", "0/3", "1/3"] {
            let object = bench.json("sweep", "shards", &["--shard", shard]);
            assert_eq!(object["computed"], 2, "{shard}");
        }
        assert!(bench.merged("whole") == bench.merged("shards"), "{key}");
        // What is there is not computed again.
        assert_eq!(bench.json("sweep", "shards", &["--plan", "60"])["skipped"], 6);
        let merged = bench.json("merge", "whole", &["--figure", key]);
        let mut expected: Vec<String> = figures
            .iter()
            .map(|figure| format!("{figure}_by_{key}.svg"))
            .collect();
        expected.push(format!("{}_by_{key}.csv", figures[0]));
        let files: Vec<&str> = merged["files"]
            .as_array()
            .unwrap()
            .iter()
            .map(|file| file.as_str().unwrap().rsplit('/').next().unwrap())
            .collect();
        assert_eq!(files[2..], expected);
    }
}

#[test]
fn a_point_of_a_loop_is_what_loop_says() {
    let bench = Bench::new(LOOP);
    let _object = bench.json("sweep", "out", &[]);
    let _object = bench.json("merge", "out", &[]);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    // Nobody is connected: nothing is heard, no age is known.
    let silent = row(&csv, 0);
    assert_eq!(value(&silent, "planning.connected_share"), "0");
    assert_eq!(value(&silent, "mean_age_ms"), "");
    assert_eq!(value(&silent, "connected_in_cell"), "0");
    assert_eq!(value(&silent, "most_connected_in_cell"), "0");
    let last = row(&csv, 5);
    let settings: Vec<_> = last.iter().skip(1).map(|(_, value)| *value).take(9).collect();
    assert_eq!(settings, ["1", "1", "0.5", "400", "100", "60", "aloha", "5", "2"]);
    let run = object(&[
        "loop",
        "--policy=aloha",
        "--seed=5",
        "--worlds=2",
        "--delay=60",
        "--set=planning.connected_share=0.5",
        "--set=planning.horizon_s=400",
        "--set=planning.warmup_s=100",
        "--set=mobility.blocks_x=1",
        "--set=mobility.blocks_y=1",
    ]);
    let policy = &run["policies"][0];
    for (column, expected) in [
        ("vehicles", &run["vehicles"]),
        ("connected_in_cell", &run["connected_in_cell"]),
        ("roads", &run["roads"]),
        ("mean_travel_time_s", &policy["mean_travel_time_s"]),
        ("mean_travel_time_ci95_s", &policy["mean_travel_time_ci95_s"]),
        ("uncapped_mean_age_ms", &policy["uncapped_mean_age_ms"]),
        ("road_age_s", &policy["road_age_s"]),
        ("regret_s_per_trip", &policy["regret_s_per_trip"]),
        ("trip_loss_obedience_s", &policy["trip_loss_s"]["obedience"]),
        (
            "trip_loss_coverage_ci95_s",
            &policy["trip_loss_s"]["coverage_ci95"],
        ),
        ("trip_loss_detection_s", &policy["trip_loss_s"]["detection"]),
        ("trip_loss_radio_s", &policy["trip_loss_s"]["radio"]),
        ("trip_loss_radio_ci95_s", &policy["trip_loss_s"]["radio_ci95"]),
        ("trip_loss_delay_s", &run["delayed"][0]["trip_loss_s"]),
        (
            "trip_loss_no_information_s",
            &run["cases"]["no_information"]["trip_loss_s"],
        ),
    ] {
        let found: f64 = value(&last, column).parse().unwrap();
        assert_eq!(Some(found), expected.as_f64(), "{column}");
    }
    // Every column has its place in the object: only what needs a connected vehicle may be missing.
    assert!(last.iter().all(|(_, value)| !value.is_empty()), "{last:?}");
}

#[test]
fn a_point_of_an_assignment_is_what_assign_says_and_its_files_are_part_of_the_grid() {
    let (bench, _) = sioux_falls();
    let _object = bench.json("sweep", "out", &[]);
    let _object = bench.json("merge", "out", &[]);
    let csv = std::fs::read_to_string(bench.path("out/merged.csv")).unwrap();
    let point = row(&csv, 4);
    assert_eq!(
        (value(&point, "objective"), value(&point, "demand_factor")),
        ("so", "0.5")
    );
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    let solved = object(&[
        "assign",
        "--net",
        &net,
        "--trips",
        &trips,
        "--objective=so",
        "--demand-factor=0.5",
    ]);
    assert_eq!(solved["total_demand"], 180_300.0);
    for (column, key) in [
        ("iterations", "iterations"),
        ("total_demand", "total_demand"),
        ("total_travel_time", "total_travel_time"),
        ("objective_value", "objective"),
        ("relative_gap", "relative_gap"),
        ("mean_v_over_c", "mean_v_over_c"),
        ("max_v_over_c", "max_v_over_c"),
    ] {
        let found: f64 = value(&point, column).parse().unwrap();
        assert_eq!(Some(found), solved[key].as_f64(), "{column}");
    }
    assert!(point.iter().all(|(_, value)| !value.is_empty()), "{point:?}");
    let trips = std::fs::read_to_string(bench.path("trips.tntp")).unwrap();
    std::fs::write(bench.path("trips.tntp"), trips + "\n").unwrap();
    let message = bench.refusal("sweep", "out", &[]);
    assert!(
        message.starts_with("error: out: found results of another grid"),
        "{message}"
    );
}

#[test]
fn a_command_knows_its_own_keys_alone() {
    let (bench, assign) = sioux_falls();
    for (grid, expected) in [
        (
            "command = \"lop\"\n",
            "grid.toml: key command: found \"lop\", expected \"run\", \"loop\", \"assign\"",
        ),
        (
            "command = [\"run\", \"loop\"]\n",
            "grid.toml: key command: found [\"run\", \"loop\"], expected the name of one command",
        ),
        (
            "comand = \"loop\"\n",
            "grid.toml: key comand: found an unknown key, expected a key of run or of the scenario, such as command",
        ),
        (
            "command = \"loop\"\nworld = 3\n",
            "grid.toml: key world: found an unknown key, expected a key of loop or of the scenario, such as worlds",
        ),
        (
            "command = \"assign\"\nmax_iteration = 3\n",
            "grid.toml: key max_iteration: found an unknown key, expected a key of assign, such as max_iterations",
        ),
        (
            "command = \"loop\"\ntrips = [\"trips.tntp\", \"net.tntp\"]\npolicy = \"clock\"\n",
            "grid.toml: point 0 (trips=trips.tntp): trips: found no net beside it, expected both, or none with the grid",
        ),
        (
            "command = \"loop\"\ntraffic = \"sumoo\"\npolicy = \"clock\"\n",
            "grid.toml: point 0 (): traffic: found \"sumoo\", expected \"built-in\", \"sumo\"",
        ),
        (
            "command = \"loop\"\nworlds = 0\npolicy = \"clock\"\n",
            "grid.toml: point 0 (): worlds: found 0, expected 1 to 100000",
        ),
        (
            "command = \"loop\"\npolicy = \"actor\"\nradio.sub_channels = 9\n",
            "grid.toml: point 0 (): radio.sub_channels: found 9, expected 1 to 8, which the table serves",
        ),
        (
            "command = \"assign\"\ndemand_factor = [1, -1]\n",
            "grid.toml: point 1 (demand_factor=-1): demand_factor: found -1, expected a finite number, not negative",
        ),
    ] {
        bench.write(grid);
        assert_eq!(bench.refusal("sweep", "out", &[]), format!("error: {expected}"));
    }
    bench.write(&assign);
    assert_eq!(
        bench.refusal("sweep", "out", &["--seeds", "1,2"]),
        "error: --seeds: found 2 seeds, expected none: `assign` draws nothing at random"
    );
    assert!(!bench.path("out").exists());
}
