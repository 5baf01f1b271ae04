//! How many vehicles a sub-channel carries: the command's numbers are those of `run`, whatever the number of threads.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use serde_json::Value;
use std::process::{Command, Output};

fn host_sim(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(arguments)
        .output()
        .unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = host_sim(arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    serde_json::from_slice(&output.stdout).unwrap()
}

const CARRY: [&str; 15] = [
    "carry",
    "--policy",
    "assigned",
    "--policy",
    "random",
    "--most",
    "90",
    "--worlds",
    "3",
    "--slots",
    "200",
    "--seed",
    "7",
    "--set",
    "radio.sub_channels=2",
];

#[test]
fn loads_are_runs_and_pass_the_ages_where_they_should() {
    let found = json(&[&CARRY[..], &["--json", "--threads", "1"]].concat());
    assert_eq!(found, json(&[&CARRY[..], &["--json", "--threads", "2"]].concat()));
    let [assigned, random, bound] = &found["policies"].as_array().unwrap()[..] else {
        panic!("{found}");
    };
    assert_eq!(
        (&assigned["policy"], &bound["policy"]),
        (&"assigned".into(), &"(bound)".into())
    );
    let loads = assigned["loads"].as_array().unwrap();
    assert_eq!(loads.last().unwrap()["vehicles"], 90);
    let run = [
        "run",
        "--json",
        "--policy",
        "assigned",
        "--vehicles",
        "2",
        "--worlds",
        "3",
        "--slots",
        "200",
        "--warmup",
        "50",
        "--seed",
        "7",
        "--set",
        "radio.sub_channels=2",
    ];
    assert_eq!(
        loads[0]["uncapped_mean_age_ms"],
        json(&run)["policies"][0]["uncapped_mean_age_ms"]
    );
    let carried = |policy: &Value, at: usize| policy["carried"][at]["vehicles_per_sub_channel"].as_f64();
    // 19 without fading. Nobody carries 199 with 45 at most; those who send at random are past 1,000 ms, and go no further.
    assert!(
        (16.0..=19.05).contains(&carried(assigned, 0).unwrap()),
        "{assigned}"
    );
    assert_eq!(carried(assigned, 1), None);
    assert!(
        carried(random, 2).is_some_and(|vehicles| vehicles < 15.0),
        "{random}"
    );
    assert!(random["loads"].as_array().unwrap().len() < loads.len());
}

#[test]
fn the_table_and_its_files_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let output = host_sim(&[&CARRY[..], &["--out", out]].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.starts_with("Vehicles that a sub-channel carries at a mean age\n"),
        "{text}"
    );
    assert!(
        text.contains("-: more than 45, the most that were tried"),
        "{text}"
    );
    for name in [
        "carried_at_10_ms.svg",
        "ages_by_load.svg",
        "carried.csv",
        "ages_by_load.csv",
    ] {
        assert!(folder.path().join(name).exists(), "{name}");
        assert!(text.contains(name), "{name}");
    }
    let csv = std::fs::read_to_string(folder.path().join("carried.csv")).unwrap();
    assert!(
        csv.starts_with("policy,vehicles_at_10_ms,fewest_at_10_ms,most_at_10_ms,"),
        "{csv}"
    );
}

#[test]
fn what_contradicts_itself_is_one_line() {
    let refusal = |arguments: &[&str]| {
        let output = host_sim(&[&["carry", "--json"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(
        refusal(&["--set", "cell.vehicles=20"]),
        "error: --most: found --set cell.vehicles=20 beside it, expected one of the two\n"
    );
    let message = refusal(&["--policy", "actor", "--most", "5000"]);
    assert!(
        message.starts_with("error: vehicles: found 5000, expected at most "),
        "{message}"
    );
}
