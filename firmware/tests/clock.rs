//! The clock's rule, said once more from the readings.

use crate::readings::{Readings, any_readings};
use firmware::clock::act;
use firmware::decision::Action;
use firmware::units::{Level, SlotIndex};
use proptest::prelude::*;

/// Whether the vehicle has a turn: a place that was handed out, or one that it found and was received in within seven frames or 50 slots.
fn has_turn(readings: &Readings) -> bool {
    let age = u64::from(readings.slots());
    let lost = age * readings.sub_channels as u64 > 7 * u64::from(readings.places) && age > 50;
    readings.place.is_some_and(|(_, assigned)| assigned || !lost)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 4_000, ..ProptestConfig::default() })]

    #[test]
    fn turns_are_taken_and_whoever_is_called_contends(
        readings in any_readings(),
        turn_now in any::<bool>(),
        required in prop_oneof![any::<i16>(), Just(10_i16 << 8)],
    ) {
        let mut readings = readings;
        let (_, carried) = readings.carried()[0];
        if turn_now && let Some((index, _)) = &mut readings.place {
            *index = carried as u16;
        }
        let observation = readings.observation();
        let (known, holds) = (observation.quantities(), readings.gains_hold);
        let reaches = |sub_channel: usize| !holds || readings.gain[sub_channel] >= required;
        // Which of the open ones is the best is held by the decisions' tests.
        let best = (known.sight.best >= 0).then_some(known.sight.best as usize);
        prop_assert_eq!(best.is_some(), !readings.open().is_empty());
        let called = i64::from(known.priority()) >= i64::from(readings.threshold);
        let contends = called && best.is_some_and(reaches) && !readings.awaits;
        let starves = i64::from(known.priority()) / 8 * 3 >= i64::from(readings.threshold);
        let guest = readings.guest().filter(|_| starves && holds && !readings.awaits);
        let is_guest = guest.is_some_and(reaches);
        let own = readings.own().filter(|_| has_turn(&readings));
        let lot = readings.identity().lot(SlotIndex(readings.slot)) >> 16;
        let expected = match own {
            // A turn in a fade is left to others only where some wait.
            Some(own) if best.is_none() || reaches(own) => Action::FullPower,
            _ if contends && holds => Action::JOINERS[lot as usize & 3],
            _ if contends => Action::Joiner4,
            _ if is_guest => Action::Guest,
            _ => Action::Silent,
        };
        prop_assert_eq!(act(&observation, Level::from_bits(required)), expected);
    }
}

/// Threshold and age decide who contends, the lot alone at which level.
#[test]
fn joiners_use_all_levels_alike() {
    let mut counts = [0_u32; 4];
    for identity in 0..40_000 {
        let readings = Readings {
            identity,
            place: None,
            open: 0b111,
            threshold: 0,
            ..Readings::default()
        };
        let action = act(&readings.observation(), Level::from_num(10));
        counts[Action::JOINERS
            .iter()
            .position(|&joiner| joiner == action)
            .unwrap()] += 1;
    }
    assert!(
        counts.iter().all(|count| count.abs_diff(10_000) < 450),
        "{counts:?}"
    );
}

/// A gain that just suffices does.
#[test]
fn who_is_called_contends_from_the_required_level_on() {
    let required = 2_164;
    let readings = Readings {
        place: None,
        age: Some(50),
        open: 0b111,
        threshold: 0,
        gain: [required; firmware::units::MAX_SUB_CHANNELS],
        ..Readings::default()
    };
    let acts = |required: i16| act(&readings.observation(), Level::from_bits(required));
    assert!(Action::JOINERS.contains(&acts(required)));
    assert_eq!(acts(required + 1), Action::Silent);
}
