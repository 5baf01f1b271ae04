//! What commands print for scripts (`--json`), against the schemas under `docs/schemas`.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use system_tests::program;
use system_tests::schema::Schemas;

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assignment/tests/fixtures");

const GRID: &str = "vehicles = [5, 10, 15, 20]\npolicy = \"clock\"\nseed = [1, 2, 3, 4, 5]\nworlds = 2\nslots = 20\nwarmup = 0\n";

const MIXTURE: &str = "[[mixture]]\npreset = \"paper\"\nweight = 2\nvehicles = [2, 5]\n[[mixture]]\nname = \"other\"\npreset = \"paper\"\nweight = 1\nset = [\"cell.vehicles=4\"]\n";

const EVALUATION: &str = "[evaluation]\nseed = 5\nworlds = 2\nslots = 20\nwarmup = 0\n";

/// Small runs whose objects have every key of their schema between them: the schema, the program and its arguments, in this order since
/// some need what others leave. `{}` is a folder, `{fixtures}` one with networks, `{traces}` one with traces.
const RUNS: &[(&str, &str)] = &[
    (
        "run",
        "host-sim run --worlds 2 --slots 40 --warmup 20 --timing --set cell.replacement_probability=0.01",
    ),
    (
        "run",
        "host-sim run --worlds 1 --slots 40 --policy clock --mobility {traces}/crossing.fcd.xml",
    ),
    (
        "loop",
        "host-sim loop --worlds 2 --policy clock --policy aloha --delay 60 --set planning.horizon_s=600 --set planning.warmup_s=60",
    ),
    (
        "loop",
        "host-sim loop --worlds 1 --policy clock --delay 1 --set planning.horizon_s=600 --set planning.warmup_s=60 --seconds-per-unit 36 \
      --set planning.demand_factor=0.02 --net {fixtures}/SiouxFalls_net.tntp --trips {fixtures}/SiouxFalls_trips.tntp",
    ),
    ("assign", "host-sim assign --net grid"),
    (
        "assign",
        "host-sim assign --net {fixtures}/SiouxFalls_net.tntp --classes {fixtures}/SiouxFalls_classes.toml --gap 1e-3",
    ),
    (
        "assign",
        "host-sim assign --net {fixtures}/SiouxFalls_net.tntp --trips {fixtures}/SiouxFalls_trips.tntp --flows {}/flows.csv",
    ),
    (
        "assign",
        "host-sim assign --net {fixtures}/SiouxFalls_net.tntp --trips {fixtures}/SiouxFalls_trips.tntp --check {}/flows.csv",
    ),
    ("diff", "host-sim diff {}/a.json {}/b.json"),
    (
        "carry",
        "host-sim carry --policy clock --policy always --most 12 --worlds 2 --slots 40",
    ),
    (
        "figures",
        "host-sim figures --worlds 1 --slots 20 --out {}/figures",
    ),
    ("init", "host-sim init {}/scenario.toml"),
    ("explain", "host-sim explain"),
    ("explain", "trainer explain"),
    (
        "sweep",
        "host-sim sweep --grid {}/grid.toml --out {}/points --shard 0/2",
    ),
    (
        "sweep",
        "host-sim sweep --grid {}/grid.toml --out {}/points --plan 1",
    ),
    (
        "merge",
        "host-sim merge --grid {}/grid.toml --out {}/points --allow-missing",
    ),
    ("bench", "host-sim bench --worlds 1 --slots 20"),
    ("hil", "host-sim hil --units 1 --slots 20"),
    ("deadline", "host-sim deadline --slots 200 --inputs 4"),
    ("trainer-bench", "trainer bench"),
    (
        "trainer-train",
        "trainer train --preset evolution --set evolution.episodes=2 --set evolution.population=4 --set evolution.elite=2 \
      --set evolution.worlds=1 --set evolution.slots=20 --out {}/evolution",
    ),
    (
        "trainer-train",
        "trainer train --preset freshlane --set maddpg.episodes=1 --set maddpg.slots=8 --set scenario.cell.vehicles=3 --out {}/maddpg",
    ),
    (
        "trainer-train",
        "trainer train --preset companion --set maddpg.episodes=1 --set maddpg.slots=4 --set scenario.cell.vehicles=2 --out {}/continuous",
    ),
    (
        "trainer-train",
        "trainer train --preset companion --set maddpg.episodes=1 --set maddpg.slots=4 --set scenario.cell.vehicles=2 \
         --set maddpg.action=sub-channels --out {}/choices",
    ),
    (
        "trainer-train",
        "trainer train --preset ppo --config {}/mixture.toml --set ppo.episodes=1 --set ppo.batches=3 --set ppo.updates=1 --set ppo.slots=8 \
      --set ppo.min_vehicles=2 --set ppo.max_vehicles=5 --set ppo.critic_hidden=[8] --set scenario.cell.vehicles=5 --out {}/mixed",
    ),
    ("trainer-distil", "trainer distil --hidden 4 --out {}/distil"),
    (
        "trainer-distil",
        "trainer distil --hidden 4 --mixture {}/mixture.toml --out {}/distilled",
    ),
    (
        "trainer-eval",
        "trainer eval --run {}/evolution --worlds 2 --slots 20 --warmup 0 --timing",
    ),
    (
        "trainer-eval",
        "trainer eval --run {}/mixed --worlds 2 --slots 20 --warmup 0",
    ),
    (
        "trainer-compare",
        "trainer compare --policy aloha --worlds 2 --slots 20 --warmup 0",
    ),
    (
        "trainer-study",
        "trainer study --plan {}/plan.toml --out {}/study --shard 0/2",
    ),
    (
        "trainer-study",
        "trainer study --plan {}/mixed.toml --out {}/studied",
    ),
    (
        "trainer-export",
        "trainer export --run {}/evolution --onnx {}/actor.onnx",
    ),
    (
        "trainer-adapt",
        "trainer adapt --set radio.min_spectral_efficiency=6 --out {}/six.bin",
    ),
    ("trainer-key", "trainer key --out {}/key.pem"),
    (
        "trainer-sign",
        "trainer sign --key {}/key.pem --version 1 --out {}/package.bin",
    ),
];

