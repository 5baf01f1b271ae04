//! What the release claims, at the size it claims it: 256 held-out worlds, 2,000 slots after 500.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::mobility::MobilitySource;
use host_sim::policy::PolicyName;
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::{Extent, Simulation};
use trainer::command::eval::compare;
use trainer::run_folder::RunFolder;

const EXTENT: Extent = Extent {
    seed: 31,
    worlds: 256,
    slots: 2000,
    warmup: 500,
};

fn scenario(vehicles: u32) -> Scenario {
    let settings = vec![format!("cell.vehicles={vehicles}")];
    ScenarioSource {
        settings,
        ..ScenarioSource::default()
    }
    .read()
    .unwrap()
}

fn ages(vehicles: u32, policy: PolicyName) -> AgeSummary {
    let (scenario, table) = (
        scenario(vehicles),
        Table::parse(firmware::tables::DISTILLED).unwrap(),
    );
    let simulation = Simulation {
        scenario: &scenario,
        source: &MobilitySource::Grid,
        extent: EXTENT,
    };
    simulation.run_policy(policy, &table, |_| ()).unwrap().0
}

#[test]
fn actor_keeps_twenty_vehicles_near_the_central_scheduler() {
    let (actor, central) = (ages(20, PolicyName::Actor), ages(20, PolicyName::Central));
    assert!(actor.mean_ms <= 4.12, "{}", actor.mean_ms);
    assert!(
        actor.mean_ms / central.mean_ms <= 1.06,
        "{} over {}",
        actor.mean_ms,
        central.mean_ms
    );
    assert!(actor.median_world_ms <= 3.97, "{}", actor.median_world_ms);
    assert!(actor.first100_ms <= 12.5, "{}", actor.first100_ms);
    assert!((3.84..=3.88).contains(&central.mean_ms), "{}", central.mean_ms);
}

#[test]
fn the_same_table_serves_ten_and_forty_vehicles() {
    for vehicles in [10, 40] {
        let (actor, central) = (
            ages(vehicles, PolicyName::Actor),
            ages(vehicles, PolicyName::Central),
        );
        assert!(
            actor.mean_ms / central.mean_ms <= 1.06,
            "{vehicles}: {} over {}",
            actor.mean_ms,
            central.mean_ms
        );
    }
}

#[test]
fn baselines_are_where_they_belong() {
    for (policy, least, most) in [
        (PolicyName::AgeThreshold, 7.5, 7.9),
        (PolicyName::Aloha, 12.7, 13.8),
        (PolicyName::Always, 60.0, 100.0),
    ] {
        let mean = ages(20, policy).mean_ms;
        assert!((least..=most).contains(&mean), "{}: {mean}", policy.name());
    }
}

/// The float network behind the shipped table is distilled anew, which also proves the table byte for byte.
#[test]
fn the_shipped_table_is_what_its_seed_gives_and_loses_nothing_to_its_float_network() {
    let shipped = Table::parse(firmware::tables::DISTILLED).unwrap();
    let recipe = trainer::distil::Recipe {
        seed: shipped.provenance().seed,
        ..Default::default()
    };
    let made = trainer::command::distil::distil_table(
        &trainer::command::distil::shipped_scenario().unwrap(),
        &recipe,
        *shipped.provenance(),
        true,
    )
    .unwrap();
    assert!(
        made.bytes == firmware::tables::DISTILLED,
        "the shipped table is not what its seed gives"
    );
    assert!(made.bytes.len() <= 8192);

    let folder = tempfile::tempdir().unwrap();
    let run = RunFolder::new(folder.path());
    run.write(&made.actors, Some(&made.bytes), &serde_json::json!({}))
        .unwrap();
    assert_eq!(run.read_actors().unwrap(), made.actors);

    let scenario = scenario(20);
    let simulation = Simulation {
        scenario: &scenario,
        source: &MobilitySource::Grid,
        extent: EXTENT,
    };
    let comparison = compare(&simulation, &made.actors, &[shipped]).unwrap();
    assert!(comparison.agreement >= 0.995, "{}", comparison.agreement);
    let lost = comparison.quantised_age_ms - comparison.float_age_ms;
    assert!(lost.abs() < 0.02, "{lost}");
}
