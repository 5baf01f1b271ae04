//! The closed loop from slot to street.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::closed_loop::{LoopOptions, LoopSummary, built_in, closed_loop};
use host_sim::journeys::town::Town;
use host_sim::policy::{Kind, aloha, clock, random};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::thread_pool;
use std::process::Command;

/// Short hours under heavy incidents.
fn scenario(settings: &[&str]) -> Scenario {
    let short = [
        "planning.horizon_s=1200",
        "planning.warmup_s=300",
        "planning.trips_per_pair_veh_per_h=30",
    ];
    let settings = short.iter().chain(settings).map(|&setting| setting.to_owned());
    ScenarioSource {
        settings: settings.collect(),
        ..ScenarioSource::default()
    }
    .read()
    .unwrap()
}

fn run(settings: &[&str], policies: &[&'static Kind], delays_s: &[f64], threads: u16) -> LoopSummary {
    let scenario = scenario(settings);
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let options = LoopOptions {
        scenario: &scenario,
        seed: 3,
        worlds: 6,
        policies,
        table: &table,
        delays_s,
    };
    let pool = thread_pool(Some(threads)).unwrap();
    pool.install(|| {
        let town = Town::of_grid(&scenario).unwrap();
        closed_loop(&town, &options, &built_in, |_| ()).unwrap()
    })
}

#[test]
fn later_knowledge_costs_more_and_milliseconds_cost_nothing() {
    let summary = run(&[], &[&clock::KIND, &random::KIND], &[30.0, 300.0], 2);
    let excludes_zero = |(mean, half): (f64, Option<f64>)| mean > half.unwrap();
    let [(_, early), (_, late)] = &summary.delayed[..] else {
        panic!("{:?}", summary.delayed)
    };
    assert!(excludes_zero(late.beyond(early)), "{:?}", late.beyond(early));
    assert!(excludes_zero(summary.no_information.beyond(&summary.detected)));
    assert!(excludes_zero(summary.full_knowledge.beyond(&summary.all_obey)));
    let [clock, random] = &summary.policies[..] else {
        panic!("{:?}", summary.policies)
    };
    assert_eq!(summary.freshest().unwrap().policy, clock.policy);
    let loss = summary.loss(clock);
    assert!(loss.radio.0.abs() < 0.5, "{:?}", loss.radio);
    assert_eq!(loss.protocol.0, 0.0);
    // Whoever is hardly ever heard leaves the base station with what it knows without reports.
    assert!(random.result.road_age_s > clock.result.road_age_s);
    assert!(random.result.beyond(&clock.result).0 > loss.radio.0);
}

#[test]
fn threads_do_not_matter() {
    let text = |threads| format!("{:?}", run(&[], &[&aloha::KIND], &[10.0], threads));
    assert_eq!(text(1), text(2));
}

#[test]
fn who_does_not_follow_is_not_informed() {
    let nobody = run(&["planning.obeying_share=0"], &[], &[], 2);
    assert_eq!(nobody.detected.beyond(&nobody.no_information).0, 0.0);
    assert_eq!(nobody.full_knowledge.beyond(&nobody.no_information).0, 0.0);
    let everybody = run(&["planning.obeying_share=1"], &[], &[], 2);
    assert_eq!(everybody.full_knowledge.beyond(&everybody.all_obey).0, 0.0);
    let disconnected = run(&["planning.connected_share=0"], &[], &[], 2);
    // Nothing is ever reported, so nothing is ever advised but by the usual times, which are those of the usual ways.
    let advised = disconnected.detected.beyond(&disconnected.no_information);
    assert!(advised.0.abs() < advised.1.unwrap(), "{advised:?}");
}

#[test]
fn no_step_makes_the_result() {
    let coarse = run(&[], &[], &[60.0], 2);
    let fine = run(&["planning.look_s=1"], &[], &[60.0], 2);
    for (coarse, fine) in [
        (&coarse.detected, &fine.detected),
        (&coarse.delayed[0].1, &fine.delayed[0].1),
        (&coarse.full_knowledge, &fine.full_knowledge),
    ] {
        let (difference, half) = fine.beyond(coarse);
        assert!(
            difference.abs() <= half.unwrap() || difference.abs() < 0.5,
            "{difference} +- {half:?}"
        );
    }
    let (one, other) = (fine.no_information.v_over_c, coarse.no_information.v_over_c);
    assert!((one / other - 1.0).abs() < 0.005, "{one} {other}");
    // Without knowledge nothing looks: the traffic itself has no step.
    assert!(fine.no_information.beyond(&coarse.no_information).0.abs() < 1e-9);
}

#[test]
fn what_has_no_effect_is_refused() {
    for (arguments, expected) in [
        (["--set", "mobility.standing_share=0.3"], "traffic moves them"),
        (["--delay=5", "--delay=5"], "5 twice"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["loop", "--json"])
            .args(arguments)
            .output()
            .unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(expected), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}

#[test]
fn a_loaded_network_is_driven_at_its_size() {
    let fixture = |name: &str| {
        format!(
            "{}/../assignment/tests/fixtures/{name}",
            env!("CARGO_MANIFEST_DIR")
        )
    };
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args([
            "loop", "--json", "--worlds", "2", "--policy", "clock", "--delay", "60",
        ])
        .args([
            "--set",
            "planning.horizon_s=1800",
            "--seconds-per-unit",
            "36",
            "--set",
            "planning.demand_factor=0.02",
        ])
        .args([
            "--net",
            &fixture("SiouxFalls_net.tntp"),
            "--trips",
            &fixture("SiouxFalls_trips.tntp"),
        ])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["traffic"], "built-in");
    assert_eq!(object["roads"], 76);
    assert!(object["base_stations"].as_u64().unwrap() > 1);
    // 360,600 trips an hour in the file, one in fifty of them here.
    let loss = &object["policies"][0]["trip_loss_s"];
    for part in ["obedience", "coverage", "detection", "radio", "protocol"] {
        assert!(loss[part].is_number(), "{loss}");
        assert!(loss[format!("{part}_ci95")].is_number(), "{loss}");
    }
    assert!(object["policies"][0]["unfinished_share"].as_f64().unwrap() < 0.01);
}