/// The object that a command prints.
fn object(arguments: &str, folder: &Path) -> Value {
    let place = |word: &str| {
        word.replace("{}", folder.to_str().unwrap())
            .replace("{fixtures}", FIXTURES)
            .replace(
                "{traces}",
                concat!(env!("CARGO_MANIFEST_DIR"), "/../host-sim/examples"),
            )
    };
    let mut words = arguments.split_whitespace();
    let mut command = Command::new(program(words.next().unwrap()));
    command
        .current_dir(folder)
        .arg(words.next().unwrap())
        .arg("--json");
    for word in words {
        command.arg(place(word));
    }
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments}: {errors}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments}: {error}"))
}

/// A result of `run`, as short as one may be.
fn result(seed: u64, half_width: &str) -> String {
    format!(
        r#"{{ "bound_age_ms": 3.85, "seed": {seed}, "scenario": {{}}, "policies": [{{ "policy": "p{seed}" }}, {{ "policy": "actor",
        "mean_age_ms": 4.0, "mean_age_ci95_ms": {half_width} }}] }}"#
    )
}

#[test]
fn every_command_prints_what_its_schema_says_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("grid.toml", GRID);
    for (name, seed, half) in [("a.json", 1, "0.1"), ("b.json", 2, "null")] {
        write(name, &result(seed, half));
    }
    write("mixture.toml", MIXTURE);
    let tiny = "set = [\"evolution.episodes=1\", \"evolution.population=4\", \"evolution.elite=2\", \"evolution.worlds=1\", \"evolution.slots=20\"]\n";
    let case = "[[case]]\nname = \"tiny\"\n";
    write(
        "plan.toml",
        &format!("preset = \"evolution\"\nseeds = [1, 2]\n{tiny}{EVALUATION}{case}"),
    );
    let mixed = "set = [\"ppo.episodes=1\", \"ppo.batches=3\", \"ppo.updates=1\", \"ppo.slots=8\", \"ppo.critic_hidden=[8]\", '''mixture=[{ preset = \"paper\", weight = 2 }, { name = \"other\", preset = \"paper\", weight = 1 }]''']\n";
    write(
        "mixed.toml",
        &format!("preset = \"ppo\"\nseeds = [1]\n{mixed}{EVALUATION}{case}"),
    );

    let mut schemas = Schemas::read();
    for (name, arguments) in RUNS {
        let object = object(arguments, folder.path());
        schemas.check(&format!("{name}.json"), &object, arguments);
    }
    // It would write into the firmware's sources: what it prints of a table, without what only a run of a mixture has.
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let export = trainer::command::export::to_json(&table, None, &[]).unwrap();
    schemas.check("trainer-export.json", &export, "trainer export");
    let mut unseen = schemas.unseen();
    unseen.retain(|key| !key.starts_with("trainer-export.json/properties/cells"));
    assert!(unseen.is_empty(), "no command here printed {unseen:#?}");
}

/// The scenario's schema is the program's own, which editors read.
#[test]
fn the_schema_of_scenarios_is_the_programs() {
    let output = Command::new(program("host-sim")).arg("schema").output().unwrap();
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let schemas = Schemas::read();
    assert!(
        printed == *schemas.file("scenario.json"),
        "host-sim schema > docs/schemas/scenario.json"
    );
}

#[test]
fn every_command_with_json_has_a_schema_and_every_key_a_meaning() {
    let schemas = Schemas::read();
    let mut expected = BTreeSet::from(["scenario.json".to_owned()]);
    for (name, prefix) in [("host-sim", ""), ("trainer", "trainer-")] {
        let help = |arguments: &[&str]| {
            let output = Command::new(program(name)).args(arguments).output().unwrap();
            String::from_utf8(output.stdout).unwrap()
        };
        let commands = help(&["--help"]);
        let (_, commands) = commands.split_once("Commands:\n").unwrap();
        let commands = commands.lines().take_while(|line| !line.is_empty());
        // A name stands behind two spaces, the lines of a long meaning behind more.
        let named = commands.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
        for command in named.filter(|command| !command.is_empty() && *command != "help") {
            if help(&[command, "--help"]).contains("--json") {
                expected.insert(match command {
                    "explain" => "explain.json".to_owned(),
                    _ => format!("{prefix}{command}.json"),
                });
            }
        }
    }
    assert_eq!(schemas.names(), expected.iter().map(String::as_str).collect());

    let book = std::fs::read_to_string(system_tests::schema::folder().join("../json.md")).unwrap();
    for name in schemas.names() {
        assert!(
            book.contains(&format!("(schemas/{name})")),
            "docs/json.md does not list {name}"
        );
    }
    for ((file, place), key) in schemas.keys() {
        assert!(
            key["description"].as_str().is_some_and(|text| !text.is_empty()),
            "{file}{place}: no description"
        );
        let types = key["type"].to_string();
        // A scenario's keys say their unit with their range.
        if file != "scenario.json" && (types.contains("number") || types.contains("integer")) {
            assert!(key["unit"].is_string(), "{file}{place}: no unit");
        }
    }
}
