//! The command line as scripts use it: keys, exit codes, one clear line on bad input, nothing half-written.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

#[path = "../../firmware/tests/table_builder.rs"]
mod table_builder;

use host_sim::KINDS;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use table_builder::Contents;

const SMALL: [&str; 6] = ["--worlds", "3", "--slots", "150", "--warmup", "100"];

fn host_sim(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(arguments)
        .output()
        .unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = host_sim(arguments);
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Fails with one line on stderr, exit code 2 and nothing on stdout.
fn refusal(arguments: &[&str]) -> String {
    let output = host_sim(arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?} printed to stdout");
    assert_eq!(message.lines().count(), 1, "{message}");
    message.trim_end().to_owned()
}

#[test]
fn run_gives_the_contract_s_keys_for_every_policy() {
    let object = json(&[&["run", "--json", "--seed", "7"], &SMALL[..]].concat());
    assert_eq!(object["bound_age_ms"], 3.85);
    let policies = object["policies"].as_array().unwrap();
    let names: Vec<_> = policies
        .iter()
        .map(|policy| policy["policy"].as_str().unwrap())
        .collect();
    let known: Vec<_> = KINDS.iter().map(|kind| kind.name).collect();
    assert_eq!(names, known);
    // Others' scripts ask for these.
    for name in [
        "actor",
        "central",
        "clock",
        "age-threshold",
        "aloha",
        "random",
        "always",
    ] {
        assert!(known.contains(&name), "{name}");
    }
    for policy in policies {
        for key in [
            "vehicles",
            "worlds",
            "slots",
            "mean_age_ms",
            "mean_age_ci95_ms",
            "median_world_age_ms",
            "p99_age_ms",
            "first100_age_ms",
            "success_per_slot",
            "peak_age_ms",
            "age_above_10_ms",
            "age_above_20_ms",
            "age_above_50_ms",
            "worst_vehicles_ms",
            "transmissions_per_vehicle_slot",
            "energy_mj_per_vehicle_slot",
        ] {
            assert!(policy[key].is_number(), "{key} of {}", policy["policy"]);
        }
        assert_eq!(policy["per_vehicle"].as_array().unwrap().len(), 20);
        assert_eq!(policy.get("slots_per_second"), None);
    }
}

#[test]
fn speed_is_said_where_it_is_asked_for() {
    let object = json(&[&["run", "--json", "--timing", "--policy", "aloha"], &SMALL[..]].concat());
    assert!(object["policies"][0]["slots_per_second"].as_f64().unwrap() > 0.0);
}

#[test]
fn results_do_not_depend_on_threads() {
    let run = |threads| json(&[&["run", "--json", "--threads", threads], &SMALL[..]].concat());
    assert_eq!(run("1"), run("2"));
}

#[test]
fn results_do_not_depend_on_the_vector_unit_that_is_named() {
    let run = |name: &str| {
        let arguments = [&["run", "--policy", "actor", "--json"], &SMALL[..]].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command
            .args(arguments)
            .env("FRESHLANE_VECTORS", name)
            .output()
            .unwrap()
    };
    let refused = run("abacus");
    let message = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(
        message.contains("FRESHLANE_VECTORS") && message.contains("\"plain\""),
        "{message}"
    );
    let ages = |name: &str| {
        let object: Value = serde_json::from_slice(&run(name).stdout).unwrap();
        object["policies"][0]["per_vehicle"].clone()
    };
    let plain = ages("plain");
    assert_eq!(plain.as_array().unwrap().len(), 20);
    for vectors in host_sim::lanes::Vectors::all() {
        assert_eq!(ages(vectors.name()), plain, "{}", vectors.name());
    }
}

#[test]
fn a_run_without_json_writes_figures_and_data() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let output = host_sim(
        &[
            &[
                "--out", out, "--policy", "actor", "--policy", "central", "--policy", "clock",
            ],
            &SMALL[..],
        ]
        .concat(),
    );
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("Age of information") && text.contains("What the age does to traffic"),
        "{text}"
    );
    assert!(text.contains("(bound)"));
    for file in [
        "mean_age.svg",
        "mean_age.csv",
        "cold_start.svg",
        "age_distribution.svg",
        "decisions.svg",
        "traffic.csv",
        "volume_over_capacity.svg",
        "travel_time.csv",
        "run.json",
    ] {
        assert!(
            std::fs::metadata(folder.path().join(file)).unwrap().len() > 100,
            "{file}"
        );
    }
    // What a reader asked: whose line is that, what is that column, what lies below the name on the map.
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
    let report = read("report.html");
    assert_eq!(report.matches("The lines of actor and clock coincide").count(), 2);
    for explained in [
        "<p>99 % within: ",
        "<p>First 100: ",
        ">uniform V/C</th>",
        ">per-road V/C</th>",
    ] {
        assert_eq!(report.matches(explained).count(), 1, "{explained}");
    }
    let map = read("age_map.svg");
    let left = |label: &str| -> f64 {
        let text = map.split("<text").find(|text| text.contains(label)).unwrap();
        text.split(" x=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .parse()
            .unwrap()
    };
    assert!(left("base station") > left("mean age (ms)"));
}

