//! Bytes and ticks in, answers out: deadlines, late frames, a modem that falls silent, floods.

use crate::noise::{below, noise};
use crate::readings::Readings;
use crate::table_builder::Contents;
use firmware::decision::{ACTIONS, Decision};
use firmware::link::{
    ClockSource, Counters, ImageStatus, ModemFrame, PROTOCOL, Receiver, ResetCause, StatusFrame, TableStatus,
    Trial, UnitFrame, UnitMessage, encode,
};
use firmware::lots::Identity;
use firmware::observation::INPUTS;
use firmware::session::{Request, Session};
use firmware::slot_clock::{MAX_TICK_MICROSECONDS, SlotClock, SlotLength};
use firmware::tables::DISTILLED;
use firmware::unit::{Event, Unit};
use firmware::units::{MAX_SUB_CHANNELS, SlotIndex};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

fn session() -> Session<'static> {
    Session::new(Unit::new(DISTILLED, Identity(5)))
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

fn send(session: &mut Session<'_>, frame: &ModemFrame) -> Vec<UnitFrame> {
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
fn only_an_index_that_is_more_than_the_limit_older_restarts_the_phase() {
    let mut clock = SlotClock::default();
    assert!(clock.hear(SlotIndex(1_000), 100));
    for back in 0..=100 {
        assert!(!clock.hear(SlotIndex(1_000 - back), 100), "{back}");
    }
    assert!(clock.hear(SlotIndex(899), 100));
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
    // On silicon none is taken, however well it is meant.
    let mut session = session();
    for (dropped, microseconds) in [(1, 5), (2, 1_000), (3, 4_000), (4, 60_000_000)] {
        assert_eq!(send(&mut session, &ModemFrame::SlotLength { microseconds }), []);
        assert_eq!(
            (session.timer_restart(), session.telemetry().dropped_frames),
            (None, dropped)
        );
    }
    assert_eq!(session.clock().length(), SlotLength::DEFAULT);
    session.set_in_emulator(true);
    assert_eq!(
        send(&mut session, &ModemFrame::SlotLength { microseconds: 5 }),
        []
    );
    assert_eq!(
        (session.timer_restart(), session.telemetry().dropped_frames),
        (None, 5)
    );
    assert_eq!(
        send(&mut session, &ModemFrame::SlotLength { microseconds: 4_000 }),
        []
    );
    assert_eq!(session.timer_restart(), Some(1_000));
}

/// A single frame from nowhere costs its own slot at most; a modem that really is somewhere else says so twice.
#[test]
fn a_jump_is_believed_when_the_next_frame_follows_it() {
    for jump in [2, 3, 50, 100, 101, 5_000, 1 << 31, u32::MAX - 101] {
        let mut session = session();
        for slot in 1_000..1_010 {
            assert_eq!(send(&mut session, &measured(slot)).len(), 1);
        }
        assert_eq!(session.timer_restart(), Some(250));
        // Forged: one frame, and one more of the same slot.
        for doubted in 1..=2 {
            assert_eq!(send(&mut session, &measured(1_009_u32.wrapping_add(jump))), []);
            assert_eq!(
                (session.timer_restart(), session.telemetry().doubted_frames),
                (None, doubted)
            );
        }
        // The real ones go on, and forged ones between them are no pair.
        for slot in 1_010..1_200_u32 {
            assert_eq!(
                send(&mut session, &measured(slot))[0].slot,
                slot,
                "after a jump by {jump}"
            );
            assert!(
                send(
                    &mut session,
                    &measured(slot.wrapping_add(jump).wrapping_add(5_000))
                )
                .is_empty()
            );
        }
        // A modem that restarted: one slot without an answer.
        let (first, mut answered) = (1_199_u32.wrapping_add(jump), Vec::new());
        for slot in 0..10 {
            answered.extend(send(&mut session, &measured(first.wrapping_add(slot))));
        }
        assert_eq!(answered.len(), 9, "{jump}");
        assert_eq!((answered[0].slot, answered[0].state), (first.wrapping_add(1), 0));
    }
}

/// Up to 100 slots back a frame is late, and no jump.
#[test]
fn late_frames_are_not_doubted() {
    let mut session = session();
    assert_eq!(send(&mut session, &measured(5_000)).len(), 1);
    for back in 0..=100 {
        assert_eq!(send(&mut session, &measured(5_000 - back)), []);
    }
    assert_eq!(session.telemetry().doubted_frames, 0);
    assert_eq!(send(&mut session, &measured(4_899)), []);
    assert_eq!(session.telemetry().doubted_frames, 1);
}

/// Whatever the base station allows.
#[test]
fn no_answer_is_above_the_ceiling_of_power() {
    let ceiling = 33 * 256;
    for (max_power, expected) in [
        (23 << 8, 23 << 8),
        (ceiling - 1, ceiling - 1),
        (ceiling, ceiling),
        (ceiling + 1, ceiling),
        (i16::MAX, ceiling),
    ] {
        let mut session = session();
        let powers: Vec<i16> = (0..100)
            .flat_map(|slot| {
                let readings = Readings {
                    slot,
                    max_power,
                    ..Readings::default()
                };
                let frame = ModemFrame::Measurement((&readings.measurement()).into());
                send(&mut session, &frame)
            })
            .filter_map(|frame| Some(frame.transmit?.1))
            .collect();
        // In its turn a vehicle sends at full power.
        assert!(
            powers.len() > 5 && powers.iter().all(|&power| power == expected),
            "{max_power}: {powers:?}"
        );
    }
}

/// A modem that sends two seconds of frames at once: each is decided, and none is late.
#[test]
fn a_backlog_loses_no_slot() {
    let mut session = session();
    for slot in 0..2_000 {
        assert_eq!(send(&mut session, &measured(slot)).len(), 1);
        // The line takes a quarter of a slot for each.
        if slot % 4 == 0 {
            assert_eq!(session.tick(), None);
        }
    }
    assert_eq!(session.telemetry().overdue, 0);
}

#[test]
fn a_unit_says_how_it_is() {
    let mut session = session();
    for slot in 0..20 {
        let _ = send(&mut session, &measured(slot));
    }
    for byte in [9, 9, 9, 0] {
        assert_eq!(session.byte(byte), None);
    }
    let _ = send(&mut session, &measured(500));
    let _: Vec<_> = (0..5).filter_map(|_| session.tick()).collect();
    let wire = encode(&ModemFrame::Status).unwrap();
    let requests: Vec<_> = wire.into_iter().filter_map(|byte| session.byte(byte)).collect();
    let [Request::Status(counters)] = requests[..] else {
        panic!("{requests:?}")
    };
    assert_eq!(
        counters,
        Counters {
            slots: 21,
            transmissions: session.telemetry().transmissions,
            degraded: 1,
            overdue: 1,
            dropped_frames: 1,
            doubted_frames: 1,
        }
    );
    // The largest answer fits a frame, and the modem reads it as it was.
    let status = StatusFrame {
        table: TableStatus {
            version: u32::MAX,
            checksum: u32::MAX,
            trial: Trial::Waiting(u32::MAX),
            floor: u32::MAX,
            erases: u32::MAX,
        },
        counters: Counters {
            slots: u32::MAX,
            transmissions: u32::MAX,
            degraded: u32::MAX,
            overdue: u32::MAX,
            dropped_frames: u32::MAX,
            doubted_frames: u32::MAX,
        },
        reset: ResetCause::Unknown,
        clock: ClockSource::Emulated,
        stack_bytes: u16::MAX,
        image: ImageStatus {
            version: u32::MAX,
            on_trial: true,
        },
    };
    // The same bytes as `python/tests/test_modem.py` has.
    let some = StatusFrame {
        table: TableStatus {
            version: 7,
            checksum: 0xef38_af8c,
            trial: Trial::Waiting(8),
            floor: 6,
            erases: 3,
        },
        counters: Counters {
            slots: 1_000_000,
            transmissions: 150_000,
            degraded: 200,
            overdue: 30,
            dropped_frames: 4,
            doubted_frames: 1,
        },
        reset: ResetCause::BrownOut,
        clock: ClockSource::Internal,
        stack_bytes: 4_000,
        image: ImageStatus {
            version: 9,
            on_trial: true,
        },
    };
    let wire = encode(&UnitMessage::Status(some)).unwrap();
    let hex: String = wire.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(
        hex,
        "2102078cdfe2f90e01080603c0843df09309c8011e04010301a01f0901a2d2954300"
    );
    let message = UnitMessage::Status(status);
    let wire = encode(&message).unwrap();
    println!("a status takes {} bytes at most", wire.len());
    let mut receiver = Receiver::default();
    let mut received = wire
        .into_iter()
        .filter_map(|byte| receiver.push::<UnitMessage>(byte));
    assert_eq!(received.next(), Some(Ok(message)));
}

#[test]
fn a_unit_says_which_frames_it_speaks() {
    let mut session = session();
    // Whatever else changes, these bytes do not.
    let hello = [0x01, 0x05, 0x8d, 0xef, 0x02, 0xd2, 0x00];
    assert_eq!(encode(&ModemFrame::Hello).unwrap(), hello);
    let requests: Vec<_> = hello.into_iter().filter_map(|byte| session.byte(byte)).collect();
    let protocol = UnitMessage::Hello { protocol: PROTOCOL };
    assert_eq!(requests, [Request::Answer(protocol)]);
    assert_eq!(encode(&protocol).unwrap()[..3], [1, 6, PROTOCOL]);
    assert_eq!(session.telemetry().slots, 0);
    assert_eq!(session.telemetry().dropped_frames, 0);
}

/// The number under which the base station knows the vehicle decides its lots from the next slot on.
#[test]
fn a_unit_draws_its_lots_under_the_number_that_it_is_told() {
    let contending = |slot: u32| {
        let readings = Readings {
            slot,
            place: None,
            age: Some(50),
            open: 0b111,
            threshold: 0,
            ..Readings::default()
        };
        ModemFrame::Measurement((&readings.measurement()).into())
    };
    let frames: Vec<ModemFrame> = (1..200).map(contending).collect();
    let all = |session: &mut Session<'_>| -> Vec<UnitFrame> {
        frames.iter().flat_map(|frame| send(session, frame)).collect()
    };
    let table = Contents::random(5, &[INPUTS, 16, ACTIONS]).bytes();
    let own = all(&mut Session::new(Unit::new(&table, Identity(5))));
    assert_eq!(own.len(), frames.len());
    let number = 0xdead_beef;
    let mut told = Session::new(Unit::new(&table, Identity(5)));
    assert_eq!(send(&mut told, &ModemFrame::Identity { number }), []);
    assert_eq!((told.timer_restart(), told.telemetry().dropped_frames), (None, 0));
    let told = all(&mut told);
    assert!(told == all(&mut Session::new(Unit::new(&table, Identity(number)))));
    let differing = told.iter().zip(&own).filter(|(told, own)| told != own).count();
    assert!(differing > 20, "{differing}");
}

