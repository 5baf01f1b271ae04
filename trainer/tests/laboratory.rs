//! The laboratory's command line: a run that is killed and goes on, runs and options that are refused, and what every run
//! leaves behind.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use serde_json::Value;
use std::fs::{read, read_to_string, write};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use trainer::laboratory::random;

/// A run of a second or two.
const TINY: [&str; 14] = [
    "train",
    "--preset",
    "evolution",
    "--json",
    "--set",
    "scenario.cell.vehicles=3",
    "--set",
    "evolution.episodes=150",
    "--set",
    "evolution.population=8",
    "--set",
    "evolution.elite=2",
    "--set",
    "evolution.slots=60",
];

fn command(arguments: &[&str], out: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    let _same = command.args(arguments).arg("--out").arg(out);
    command
}

fn trainer(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(arguments)
        .output()
        .unwrap()
}

fn success(output: &Output) -> Value {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(message.is_empty(), "{message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Fails with one line on stderr, exit code 2 and nothing on stdout.
fn refusal(output: Output) -> String {
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty());
    assert_eq!(message.lines().count(), 1, "{message}");
    message.trim_end().to_owned()
}

#[test]
fn a_run_killed_twenty_times_ends_in_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    let report = success(&command(&TINY, &whole).output().unwrap());
    assert_eq!(report["episodes"], 150);

    let every = [&TINY[..], &["--resume", "--checkpoint-every", "0"]].concat();
    let mut stream = random::initial(7, 0);
    let mut kills = 0;
    for _ in 0..20 {
        let mut child = command(&every, &killed)
            .args(["--threads", "1"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(15 + u64::from(stream.below(80))));
        child.kill().unwrap();
        // Exit code 2 would be a checkpoint that a kill has spoiled.
        kills += u32::from(child.wait().unwrap().code().is_none());
    }
    assert!(kills >= 10, "only {kills} runs were killed at work");
    assert_eq!(success(&command(&every, &killed).output().unwrap()), report);

    for name in [
        "actor.safetensors",
        "checkpoint.safetensors",
        "metrics.csv",
        "metrics.parquet",
        "actor.onnx",
        "table.bin",
        "report.json",
        "run.json",
        "events.out.tfevents.0.freshlane",
    ] {
        assert!(
            read(whole.join(name)).unwrap() == read(killed.join(name)).unwrap(),
            "{name} differs"
        );
    }
    assert_eq!(
        read_to_string(killed.join("metrics.csv"))
            .unwrap()
            .lines()
            .count(),
        151
    );
    let left: Vec<_> = std::fs::read_dir(&whole)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(left.len(), 9, "{left:?}");
}

#[test]
fn other_runs_and_spoiled_files_are_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let short = [&TINY[..], &["--set", "evolution.episodes=3"]].concat();
    let _report = success(&command(&short, &out).output().unwrap());
    let checkpoint = out.join("checkpoint.safetensors");
    let before = read(&checkpoint).unwrap();
    let again = |more: &[&str]| refusal(command(&[&short[..], more].concat(), &out).output().unwrap());

    assert!(
        again(&[])
            .ends_with("found this run already begun, expected --resume to go on with it, or another folder")
    );
    assert!(again(&["--resume", "--seed", "2"]).contains("key seed: found 1, so another run, expected 2"));
    assert!(
        again(&["--resume", "--set", "evolution.hidden=[4]"]).contains(
            "key configuration.algorithm.evolution.hidden: found [8], so another run, expected [4]"
        )
    );
    assert_eq!(read(&checkpoint).unwrap(), before);

    write(&checkpoint, &before[..before.len() - 1]).unwrap();
    assert!(again(&["--resume"]).contains("checkpoint.safetensors: found "));
    write(&checkpoint, read(out.join("actor.safetensors")).unwrap()).unwrap();
    assert!(again(&["--resume"]).contains("checkpoint.safetensors: found "));
    write(&checkpoint, &before).unwrap();
    assert_eq!(read(&checkpoint).unwrap(), before);
}

