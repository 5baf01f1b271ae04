//! Bytes and ticks in, answers out: deadlines, late frames, a modem that falls silent, floods.

use crate::noise::{below, noise};
use crate::observation::Readings;
use firmware::link::{ModemFrame, UnitFrame, UnitMessage, encode};
use firmware::session::{Request, Session};
use firmware::slot_clock::{MAX_TICK_MICROSECONDS, SlotClock, SlotLength};
use firmware::table::Table;
use firmware::tables::DISTILLED;
use firmware::unit::{Unit, back_off};
use firmware::units::{Dbm, SlotIndex};
use rand_core::Rng;
use rand_pcg::{Pcg32, Pcg64Mcg};

fn session() -> Session<'static, Pcg32> {
    Session::new(Unit::new(DISTILLED, back_off([5, 6, 7])))
}

fn measured(slot: u32) -> ModemFrame {
    let readings = Readings {
        slot,
        ..Readings::default()
    };
    ModemFrame::Measurement((&readings.measurement()).into())
}

fn decision(request: Option<Request>) -> Option<UnitFrame> {
    match request? {
        Request::Answer(UnitMessage::Decision(frame)) => Some(frame),
        other => panic!("{other:?}"),
    }
}

fn send(session: &mut Session<'_, Pcg32>, frame: &ModemFrame) -> Vec<UnitFrame> {
    let wire = encode(frame).unwrap();
    wire.into_iter()
        .filter_map(|byte| decision(session.byte(byte)))
        .collect()
}

#[test]
fn a_slot_without_a_frame_is_decided_a_quarter_after_the_next_should_have_come() {
    let mut session = session();
    for _ in 0..1_000 {
        assert_eq!(
            session.tick(),
            None,
            "before the first frame no slot has an index"
        );
    }
    assert_eq!(send(&mut session, &measured(u32::MAX))[0].state, 0);
    assert_eq!(session.timer_restart(), Some(250));
    // A silent modem: slots 0, 1, 2, ... at ticks 5, 9, 13, ... after the frame, degraded and then silent for ever.
    let mut decided = Vec::new();
    for tick in 1..=4 * 150 + 1_u32 {
        if let Some(frame) = decision(session.tick()) {
            assert_eq!(tick, 5 + 4 * frame.slot);
            decided.push((frame.slot, frame.state));
        }
    }
    let expected: Vec<_> = (0..150)
        .map(|slot| (slot, if slot < 99 { 1 } else { 3 }))
        .collect();
    assert_eq!(decided, expected);
    // It returns: nominal with the first slot that is not decided yet.
    assert_eq!(send(&mut session, &measured(149)), [], "decided as missed");
    assert_eq!(send(&mut session, &measured(150))[0].state, 0);
    assert_eq!(session.telemetry().overdue, 150);
}

#[test]
fn a_late_frame_is_dropped_and_sets_the_phase() {
    let mut session = session();
    assert_eq!(send(&mut session, &measured(10)).len(), 1);
    let missed: Vec<_> = (0..5).filter_map(|_| decision(session.tick())).collect();
    assert_eq!(missed.len(), 1);
    assert_eq!(missed[0].slot, 11);
    assert_eq!(session.timer_restart(), Some(250));
    assert_eq!(send(&mut session, &measured(11)), []);
    assert_eq!(
        session.timer_restart(),
        Some(250),
        "the next is a slot after this one"
    );
    assert!((0..4).all(|_| session.tick().is_none()));
    assert_eq!(
        send(&mut session, &measured(12)).len(),
        1,
        "in time by the new phase"
    );
}

#[test]
fn duplicates_and_old_frames_cannot_put_the_deadline_off() {
    let mut session = session();
    assert_eq!(send(&mut session, &measured(500)).len(), 1);
    assert!(session.timer_restart().is_some());
    let mut decided = 0;
    for tick in 0..40_u32 {
        assert_eq!(send(&mut session, &measured(500 - tick % 100)), []);
        assert_eq!(session.timer_restart(), None);
        decided += u32::from(session.tick().is_some());
    }
    assert_eq!(decided, 9);
}