/// Where information is never older than a slot there is no figure of how often it is, and the report is there all the same.
#[test]
fn a_single_vehicle_has_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let small = "run --vehicles 1 --worlds 1 --slots 3 --policy actor --out";
    let output = host_sim(&small.split(' ').chain(folder.path().to_str()).collect::<Vec<_>>());
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(folder.path().join("report.html").exists());
    assert!(!folder.path().join("age_distribution.svg").exists());
}

#[test]
fn figures_are_listed_and_there() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["figures", "--json", "--worlds", "2", "--slots", "200", "--out"];
    let arguments: Vec<&str> = small.into_iter().chain(folder.path().to_str()).collect();
    let object = json(&arguments);
    let files = object["files"].as_array().unwrap();
    assert_eq!(files.len(), 10);
    assert!(
        files
            .iter()
            .all(|file| Path::new(file.as_str().unwrap()).exists())
    );
}

#[test]
fn a_trace_runs_to_its_end_with_all_its_vehicles() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fcd.xml");
    let mut trace = String::from("<fcd-export>\n");
    for step in 0..=20 {
        trace += &format!("<timestep time=\"{}.{}\">", step / 10, step % 10);
        for (name, first, last) in [("a", 0, 20), ("b", 0, 20), ("late", 8, 20), ("early", 0, 12)] {
            if (first..=last).contains(&step) {
                trace += &format!(
                    "<vehicle id=\"{name}\" x=\"{}\" y=\"700\" speed=\"13\"/>",
                    100 + step
                );
            }
        }
        trace += "</timestep>\n";
    }
    std::fs::write(&path, trace + "</fcd-export>\n").unwrap();
    let path = path.to_str().unwrap();
    let arguments = ["run", "--json", "--mobility", path, "--worlds", "2"];
    let object = json(&arguments);
    assert_eq!(object, json(&arguments));
    let actor = &object["policies"][0];
    assert_eq!(
        (actor["vehicles"].as_u64(), actor["slots"].as_u64()),
        (Some(4), Some(1500))
    );
    assert!(actor["mean_age_ms"].as_f64().unwrap() < 10.0);
    let slots = |vehicle: usize| actor["per_vehicle"][vehicle]["slots"].as_u64().unwrap();
    let names: Vec<_> = (0..4)
        .map(|v| actor["per_vehicle"][v]["vehicle"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["a", "b", "early", "late"]);
    // After 500 slots of warm-up: 2 worlds x 1500, 800 to 1200 for "early", 800 to the end for "late".
    assert_eq!((slots(0), slots(1)), (3000, 3000));
    assert!((1400..=1602).contains(&slots(2)), "{}", slots(2));
    assert!((2398..=2402).contains(&slots(3)), "{}", slots(3));
    assert!(object["bound_age_ms"].as_f64().unwrap() >= 1.0);
    assert!(refusal(&["run", "--mobility", path, "--slots", "5000"]).contains("the length of the trace"));
    assert!(refusal(&["run", "--mobility", path, "--vehicles", "5"]).contains("brings its own vehicles"));
}

