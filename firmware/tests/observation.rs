//! The encoding against real-valued formulas in f64, over all ages, places and thresholds.

use crate::readings::{Readings, any_readings};
use firmware::measurement::MeasurementError;
use firmware::observation::{INPUTS, LEAST_KEPT, ONE, Observation, PAPER_SUB_CHANNELS, places_reciprocal};
use firmware::ring::MAX_PLACES;
use firmware::units::{Age, Level, MAX_SUB_CHANNELS, SlotIndex};
use proptest::prelude::*;

const STEP: f64 = 256.0;

fn encoded(readings: &Readings, required_sinr: i16) -> [i8; INPUTS] {
    readings.observation().encode(Level::from_bits(required_sinr))
}

/// Places until the vehicle's own is handed out, as a share of the ring.
fn until_turn(readings: &Readings) -> Option<f64> {
    let (index, _) = readings.place?;
    let places = u64::from(readings.places);
    let first = u64::from(readings.slot) * readings.sub_channels as u64 % places;
    Some(((u64::from(index) + places - first) % places) as f64 / places as f64)
}

fn turn_lost(readings: &Readings) -> bool {
    let age = u64::from(readings.slots());
    let old = age * readings.sub_channels as u64 > 7 * u64::from(readings.places) && age > LEAST_KEPT as u64;
    readings.place.is_none_or(|(_, assigned)| !assigned && old)
}

/// The priority in real numbers, and how far integers may be from it.
fn priority(readings: &Readings) -> (f64, f64) {
    let frame = f64::from(readings.places) / readings.sub_channels as f64;
    let age = f64::from(readings.slots());
    let counted = age.min(15.0 * frame).min(4_095.0);
    let lot = f64::from(readings.identity().lot(SlotIndex(readings.slot))) / 4_294_967_296.0;
    let weighed = counted * f64::from(readings.weight) * 64.0 * (1.0 + lot / 16.0);
    // An age is rounded down to whole slots, the lot to 64 steps.
    let error = f64::from(readings.weight) * 68.0 + weighed / 1_024.0 + 1.0;
    if turn_lost(readings) {
        return (weighed, error);
    }
    if 2.0 * age < frame {
        return (0.0, 0.0);
    }
    let patience = if readings.gains_hold { 115.0 } else { 70.0 };
    let owner = |until: f64| weighed * (1.0 + until) * patience / 256.0;
    let until = until_turn(readings).unwrap();
    // Reciprocals of rings of more than 256 places are up to a sixteenth too large.
    let rough = if readings.places > 256 {
        1.0 / 16.0
    } else {
        1.0 / 256.0
    };
    let spread = owner((until * (1.0 + rough)).min(1.0)) - owner(until);
    (owner(until), spread + owner(until) / 64.0 + 2.0 * (error + 256.0))
}

/// Everything that an observation says, input by input.
fn check(readings: &Readings, required: i16) {
    let (inputs, known) = (encoded(readings, required), *readings.observation().quantities());
    let (frame, age) = (
        f64::from(readings.places) / readings.sub_channels as f64,
        f64::from(readings.slots()),
    );
    let flags = |index: usize, expected: bool| {
        let code = if expected { ONE } else { 0 };
        assert_eq!(inputs[index], code, "input {index} of {readings:?}");
    };
    let close = |index: usize, real: f64, most: f64| {
        let code = f64::from(inputs[index]);
        let real = real.clamp(-128.0, 127.0);
        assert!(
            (code - real).abs() <= most,
            "input {index}: {code} for {real} in {readings:?}"
        );
    };
    let own = readings.own();
    let best = usize::try_from(known.sight.best).ok();
    flags(0, own.is_some());
    flags(1, turn_lost(readings));
    flags(2, age > frame);
    flags(3, age > 3.0 * frame);
    flags(4, readings.place.is_some_and(|(_, assigned)| assigned));
    flags(5, readings.awaits);
    // Beyond 256 places reciprocals are up to a sixteenth too large.
    let rough = if readings.places > 256 {
        1.0 / 16.0
    } else {
        1.0 / 256.0
    };
    let frames = 64.0 * age / frame / 5.0;
    close(6, frames, 1.1 + rough * frames.min(128.0));
    close(7, 64.0 * frame / 20.0, 1.06);
    for (index, sub_channel) in [(8, own), (10, best)] {
        // The constant 819 / 65536 for 3.2 / 256 adds up to 0.06 steps at the top of the range.
        let level = sub_channel.map_or(i16::MIN, |sub_channel| readings.gain[sub_channel]);
        close(index, 64.0 * (f64::from(level) / STEP / 10.0 - 3.5) / 2.0, 1.06);
        flags(index + 1, level >= required);
    }
    flags(12, readings.gains_hold);
    flags(13, i64::from(known.priority()) >= i64::from(readings.threshold));
    let (expected, error) = priority(readings);
    let found = f64::from(known.priority());
    assert!(
        (found - expected).abs() <= error,
        "{found} for {expected} within {error}: {readings:?}"
    );
    let sixteenths = |number: f64| 16.0 * libm::log2(number.max(16.0));
    let threshold = f64::from(readings.threshold.min(i32::MAX as u32));
    close(14, sixteenths(found) - sixteenths(threshold), LOGARITHM_ERROR);
    close(15, 64.0 * f64::from(readings.weight) / 32.0 / 4.0, 1.0);
    let lot = readings.identity().lot(SlotIndex(readings.slot)) >> 16;
    let level = if readings.gains_hold { lot % 4 } else { 3 };
    flags(16, level > 0);
    flags(17, level > 1);
    flags(20, level > 2);
    flags(18, !readings.open().is_empty());
    let starves = i64::from(known.priority()) / 8 * 3 >= i64::from(readings.threshold);
    let guest = readings.guest().filter(|_| starves && readings.gains_hold);
    flags(21, guest.is_some_and(|guest| readings.gain[guest] >= required));
    if let Some(until) = until_turn(readings) {
        close(19, 64.0 * until, 1.0 + 64.0 * rough);
    }
}

