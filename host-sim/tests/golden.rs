//! A small run of every policy, pinned to the last digit: the simulator's bytes are part of its contract.
//!
//! After a wanted change, `BLESS=1 cargo test -p host-sim --test golden` writes the new values; say why in CHANGELOG.md.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::mobility::Grid;
use host_sim::policy::KINDS;
use host_sim::scenario::ScenarioSource;
use host_sim::simulation::{Extent, Simulation};
use std::fmt::Write as _;

#[test]
fn every_policy_on_small_worlds() {
    let scenario = ScenarioSource::default().read().unwrap();
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let extent = Extent {
        seed: 2026,
        worlds: 4,
        slots: 400,
        warmup: 200,
    };
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent,
    };
    let mut found = String::from("policy mean_age_ms median_world_age_ms first100_age_ms success_per_slot\n");
    for &policy in KINDS {
        let (ages, _) = simulation.run_policy(policy, &table, |_, _| ()).unwrap();
        let (mean, median) = (ages.mean_ms, ages.median_world_ms);
        writeln!(
            found,
            "{} {mean} {median} {} {}",
            policy.name, ages.first100_ms, ages.success_per_slot
        )
        .unwrap();
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/policies.txt");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(path, &found).unwrap();
    }
    let expected = std::fs::read_to_string(path).unwrap();
    let differing = found
        .lines()
        .filter(|line| !expected.lines().any(|known| known == *line));
    assert!(
        found == expected,
        "{path} does not have:\n{}\nafter a wanted change: BLESS=1 cargo test -p host-sim --test golden",
        differing.collect::<Vec<_>>().join("\n")
    );
}