#[test]
fn bad_scenarios_are_one_line_each() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    let path = file.to_str().unwrap();
    let in_file = |text: &str| {
        std::fs::write(&file, text).unwrap();
        refusal(&["run", "--scenario", path]).replace(path, "FILE")
    };
    assert_eq!(
        in_file("[radio]\nmax_power_dbm = \"high\"\n"),
        "error: FILE: key radio.max_power_dbm: found \"high\", expected a number"
    );
    assert_eq!(
        in_file("[radio]\nmax_powr_dbm = 3\n"),
        "error: FILE: key radio.max_powr_dbm: found an unknown key, expected radio.max_power_dbm, or another key of `host-sim explain`"
    );
    assert!(in_file("[radio\n").starts_with("error: FILE:1: found "));
    assert_eq!(
        in_file("[mobility]\nturn_probability = 1.5\n"),
        "error: FILE: key mobility.turn_probability: found 1.5, expected 0 to 1"
    );
    assert_eq!(
        refusal(&["run", "--set", "radio.shadowing_deviation_db=-1"]),
        "error: radio.shadowing_deviation_db: found -1, expected 0 to 100 dB"
    );
    assert_eq!(
        refusal(&["run", "--vehicles", "5000"]),
        "error: vehicles: found 5000, expected at most 2000, which the table serves"
    );
    assert_eq!(
        refusal(&["run", "--vehicles", "5000", "--policy", "clock"]),
        "error: vehicles: found 5000, expected at most 4000, the places of a ring, for policy clock"
    );
    assert_eq!(
        refusal(&["run", "--set", "radio.min_spectral_efficiency=2"]),
        "error: radio.min_spectral_efficiency: found 2 (a required SINR of 4.773 dB), expected a required SINR of 8.453 dB as in the table"
    );
    for sub_channels in ["9", "17"] {
        assert_eq!(
            refusal(&[
                "run",
                "--policy",
                "actor",
                "--set",
                &format!("radio.sub_channels={sub_channels}")
            ]),
            format!(
                "error: radio.sub_channels: found {sub_channels}, expected 1 to 8, which the table serves"
            )
        );
    }
    assert_eq!(
        refusal(&["run", "--policy", "clock", "--set", "radio.sub_channels=17"]),
        "error: radio.sub_channels: found 17, expected at most 16, which units know, for policy clock"
    );
    assert_eq!(
        refusal(&["run", "--preset", "moon"]),
        "error: --preset: found moon, expected companion, paper, street, edge"
    );
    for (arguments, words) in [
        (
            &["rnu"][..],
            "rnu: found no command of this name, expected run; `host-sim --help` lists them",
        ),
        (
            &["run", "--policy", "ACTOR"],
            "--policy: found ACTOR, expected actor, central, ",
        ),
        (
            &["run", "--vehicles", "20km"],
            "--vehicles: found 20km, expected a whole number",
        ),
        (
            &["run", "--seed", "-5"],
            "--seed: found -5, expected a whole number",
        ),
        (&["run", "--worlds", "0"], "--worlds: found 0, expected 1 to "),
        (
            &["run", "--wrolds", "5"],
            "--wrolds: found no option of this name, expected --worlds; ",
        ),
        (&["run", "--json", "--out", "x"], "found --"),
        (&["merge"], "command line: found too few options, expected "),
    ] {
        let text = refusal(arguments);
        assert!(
            text.starts_with("error: ") && text.contains(words),
            "{arguments:?}: {text}"
        );
    }
    for (command, option, setting) in [
        ("run", "--vehicles", "cell.vehicles=5"),
        ("hil", "--vehicles", "cell.vehicles=5"),
        ("bench", "--sub-channels", "radio.sub_channels=5"),
    ] {
        assert_eq!(
            refusal(&[command, "--set", setting, option, "10"]),
            format!("error: {option}: found --set {setting} beside it, expected one of the two")
        );
    }
    for command in ["run", "loop"] {
        assert_eq!(
            refusal(&[
                command, "--policy", "central", "--policy", "clock", "--table", path
            ]),
            "error: --table: found only --policy central, clock beside it, expected --policy actor, which alone uses a table"
        );
    }
    assert!(refusal(&["run", "--worlds", "0"]).contains("--worlds"));
    assert!(refusal(&["run", "--worlds", "-3"]).contains("--worlds: found -3, expected 1 to "));
    assert!(
        refusal(&["run", "--scenario", "/no/such.toml"]).starts_with("error: /no/such.toml: No such file")
    );
}