/// A run that is done goes on for more episodes; killed there, it comes to the same bytes. It is not the run that was told so many at
/// once: that one's schedules were longer from the start.
#[test]
fn a_run_that_is_done_goes_on_to_the_same_bytes_however_often_it_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    let run = |out: &Path, episodes: u32, more: &[&str]| {
        let episodes = format!("evolution.episodes={episodes}");
        let arguments = [&TINY[..], &["--set", &episodes], more].concat();
        command(&arguments, out)
    };
    for out in [&whole, &killed] {
        let _report = success(&run(out, 4, &[]).output().unwrap());
    }
    let report = success(&run(&whole, 120, &["--extend"]).output().unwrap());
    assert_eq!(report["episodes"], 120);
    let mut stream = random::initial(8, 0);
    let mut kills = 0;
    for _ in 0..8 {
        let mut child = run(&killed, 120, &["--extend", "--checkpoint-every", "0"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(15 + u64::from(stream.below(60))));
        child.kill().unwrap();
        kills += u32::from(child.wait().unwrap().code().is_none());
    }
    assert!(kills >= 4, "only {kills} runs were killed at work");
    assert_eq!(
        success(&run(&killed, 120, &["--extend"]).output().unwrap()),
        report
    );
    assert_eq!(files(&killed), files(&whole));
    let again = refusal(run(&whole, 120, &["--resume"]).output().unwrap());
    assert!(
        again.contains("key lengths_before: found [4], so another run"),
        "{again}"
    );
}

/// Names and contents of all files but those that the killed have just left half-written: they are swept up when they are old.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut files: Vec<_> = names
        .filter(|name| !name.ends_with(".partial"))
        .map(|name| (name.clone(), read(folder.join(name)).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn whatever_a_cut_leaves_the_run_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, out) = (folder.path().join("whole"), folder.path().join("run"));
    let short = [&TINY[..], &["--set", "evolution.episodes=3"]].concat();
    let resumed = [&short[..], &["--resume"]].concat();
    let _report = success(&command(&short, &whole).output().unwrap());
    let _report = success(&command(&short, &out).output().unwrap());
    let undisturbed = files(&whole);
    assert_eq!(files(&out), undisturbed);
    for name in [
        "run.json",
        "metrics.csv",
        "metrics.parquet",
        "events.out.tfevents.0.freshlane",
        "report.json",
        "actor.safetensors",
        "actor.onnx",
        "table.bin",
    ] {
        let bytes = read(out.join(name)).unwrap();
        for left in [bytes.len() - 1, bytes.len() / 2, 0] {
            write(out.join(name), &bytes[..left]).unwrap();
            let _report = success(&command(&resumed, &out).output().unwrap());
            assert!(files(&out) == undisturbed, "{name} cut to {left} bytes");
            let events = read(out.join("events.out.tfevents.0.freshlane")).unwrap();
            assert!(name != "events.out.tfevents.0.freshlane" || events.len() == bytes.len());
        }
    }
    // Of two checkpoints the newest whole one counts.
    let checkpoint = out.join("checkpoint.safetensors");
    let bytes = read(&checkpoint).unwrap();
    write(out.join("checkpoint.previous.safetensors"), &bytes).unwrap();
    write(&checkpoint, &bytes[..100]).unwrap();
    let output = command(&resumed, &out).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.contains("goes on from the checkpoint before"),
        "{message}"
    );
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(files(&out) == undisturbed);
}

#[test]
fn bad_options_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("none");
    let message = |more: &[&str]| refusal(command(&[&TINY[..], more].concat(), &out).output().unwrap());
    assert!(message(&["--set", "evolution.elit=2"]).contains("--set evolution.elit: found an unknown key"));
    assert!(
        message(&["--set", "evolution.elite=5"]).contains("evolution.elite: found 5, expected at most half")
    );
    assert!(message(&["--config", "missing.toml"]).contains("missing.toml"));
    assert!(message(&["--rate", "2"]).contains("--rate"));
    assert!(!out.exists());
}

#[test]
fn every_key_is_explained() {
    let explained = success(&trainer(&["explain", "--json"]));
    let keys = explained["keys"].as_array().unwrap();
    let key = |name: &str| keys.iter().find(|key| key["key"] == name).unwrap();
    assert_eq!(key("ppo.clip")["maximum"], 1.0);
    assert_eq!(key("maddpg.replay")["unit"], "transitions");
    assert_eq!(key("scenario.cell.vehicles")["default"], 20);
    let text = |key: &str| String::from_utf8(trainer(&["explain", key]).stdout).unwrap();
    let one = text("maddpg.updates");
    assert!(one.starts_with("maddpg.updates = \"episode\"\n  When networks learn."));
    assert!(one.contains("\n  \"slot\": Once after every slot, as the authors' companion code does."));
    assert!(one.contains("\n  in preset freshlane: \"slot\""));
    let section = text("evolution");
    let keys: Vec<&str> = section.lines().filter(|line| !line.starts_with(' ')).collect();
    assert_eq!(keys.len(), 10, "{section}");
    assert!(keys.iter().all(|key| key.starts_with("evolution.")));
    assert_eq!(
        refusal(trainer(&["explain", "maddpg.nois"])),
        "error: explain: found maddpg.nois, expected maddpg.noise, or another key"
    );
}

