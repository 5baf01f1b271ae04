//! The state machine over slots: duplicates, restarts, missing measurements, lost places, a damaged table.

use crate::readings::{Readings, any_readings};
use crate::table_builder::Contents;
use firmware::actor::Actor;
use firmware::decision::{ACTIONS, Decision};
use firmware::lots::Identity;
use firmware::observation::INPUTS;
use firmware::table::{Table, TableError};
use firmware::unit::{Event, MAX_MISSED, Report, Silence, State, Unit};
use firmware::units::{Dbm, Level, SlotIndex, SubChannel};
use proptest::prelude::*;

fn table() -> Vec<u8> {
    Contents::random(11, &[INPUTS, 16, ACTIONS]).bytes()
}

fn unit(table: &[u8]) -> Unit<'_> {
    Unit::new(table, Identity(7))
}

fn measured(slot: u32) -> Event {
    let readings = Readings {
        slot,
        ..Readings::default()
    };
    readings.event()
}

fn missed(slot: u32) -> Event {
    Event::Missed(SlotIndex(slot))
}

#[test]
fn nominal_slots_are_the_actors() {
    let bytes = table();
    let (mut unit, mut actor) = (unit(&bytes), Actor::new(Table::parse(&bytes).unwrap()));
    for n in 0..500_u32 {
        let slot = (u32::MAX - 250).wrapping_add(n);
        let readings = Readings {
            slot,
            age: Some(1 + n * 7 % 100),
            place: (n % 4 > 0).then_some(((n % 20) as u16, n % 2 == 0)),
            open: n as u16,
            threshold: n << 8,
            ..Readings::default()
        };
        let report = unit.slot(&readings.event()).unwrap();
        let decision = actor.decide(&readings.observation());
        assert_eq!(
            report,
            Report {
                slot: SlotIndex(slot),
                decision,
                state: State::Nominal
            }
        );
    }
}

#[test]
fn a_slot_is_decided_once() {
    let bytes = table();
    for start in [1_000, u32::MAX - 1] {
        let mut unit = unit(&bytes);
        let later = start.wrapping_add(5);
        assert!(unit.slot(&measured(start)).is_some());
        assert_eq!(unit.slot(&measured(start)), None, "duplicate");
        assert_eq!(unit.slot(&missed(start)), None, "duplicate of another kind");
        assert!(unit.slot(&measured(later)).is_some(), "slots may be skipped");
        for late in 0..=u32::from(MAX_MISSED) {
            assert_eq!(
                unit.slot(&measured(later.wrapping_sub(late))),
                None,
                "{late} slots late"
            );
        }
        assert!(
            unit.slot(&measured(later.wrapping_add(1))).is_some(),
            "late events change nothing"
        );
    }
}

#[test]
fn a_modem_that_restarts_is_served() {
    let bytes = table();
    let mut unit = unit(&bytes);
    assert!(unit.slot(&measured(90_000)).is_some());
    let report = unit.slot(&measured(200)).expect("the slot index started anew");
    assert_eq!(report.state, State::Nominal);
    assert!(unit.slot(&measured(201)).is_some());

    let mut unit = self::unit(&bytes);
    assert!(unit.slot(&measured(90_000)).is_some());
    let report = unit.slot(&missed(3)).unwrap();
    let nothing = (Decision::Silent, State::Silent(Silence::NoMeasurement));
    assert_eq!(
        (report.decision, report.state),
        nothing,
        "what it knew is from another count"
    );
}

#[test]
fn a_missing_measurement_degrades_then_silences() {
    let bytes = table();
    let mut unit = unit(&bytes);
    let first = unit.slot(&missed(0)).unwrap();
    assert_eq!(
        (first.decision, first.state),
        (Decision::Silent, State::Silent(Silence::NoMeasurement))
    );
    assert_eq!(unit.slot(&measured(1)).unwrap().state, State::Nominal);
    for n in 1..=300 {
        let report = unit.slot(&missed(1 + n)).unwrap();
        if n < u32::from(MAX_MISSED) {
            assert_eq!(report.state, State::Degraded, "{n} missed");
        } else {
            assert_eq!(report.state, State::Silent(Silence::NoMeasurement), "{n} missed");
            assert_eq!(report.decision, Decision::Silent);
        }
    }
    assert_eq!(
        unit.slot(&measured(302)).unwrap().state,
        State::Nominal,
        "recovers at once"
    );
    // A gap in the slot index counts as much as events that say so.
    assert_eq!(unit.slot(&missed(302 + 99)).unwrap().state, State::Degraded);
    assert_eq!(
        unit.slot(&missed(302 + 100)).unwrap().state,
        State::Silent(Silence::NoMeasurement)
    );
}

