//! The state machine over slots: age, duplicates, restarts, missing measurements, a damaged table.

use crate::observation::Readings;
use crate::table_builder::Contents;
use firmware::actor::Actor;
use firmware::decision::{ACTIONS, Decision};
use firmware::measurement::{Broadcast, Measurement, MeasurementError};
use firmware::observation::{INPUTS, Observation};
use firmware::table::{Table, TableError};
use firmware::unit::{Event, MAX_MISSED, Report, Silence, State, Unit, back_off};
use firmware::units::{Age, JoinerProbability, Level, Period, SlotIndex, SubChannel};
use proptest::prelude::*;
use rand_pcg::Pcg32;
use std::collections::BTreeSet;

fn table() -> Vec<u8> {
    Contents::random(11, &[INPUTS, 16, ACTIONS]).bytes()
}

fn unit(table: &[u8]) -> Unit<'_, Pcg32> {
    Unit::new(table, back_off([1, 2, 3]))
}

fn measured(slot: u32) -> Event {
    Event::Measured(
        Readings {
            slot,
            ..Readings::default()
        }
        .measurement(),
    )
}

fn missed(slot: u32) -> Event {
    Event::Missed(SlotIndex(slot))
}

#[test]
fn age_counts_from_the_acknowledgement_through_the_wrap() {
    for (slot, acknowledged, age) in [
        (1, 0, 1),
        (3, u32::MAX, 4),
        (u32::MAX, u32::MAX - 1, 1),
        (0, u32::MAX, 1),
        (98, u32::MAX, 99),
        (99, u32::MAX, 100),
        (5_000, u32::MAX, 100),
    ] {
        let measurement = at(slot, Some(acknowledged)).unwrap();
        assert_eq!(
            measurement.age().slots(),
            age,
            "slot {slot}, acknowledged {acknowledged}"
        );
    }
    assert_eq!(at(0, None).unwrap().age(), Age::MAX);
    for (slot, acknowledged) in [(5, 5), (5, 6), (u32::MAX, 0)] {
        let error = at(slot, Some(acknowledged)).unwrap_err();
        assert_eq!(error, MeasurementError::AcknowledgedInFuture);
    }
}

fn at(slot: u32, acknowledged: Option<u32>) -> Result<Measurement, MeasurementError> {
    Measurement::new(
        SlotIndex(slot),
        [Level::ZERO; 3],
        [Level::ZERO; 3],
        acknowledged.map(SlotIndex),
        Broadcast {
            home: SubChannel::new(0).unwrap(),
            period: Period::new(5).unwrap(),
            joiner_probability: JoinerProbability::ONE,
        },
    )
}

