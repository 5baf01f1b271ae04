//! The contract between what is trained and what is deployed, to the byte: a thousand encodings and a thousand slots.
//!
//! After a wanted change, `BLESS=1 cargo test -p firmware --test contracts golden` writes them anew; say why in CHANGELOG.md, and train
//! anew: a network knows the encoding that it was trained with, and no other.

use crate::noise::below;
use crate::readings::Readings;
use firmware::link::{ModemFrame, UnitFrame, UnitMessage, encode};
use firmware::lots::Identity;
use firmware::observation::{Observation, Quantities};
use firmware::ring::MAX_PLACES;
use firmware::session::{Request, Session};
use firmware::table::CHECKSUM;
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use firmware::units::{Level, MAX_SUB_CHANNELS};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::fmt::Write as _;

const COUNT: usize = 1_000;
/// What the shipped table requires, to a step.
const REQUIRED: i16 = 2_164;

fn hex(bytes: impl IntoIterator<Item = u8>) -> String {
    bytes.into_iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

/// Compares with what was written, or writes it.
fn check(name: &str, lines: &[String]) {
    let path = format!("{}/tests/golden/{name}.txt", env!("CARGO_MANIFEST_DIR"));
    let found = lines.iter().map(|line| format!("{line}\n")).collect::<String>();
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    let golden = std::fs::read_to_string(&path).unwrap();
    for (number, (found, golden)) in lines.iter().zip(golden.lines()).enumerate() {
        assert_eq!(
            found,
            golden,
            "line {} of {path}; this file says how to bless",
            number + 1
        );
    }
    assert_eq!(found, golden, "{path}");
}

/// A number from a range or, every other time, from one of its edges.
fn edged(rng: &mut Pcg64Mcg, range: u32, edges: &[u32]) -> u32 {
    if rng.next_u32() & 1 == 0 {
        below(rng, range)
    } else {
        edges[below(rng, edges.len() as u32) as usize]
    }
}

/// Readings of all kinds, on edges of what depends on them every other time.
fn readings(rng: &mut Pcg64Mcg) -> Readings {
    let sub_channels = edged(rng, MAX_SUB_CHANNELS as u32, &[2, 2, 2, 7]) + 1;
    let places = sub_channels + edged(rng, 100, &[0, 17, 60, u32::from(MAX_PLACES) - sub_channels]);
    let index = below(rng, places);
    // Ages around multiples of a frame, and where things saturate.
    let frames = |count: u32| (count * places / sub_channels).max(1);
    let ages = [
        1,
        50,
        51,
        frames(1),
        frames(3),
        frames(5),
        frames(7),
        frames(10),
        frames(15),
    ];
    let age = edged(rng, 150, &ages).max(1) + below(rng, 2);
    let required = i32::from(REQUIRED);
    let level = |rng: &mut Pcg64Mcg| {
        let steps = match below(rng, 4) {
            0 => required - 1 + below(rng, 3).cast_signed(),
            1 => rng.next_u32() as i16 as i32,
            _ => -10 * 256 + below(rng, 80 * 256).cast_signed(),
        };
        steps as i16
    };
    let readings = Readings {
        slot: rng.next_u32(),
        sub_channels: sub_channels as usize,
        gain: std::array::from_fn(|_| level(rng)),
        interference: std::array::from_fn(|_| below(rng, 1 << 15) as i16),
        age: (below(rng, 16) > 0).then_some(age),
        place: (below(rng, 8) > 0).then(|| (index as u16, rng.next_u32() & 1 == 0)),
        awaits: rng.next_u32() & 3 == 0,
        weight: edged(rng, 256, &[0, 32, 255]) as u8,
        places: places as u16,
        open: rng.next_u32() as u16 & rng.next_u32() as u16,
        threshold: rng.next_u32() >> below(rng, 32),
        salt: rng.next_u32() as u8,
        gains_hold: rng.next_u32() & 3 > 0,
        max_power: 23 << 8,
        identity: rng.next_u32(),
    };
    // Thresholds that a vehicle just reaches, as one that is called and as a guest.
    let priority = readings.observation().quantities().priority();
    let near = |threshold: i32, rng: &mut Pcg64Mcg| {
        (threshold + below(rng, 3).cast_signed() - 1)
            .max(0)
            .cast_unsigned()
    };
    let threshold = match below(rng, 4) {
        0 => near(priority, rng),
        1 => near((priority >> 3) * 3, rng),
        2 => Quantities::NEVER.cast_unsigned(),
        _ => readings.threshold,
    };
    Readings {
        threshold,
        ..readings
    }
}

/// A line: the ring's form, the paper's, and the checksum of the form that finds a phase by itself.
#[test]
fn encodings_are_what_networks_were_trained_with() {
    let mut rng = Pcg64Mcg::new(0x601d);
    let mut seen = [[false; 256]; firmware::observation::INPUTS];
    let lines: Vec<String> = (0..COUNT)
        .map(|_| {
            let observation: Observation = readings(&mut rng).observation();
            let required = Level::from_bits(REQUIRED);
            let ring = observation.encode(required).map(i8::cast_unsigned);
            for (seen, code) in seen.iter_mut().zip(ring) {
                seen[usize::from(code)] = true;
            }
            let paper = observation.encode_paper().map(i8::cast_unsigned);
            let one_hot = observation.encode_age_one_hot(required).map(i8::cast_unsigned);
            format!("{} {} {:08x}", hex(ring), hex(paper), CHECKSUM.checksum(&one_hot))
        })
        .collect();
    // Both values of every flag, and many of every number.
    for (input, seen) in seen.iter().enumerate() {
        let codes = seen.iter().filter(|&&seen| seen).count();
        let number = [6, 7, 8, 10, 14, 15, 19].contains(&input);
        assert!(
            if number { codes > 12 } else { codes == 2 },
            "input {input}: {codes} codes"
        );
    }
    check("encodings", &lines);
}

/// A line: an event, and the answer as it goes over the line, or `-` for none.
#[test]
fn slots_are_decided_as_they_always_were() {
    let mut rng = Pcg64Mcg::new(0x5107);
    let damaged = [&DISTILLED[..700], &[DISTILLED[700] ^ 1], &DISTILLED[701..]].concat();
    let mut session = Session::new(Unit::new(DISTILLED, Identity(0xf1e1d)));
    // Shortly before the index wraps.
    let mut slot = u32::MAX - 300;
    let (mut lines, mut states) = (Vec::new(), BTreeMap::new());
    let mut misses = 0;
    while lines.len() < COUNT {
        match lines.len() {
            400 => session.replace_table(&damaged),
            440 => session.replace_table(DISTILLED),
            // Long enough to silence the unit.
            600 => misses = 110,
            _ => {}
        }
        let (event, requests): (&str, Vec<Request>) = match below(&mut rng, 40) {
            kind if misses > 0 || kind < 5 => {
                misses = misses.max(1) - 1;
                slot = slot.wrapping_add(1);
                ("missed", bytes(&mut session, &ModemFrame::Missed { slot }))
            }
            5 => ("overdue", (0..5).filter_map(|_| session.tick()).collect()),
            6 => {
                slot = slot.wrapping_add(1 + below(&mut rng, 150));
                ("jump", bytes(&mut session, &ModemFrame::Missed { slot }))
            }
            7 => ("again", bytes(&mut session, &ModemFrame::Missed { slot })),
            _ => {
                slot = slot.wrapping_add(1);
                let readings = Readings {
                    slot,
                    ..readings(&mut rng)
                };
                let frame = ModemFrame::Measurement((&readings.measurement()).into());
                ("measured", bytes(&mut session, &frame))
            }
        };
        if event == "overdue" {
            slot = session.unit().last_slot().map_or(slot, |slot| slot.0);
        }
        let answers: Vec<String> = requests
            .iter()
            .map(|request| answer(request, &mut states))
            .collect();
        let answers = if answers.is_empty() {
            "-".to_owned()
        } else {
            answers.join(" ")
        };
        lines.push(format!("{event} {answers}"));
    }
    println!("{states:?}");
    for state in [
        (0, true),
        (0, false),
        (1, true),
        (1, false),
        (2, false),
        (3, false),
    ] {
        assert!(
            states.get(&state).is_some_and(|&count| count >= 5),
            "state {state:?}"
        );
    }
    check("slots", &lines);
}

fn bytes(session: &mut Session<'_>, frame: &ModemFrame) -> Vec<Request> {
    let wire = encode(frame).unwrap();
    wire.into_iter().filter_map(|byte| session.byte(byte)).collect()
}

fn answer(request: &Request, states: &mut BTreeMap<(u8, bool), u32>) -> String {
    let Request::Answer(message @ UnitMessage::Decision(frame)) = request else {
        panic!("{request:?}")
    };
    let UnitFrame { transmit, state, .. } = frame;
    *states.entry((*state, transmit.is_some())).or_default() += 1;
    hex(encode(message).unwrap())
}