/// The tracker's level goes on with its change in every slot without a measurement, and starts anew when one comes after [`MAX_MISSED`].
#[test]
fn the_level_is_tracked_through_missing_slots() {
    let bytes = table();
    let levels = |slot: u32| [(10 << 8) + 8 * slot as i16; firmware::units::MAX_SUB_CHANNELS];
    let measured = |slot| {
        let gain = levels(slot);
        Readings {
            slot,
            gain,
            ..Readings::default()
        }
        .event()
    };
    for missing in 1..=105 {
        let (mut unit, mut tracker) = (unit(&bytes), firmware::tracker::LevelTracker::new());
        for slot in 1..=400 {
            assert!(unit.slot(&measured(slot)).is_some());
            tracker.measure(&levels(slot).map(firmware::units::Level::from_bits));
        }
        assert_eq!(unit.level(), tracker.predicted());
        let before = unit.level().unwrap();
        for slot in 401..400 + missing {
            assert!(unit.slot(&missed(slot)).is_some());
            tracker.miss();
            assert_eq!(unit.level(), tracker.predicted(), "{missing} missing");
        }
        assert!(
            missing < 20 || unit.level().unwrap() > before,
            "the level rises on"
        );
        // The next measurement comes in its own slot: as many slots passed without one as were missing before it.
        let slot = 400 + missing;
        assert!(unit.slot(&measured(slot)).is_some());
        if missing > u32::from(MAX_MISSED) {
            tracker = firmware::tracker::LevelTracker::new();
        }
        tracker.measure(&levels(slot).map(firmware::units::Level::from_bits));
        assert_eq!(unit.level(), tracker.predicted(), "{missing} missing");

        // The same where the modem leaves the slots out.
        let mut leaping = self::unit(&bytes);
        for slot in (1..=400).chain([400 + missing]) {
            assert!(leaping.slot(&measured(slot)).is_some());
        }
        assert_eq!(leaping.level(), unit.level(), "{missing} left out");
    }
}

/// What a vehicle sends in its turn: at full power on the sub-channel that carries its place in this slot.
fn turn(readings: &Readings, slot: u32) -> Decision {
    let readings = Readings { slot, ..*readings };
    readings.own().map_or(Decision::Silent, |own| Decision::Transmit {
        sub_channel: SubChannel::new(own as u8).unwrap(),
        power: Dbm::from_bits(readings.max_power),
    })
}

/// The places, their number and sub-channels of some cells, and the age from which on a place is lost that was found: seven frames and 50
/// slots.
const CELLS: [(u16, u16, usize, u32); 6] = [
    (0, 20, 3, 50),
    (19, 20, 3, 50),
    (5, 22, 3, 51),
    (11, 24, 2, 84),
    (8, 9, 1, 63),
    (70, 80, 8, 70),
];

#[test]
fn a_degraded_unit_keeps_its_turn_by_the_ring() {
    let bytes = table();
    for (index, places, sub_channels, last) in CELLS {
        for assigned in [true, false] {
            for (start, open) in [(100, 0), (u32::MAX - 40, u16::MAX)] {
                let readings = Readings {
                    slot: start,
                    sub_channels,
                    places,
                    place: Some((index, assigned)),
                    // Nobody contends where it cannot know whether a place is open still, or for whom.
                    open,
                    threshold: 0,
                    ..Readings::default()
                };
                let mut unit = unit(&bytes);
                assert!(unit.slot(&readings.event()).is_some());
                let mut turns = 0;
                for age in 2..=100 {
                    let slot = start.wrapping_add(age - 1);
                    let keeps = assigned || age <= last;
                    let expected = if keeps {
                        turn(&readings, slot)
                    } else {
                        Decision::Silent
                    };
                    let report = unit.slot(&missed(slot)).unwrap();
                    assert_eq!(
                        (report.decision, report.state),
                        (expected, State::Degraded),
                        "age {age} of {readings:?}"
                    );
                    turns += u32::from(expected != Decision::Silent);
                }
                assert!(turns >= 5, "{readings:?}");
            }
        }
    }
}

#[test]
fn an_acknowledgement_that_is_old_already_costs_a_found_place_sooner() {
    let bytes = table();
    let readings = Readings {
        age: Some(49),
        place: Some((3, false)),
        ..Readings::default()
    };
    let mut unit = unit(&bytes);
    assert!(unit.slot(&readings.event()).is_some());
    // One slot more is the fiftieth.
    for (missing, keeps) in [(1, true), (2, false), (3, false), (20, false)] {
        let slot = readings.slot + missing;
        let expected = if keeps {
            turn(&readings, slot)
        } else {
            Decision::Silent
        };
        assert_eq!(unit.slot(&missed(slot)).unwrap().decision, expected, "{missing}");
    }
}

