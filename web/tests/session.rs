//! What the page's program does, without a browser.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use freshlane_web::session::{Request, Session};
use kit::error::Result;

fn open(seed: &str, settings: &[&str], policy: &str) -> Result<Session> {
    Session::open(&Request {
        seed: seed.to_owned(),
        settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
        policy: policy.to_owned(),
        comparisons: vec!["central".to_owned(), "aloha".to_owned()],
    })
}

/// A vehicle's numbers: x, y, age, sub-channel, received, jammed.
fn vehicle(session: &mut Session, index: usize) -> Vec<f32> {
    session.vehicles().chunks(6).nth(index).unwrap().to_vec()
}

#[test]
fn what_does_not_fit_is_named() {
    let refusal = |seed: &str, settings: &[&str], policy: &str| match open(seed, settings, policy) {
        Ok(_) => panic!("accepted"),
        Err(error) => error.to_string(),
    };
    assert_eq!(
        refusal("-1", &[], "actor"),
        "seed: found \"-1\", expected a whole number from 0 to 18446744073709551615"
    );
    assert_eq!(
        refusal("1", &["cell.vehicles=73"], "aloha"),
        "cell.vehicles: found 73, expected at most 72 on this page"
    );
    assert!(
        refusal("1", &["radio.min_spectral_efficiency=2"], "actor")
            .starts_with("radio.min_spectral_efficiency: found 2")
    );
    assert!(
        refusal("1", &[], "oracle").starts_with("policy: found \"oracle\", expected \"actor\", \"central\"")
    );
}

#[test]
fn a_jammed_vehicle_ages_in_every_run_and_recovers() {
    let mut session = open("5", &[], "actor").unwrap();
    session.advance(1000);
    assert!(session.jam(3, true) && !session.jam(20, true));
    assert_eq!(session.count_from(), 1500);
    session.advance(150);
    let jammed = vehicle(&mut session, 3);
    assert_eq!((jammed[2], jammed[4], jammed[5]), (100.0, 0.0, 1.0));
    // 19 fresh vehicles and one at 100 ms; the central scheduler spends a sub-channel on it, which is the oldest.
    let [actor, central] = [0, 1].map(|run| session.history_ms(run)[1149]);
    assert!((8.0..9.5).contains(&actor), "{actor}");
    assert!((9.5..10.5).contains(&central), "{central}");
    assert!(session.jam(3, false));
    session.advance(150);
    assert!(vehicle(&mut session, 3)[2] < 50.0);
}

#[test]
fn room_changes_nothing_until_a_vehicle_joins() {
    let mut session = open("5", &[], "actor").unwrap();
    session.advance(1000);
    assert!(!session.join(f64::NAN, 0.0));
    assert!(session.join(10.0, 600.0));
    assert_eq!(session.vehicle_count(), 20);
    session.advance(100);
    assert_eq!(session.vehicle_count(), 21);
    let [x, y] = vehicle(&mut session, 20)[..2] else {
        panic!("no place")
    };
    // On the nearest northbound lane of the western border, within one update's way.
    assert!((x - 5.25).abs() < 1e-3 && (599.0..=602.0).contains(&y), "{x} {y}");
    session.advance(400);
    assert!(vehicle(&mut session, 20)[2] < 50.0, "it is heard of");
    let joined = (0..100).filter(|_| session.join(375.0, 649.5)).count();
    assert_eq!(joined, 72 - 21);
}

#[test]
fn use_of_the_sub_channels_agrees_with_the_receptions() {
    let mut session = open("9", &[], "aloha").unwrap();
    let mut received = 0;
    session.advance(500);
    for slot in 500..1500_usize {
        session.advance(1);
        let uses = &session.occupancy()[slot % 256 * 9..][..9];
        for bytes in uses.chunks(3) {
            assert!(bytes[0] > 0 || bytes[2] == u8::MAX);
            received += u32::from(bytes[2] != u8::MAX);
        }
    }
    let per_slot = session.summaries()[2];
    assert_eq!(f64::from(received) / 1000.0, per_slot);
}
