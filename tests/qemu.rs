//! The deployed image, in QEMU, gives the library's bytes.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::link::{ModemFrame, UnitFrame, UnitMessage, encode};
use firmware::lots::Identity;
use firmware::ring::MAX_PLACES;
use firmware::session::{Request, Session};
use firmware::table::Table;
use firmware::tables::DISTILLED;
use firmware::unit::{Event, Unit};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use system_tests::qemu::Qemu;
use system_tests::{below, image, random_measurement};

const FRAMES: usize = 10_000;
/// For one answer. An answer takes well under a millisecond; a machine may be loaded.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// For an answer that must not come.
const SILENCE: Duration = Duration::from_millis(300);

/// The library behind the same bytes.
struct Reference(Session<'static>);

impl Reference {
    fn new() -> Self {
        // The emulated chip's identity reads 0.
        Self(Session::new(Unit::new(DISTILLED, Identity::of_device([0; 3]))))
    }

    fn answers(&mut self, bytes: &[u8]) -> Vec<UnitFrame> {
        let requests = bytes.iter().filter_map(|&byte| self.0.byte(byte));
        requests
            .map(|request| match request {
                Request::Answer(UnitMessage::Decision(frame)) => frame,
                other => panic!("{other:?}"),
            })
            .collect()
    }
}

/// A modem that measures, misses, repeats itself, restarts, and sits on a noisy line.
struct Recording {
    rng: Pcg64Mcg,
    slot: u32,
}

impl Recording {
    /// What comes over the line next, and what kind of thing it is.
    fn next(&mut self) -> (&'static str, Vec<u8>) {
        let slot = self.slot;
        let kind = below(&mut self.rng, 100);
        let advance = match below(&mut self.rng, 200) {
            0 => 1 + below(&mut self.rng, 150), // slots that the modem leaves out
            1 => 0_u32.wrapping_sub(200),       // the modem restarts
            // The next frame is of the same slot, and answered: a slot that is left out would cost it that.
            _ if kind >= 86 => 0,
            _ => 1,
        };
        self.slot = slot.wrapping_add(advance);
        let measurement = random_measurement(&mut self.rng, slot);
        let good = ModemFrame::Measurement((&measurement).into());
        match kind {
            0..60 => ("measurement", wire(&good)),
            60..82 => ("missed", wire(&ModemFrame::Missed { slot })),
            82..86 => {
                let mut twice = wire(&good);
                twice.extend(wire(&good));
                ("repeated", twice)
            }
            86..90 => ("invalid", wire(&self.invalid(&good))),
            _ => ("damaged", self.damaged(wire(&good))),
        }
    }

    fn invalid(&mut self, frame: &ModemFrame) -> ModemFrame {
        let ModemFrame::Measurement(mut frame) = frame.clone() else {
            return frame.clone();
        };
        match below(&mut self.rng, 5) {
            0 => frame.places = MAX_PLACES + 1,
            1 => frame.places = frame.gain.len() as u16 - 1,
            2 => frame.interference[0] = -1,
            3 => (frame.gain, frame.interference) = Default::default(),
            _ => frame.last_acknowledged = Some(frame.slot),
        }
        ModemFrame::Measurement(frame)
    }

    fn damaged(&mut self, mut bytes: Vec<u8>) -> Vec<u8> {
        let position = below(&mut self.rng, bytes.len() as u32 - 1) as usize;
        match below(&mut self.rng, 3) {
            0 => bytes[position] ^= 1 << below(&mut self.rng, 8),
            1 => drop(bytes.remove(position)),
            _ => bytes.splice(position..position, [0xa5; 140]).for_each(drop),
        }
        bytes
    }
}

fn wire(frame: &ModemFrame) -> Vec<u8> {
    encode(frame).unwrap().to_vec()
}

fn valid_table() {
    if let Err(error) = Table::parse(DISTILLED) {
        panic!("no table is built in, so there is nothing to compare: {error}");
    }
}

#[test]
fn ten_thousand_frames_give_the_librarys_answers() {
    valid_table();
    let mut unit = Qemu::boot(image::elf());
    let mut reference = Reference::new();
    // Starts shortly before the slot index wraps.
    let mut recording = Recording {
        rng: Pcg64Mcg::new(0x5eed),
        slot: u32::MAX - 3_000,
    };
    let (mut answered, mut kinds, mut answers) = (0, BTreeMap::new(), BTreeMap::new());
    let start = Instant::now();
    for _ in 0..FRAMES {
        let (kind, bytes) = recording.next();
        *kinds.entry(kind).or_insert(0) += 1;
        unit.send(&bytes);
        let expected = reference.answers(&bytes);
        if kind == "invalid" || kind == "damaged" {
            assert_eq!(expected, [], "the library answers a {kind} frame");
            // A frame that must have no answer is followed by one that has: an answer too many would come first.
            let next = wire(&ModemFrame::Missed { slot: recording.slot });
            unit.send(&next);
            for expected in reference.answers(&next) {
                let received = unit.receive(ANSWER_LIMIT);
                assert_eq!(received, Some(expected), "after a {kind} frame");
                answered += 1;
            }
            recording.slot = recording.slot.wrapping_add(1);
        }
        for expected in expected {
            assert_eq!(
                unit.receive(ANSWER_LIMIT),
                Some(expected),
                "{kind} frame {bytes:02x?}"
            );
            answered += 1;
            *answers
                .entry((expected.state, expected.transmit.is_some()))
                .or_insert(0) += 1;
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    assert_eq!(unit.receive(SILENCE), None, "an answer too many");
    println!("{FRAMES} frames, {answered} answers compared, 0 mismatches, {seconds:.1} s");
    println!("sent {kinds:?}; (state, transmits) answered {answers:?}");
    for state in [0, 1, 3] {
        assert!(
            answers.keys().any(|&(found, _)| found == state),
            "state {state} never occurred"
        );
    }
    unit.assert_stack_is_within_budget();
}

/// The number that the modem tells decides the image's lots as it does the library's.
#[test]
fn the_image_draws_its_lots_under_the_number_that_it_is_told() {
    valid_table();
    let mut unit = Qemu::boot(image::elf());
    let mut rng = Pcg64Mcg::new(12);
    let mut others = 0;
    for (round, number) in [0x1234_5678, 0, u32::MAX].into_iter().enumerate() {
        unit.send(&wire(&ModemFrame::Identity { number }));
        let mut named = Unit::new(DISTILLED, Identity(number));
        let mut unnamed = Unit::new(DISTILLED, Identity::of_device([0; 3]));
        for slot in 0..300 {
            let measurement = random_measurement(&mut rng, 300 * round as u32 + slot);
            unit.send(&wire(&ModemFrame::Measurement((&measurement).into())));
            let [expected, other] = [&mut named, &mut unnamed].map(|unit| {
                unit.slot(&Event::Measured(measurement))
                    .map(|report| UnitFrame::from(&report))
            });
            assert_eq!(unit.receive(ANSWER_LIMIT), expected);
            others += u32::from(other != expected);
        }
    }
    assert!(others > 10, "the number changes hardly a decision: {others}");
}

#[test]
fn invalid_fields_get_no_answer() {
    let mut unit = Qemu::boot(image::elf());
    let mut rng = Pcg64Mcg::new(3);
    let ModemFrame::Measurement(good) = ModemFrame::Measurement((&random_measurement(&mut rng, 5)).into())
    else {
        unreachable!()
    };
    let mut frames: [_; 5] = std::array::from_fn(|_| good.clone());
    frames[0].places = 0;
    frames[1].places = MAX_PLACES + 1;
    (frames[2].gain, frames[2].interference) = Default::default();
    frames[3].interference[0] = -1;
    frames[4].last_acknowledged = Some(6);
    for frame in frames {
        let frame = ModemFrame::Measurement(frame);
        unit.send(&wire(&frame));
        assert_eq!(unit.receive(SILENCE), None, "{frame:?}");
    }
    unit.send(&wire(&ModemFrame::Measurement(good)));
    assert_eq!(
        unit.receive(ANSWER_LIMIT).map(|answer| answer.slot),
        Some(5),
        "the unit goes on"
    );
}

#[test]
fn a_unit_with_a_damaged_table_stays_silent() {
    valid_table();
    let elf = image::read(image::elf());
    let table = image::table_offset(&elf);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("damaged");
    let last = DISTILLED.len() - 1;
    // The magic, the version, a reserved byte, some weight, the checksum.
    for (position, bit) in [(0, 0), (4, 1), (16, 7), (last / 2, 3), (last, 6)] {
        let mut damaged = elf.clone();
        damaged[table + position] ^= 1 << bit;
        std::fs::write(&path, damaged).unwrap();

        let mut unit = Qemu::boot(&path);
        let mut rng = Pcg64Mcg::new(9);
        for slot in 1..=110 {
            let frame = if rng.next_u32().is_multiple_of(4) {
                ModemFrame::Missed { slot }
            } else {
                ModemFrame::Measurement((&random_measurement(&mut rng, slot)).into())
            };
            unit.send(&wire(&frame));
            let silent = UnitFrame {
                slot,
                transmit: None,
                state: 2,
            };
            assert_eq!(
                unit.receive(ANSWER_LIMIT),
                Some(silent),
                "bit {bit} of byte {position}"
            );
        }
    }
}

#[test]
fn the_logging_image_answers_too() {
    let mut unit = Qemu::boot(image::elf_with_defmt());
    for slot in 0..2_500 {
        unit.send(&wire(&ModemFrame::Missed { slot }));
        assert_eq!(unit.receive(ANSWER_LIMIT).map(|answer| answer.slot), Some(slot));
    }
}
