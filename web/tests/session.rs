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

/// A vehicle's numbers: x, y, age, sub-channel, received, jammed, place, called.
fn vehicle(session: &mut Session, index: usize) -> Vec<f32> {
    session.vehicles().chunks(8).nth(index).unwrap().to_vec()
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
        refusal("1", &["cell.vehicles=256"], "aloha"),
        "cell.vehicles: found 256, expected at most 255 on this page"
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
    assert!((150.0..250.0).contains(&jammed[2]), "{}", jammed[2]);
    assert_eq!((jammed[4], jammed[5]), (0.0, 1.0));
    // 19 fresh vehicles and one that counts as 100 ms; the central scheduler spends a sub-channel on it, which is the oldest.
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
    let joined = (0..300).filter(|_| session.join(375.0, 649.5)).count();
    assert_eq!(joined, 255 - 21);
}

#[test]
fn use_of_the_sub_channels_agrees_with_the_receptions() {
    let mut session = open("9", &[], "aloha").unwrap();
    let mut received = 0;
    session.advance(500);
    for slot in 500..1500_usize {
        session.advance(1);
        let uses = &session.occupancy()[slot % 256 * 12..][..12];
        for bytes in uses.chunks(4) {
            assert!(bytes[0] > 0 || bytes[2] == u8::MAX);
            received += u32::from(bytes[2] != u8::MAX);
        }
    }
    let per_slot = session.summaries()[2];
    assert_eq!(f64::from(received) / 1000.0, per_slot);
}

#[test]
fn places_and_calls_are_shown() {
    // Nobody fails at this power: everybody has a place, nothing is open, and nobody is called.
    let mut session = open("9", &["radio.max_power_dbm=50"], "clock").unwrap();
    let mut places: Vec<f32> = session.vehicles().chunks(8).map(|numbers| numbers[6]).collect();
    places.sort_unstable_by(f32::total_cmp);
    assert!(
        places
            .iter()
            .zip(0_u8..20)
            .all(|(&place, number)| place == f32::from(number))
    );
    session.advance(300);
    assert!(session.occupancy().chunks(4).all(|bytes| bytes[3] == 0));
    assert!(session.vehicles().chunks(8).all(|numbers| numbers[7] == 0.0));
    // Where many fail, places are open, and who contends was called.
    let hard = ["radio.carrier_ghz=5.9", "radio.max_power_dbm=23"];
    let mut session = open("9", &hard, "clock").unwrap();
    let (mut opened, mut called, mut contended) = (0, 0, 0);
    for slot in 0..1000_usize {
        session.advance(1);
        let uses = session.occupancy()[slot % 256 * 12..][..12].to_vec();
        opened += uses.chunks(4).filter(|bytes| bytes[3] > 0).count();
        for numbers in session.vehicles().chunks(8) {
            called += usize::from(numbers[7] > 0.0);
            let sent_on = numbers[3];
            if sent_on >= 0.0 && uses[sent_on as usize * 4 + 3] > 0 {
                contended += 1;
                assert_eq!(numbers[7], 1.0, "slot {slot}: sends on an open sub-channel");
            }
        }
    }
    assert!(
        opened > 100 && contended > 100 && called >= contended,
        "{opened} {called} {contended}"
    );
    let places = |session: &mut Session| {
        session
            .vehicles()
            .iter()
            .skip(6)
            .step_by(8)
            .filter(|&&place| place < 0.0)
            .count()
    };
    assert!(places(&mut session) > 0, "the weak have no place");
}
