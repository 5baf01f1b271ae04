//! Whose turn it is, against plain division; and that every place gets its turns.

use firmware::ring::{MAX_PLACES, Open, Ring, carrier, hop};
use firmware::units::{MAX_SUB_CHANNELS, SlotIndex, SubChannels};
use proptest::prelude::*;
use std::collections::BTreeSet;

fn sub_channels(count: usize) -> SubChannels {
    SubChannels::new(count).unwrap()
}

fn ring(places: u16, count: usize) -> Ring {
    Ring::new(places, sub_channels(count)).unwrap()
}

/// `N t` modulo the number of places.
fn first_place(slot: u32, places: u16, count: usize) -> u64 {
    u64::from(slot) * count as u64 % u64::from(places)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn the_first_place_is_the_remainder(
        slot in prop_oneof![any::<u32>(), (0..5_000_u32).prop_map(|back| u32::MAX - back)],
        count in 1..=MAX_SUB_CHANNELS,
        places in any::<u16>(),
    ) {
        let least = count as u16;
        let places = least + places % (MAX_PLACES + 1 - least);
        let found = ring(places, count).first_place(SlotIndex(slot));
        prop_assert_eq!(u64::from(found), first_place(slot, places, count));
    }
}

#[test]
fn the_first_place_is_the_remainder_in_every_ring_at_the_ends() {
    for count in 1..=MAX_SUB_CHANNELS {
        for places in count as u16..=MAX_PLACES {
            let ring = ring(places, count);
            let ends = [
                0,
                1,
                u32::from(places) - 1,
                u32::from(places),
                u32::MAX - 1,
                u32::MAX,
            ];
            let powers = (0..32).flat_map(|bit| [1_u32 << bit, (1 << bit) - 1]);
            for slot in ends.into_iter().chain(powers) {
                let found = u64::from(ring.first_place(SlotIndex(slot)));
                assert_eq!(
                    found,
                    first_place(slot, places, count),
                    "{slot} of {places} on {count}"
                );
            }
        }
    }
}

#[test]
fn every_place_is_carried_once_a_round() {
    for (places, count) in [
        (1, 1),
        (3, 3),
        (20, 3),
        (21, 3),
        (64, 16),
        (67, 16),
        (400, 8),
        (4_000, 16),
        (999, 1),
    ] {
        let ring = ring(places, count);
        // As many slots as places are as many rounds as sub-channels; from the index's wrap on, too.
        for start in [0, 12_345, 0_u32.wrapping_sub(u32::from(places))] {
            let mut carried: Vec<Vec<u32>> = vec![Vec::new(); usize::from(places)];
            for n in 0..u32::from(places) {
                let slot = SlotIndex(start.wrapping_add(n));
                let first = usize::from(ring.first_place(slot));
                for offset in 0..count {
                    carried[(first + offset) % usize::from(places)].push(n);
                }
            }
            let frame = u32::from(places) as f64 / count as f64;
            for (place, slots) in carried.iter().enumerate() {
                assert_eq!(slots.len(), count, "place {place} of {places} on {count}");
                for pair in slots.windows(2) {
                    let apart = f64::from(pair[1] - pair[0]);
                    assert!(
                        (apart - frame).abs() < 1.0,
                        "place {place}: {pair:?}, a frame is {frame}"
                    );
                }
            }
        }
    }
}

#[test]
fn each_sub_channel_carries_one_place() {
    for count in 1..=MAX_SUB_CHANNELS {
        for slot in (0..2_000).chain(u32::MAX - 2_000..=u32::MAX) {
            let hop = hop(SlotIndex(slot), sub_channels(count));
            assert!(hop < count);
            let carriers: BTreeSet<_> = (0..count)
                .map(|offset| carrier(offset, hop, sub_channels(count)))
                .collect();
            assert_eq!(carriers, (0..count).collect(), "slot {slot}");
        }
    }
}

/// A place that comes round every whole number of slots is on every sub-channel as often as on the others, and hardly ever stays for long.
#[test]
fn turns_hop_over_all_sub_channels() {
    for count in 2..=MAX_SUB_CHANNELS {
        for rounds in [1_u32, 2, 3, 5, 8, 10, 16, 64, 100, 250] {
            let turns = 4_000_u32;
            let mut counts = vec![0_u32; count];
            let (mut last, mut stays, mut longest) = (usize::MAX, 0, 0);
            for turn in 0..turns {
                let slot = SlotIndex(turn.wrapping_mul(rounds));
                let sub_channel = carrier(0, hop(slot, sub_channels(count)), sub_channels(count));
                counts[sub_channel] += 1;
                stays = if sub_channel == last { stays + 1 } else { 1 };
                (last, longest) = (sub_channel, longest.max(stays));
            }
            let fair = f64::from(turns) / count as f64;
            for &found in &counts {
                assert!(
                    (f64::from(found) / fair - 1.0).abs() < 0.25,
                    "{count}, every {rounds}: {counts:?}"
                );
            }
            assert!(
                longest <= 16,
                "{count}, every {rounds}: {longest} turns on one sub-channel"
            );
        }
    }
}

#[test]
fn rings_have_a_place_for_each_sub_channel_and_a_greatest_size() {
    for count in 1..=MAX_SUB_CHANNELS {
        let of = |places: usize| Ring::new(places as u16, sub_channels(count));
        assert_eq!(of(count - 1), None);
        let least = of(count).unwrap();
        assert_eq!(
            (usize::from(least.places()), least.sub_channels().count()),
            (count, count)
        );
        assert!(of(usize::from(MAX_PLACES)).is_some());
        assert_eq!(of(usize::from(MAX_PLACES) + 1), None);
        assert_eq!(of(usize::from(u16::MAX)), None);
    }
    assert_eq!(SubChannels::new(0), None);
    assert_eq!(SubChannels::new(MAX_SUB_CHANNELS + 1), None);
}

#[test]
fn a_frame_is_the_rings_length_in_slots() {
    let mut worst = 0.0_f64;
    for count in 1..=MAX_SUB_CHANNELS {
        for places in count as u16..=MAX_PLACES {
            let exact = 256.0 * f64::from(places) / count as f64;
            let error = f64::from(ring(places, count).frame()) - exact;
            assert!(
                error > -1.0 && error < exact * FRAME_ERROR,
                "{places} on {count}: {error}"
            );
            worst = worst.max(error / exact);
        }
    }
    println!("frame: at most {worst:.2e} too long");
}

/// What `Ring::frame` says of itself.
const FRAME_ERROR: f64 = 2.2e-4;

#[test]
fn open_is_a_bit_for_each_sub_channel() {
    for sub_channel in 0..MAX_SUB_CHANNELS {
        let open = Open(1 << sub_channel);
        for other in 0..MAX_SUB_CHANNELS {
            assert_eq!(open.contains(other), other == sub_channel);
        }
        assert!(!Open::default().contains(sub_channel));
    }
}
