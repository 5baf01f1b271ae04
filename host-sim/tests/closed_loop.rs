//! The closed loop from slot to street.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::closed_loop::{LoopSummary, closed_loop};
use host_sim::mobility::Grid;
use host_sim::policy::{Kind, actor, aloha, always, clock};
use host_sim::scenario::ScenarioSource;
use host_sim::simulation::{Extent, Simulation};
use host_sim::thread_pool;

fn run(settings: &[&str], policies: &[&'static Kind], threads: u16) -> kit::error::Result<LoopSummary> {
    let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
    let scenario = ScenarioSource {
        settings,
        ..ScenarioSource::default()
    }
    .read()
    .unwrap();
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let extent = Extent {
        seed: 3,
        worlds: 6,
        slots: 600,
        warmup: 200,
    };
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent,
    };
    thread_pool(Some(threads))
        .unwrap()
        .install(|| closed_loop(&simulation, policies, &table, || ()))
}

#[test]
fn staler_knowledge_costs_more_and_full_knowledge_nothing() {
    let policies = [&actor::KIND, &always::KIND];
    let summary = run(&[], &policies, 2).unwrap();
    assert_eq!(
        summary.plan_slots,
        (11..=40).map(|plan| plan * 20).collect::<Vec<u32>>()
    );
    let [actor, always, full] = summary.results.try_into().unwrap();
    assert_eq!((full.policy, full.mean.regret_s_per_trip), (None, 0.0));
    assert!(actor.mean.regret_s_per_trip > 0.0);
    assert!(actor.mean.regret_s_per_trip < always.mean.regret_s_per_trip);
    assert!(actor.mean.capacity_error_veh_per_h < always.mean.capacity_error_veh_per_h);
    assert!(actor.mean.road_age_ms < always.mean.road_age_ms);
    assert!((actor.mean.trip_time_s - full.mean.trip_time_s - actor.mean.regret_s_per_trip).abs() < 1e-9);
    let (cost, interval) = summary.cost_s_per_trip_and_ms.unwrap();
    assert!(cost > 0.0 && interval.unwrap() > 0.0);
}

#[test]
fn threads_do_not_matter() {
    let text = |threads| format!("{:?}", run(&[], &[&clock::KIND], threads).unwrap());
    assert_eq!(text(1), text(2));
}

#[test]
fn without_incidents_nothing_is_lost() {
    let summary = run(&["planning.incident_capacity_loss=0"], &[&aloha::KIND], 2).unwrap();
    let mean = summary.results[0].mean;
    assert_eq!(
        (mean.capacity_error_veh_per_h, mean.regret_s_per_trip),
        (0.0, 0.0)
    );
    // The grid's equilibrium at full capacity: 13.333 / 30.
    assert!((mean.v_over_c - 0.444_444).abs() < 1e-5);
}

#[test]
fn a_run_without_a_plan_is_refused() {
    let message = run(&["planning.period_slots=5000"], &[&clock::KIND], 1)
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "planning.period_slots: found 5000, expected less than the 600 slots after warm-up"
    );
}
