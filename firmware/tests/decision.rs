//! Decisions are total and keep the paper's C3 and C4.

use crate::readings::{Readings, any_readings};
use firmware::decision::{ACTIONS, Action, Decision, PowerPlan};
use firmware::units::{Dbm, Level, SlotIndex};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_first_largest_output_wins(outputs in prop::array::uniform7(prop_oneof![any::<i32>(), -2..3, Just(i32::MIN)])) {
        let largest = *outputs.iter().max().unwrap();
        let first = outputs.iter().position(|&output| output == largest).unwrap();
        prop_assert_eq!(Action::from_outputs(&outputs) as usize, first);
    }

    #[test]
    fn every_decision_is_legal_and_joiners_meet_their_level(
        readings in any_readings(),
        levels in prop::array::uniform4(any::<i16>()),
    ) {
        let (observation, full) = (readings.observation(), i32::from(readings.max_power));
        let plan = PowerPlan { joiner_levels: levels.map(Level::from_bits) };
        for action in Action::ALL {
            // Received at the level, at full power where that is not enough, and never below what 16 bits can say.
            let at_level = |sub_channel: usize, level: i16| {
                let above = i32::from(readings.gain[sub_channel]) - i32::from(level);
                (sub_channel, (full - above.clamp(0, i32::from(i16::MAX))).max(i32::from(i16::MIN)))
            };
            let joiner = Action::JOINERS.iter().position(|&joiner| joiner == action);
            let expected = match (joiner, action) {
                (Some(joiner), _) => best(&readings).map(|best| at_level(best, levels[joiner])),
                (None, Action::FullPower) => readings.own().map(|own| (own, full)),
                (None, Action::Guest) => readings.guest().map(|guest| at_level(guest, levels[0])),
                _ => None,
            };
            let found = match plan.decision(action, &observation) {
                Decision::Silent => None,
                Decision::Transmit { sub_channel, power } => {
                    prop_assert!(sub_channel.index() < readings.sub_channels);
                    prop_assert!(power <= Dbm::from_bits(readings.max_power));
                    Some((sub_channel.index(), i32::from(power.to_bits())))
                }
            };
            prop_assert_eq!(found, expected, "{:?}", action);
        }
    }
}

/// Of the open sub-channels the one that is liked best, of equal ones the first: by its gain, or where gains do not hold by what the base
/// station draws as well.
fn best(readings: &Readings) -> Option<usize> {
    let lot = readings.identity().lot(SlotIndex(readings.slot)) >> 16;
    let liking = |sub_channel: usize| -> i64 {
        if readings.gains_hold {
            return readings.gain[sub_channel].into();
        }
        let sum = lot + u32::from(readings.salt) * 0x3c6f + sub_channel as u32 * 0x9e37;
        let once = sum.wrapping_mul(0x85eb_ca6b);
        // The sign is kept where bits are moved down.
        let twice = (once ^ (once.cast_signed() >> 13).cast_unsigned()).wrapping_mul(0xc2b2_ae35);
        (twice >> 16 & 0x7fff).into()
    };
    let open = readings.open();
    let most = open.iter().map(|&sub_channel| liking(sub_channel)).max()?;
    open.into_iter().find(|&sub_channel| liking(sub_channel) == most)
}

/// Where gains do not hold, vehicles spread over the open sub-channels, and the base station's salt decides how.
#[test]
fn vehicles_spread_where_gains_do_not_hold() {
    let liked = |open: u16, salt: u8, identity: u32| {
        let readings = Readings {
            sub_channels: 8,
            open,
            salt,
            gains_hold: false,
            identity,
            ..Readings::default()
        };
        readings.observation().quantities().sight.best as usize
    };
    let draws = 8_000;
    for open in [0b11_u16, 0b101, 0b111, 0xff] {
        let count = f64::from(open.count_ones());
        for salt in [0, 3, 200] {
            let mut counts = [0_u32; 8];
            (0..draws).for_each(|identity| counts[liked(open, salt, identity)] += 1);
            for (sub_channel, &found) in counts.iter().enumerate() {
                let share = f64::from(found) * count / f64::from(draws);
                let is_open = open >> sub_channel & 1 == 1;
                assert!(
                    if is_open {
                        (0.88..1.12).contains(&share)
                    } else {
                        found == 0
                    },
                    "{open:b}: {counts:?}"
                );
            }
        }
        for identity in 0..100 {
            let by_salt: u16 = (0..=u8::MAX)
                .map(|salt| 1 << liked(open, salt, identity))
                .fold(0, |all, one| all | one);
            assert_eq!(by_salt, open, "no salt brings vehicle {identity} everywhere");
        }
        // One salt's choice says nothing about another's.
        let both = (0..draws)
            .filter(|&identity| liked(open, 3, identity) == liked(open, 200, identity))
            .count();
        let share = both as f64 * count / f64::from(draws);
        assert!((share - 1.0).abs() < 0.12, "{open:b}: {share}");
    }
}

#[test]
fn silence_wins_every_tie() {
    for value in [i32::MIN, -1, 0, i32::MAX] {
        assert_eq!(Action::from_outputs(&[value; ACTIONS]), Action::Silent);
    }
}