#[test]
fn a_degraded_unit_without_a_place_waits() {
    let bytes = table();
    for identity in 0..200 {
        let mut unit = Unit::new(&bytes, Identity(identity));
        let readings = Readings {
            place: None,
            age: Some(90),
            open: u16::MAX,
            threshold: 0,
            ..Readings::default()
        };
        assert!(unit.slot(&readings.event()).is_some());
        for slot in 1..u32::from(MAX_MISSED) {
            let report = unit.slot(&missed(readings.slot + slot)).unwrap();
            assert_eq!(
                (report.decision, report.state),
                (Decision::Silent, State::Degraded)
            );
        }
    }
}

/// The place is nobody else's, so silence in it is worth nothing.
#[test]
fn a_degraded_unit_takes_its_turn_however_weak_it_is() {
    let bytes = table();
    for decibels in [-128, -20, 0, 25, 127] {
        let mut unit = unit(&bytes);
        let readings = Readings {
            gain: [decibels << 8; 16],
            places: 3,
            ..Readings::default()
        };
        assert!(unit.slot(&readings.event()).is_some());
        for slot in readings.slot + 1..readings.slot + 50 {
            assert_eq!(unit.slot(&missed(slot)).unwrap().decision, turn(&readings, slot));
        }
    }
}

#[test]
fn a_level_from_before_a_long_gap_is_forgotten() {
    let bytes = table();
    let mut unit = unit(&bytes);
    let at = |slot: u32, decibels: i16| {
        let readings = Readings {
            slot,
            gain: [decibels << 8; 16],
            ..Readings::default()
        };
        readings.event()
    };
    let near = |unit: &Unit<'_>, decibels: i32| {
        let level = unit.level().unwrap();
        assert!(
            (level - Level::from_num(decibels)).abs() < Level::from_num(1),
            "{level} for {decibels}"
        );
    };
    assert_eq!(unit.level(), None);
    for slot in 0..200 {
        assert!(unit.slot(&at(slot, 40)).is_some());
    }
    assert!(unit.slot(&missed(200)).is_some());
    near(&unit, 40);
    assert!(unit.slot(&at(201, -20)).is_some());
    assert!(
        unit.level().unwrap() > Level::from_num(30),
        "one fade is no other place"
    );
    assert!(unit.slot(&at(1_000, -20)).is_some());
    near(&unit, -20);
    assert!(unit.slot(&missed(1_001)).is_some());
    assert!(unit.slot(&at(2_000, 40)).is_some());
    near(&unit, 40);
}

/// A slot's answer follows from the slot alone: recorded, it comes out the same in another unit of the same identity, whatever that did.
#[test]
fn a_recorded_slot_replays() {
    let bytes = table();
    let recorded: Vec<Readings> = (0..300_u32)
        .map(|n| Readings {
            slot: 5_000 + n,
            age: Some(1 + n % 90),
            place: (n % 3 > 0).then_some((n as u16 % 20, n % 2 > 0)),
            open: 0b111,
            threshold: 1 << 12,
            gains_hold: n % 5 > 0,
            ..Readings::default()
        })
        .collect();
    let mut first = unit(&bytes);
    let answers: Vec<_> = recorded
        .iter()
        .map(|readings| first.slot(&readings.event()))
        .collect();
    let mut differing = 0;
    for (readings, answer) in recorded.iter().zip(&answers) {
        let mut fresh = unit(&bytes);
        assert_eq!(fresh.slot(&readings.event()), *answer);
        let mut busy = unit(&bytes);
        for slot in 4_900..readings.slot {
            let _ = if slot % 2 == 0 {
                busy.slot(&missed(slot))
            } else {
                busy.slot(&measured(slot))
            };
        }
        assert_eq!(busy.slot(&readings.event()), *answer);
        // Told in between who it is, it is another.
        let mut renamed = unit(&bytes);
        renamed.set_identity(Identity(8));
        let other = renamed.slot(&readings.event());
        assert_eq!(Unit::new(&bytes, Identity(8)).slot(&readings.event()), other);
        differing += u32::from(other != *answer);
    }
    assert!(differing > 15, "lots decide nothing: {differing}");
}