/// Each of the two logarithms is rounded down and straight between powers of two: by 16 x 0.086 and one more.
const LOGARITHM_ERROR: f64 = 2.38;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn every_input_follows_its_formula(readings in any_readings(), required in any::<i16>()) {
        let mut readings = readings;
        if let Some((index, _)) = &mut readings.place {
            *index %= readings.places;
        }
        check(&readings, required);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_priority_never_falls_with_age(readings in any_readings(), assigned in any::<bool>(), step in 1..300_u32) {
        let mut last = 0;
        for age in (1..65_535).step_by(step as usize) {
            let place = readings.place.map(|(index, _)| (index % readings.places, assigned));
            let readings = Readings { age: Some(age), place, ..readings };
            let priority = readings.observation().quantities().priority();
            prop_assert!(priority >= last, "{} after {} at age {}", priority, last, age);
            last = priority;
        }
    }
}

#[test]
fn every_age_place_and_threshold_follows_its_formula() {
    let shapes = [
        (1, 1),
        (3, 3),
        (20, 3),
        (60, 3),
        (100, 8),
        (256, 16),
        (257, 16),
        (2_000, 8),
        (MAX_PLACES, 16),
    ];
    for (places, sub_channels) in shapes {
        for (index, assigned) in [(0, true), (places - 1, false)] {
            let readings = Readings {
                places,
                sub_channels,
                place: Some((index, assigned)),
                open: 0b10,
                threshold: 40_000,
                ..Readings::default()
            };
            for age in 1..=u32::from(Age::MAX.slots()) {
                check(
                    &Readings {
                        age: Some(age),
                        ..readings
                    },
                    0,
                );
            }
            check(
                &Readings {
                    age: None,
                    ..readings
                },
                0,
            );
        }
        for index in 0..places {
            let readings = Readings {
                places,
                sub_channels,
                place: Some((index, false)),
                age: Some(40),
                threshold: 3_000,
                ..Readings::default()
            };
            check(&readings, 0);
        }
    }
    for exponent in 0..32 {
        for mantissa in 0..64_u64 {
            let threshold = ((1 << exponent) * (64 + mantissa) / 64) as u32;
            for (age, weight) in [(1, 1), (1, 32), (100, 32), (4_000, 255)] {
                let readings = Readings {
                    threshold,
                    weight,
                    age: Some(age),
                    place: None,
                    places: MAX_PLACES,
                    ..Readings::default()
                };
                check(&readings, 0);
            }
        }
    }
    for bits in i16::MIN..=i16::MAX {
        // All places are carried in each slot: the own one is, and the open one is another's.
        let mut gain = [0; MAX_SUB_CHANNELS];
        gain[..2].copy_from_slice(&[bits, i16::MAX - bits.max(0)]);
        let readings = Readings {
            sub_channels: 2,
            places: 2,
            gain,
            open: 0b01,
            ..Readings::default()
        };
        check(&readings, 11);
    }
}

/// Who is older by a sixteenth comes first, and lots part those who are equal.
#[test]
fn lots_part_equals_and_nobody_else() {
    let priorities = |age: u32| -> Vec<i32> {
        let of = |identity| Readings {
            age: Some(age),
            place: None,
            places: 900,
            identity,
            ..Readings::default()
        };
        (0..500)
            .map(|identity| of(identity).observation().quantities().priority())
            .collect()
    };
    for age in (16..1_000).step_by(11) {
        let (mut younger, older) = (priorities(age), priorities(age + age.div_ceil(16)));
        assert!(younger.iter().max() <= older.iter().min(), "{age}");
        younger.sort_unstable();
        younger.dedup();
        assert_eq!(younger.len(), 64, "{age}");
    }
}

