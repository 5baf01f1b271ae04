//! Learning in a mixture of cells on the command line: training that goes on, evaluation and a study by cell, refusals.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use serde_json::Value;
use std::fs::{read, read_to_string, write};
use std::path::Path;
use std::process::{Command, Output};

const CELLS: &str = r#"
    [[mixture]]
    preset = "paper"
    weight = 2
    vehicles = [2, 5]
    [[mixture]]
    name = "weak"
    preset = "edge"
    weight = 1
    set = ["radio.sub_channels=2", "cell.vehicles=4"]
"#;

/// The cells, and what is set for all of them.
fn mixture() -> String {
    format!("{CELLS}\n[scenario.cell]\nvehicles = 8\n")
}

/// A run of a second or two.
const TINY: [&str; 7] = [
    "ppo.episodes=3",
    "ppo.batches=3",
    "ppo.updates=1",
    "ppo.slots=8",
    "ppo.min_vehicles=3",
    "ppo.max_vehicles=9",
    "ppo.critic_hidden=[8]",
];

fn trainer(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trainer"));
    command.args(arguments).output().unwrap()
}

fn success(output: &Output) -> Value {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && message.is_empty(), "{message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Fails with one line on stderr, exit code 2 and nothing on stdout.
fn refusal(output: Output) -> String {
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(
        output.stdout.is_empty() && message.lines().count() == 1,
        "{message}"
    );
    message.trim_end().to_owned()
}

fn train(config: &Path, out: &Path, more: &[&str]) -> Output {
    let (config, out) = (config.to_str().unwrap(), out.to_str().unwrap());
    let start = [
        "train", "--preset", "ppo", "--json", "--config", config, "--out", out,
    ];
    let settings = TINY.iter().flat_map(|setting| ["--set", setting]);
    let arguments: Vec<&str> = start
        .into_iter()
        .chain(settings)
        .chain(more.iter().copied())
        .collect();
    trainer(&arguments)
}

#[test]
fn a_run_of_a_mixture_is_learned_resumed_evaluated_and_studied_by_cell() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("mixture.toml");
    write(&config, mixture()).unwrap();
    let [whole, again] = ["whole", "again"].map(|name| folder.path().join(name));
    let report = success(&train(&config, &whole, &["--threads", "2"]));
    assert!(report["last"]["mean_age_ms/weak"].as_f64().unwrap() >= 1.0);
    let metrics = read_to_string(whole.join("metrics.csv")).unwrap();
    assert!(
        metrics
            .lines()
            .next()
            .unwrap()
            .contains(",success_per_slot/paper,")
    );

    let _report = success(&train(
        &config,
        &again,
        &["--checkpoint-every", "0", "--threads", "1"],
    ));
    for file in [
        "actor.safetensors",
        "checkpoint.safetensors",
        "metrics.csv",
        "table.bin",
    ] {
        assert_eq!(
            read(whole.join(file)).unwrap(),
            read(again.join(file)).unwrap(),
            "{file}"
        );
    }
    write(&config, mixture().replace("weight = 2", "weight = 3")).unwrap();
    let other = refusal(train(&config, &again, &["--resume"]));
    assert!(
        other.contains("key configuration.mixture[0].weight: found 2.0, so another run, expected 3.0"),
        "{other}"
    );
    write(&config, mixture()).unwrap();

    let run = whole.to_str().unwrap();
    let small = [
        "--worlds",
        "3",
        "--slots",
        "60",
        "--warmup",
        "20",
        "--json",
        "--set",
        "feedback.place_loss=0.25",
    ];
    let evaluated = success(&trainer(&[&["eval", "--run", run], &small[..]].concat()));
    let cells = evaluated["cells"].as_array().unwrap();
    let names: Vec<&Value> = cells.iter().map(|cell| &cell["cell"]).collect();
    assert_eq!(names, ["paper", "weak"]);
    for (cell, (vehicles, sub_channels)) in cells.iter().zip([(8, 3), (4, 2)]) {
        assert_eq!(cell["scenario"]["radio"]["sub_channels"], sub_channels);
        assert_eq!(cell["scenario"]["feedback"]["place_loss"], 0.25);
        let differences = cell["differences"].as_array().unwrap();
        let policies: Vec<&str> = differences
            .iter()
            .map(|difference| difference["policy"].as_str().unwrap())
            .collect();
        assert_eq!(cell["scenario"]["cell"]["vehicles"], vehicles);
        assert_eq!(
            policies,
            [
                "actor",
                "float",
                "exploring",
                "central",
                "clock",
                "assigned",
                "shipped"
            ]
        );
        let own = differences[0]["mean_age_ms"].as_f64().unwrap();
        for difference in differences {
            let expected = own - difference["mean_age_ms"].as_f64().unwrap();
            let found = difference["difference_ms"].as_f64().unwrap();
            assert!((found - expected).abs() < 1e-9, "{difference}");
        }
    }
    let beside = [&["eval", "--run", run, "--policy", "aloha"], &small[..]].concat();
    let beside = success(&trainer(&beside));
    assert_eq!(beside["cells"][1]["differences"].as_array().unwrap().len(), 5);

    let plan = folder.path().join("plan.toml");
    let sets: Vec<String> = TINY.iter().map(|setting| format!("{setting:?}")).collect();
    let text = format!(
        "preset = 'ppo'\nset = ['''mixture=[{{ preset = \"paper\", weight = 2 }}, {{ preset = \"edge\", weight = 1 }}]''', \
         'scenario.cell.vehicles=5', {}]\nseeds = [1]\nevaluation = {{ seed = 5, worlds = 2, slots = 50, warmup = 10 }}\n\
         [[case]]\nname = 'mixed'",
        sets.join(", ")
    );
    write(&plan, text).unwrap();
    let out = folder.path().join("study");
    let arguments = [
        "study",
        "--json",
        "--plan",
        plan.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    let studied = success(&trainer(&arguments));
    assert_eq!(studied["runs"][0]["forms"].as_array().unwrap().len(), 6);
    let table = read_to_string(out.join("plan.csv")).unwrap();
    assert!(table.starts_with("case,seed,cell,form,") && table.contains("mixed,1,edge,actor,"));
    let markdown = read_to_string(out.join("plan.md")).unwrap();
    assert!(markdown.contains("| mixed, paper | ") && markdown.contains("| mixed, edge | "));
}

#[test]
fn mixtures_that_make_no_sense_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (config, out) = (folder.path().join("mixture.toml"), folder.path().join("run"));
    for (from, to, expected) in [
        (
            "\"edge\"",
            "\"egde\"",
            "key mixture[1].preset: found \"egde\", expected \"paper\", \"companion\", \"street\", \"edge\"",
        ),
        (
            "weight = 2",
            "",
            "mixture[0].weight: found none, expected 1e-6 to 1e6",
        ),
        (
            "weight = 2",
            "wieght = 2",
            "key mixture[0].wieght: found an unknown key, expected one of preset, weight, name, set, vehicles, varied",
        ),
        (
            "sub_channels=2",
            "sub_channels=17",
            "mixture[1]: radio.sub_channels: found 17, expected at most 16, which units know",
        ),
        (
            "radio.sub_channels=2",
            "radio.sub_channels=3\", \"radio.sub_channels=2",
            "mixture[1].set: found radio.sub_channels twice, expected each key once",
        ),
    ] {
        write(&config, mixture().replace(from, to)).unwrap();
        let message = refusal(train(&config, &out, &[]));
        assert!(message.contains(expected), "{message}");
        let (config, out) = (config.to_str().unwrap(), out.to_str().unwrap());
        write(config, CELLS.replace(from, to)).unwrap();
        let message = refusal(trainer(&["distil", "--mixture", config, "--out", out]));
        assert!(message.contains(expected), "{message}");
    }
    write(&config, CELLS).unwrap();
    let file = config.to_str().unwrap();
    let preset = refusal(trainer(&["distil", "--mixture", file, "--preset", "edge"]));
    assert!(
        preset.contains("--preset: found edge, expected none with --mixture"),
        "{preset}"
    );
    let paper = [
        "train",
        "--preset",
        "paper",
        "--config",
        file,
        "--out",
        out.to_str().unwrap(),
    ];
    let message = refusal(trainer(&paper));
    assert!(
        message.contains("mixture[1]: radio.sub_channels: found 2, expected 3, which actors know"),
        "{message}"
    );
    assert!(!out.exists());
}

#[test]
fn the_mixtures_that_come_with_the_program_are_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("mixtures");
    for entry in std::fs::read_dir(folder).unwrap() {
        let source = trainer::ConfigurationSource {
            preset: trainer::Preset::FineTune,
            file: Some(entry.unwrap().path()),
            settings: vec!["ppo.first_actor=out/distil".to_owned()],
        };
        assert!(source.read().unwrap().cells().is_mixed());
    }
}