/// Random and mutated frames, with valid ones between them whose answers a second unit gives as well.
struct Fuzz {
    rng: Pcg64Mcg,
    frames: u64,
    valid: u64,
}

impl Fuzz {
    /// A valid measurement with random readings, of the next slot.
    fn valid_frame(&mut self, session: &Session<'_>) -> ModemFrame {
        let slot = session.unit().last_slot().map_or(0, |slot| slot.next().0);
        let sub_channels = 1 + below(&mut self.rng, MAX_SUB_CHANNELS as u32);
        let places = sub_channels + below(&mut self.rng, 100);
        let random = self.rng.next_u32();
        let readings = Readings {
            slot,
            sub_channels: sub_channels as usize,
            gain: std::array::from_fn(|_| self.rng.next_u32() as i16),
            age: (random & 15 > 0).then(|| 1 + below(&mut self.rng, 100)),
            place: (random & 48 > 0).then(|| (below(&mut self.rng, places) as u16, random & 64 > 0)),
            awaits: random & 0x180 == 0,
            weight: (random >> 16) as u8,
            places: places as u16,
            open: self.rng.next_u32() as u16,
            threshold: below(&mut self.rng, 1 << 24),
            salt: (random >> 24) as u8,
            gains_hold: random & 512 > 0,
            max_power: self.rng.next_u32() as i16,
            ..Readings::default()
        };
        ModemFrame::Measurement((&readings.measurement()).into())
    }

