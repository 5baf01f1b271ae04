//! The tour's town, without a browser.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use freshlane_web::town::{TownRequest, TownSession};

fn open(seed: &str, policy: &str) -> kit::error::Result<TownSession> {
    TownSession::open(&TownRequest {
        seed: seed.to_owned(),
        policy: policy.to_owned(),
    })
}

#[test]
fn who_is_told_of_an_incident_queues_less_and_arrives_sooner() {
    let town = open("1", "actor").unwrap();
    let description = town.description();
    let pictures = description["pictures"].as_u64().unwrap() as usize;
    let roads = description["roads"].as_array().unwrap().len();
    assert_eq!((pictures, roads), (751, 48));
    let width = description["vehicle_numbers"].as_u64().unwrap() as usize;
    // Queued vehicles, mean over the incident and the minutes in which its queue goes.
    let queued = [0, 1].map(|side| {
        let side = town.side(side).unwrap();
        assert_eq!(side.starts().len(), pictures + 1);
        assert_eq!(
            side.numbers().len(),
            *side.starts().last().unwrap() as usize * width
        );
        let numbers = side.numbers().chunks(width);
        numbers.filter(|vehicle| vehicle[2] > 0.0).count() as f64 / pictures as f64
    });
    assert!(queued[1] < 0.8 * queued[0], "{queued:?}");
    let times = &description["trip_times_s"];
    assert!(times[1].as_f64().unwrap() < times[0].as_f64().unwrap(), "{times}");
    assert!(description["mean_age_ms"].as_f64().unwrap() > 1.0);
    assert!(town.side(2).is_none());
}

#[test]
fn what_does_not_fit_is_named() {
    let refusal = |seed, policy| open(seed, policy).unwrap_err().to_string();
    assert!(refusal("-1", "actor").starts_with("seed: found \"-1\""));
    assert!(refusal("1", "oracle").starts_with("policy: found \"oracle\""));
}