#[test]
fn a_trained_run_is_evaluated_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let short = [&TINY[..], &["--set", "evolution.episodes=5"]].concat();
    let report = success(&command(&short, &out).output().unwrap());
    let run = out.to_str().unwrap();
    let small = ["--worlds", "3", "--slots", "100", "--warmup", "50", "--json"];
    let object = success(&trainer(&[&["eval", "--run", run], &small[..]].concat()));
    let policies = object["policies"].as_array().unwrap();
    let names: Vec<_> = policies
        .iter()
        .map(|policy| policy["policy"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["actor", "float", "exploring", "central"]);
    for policy in policies {
        assert_eq!(policy["vehicles"], 3);
        assert!(policy["mean_age_ms"].as_f64().unwrap() >= 1.0);
    }
    assert!(object["agreement"].as_f64().unwrap() > 0.9);
    assert_eq!(object["float_mean_age_ms"], policies[1]["mean_age_ms"]);

    // The same table, once written by the training and once given as a file.
    let table = out.join("table.bin");
    assert_eq!(
        read(&table).unwrap().len(),
        report["table_bytes"].as_u64().unwrap() as usize
    );
    let given = [
        "eval",
        "--table",
        table.to_str().unwrap(),
        "--policy",
        "actor",
        "--vehicles",
        "3",
    ];
    let alone = success(&trainer(&[&given[..], &small[..]].concat()));
    assert_eq!(alone["policies"][0]["mean_age_ms"], policies[0]["mean_age_ms"]);

    let more = refusal(trainer(
        &[&["eval", "--run", run, "--vehicles", "4"], &small[..]].concat(),
    ));
    assert!(more.contains("vehicles: found 4, expected at most 3"), "{more}");
    let elsewhere =
        |setting: &str| trainer(&[&["eval", "--run", run, "--set", setting], &small[..]].concat());
    let efficiency = refusal(elsewhere("radio.min_spectral_efficiency=2"));
    assert!(
        efficiency.contains("radio.min_spectral_efficiency: found 2, expected a required SINR of 8.4")
            && efficiency.ends_with("dB as in training"),
        "{efficiency}"
    );
    let sub_channels = refusal(elsewhere("radio.sub_channels=4"));
    assert!(
        sub_channels.contains("radio.sub_channels: found 4, expected 1 to 3, which the table serves"),
        "{sub_channels}"
    );
    // Full power is broadcast, so that any will do.
    let weaker = success(&elsewhere("radio.max_power_dbm=23"));
    assert_eq!(weaker["policies"].as_array().unwrap().len(), 4);

    let model = folder.path().join("model.onnx");
    let _report = success(&trainer(&[
        "export",
        "--run",
        run,
        "--onnx",
        model.to_str().unwrap(),
        "--json",
    ]));
    assert_eq!(read(model).unwrap(), read(out.join("actor.onnx")).unwrap());
    let actor = out.join("actor.safetensors");
    let spoilt = refusal(trainer(&[
        "export",
        "--run",
        run,
        "--onnx",
        actor.to_str().unwrap(),
    ]));
    assert!(spoilt.contains("--onnx: found "), "{spoilt}");
    let alone = refusal(trainer(&["compare", "--run", run, "--policy", "actor"]));
    assert!(
        alone.ends_with("--policy: found actor, expected others to compare it with"),
        "{alone}"
    );
    let vehicle = refusal(trainer(&["export", "--run", run, "--vehicle", "1"]));
    assert!(vehicle.contains("--vehicle: found 1"), "{vehicle}");
}

#[test]
fn the_plans_that_come_with_the_program_are_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("studies");
    let mut plans = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let plan = trainer::study::Plan::read(&entry.unwrap().path()).unwrap();
        assert!(plan.evaluation.worlds >= 64, "too few worlds to say anything");
        plans += 1;
    }
    assert!(plans > 0);
}