#[test]
fn an_assignment_above_its_gap_says_so_beside_its_results() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("flows.csv");
    let flows = file.to_str().unwrap();
    let fixture = |name: &str| {
        format!(
            "{}/../assignment/tests/fixtures/SiouxFalls_{name}.tntp",
            env!("CARGO_MANIFEST_DIR")
        )
    };
    let (net, trips) = (fixture("net"), fixture("trips"));
    let problem = [
        "assign", "--net", &net, "--trips", &trips, "--gap", "0", "--flows", flows,
    ];
    for (limit, stopped, why) in [
        (["--max-iterations", "2"], "iterations", "not converged"),
        (["--algorithm", "bfw"], "stagnation", "stagnated"),
    ] {
        let solve = |form: &[&str]| {
            let output = host_sim(&[&problem, &limit[..], form].concat());
            let message = String::from_utf8(output.stderr).unwrap();
            assert!(output.status.success(), "{message}");
            assert!(message.starts_with(why), "{message}");
            assert!(message.ends_with(" iterations, 0e0 was asked for\n"), "{message}");
            assert_eq!(std::fs::read_to_string(flows).unwrap().lines().count(), 77);
            std::fs::remove_file(flows).unwrap();
            String::from_utf8(output.stdout).unwrap()
        };
        let object: Value = serde_json::from_str(&solve(&["--json"])).unwrap();
        assert_eq!(object["converged"], false);
        assert_eq!(object["stopped"], stopped);
        assert_eq!(object["gap_asked_for"], 0.0);
        let text = solve(&[]);
        let ending = format!("converged            NO\nstopped by           {stopped}\n");
        assert!(
            text.contains(&ending) && text.contains(" (0e0 was asked for)\n"),
            "{text}"
        );
    }
}

#[test]
fn a_solve_that_runs_out_of_time_ends_whole_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let fixture = |name: &str| {
        let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../assignment/tests/fixtures");
        format!("{fixtures}/SiouxFalls_{name}.tntp")
    };
    let (net, trips, flows, paths) = (fixture("net"), fixture("trips"), path("flows"), path("paths.csv"));
    let flows = format!("{flows}.csv");
    let problem = ["assign", "--json", "--net", &net, "--trips", &trips];
    let ended = host_sim(
        &[
            &problem,
            &["--max-seconds", "0", "--paths", &paths, "--flows", &flows][..],
        ]
        .concat(),
    );
    assert_eq!(ended.status.code(), Some(3));
    let message = String::from_utf8(ended.stderr).unwrap();
    assert!(message.contains("ended early"), "{message}");
    assert_eq!(std::fs::read_to_string(&flows).unwrap().lines().count(), 77);
    let object: Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert_eq!(
        (&object["converged"], &object["stopped"]),
        (&false.into(), &"time".into())
    );
    let resumed = json(&[&problem, &["--resume", &paths][..]].concat());
    assert_eq!(resumed["converged"], true);
}