/// To the slot: properties seldom draw the border.
#[test]
fn an_owner_counts_again_from_half_a_frame_on() {
    let priority = |age| {
        let owner = Readings {
            age: Some(age),
            place: Some((30, true)),
            places: 40,
            sub_channels: 2,
            ..Readings::default()
        };
        owner.observation().quantities().priority()
    };
    assert_eq!((priority(1), priority(9)), (0, 0));
    assert!(priority(10) > 0 && priority(11) > priority(10));
}

/// Whoever has no chance at all is not asked.
#[test]
fn nobody_reaches_the_greatest_threshold_and_everybody_the_least() {
    let oldest = Readings {
        age: None,
        place: None,
        weight: 255,
        places: MAX_PLACES,
        sub_channels: 1,
        ..Readings::default()
    };
    assert!(!oldest.observation().quantities().is_called());
    let youngest = Readings {
        threshold: 0,
        weight: 0,
        ..Readings::default()
    };
    assert!(youngest.observation().quantities().is_called());
}

/// A place that the ring does not have never comes round, and is the farthest there is.
#[test]
fn a_place_beyond_the_ring_never_comes_round() {
    for (index, places) in [(20, 20), (21, 20), (u16::MAX, 3), (u16::MAX, MAX_PLACES)] {
        for slot in 0..4_100 {
            let readings = Readings {
                slot,
                places,
                place: Some((index, true)),
                age: Some(9_999),
                ..Readings::default()
            };
            let (inputs, known) = (encoded(&readings, 0), *readings.observation().quantities());
            assert_eq!(inputs[0], 0);
            assert!(inputs[19] >= 63, "{}", inputs[19]);
            let last = Readings {
                place: Some(((known.places - 1) as u16, true)),
                slot: 0,
                ..readings
            };
            let farthest = last.observation().quantities().priority();
            // The lots of two slots differ by a sixteenth at most.
            assert!(known.priority() >= farthest - farthest / 8, "{index} of {places}");
        }
    }
}

#[test]
fn reciprocals_of_places_are_as_near_as_they_say() {
    for places in 1..=MAX_PLACES {
        let (found, exact) = (
            f64::from(places_reciprocal(places)),
            16_777_216.0 / f64::from(places),
        );
        let over = found - exact;
        if places <= 256 {
            assert!((0.0..=256.0).contains(&over), "{places}: {found}");
        } else {
            assert!(over >= 0.0 && found <= exact * 17.0 / 16.0, "{places}: {found}");
        }
    }
}

/// Actors that see the sub-channels one by one see them in an order that turns with their place.
#[test]
fn neighbours_in_the_ring_see_different_sub_channels_first() {
    for (place, home) in [
        (None, 0),
        (Some(0), 0),
        (Some(1), 1),
        (Some(2), 2),
        (Some(3), 0),
        (Some(3_999), 0),
    ] {
        let readings = Readings {
            place: place.map(|index| (index, true)),
            ..Readings::default()
        };
        assert_eq!(readings.observation().home(), home);
        assert!(home < PAPER_SUB_CHANNELS);
    }
}

#[test]
fn ages_count_from_the_acknowledgement_through_the_wrap() {
    for (slot, acknowledged, age) in [
        (1, 0, 1),
        (3, u32::MAX, 4),
        (u32::MAX, u32::MAX - 1, 1),
        (0, u32::MAX, 1),
        (98, u32::MAX, 99),
        (65_533, u32::MAX, 65_534),
        (65_534, u32::MAX, 65_535),
        (65_535, u32::MAX, 65_535),
        (1 << 30, 0, 65_535),
        ((1 << 31) - 1, 0, 65_535),
    ] {
        let readings = Readings {
            slot,
            age: Some(slot.wrapping_sub(acknowledged)),
            ..Readings::default()
        };
        assert_eq!(
            readings.measurement().age().slots(),
            age,
            "slot {slot}, acknowledged {acknowledged}"
        );
    }
    let never = Readings {
        age: None,
        ..Readings::default()
    };
    assert_eq!(never.measurement().age(), Age::MAX);
    for ahead in [0, 1 << 31, u32::MAX] {
        let readings = Readings {
            age: Some(ahead),
            ..Readings::default()
        };
        assert_eq!(
            readings.read().unwrap_err(),
            MeasurementError::AcknowledgedInFuture,
            "{ahead}"
        );
    }
}

/// What a measurement says arrives in the observation by sub-channel, padded with zeros.
#[test]
fn levels_stand_by_sub_channel() {
    for sub_channels in 1..=MAX_SUB_CHANNELS {
        let readings = Readings {
            sub_channels,
            gain: std::array::from_fn(|n| 100 + n as i16),
            interference: std::array::from_fn(|n| 7 + n as i16),
            ..Readings::default()
        };
        let observation: Observation = readings.observation();
        for n in 0..MAX_SUB_CHANNELS {
            let there = |bits: i16| if n < sub_channels { bits } else { 0 };
            assert_eq!(observation.gain()[n].to_bits(), there(readings.gain[n]));
            assert_eq!(
                observation.interference()[n].to_bits(),
                there(readings.interference[n])
            );
        }
    }
}