#[test]
fn a_study_gives_the_same_table_whenever_and_however_its_runs_are_done() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.toml");
    let text = r#"
        preset = "evolution"
        set = ["scenario.cell.vehicles=3", "evolution.episodes=4", "evolution.population=4", "evolution.elite=2",
               "evolution.slots=30"]
        seeds = [1, 2]
        [evaluation]
        seed = 5
        worlds = 2
        slots = 50
        warmup = 10
        [[case]]
        name = "as it is"
        [[case]]
        name = "wider | network"
        set = ["evolution.hidden=[16]"]
    "#;
    write(&plan, text).unwrap();
    let study = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let arguments = [&["study", "--json", "--plan", plan.to_str().unwrap()], more].concat();
        let object = success(&command(&arguments, &out).output().unwrap());
        let table = read_to_string(out.join("plan.csv")).unwrap();
        (object, table + &read_to_string(out.join("plan.md")).unwrap())
    };
    let curves = folder.path().join("curves.csv");
    let (object, one) = study("one", &["--curves", curves.to_str().unwrap()]);
    assert_eq!(object["runs"].as_array().unwrap().len(), 4);
    assert_eq!(one.lines().filter(|line| line.contains(",actor,")).count(), 4);
    assert!(one.contains("| wider \\| network | "));
    let curves = host_sim::report::learning::read_curves("curves", &read_to_string(curves).unwrap()).unwrap();
    assert_eq!(curves.len(), 8);
    // In parallel; then again in the folder of the first, where everything is done.
    assert_eq!(study("two", &["--parallel", "3", "--threads", "2"]).1, one);
    let run = folder.path().join("one/runs/as-it-is/1");
    let before = std::fs::metadata(run.join("report.json"))
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(study("one", &[]).1, one);
    assert_eq!(
        std::fs::metadata(run.join("report.json"))
            .unwrap()
            .modified()
            .unwrap(),
        before
    );

    // In shards, in folders of their own that are copied together afterwards: nothing is left but the tables.
    let shard = |out: &str, more: &[&str]| {
        let arguments = [&["study", "--json", "--plan", plan.to_str().unwrap()], more].concat();
        success(&command(&arguments, &folder.path().join(out)).output().unwrap())
    };
    let object = shard("near", &["--shard", "0/3"]);
    assert_eq!(object["runs"].as_array().unwrap().len(), 2);
    assert_eq!(
        object["missing"],
        serde_json::json!([
            { "case": "as it is", "seed": 2 },
            { "case": "wider | network", "seed": 1 },
        ])
    );
    assert!(!folder.path().join("near/plan.csv").exists());
    for index in ["1/3", "2/3"] {
        let object = shard("far", &["--shard", index]);
        assert_eq!(object["runs"].as_array().unwrap().len(), 1);
    }
    for (case, seed) in [("as-it-is", "2"), ("wider-network", "1")] {
        let of = |out: &str| folder.path().join(out).join("runs").join(case).join(seed);
        std::fs::create_dir_all(of("near").parent().unwrap()).unwrap();
        std::fs::rename(of("far"), of("near")).unwrap();
    }
    assert_eq!(
        shard("near", &["--shard", "1/3"])["missing"],
        serde_json::json!([])
    );
    assert_eq!(study("near", &[]).1, one);

    let arguments = ["study", "--plan", plan.to_str().unwrap()];
    let bad = folder.path().join("bad");
    for (from, to, expected) in [
        (
            "hidden=[16]",
            "hiden=[16]",
            "case wider | network: --set evolution.hiden: found an unknown key",
        ),
        (
            "[1, 2]",
            "[1, 1]",
            "seeds: found 1 twice, expected each seed once",
        ),
        (
            "slots = 50",
            "slots = 0",
            "evaluation.slots: found 0, expected 1 or more",
        ),
    ] {
        write(&plan, text.replace(from, to)).unwrap();
        let message = refusal(command(&arguments, &bad).output().unwrap());
        assert!(message.contains(expected), "{message}");
    }
    write(&plan, text).unwrap();
    let curves = [&arguments[..], &["--curves", plan.to_str().unwrap()]].concat();
    let message = refusal(command(&curves, &bad).output().unwrap());
    assert!(
        message.contains("plan.toml, which is read, expected a file of its own"),
        "{message}"
    );
    assert!(!bad.exists());
}
