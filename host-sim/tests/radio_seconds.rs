//! Played seconds against a cell that is played whole: the same delays of reports.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::Environment;
use host_sim::decisions::Decisions;
use host_sim::journeys::OnRoad;
use host_sim::journeys::delays::{Delays as _, Fixed};
use host_sim::journeys::hour::{self, Case, Sight};
use host_sim::journeys::incidents::Incidents;
use host_sim::journeys::queues::Queues;
use host_sim::journeys::radio_seconds::{Moment, Sampled, moments, play};
use host_sim::journeys::town::Town;
use host_sim::journeys::trips;
use host_sim::mobility::MobilitySource as _;
use host_sim::mobility::floating_car_data::Trace;
use host_sim::policy::{aloha, clock};
use host_sim::scenario::ScenarioSource;
use host_sim::simulation::run_slot;
use host_sim::stream::{Purpose, WorldKey};
use std::fmt::Write as _;

/// The minute that both look at, in s.
const FROM_S: f64 = 300.0;
const TO_S: f64 = 360.0;

/// Time between two sampled seconds.
const SAMPLE_S: f64 = 5.0;

#[test]
fn delays_are_those_of_a_cell_that_is_played_whole() {
    let settings = ["planning.trips_per_pair_veh_per_h=6", "planning.look_s=1"];
    let scenario = ScenarioSource {
        settings: settings.map(str::to_owned).to_vec(),
        ..ScenarioSource::default()
    }
    .read()
    .unwrap();
    let town = Town::of_grid(&scenario).unwrap();
    let key = WorldKey {
        seed: 5,
        purpose: Purpose::Evaluation,
        world: 0,
    };
    let trips = trips::draw(town.paths(), 2.0 * TO_S, &key);
    let incidents = Incidents::none(town.map().block_count());
    let usual = town.free_speeds_m_per_s();
    let world = town.world(key, &trips, &incidents, &usual, &scenario.planning);
    let blind = Case {
        sight: Sight::Blind,
        connected_share: 1.0,
        obeying_share: 0.0,
        fade_s: 1.0,
    };
    let mut looks: Vec<(f64, Vec<OnRoad>)> = Vec::new();
    let mut samples: Vec<Moment> = Vec::new();
    let mut before: Vec<OnRoad> = Vec::new();
    let mut traffic = Queues::new(town.map(), &incidents);
    hour::run(world, blind, &mut traffic, &mut Fixed(0.0), |time_s, now| {
        if (FROM_S..=TO_S).contains(&time_s) {
            if (time_s - FROM_S) % SAMPLE_S == 0.0 {
                samples.extend(moments(&town, &before, now, 1.0, |_| true));
            }
            looks.push((time_s, now.to_vec()));
        }
        before = now.to_vec();
    })
    .unwrap();

    let mut text = "<fcd-export>\n".to_owned();
    for (time_s, vehicles) in &looks {
        writeln!(text, "<timestep time=\"{:.2}\">", time_s - FROM_S).unwrap();
        for vehicle in vehicles {
            let ((x_m, y_m), id) = (town.map().place_m(vehicle), vehicle.vehicle);
            let place = format!("x=\"{x_m:.3}\" y=\"{y_m:.3}\"");
            writeln!(text, "<vehicle id=\"{id}\" {place} speed=\"13.9\"/>").unwrap();
        }
        text += "</timestep>\n";
    }
    text += "</fcd-export>\n";
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("minute.xml");
    std::fs::write(&file, text).unwrap();
    let trace = Trace::read(&file).unwrap();
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    for policy in [&clock::KIND, &aloha::KIND] {
        // Whole: who was received when, over the minute.
        let mut environment = Environment::new(&scenario, &trace, 5, Purpose::Evaluation, 0..1);
        let mut decider = (policy.build)(&environment.setup(), &table);
        let mut decisions = Decisions::new(1, environment.vehicles());
        let mut received: Vec<Vec<f64>> = vec![Vec::new(); environment.vehicles()];
        for slot in 0..(1000.0 * (TO_S - FROM_S)) as u32 {
            run_slot(&mut environment, &mut decider, &mut decisions);
            for (vehicle, times) in received.iter_mut().enumerate() {
                if environment.received(0, vehicle) {
                    times.push(f64::from(slot + 1) / 1000.0);
                }
            }
        }
        let index = |name: u32| {
            (0..environment.vehicles())
                .find(|&vehicle| trace.vehicle_name(vehicle) == name.to_string())
                .unwrap()
        };
        // By samples.
        let (seconds, ages) = play(&scenario, 5, policy, &table, &samples).unwrap();
        assert!(ages.unwrap().mean_ms > 1.0);
        let mut sampled = Sampled::new(&town, &seconds, SAMPLE_S);
        let (mut whole_s, mut sampled_s) = (Vec::new(), Vec::new());
        // The last seconds have no future, and a unit needs the first to find its place.
        for (time_s, vehicles) in &looks[2..looks.len() - 5] {
            for vehicle in vehicles {
                let time_s = time_s - FROM_S;
                let arrival = sampled.arrival_s(vehicle, time_s).unwrap();
                sampled_s.push(arrival - time_s);
                let times = &received[index(vehicle.vehicle)];
                // A vehicle that arrives before it is heard again is heard no more.
                let next = times.iter().find(|&&time| time > time_s);
                whole_s.extend(next.map(|time| time - time_s));
            }
        }
        for values in [&mut whole_s, &mut sampled_s] {
            values.sort_by(f64::total_cmp);
        }
        assert!(whole_s.len() > 1000, "{}", whole_s.len());
        // Kolmogorov and Smirnov's distance; reports of one vehicle depend on each other, hence not their quantile.
        let share_below = |values: &[f64], limit: f64| {
            values.partition_point(|&value| value <= limit) as f64 / values.len() as f64
        };
        let distance = whole_s
            .iter()
            .map(|&limit| (share_below(&whole_s, limit) - share_below(&sampled_s, limit)).abs())
            .fold(0.0, f64::max);
        assert!(distance < 0.06, "{}: {distance}", policy.name);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let ratio = mean(&sampled_s) / mean(&whole_s);
        assert!((0.9..1.1).contains(&ratio), "{}: {ratio}", policy.name);
    }
}