#[test]
fn bad_tables_are_named_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("table.bin"), folder.path().join("out"));
    let path = file.to_str().unwrap();
    let with = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        let message =
            refusal(&["run", "--table", path, "--out", out.to_str().unwrap()]).replace(path, "FILE");
        assert!(!out.exists());
        message
    };
    let table = firmware::tables::DISTILLED;
    assert_eq!(
        with(&[]),
        "error: FILE: truncated: found 0 bytes, expected at least 92 bytes".trim_end_matches(" bytes")
    );
    assert!(with(&table[..table.len() - 1]).starts_with("error: FILE: length: found "));
    let mut flipped = table.to_vec();
    flipped[500] ^= 4;
    assert!(with(&flipped).starts_with("error: FILE: checksum: found "));
    flipped[0] = b'X';
    assert!(with(&flipped).starts_with("error: FILE: magic: found "));
    // A table that sees or chooses sub-channels one by one serves a cell of three alone.
    let out = out.to_str().unwrap();
    for (observation, output) in [(1, 0), (0, 1)] {
        std::fs::write(&file, Contents::in_form(1, observation, output).bytes()).unwrap();
        let more = ["--policy", "actor", "--set", "radio.sub_channels=5", "--out", out];
        let message = refusal(&[&["run", "--table", path], &more[..]].concat());
        assert_eq!(
            message,
            "error: radio.sub_channels: found 5, expected 3, which the table serves"
        );
        assert!(!folder.path().join("out").exists());
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_stream_that_takes_nothing_stops_no_work() {
    use std::process::Stdio;
    let full = || Stdio::from(std::fs::File::options().write(true).open("/dev/full").unwrap());
    let folder = tempfile::tempdir().unwrap();
    let run = |out: &str, stdout: Stdio, stderr: Stdio| {
        let out = folder.path().join(out);
        let status = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["--worlds", "1", "--slots", "50", "--policy", "clock", "--out"])
            .arg(&out)
            .stdout(stdout)
            .stderr(stderr)
            .status()
            .unwrap();
        assert!(out.join("report.html").is_file());
        status.code()
    };
    assert_eq!(run("full", full(), Stdio::null()), Some(2));
    assert_eq!(run("unheard", full(), full()), Some(2));
    assert_eq!(run("silent", Stdio::null(), full()), Some(0));
    // Nobody reads any more.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    assert_eq!(run("left", writer.into(), Stdio::null()), Some(0));
    // Also where a command ends with a code of its own.
    let mut assign = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    assign
        .args(["assign", "--net", "grid"])
        .stdout(full())
        .stderr(Stdio::null());
    assert_eq!(assign.status().unwrap().code(), Some(2));
}

/// What people read fits a terminal of 80 columns; paths are as long as they are.
#[test]
fn lines_fit_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let commands = [
        "run",
        "loop",
        "assign",
        "carry",
        "figures",
        "sweep",
        "merge",
        "hil",
        "deadline",
        "bench",
        "init",
        "explain",
        "schema",
        "completions",
    ];
    let mut lines: Vec<Vec<&str>> = commands.iter().map(|command| vec![*command, "--help"]).collect();
    lines.push([&["run", "--out", &out], &SMALL[..]].concat());
    lines.push(vec![
        "loop",
        "--worlds",
        "2",
        "--set",
        "planning.horizon_s=300",
        "--set",
        "planning.warmup_s=0",
        "--out",
        &out,
    ]);
    lines.push(vec!["explain"]);
    lines.push(vec!["explain", "planning.horizon_s"]);
    let fixture =
        |name: &str| concat!(env!("CARGO_MANIFEST_DIR"), "/../assignment/tests/fixtures/").to_owned() + name;
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    let flows = folder.path().join("flows.csv").display().to_string();
    let problem = ["assign", "--net", &net, "--trips", &trips];
    lines.push([&problem[..], &["--flows", &flows]].concat());
    lines.push([&problem[..], &["--check", &flows]].concat());
    lines.push(vec!["bench", "--worlds", "2", "--slots", "20"]);
    for arguments in lines {
        let output = host_sim(&arguments);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.status.success() && !text.is_empty(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        for line in text
            .lines()
            .filter(|line| !line.contains(&*folder.path().to_string_lossy()))
        {
            assert!(line.chars().count() <= 80, "{arguments:?}: {line}");
        }
    }
    let wide = host_sim(&[&["run", "--wide", "--out", &out], &SMALL[..]].concat());
    assert!(String::from_utf8(wide.stdout).unwrap().contains("successes"));
}