#[test]
fn a_unit_without_a_table_stays_silent_and_says_why() {
    let mut bytes = table();
    bytes[100] ^= 4;
    let mut unit = unit(&bytes);
    assert!(matches!(unit.table().unwrap_err(), TableError::Checksum { .. }));
    for n in 0..300 {
        let event = if n % 3 == 0 { missed(n) } else { measured(n) };
        let report = unit.slot(&event).unwrap();
        assert_eq!(
            (report.decision, report.state),
            (Decision::Silent, State::Silent(Silence::NoTable))
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_happens_the_decision_is_legal(
        start in any::<u32>(),
        readings in any_readings(),
        others in prop::collection::vec(any_readings(), 1..4),
        steps in prop::collection::vec((1_u32..40, any::<Option<prop::sample::Index>>()), 1..60),
        // Of any form, even where the cell is one that it does not serve.
        (observation_form, output_form) in (0_u8..3, 0_u8..4),
    ) {
        let bytes = Contents::in_form(11, observation_form, output_form).bytes();
        let mut unit = Unit::new(&bytes, readings.identity());
        // A missing measurement's slot is decided by what the last one said.
        let (mut slot, mut last) = (start, None);
        for (step, chosen) in steps {
            slot = slot.wrapping_add(step);
            let event = match chosen {
                Some(chosen) => {
                    let readings = Readings { slot, ..*chosen.get(&others) };
                    last = Some(readings);
                    readings.event()
                }
                None => missed(slot),
            };
            let report = unit.slot(&event).unwrap();
            prop_assert_eq!(report.slot, SlotIndex(slot));
            prop_assert_eq!(report.state == State::Nominal, chosen.is_some());
            if let Decision::Transmit { sub_channel, power } = report.decision {
                let last = last.unwrap();
                prop_assert!(sub_channel.index() < last.sub_channels);
                prop_assert!(power <= Dbm::from_bits(last.max_power));
                prop_assert!(report.state == State::Nominal || report.state == State::Degraded);
            }
        }
    }
}

/// What the documentation of `firmware::unit` says, in a few lines of arithmetic on one count.
#[derive(Default)]
struct Model {
    last: Option<u32>,
    missed: u64,
    known: bool,
}

impl Model {
    fn slot(&mut self, slot: u32, measured: bool, table: bool) -> Option<State> {
        let elapsed = self.last.map_or(1, |last| slot.wrapping_sub(last));
        // Back by up to the limit, a repetition included.
        if self.last.is_some_and(|last| last.wrapping_sub(slot) <= 100) {
            return None;
        }
        self.last = Some(slot);
        if measured {
            (self.known, self.missed) = (true, 0);
        } else {
            self.missed += u64::from(elapsed);
        }
        Some(match (table, measured) {
            (false, _) => State::Silent(Silence::NoTable),
            (true, true) => State::Nominal,
            (true, false) if self.known && self.missed < 100 => State::Degraded,
            (true, false) => State::Silent(Silence::NoMeasurement),
        })
    }
}

/// How the next event's slot relates to the newest before it.
fn step() -> impl Strategy<Value = u32> {
    prop_oneof![
        20 => Just(1_u32),
        3 => 2_u32..120,
        2 => Just(0_u32),
        4 => (0_u32..=103).prop_map(|back| 0_u32.wrapping_sub(back)),
        1 => any::<u32>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn states_follow_the_documented_transitions(
        identity in any::<u32>(),
        start in prop_oneof![any::<u32>(), (0_u32..60).prop_map(|back| u32::MAX - back)],
        damaged in prop::bool::weighted(0.1),
        events in prop::collection::vec(
            (step(), prop::bool::weighted(0.4), any_readings()), 1..300),
        replaced_at in 0_usize..400,
    ) {
        let good = table();
        let mut bytes = good.clone();
        bytes[200] ^= u8::from(damaged);
        let mut unit = Unit::new(&bytes, Identity(identity));
        let (mut model, mut slot, mut has_table) = (Model::default(), start, !damaged);
        for (index, (step, measured, readings)) in events.into_iter().enumerate() {
            if index == replaced_at {
                unit.replace_table(&good);
                has_table = true;
            }
            slot = slot.wrapping_add(step);
            let event = if measured { Readings { slot, ..readings }.event() } else { missed(slot) };
            let report = unit.slot(&event);
            prop_assert_eq!(report.map(|report| report.state), model.slot(slot, measured, has_table), "slot {}", slot);
            let Some(report) = report else { continue };
            prop_assert_eq!(report.slot, SlotIndex(slot));
            prop_assert_eq!(unit.last_slot(), Some(SlotIndex(slot)));
            let sends = report.decision != Decision::Silent;
            prop_assert!(!sends || !matches!(report.state, State::Silent(_)), "a silent unit sends");
        }
    }
}