#[test]
fn nominal_slots_are_the_actors() {
    let bytes = table();
    let (mut unit, mut actor) = (unit(&bytes), Actor::new(Table::parse(&bytes).unwrap()));
    for n in 0..500_u32 {
        let slot = (u32::MAX - 250).wrapping_add(n);
        let age = 1 + (n * 7 % 100) as u8;
        let measurement = Readings {
            slot,
            age,
            home: (n % 3) as u8,
            ..Readings::default()
        }
        .measurement();
        let report = unit.slot(&Event::Measured(measurement)).unwrap();
        let decision = actor.decide(&Observation::new(&measurement));
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

#[test]
fn a_degraded_unit_keeps_its_turn() {
    let bytes = table();
    let mut unit = unit(&bytes);
    let readings = Readings {
        slot: 100,
        home: 2,
        period: 10,
        ..Readings::default()
    };
    assert!(unit.slot(&Event::Measured(readings.measurement())).is_some());
    for age in 2..=70_u32 {
        let sends = matches!(unit.slot(&missed(99 + age)).unwrap().decision, Decision::Transmit { sub_channel, power }
            if sub_channel.index() == 2 && power.to_bits() == 23 << 8);
        assert_eq!(sends, age % 10 == 0, "age {age}");
    }
}

#[test]
fn a_degraded_unit_that_lost_its_turn_joins_with_the_broadcast_probability() {
    let bytes = table();
    for (code, probability) in [(0, 1.0 / 256.0), (31, 0.125), (191, 0.75), (255, 1.0)] {
        let (mut joined, mut slots, mut powers) = (0, 0, BTreeSet::new());
        for identity in 0..100 {
            let mut unit = Unit::new(&bytes, back_off([identity, 7, 7]));
            let readings = Readings {
                age: 100,
                joiner_probability: code,
                ..Readings::default()
            };
            assert!(unit.slot(&Event::Measured(readings.measurement())).is_some());
            for n in 1..=90 {
                slots += 1;
                if let Decision::Transmit { power, .. } = unit.slot(&missed(1_000 + n)).unwrap().decision {
                    joined += 1;
                    powers.insert(power.value().to_num::<i32>());
                }
            }
        }
        let (share, deviation) = (
            f64::from(joined) / f64::from(slots),
            libm::sqrt(probability / f64::from(slots)),
        );
        assert!(
            (share - probability).abs() <= 5.0 * deviation,
            "{share} joined, expected {probability}"
        );
        // At 25 dB and 23 dBm the joiner levels of 12 and 23 dB take 10 and 21 dBm, those above full power.
        if code > 0 {
            assert_eq!(powers, BTreeSet::from([10, 21, 23]));
        }
    }
}

#[test]
fn a_level_from_before_a_long_gap_is_forgotten() {
    let bytes = table();
    let mut unit = unit(&bytes);
    // With a period of 1 every slot is the unit's turn, so a degraded unit sends unless it hears itself too weakly.
    let at = |slot: u32, decibels: i16| {
        let readings = Readings {
            slot,
            gain: [decibels << 8; 3],
            period: 1,
            ..Readings::default()
        };
        Event::Measured(readings.measurement())
    };
    for slot in 0..200 {
        assert!(unit.slot(&at(slot, 40)).is_some());
    }
    assert_ne!(unit.slot(&missed(200)).unwrap().decision, Decision::Silent);
    assert!(unit.slot(&at(1_000, -20)).is_some());
    let report = unit.slot(&missed(1_001)).unwrap();
    assert_eq!(
        (report.decision, report.state),
        (Decision::Silent, State::Degraded)
    );
    assert!(unit.slot(&at(2_000, 40)).is_some());
    assert_ne!(unit.slot(&missed(2_001)).unwrap().decision, Decision::Silent);
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
        identity in any::<[u32; 3]>(),
        start in any::<u32>(),
        gain in prop::array::uniform3(any::<i16>()),
        home in 0_u8..3, period in 1_u8..=100, age in 1_u8..=100, code in any::<u8>(),
        steps in prop::collection::vec((1_u32..40, any::<bool>()), 1..60),
    ) {
        let bytes = table();
        let max_power = Table::parse(&bytes).unwrap().power_plan().max_power;
        let mut unit = Unit::new(&bytes, back_off(identity));
        let mut slot = start;
        for (step, has_measurement) in steps {
            slot = slot.wrapping_add(step);
            let readings = Readings { slot, gain, home, period, age, joiner_probability: code, ..Readings::default() };
            let event = if has_measurement { Event::Measured(readings.measurement()) } else { missed(slot) };
            let report = unit.slot(&event).unwrap();
            prop_assert_eq!(report.slot, SlotIndex(slot));
            prop_assert_eq!(report.state == State::Nominal, has_measurement);
            if let Decision::Transmit { sub_channel, power } = report.decision {
                prop_assert_eq!(sub_channel.index(), usize::from(home));
                prop_assert!(power <= max_power);
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
        identity in any::<[u32; 3]>(),
        start in prop_oneof![any::<u32>(), (0_u32..60).prop_map(|back| u32::MAX - back)],
        damaged in prop::bool::weighted(0.1),
        events in prop::collection::vec(
            (step(), prop::bool::weighted(0.4), 1_u8..=100, prop::array::uniform3(any::<i16>()), 0_u8..3), 1..300),
        replaced_at in 0_usize..400,
    ) {
        let good = table();
        let mut bytes = good.clone();
        bytes[200] ^= u8::from(damaged);
        let mut unit = Unit::new(&bytes, back_off(identity));
        let max_power = Table::parse(&good).unwrap().power_plan().max_power;
        let (mut model, mut slot, mut has_table) = (Model::default(), start, !damaged);
        for (index, (step, measured, age, gain, home)) in events.into_iter().enumerate() {
            if index == replaced_at {
                unit.replace_table(&good);
                has_table = true;
            }
            slot = slot.wrapping_add(step);
            let readings = Readings { slot, gain, home, age, ..Readings::default() };
            let event = if measured { Event::Measured(readings.measurement()) } else { missed(slot) };
            let report = unit.slot(&event);
            prop_assert_eq!(report.map(|report| report.state), model.slot(slot, measured, has_table), "slot {}", slot);
            let Some(report) = report else { continue };
            prop_assert_eq!(report.slot, SlotIndex(slot));
            prop_assert_eq!(unit.last_slot(), Some(SlotIndex(slot)));
            match report.decision {
                Decision::Silent => {}
                Decision::Transmit { sub_channel, power } => {
                    prop_assert!(!matches!(report.state, State::Silent(_)), "a silent unit sends");
                    prop_assert!(sub_channel.index() < 3 && power <= max_power);
                }
            }
        }
    }
}