#[test]
fn slot_lengths_are_bounded_and_divide_into_ticks() {
    assert_eq!(SlotLength::new(999), None);
    assert_eq!(SlotLength::new(60_000_001), None);
    for microseconds in [1_000, 1_001, 5_000, 199_999, 200_000, 200_001, 60_000_000] {
        let mut clock = SlotClock::default();
        clock.set_length(SlotLength::new(microseconds).unwrap());
        let tick = clock.tick_microseconds();
        assert!(tick <= MAX_TICK_MICROSECONDS);
        assert!(clock.hear(SlotIndex(3), 100));
        let ticks = (1..).find(|_| clock.tick()).unwrap();
        let (until, expected) = (u64::from(tick) * ticks, u64::from(microseconds) * 5 / 4);
        assert!(
            until <= expected && expected - until < 2 * ticks,
            "{until} of {expected}"
        );
        let ticks = (1..).find(|_| clock.tick()).unwrap();
        assert!(u64::from(tick) * ticks <= u64::from(microseconds));
    }
    let mut session = session();
    assert_eq!(
        send(&mut session, &ModemFrame::SlotLength { microseconds: 5 }),
        []
    );
    assert_eq!(
        (session.timer_restart(), session.telemetry().dropped_frames),
        (None, 1)
    );
    assert_eq!(
        send(&mut session, &ModemFrame::SlotLength { microseconds: 4_000 }),
        []
    );
    assert_eq!(session.timer_restart(), Some(1_000));
}

/// Random and mutated frames, with valid ones between them whose answers a second unit gives as well.
struct Fuzz {
    rng: Pcg64Mcg,
    slot: u32,
    frames: u64,
    valid: u64,
}

impl Fuzz {
    /// A valid measurement with random readings, of the next slot.
    fn valid_frame(&mut self) -> ModemFrame {
        self.slot = self.slot.wrapping_add(1 + below(&mut self.rng, 2));
        let readings = Readings {
            slot: self.slot,
            gain: std::array::from_fn(|_| self.rng.next_u32() as i16),
            home: below(&mut self.rng, 3) as u8,
            period: 1 + below(&mut self.rng, 100) as u8,
            age: 1 + below(&mut self.rng, 100) as u8,
            joiner_probability: self.rng.next_u32() as u8,
            ..Readings::default()
        };
        ModemFrame::Measurement((&readings.measurement()).into())
    }

    /// One round: noise, a delimiter, a valid frame. Panics on an illegal or wrong answer.
    fn round(&mut self, session: &mut Session<'static, Pcg32>, max_power: Dbm) {
        let legal = |frame: &UnitFrame| {
            frame
                .transmit
                .is_none_or(|(sub_channel, power)| sub_channel < 3 && power <= max_power.to_bits())
        };
        let good = encode(&self.valid_frame()).unwrap();
        let noise = noise(&mut self.rng, &good, 4);
        self.frames += 1;
        for byte in noise.into_iter().chain([0]) {
            if let Some(Request::Answer(UnitMessage::Decision(frame))) = session.byte(byte) {
                // Fields that make a measurement by chance are one; the count goes on from there.
                assert!(legal(&frame), "{frame:?}");
                self.slot = frame.slot;
            }
        }
        if below(&mut self.rng, 8) == 0 {
            let ticks = below(&mut self.rng, 12);
            for _ in 0..ticks {
                if let Some(frame) = decision(session.tick()) {
                    assert!(legal(&frame), "{frame:?}");
                    self.slot = frame.slot;
                }
            }
        }
        let frame = self.valid_frame();
        let event = frame.event().unwrap().unwrap();
        let expected = session
            .unit()
            .clone()
            .slot(&event)
            .map(|report| UnitFrame::from(&report));
        assert_eq!(send(session, &frame), Vec::from_iter(expected), "{frame:?}");
        assert!(expected.is_some_and(|frame| legal(&frame)));
        self.frames += 1;
        self.valid += 1;
    }
}

fn fuzz(seed: u128, frames: u64) {
    let max_power = Table::parse(DISTILLED).unwrap().power_plan().max_power;
    let mut session = session();
    let mut fuzz = Fuzz {
        rng: Pcg64Mcg::new(seed),
        slot: 0,
        frames: 0,
        valid: 0,
    };
    while fuzz.frames < frames {
        fuzz.round(&mut session, max_power);
    }
    let (dropped, decided) = (session.telemetry().dropped_frames, session.telemetry().slots);
    println!(
        "{} frames, {} valid and answered, {dropped} dropped, {decided} decided",
        fuzz.frames, fuzz.valid
    );
    assert!(u64::from(dropped) > frames / 5);
}

#[test]
fn noise_never_makes_an_illegal_or_a_wrong_answer() {
    fuzz(0xf022, 200_000);
}

/// The whole run: `cargo test -p firmware -- --ignored --nocapture ten_million`.
#[test]
#[ignore = "half a minute"]
fn ten_million_frames_of_noise() {
    let seed = std::env::var("FUZZ_SEED").ok().and_then(|seed| seed.parse().ok());
    fuzz(seed.unwrap_or(1), 10_000_000);
}
