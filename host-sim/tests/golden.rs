//! A small run of every policy, and cells in which vehicles come and go, pinned to the last digit: the simulator's bytes are part of its
//! contract.
//!
//! After a wanted change, `BLESS=1 cargo test -p host-sim --test golden` writes the new values; say why in CHANGELOG.md.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::age::{AgeCounter, AgeSummary};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::mobility::floating_car_data::Trace;
use host_sim::mobility::{Grid, MobilitySource};
use host_sim::policy::{KINDS, Kind, actor, clock};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::{Extent, Simulation, run_slot};
use host_sim::stream::Purpose;
use host_sim::traffic::TrafficModel;
use std::fmt::Write as _;
use std::path::Path;

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
    compare("policies.txt", &found);
}

/// A cell with an edge, where places are open and lost.
const EDGE: [&str; 3] = [
    "radio.carrier_ghz=5.9",
    "radio.max_power_dbm=23",
    "feedback.place_loss=0.2",
];

/// Worlds, each a few.
const WORLDS: u64 = 3;

fn scenario(settings: &[&str]) -> Scenario {
    let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
    ScenarioSource {
        settings,
        ..ScenarioSource::default()
    }
    .read()
    .unwrap()
}

/// Runs a policy; a digest of all that units, base station and statistics see in every slot, absent vehicles included, and what people
/// read.
fn cell(
    name: &str,
    scenario: &Scenario,
    source: &dyn MobilitySource,
    policy: &'static Kind,
    slots: u32,
) -> String {
    const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let mut environment = Environment::new(scenario, source, 11, Purpose::Evaluation, 0..WORLDS);
    let mut decider = (policy.build)(&environment.setup(), &table);
    let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
    let mut counter = AgeCounter::new(50, environment.worlds(), environment.vehicles());
    let mut digest = CRC.digest();
    for slot in 0..slots {
        run_slot(&mut environment, &mut decider, &mut decisions);
        counter.record(slot, &environment);
        for world in 0..environment.worlds() {
            for vehicle in 0..environment.vehicles() {
                digest.update(&environment.age(world, vehicle).slots().to_le_bytes());
                digest.update(&[u8::from(environment.received(world, vehicle))]);
                digest.update(&environment.identity(world, vehicle).0.to_le_bytes());
                for n in 0..environment.sub_channels() {
                    digest.update(
                        &environment
                            .interference_db(world, vehicle, n)
                            .to_bits()
                            .to_le_bytes(),
                    );
                }
            }
            for &vehicle in environment.present() {
                if let Some(measurement) = environment.measurement(world, vehicle) {
                    digest.update(format!("{measurement:?}").as_bytes());
                }
            }
        }
    }
    let mut worlds = counter.worlds();
    for (world, ages) in worlds.iter_mut().enumerate() {
        ages.joiner_waits = environment.joiner_waits(world, 50);
    }
    let summary = AgeSummary::new(&worlds).unwrap();
    let joiners = summary.joiners.map_or("none".to_owned(), |joiners| {
        format!(
            "{} {:?} {:?}",
            joiners.count, joiners.median_slots, joiners.p90_slots
        )
    });
    let traffic = TrafficModel::new(scenario).unwrap();
    let roads: Option<Vec<_>> = (0..environment.worlds())
        .map(|world| traffic.road_ages(&environment, world))
        .collect();
    let roads = roads.map_or("none".to_owned(), |roads| {
        let sums: Vec<String> = roads
            .iter()
            .map(|ages| ages.iter().sum::<f64>().to_string())
            .collect();
        let trip = traffic
            .summary(summary.mean_ms, &roads)
            .unwrap()
            .stale
            .mean_trip_time;
        format!("{} {trip}", sums.join(" "))
    });
    format!(
        "{name} {}\n  seen {:016x}\n  ages {} {} {}\n  joiners {joiners}\n  roads {roads}\n",
        policy.name,
        digest.finalize(),
        summary.mean_ms,
        summary.uncapped_mean_ms,
        summary.peak_ms.unwrap_or_default()
    )
}

#[test]
fn vehicles_that_come_and_go() {
    let paper = scenario(&[]);
    let churn = scenario(&["cell.replacement_probability=0.003"]);
    let edge = scenario(&[&EDGE[..], &["cell.replacement_probability=0.003"]].concat());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/fcd-gap.xml");
    let trace = Trace::read(&path).unwrap();
    let mut found = String::new();
    for policy in [&clock::KIND, &actor::KIND] {
        found += &cell("paper", &paper, &Grid, policy, 300);
        found += &cell("churn", &churn, &Grid, policy, 600);
        found += &cell("churn at the edge", &edge, &Grid, policy, 600);
        found += &cell("trace", &paper, &trace, policy, 590);
    }
    compare("comings_and_goings.txt", &found);
}

/// Compares with what is known, or makes it known.
fn compare(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(name);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, found).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap();
    let differing = found
        .lines()
        .filter(|line| !expected.lines().any(|known| known == *line));
    assert!(
        found == expected,
        "{} does not have:\n{}\nafter a wanted change: BLESS=1 cargo test -p host-sim --test golden",
        path.display(),
        differing.collect::<Vec<_>>().join("\n")
    );
}