    /// One round: noise, a delimiter, a valid frame. Panics on an illegal or wrong answer.
    fn round(&mut self, session: &mut Session<'static>) {
        let legal = |frame: &UnitFrame| frame.decision().is_some();
        let good = encode(&self.valid_frame(session)).unwrap();
        let noise = noise(&mut self.rng, &good, &[0, 1, 2, 3, 4, 5, 6]);
        self.frames += 1;
        for byte in noise.into_iter().chain([0]) {
            if let Some(Request::Answer(UnitMessage::Decision(frame))) = session.byte(byte) {
                // Fields that make a measurement by chance are one; the count goes on from there.
                assert!(legal(&frame), "{frame:?}");
            }
        }
        if below(&mut self.rng, 8) == 0 {
            let ticks = below(&mut self.rng, 12);
            for _ in 0..ticks {
                if let Some(frame) = decision(session.tick()) {
                    assert!(legal(&frame), "{frame:?}");
                }
            }
        }
        let frame = self.valid_frame(session);
        let ModemFrame::Measurement(sent) = &frame else {
            unreachable!()
        };
        let event = Event::Measured(sent.measurement().unwrap());
        let expected = session
            .unit()
            .clone()
            .slot(&event)
            .map(|report| UnitFrame::from(&report));
        assert_eq!(send(session, &frame), Vec::from_iter(expected), "{frame:?}");
        // At most the broadcast power, on one of the cell's sub-channels.
        let allowed = |decision| match decision {
            Decision::Silent => true,
            Decision::Transmit { sub_channel, power } => {
                sub_channel.index() < sent.gain.len() && power.to_bits() <= sent.max_power
            }
        };
        assert!(expected.is_some_and(|frame| frame.decision().is_some_and(allowed)));
        self.frames += 1;
        self.valid += 1;
    }
}

fn fuzz(seed: u128, frames: u64) {
    let mut session = session();
    let mut fuzz = Fuzz {
        rng: Pcg64Mcg::new(seed),
        frames: 0,
        valid: 0,
    };
    while fuzz.frames < frames {
        fuzz.round(&mut session);
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
