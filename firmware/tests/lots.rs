//! Lots are uniform and independent between slots, between units and within a slot, and the same whenever they are drawn.

use firmware::lots::Identity;
use firmware::units::SlotIndex;
use rand_core::Rng;
use std::collections::BTreeSet;

/// Pearson's statistic of these counts for equal probabilities, in standard deviations from its mean (a chi-square with k degrees of
/// freedom has mean k and variance 2 k).
fn deviation(counts: &[u32]) -> f64 {
    let total: u32 = counts.iter().sum();
    let expected = f64::from(total) / counts.len() as f64;
    let statistic: f64 = counts
        .iter()
        .map(|&count| (f64::from(count) - expected) * (f64::from(count) - expected) / expected)
        .sum();
    let freedom = (counts.len() - 1) as f64;
    (statistic - freedom) / libm::sqrt(2.0 * freedom)
}

/// Neither more uneven than chance makes it nor more even.
fn is_uniform(what: &str, counts: &[u32]) {
    let deviation = deviation(counts);
    println!("{what}: {deviation:.2}");
    assert!(
        deviation.abs() < 4.5,
        "{what}: {deviation} deviations of {counts:?}"
    );
}

/// How often each value of so many highest bits comes.
fn histogram(bits: u32, lots: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut counts = vec![0; 1 << bits];
    lots.for_each(|lot| counts[(lot >> (32 - bits)) as usize] += 1);
    counts
}

/// How often each pair of values of the four highest bits comes.
fn pairs(lots: impl Iterator<Item = [u32; 2]>) -> Vec<u32> {
    histogram(8, lots.map(|[a, b]| (a >> 28 << 28) | (b >> 28 << 24)))
}

const DRAWS: u32 = 200_000;

#[test]
fn lots_are_uniform_over_slots_and_over_units() {
    for number in [0, 1, 2, 0xffff_ffff, 0x1234_5678] {
        for start in [0, u32::MAX - DRAWS / 2] {
            let slots = (0..DRAWS).map(|n| Identity(number).lot(SlotIndex(start.wrapping_add(n))));
            // Also the lowest of the sixteen bits that observations keep, which choose a level.
            let lowest = slots.clone().map(|lot| lot << 14);
            is_uniform("over slots", &histogram(8, slots));
            is_uniform("lowest bits kept", &histogram(2, lowest));
        }
    }
    for slot in [0, 1, 1_000, u32::MAX] {
        let units = (0..DRAWS).map(|number| Identity(number).lot(SlotIndex(slot)));
        is_uniform("over units", &histogram(8, units));
    }
}

#[test]
fn slots_and_units_are_independent() {
    for ahead in [1, 2, 3, 7, 20] {
        let following = (0..DRAWS).map(|n| [n, n + ahead].map(|slot| Identity(99).lot(SlotIndex(slot))));
        is_uniform("slots ahead", &pairs(following));
        let neighbours = (0..DRAWS).map(|n| [n, n + ahead].map(|number| Identity(number).lot(SlotIndex(5))));
        is_uniform("numbers ahead", &pairs(neighbours));
        let same_cell = (0..DRAWS).map(|n| [0, ahead].map(|number| Identity(number).lot(SlotIndex(n))));
        is_uniform("two units", &pairs(same_cell));
    }
}

/// Two units with one lot would contend alike: in no slot do any.
#[test]
fn no_two_units_ever_share_a_lot() {
    for slot in [0, 77, u32::MAX] {
        let lots: BTreeSet<u32> = (0..20_000)
            .map(|number| Identity(number).lot(SlotIndex(slot)))
            .collect();
        assert_eq!(lots.len(), 20_000);
    }
}

#[test]
fn a_slot_has_as_many_lots_as_are_drawn() {
    let slot = SlotIndex(1_000);
    let mut lots = Identity(3).lots(slot);
    let drawn: Vec<u32> = (0..DRAWS).map(|_| lots.next_u32()).collect();
    assert_eq!(drawn[0], Identity(3).lot(slot), "the first is the observation's");
    is_uniform("within a slot", &histogram(8, drawn.iter().copied()));
    is_uniform(
        "one after the other",
        &pairs(drawn.windows(2).map(|pair| [pair[0], pair[1]])),
    );
    // No slot's second lot is another slot's first: otherwise what is drawn twice in a slot would come again.
    let seconds: BTreeSet<u32> = (0..1_000)
        .map(|slot| {
            let mut lots = Identity(3).lots(SlotIndex(slot));
            let _ = lots.next_u32();
            lots.next_u32()
        })
        .collect();
    let firsts: BTreeSet<u32> = (0..1_000).map(|slot| Identity(3).lot(SlotIndex(slot))).collect();
    assert!(firsts.is_disjoint(&seconds));

    // The same again, in whatever portions.
    let mut bytes = [0; 10];
    Identity(3).lots(slot).fill_bytes(&mut bytes);
    let words: Vec<u8> = drawn.iter().flat_map(|lot| lot.to_le_bytes()).collect();
    assert_eq!(bytes[..], words[..10]);
    let wide = Identity(3).lots(slot).next_u64();
    assert_eq!(wide, u64::from(drawn[1]) << 32 | u64::from(drawn[0]));
}

#[test]
fn neighbouring_chips_differ_in_all_their_bits() {
    // Position on the wafer, wafer and lot, as in RM0090 section 39.1: a chip's neighbours differ in a bit or two.
    let device = |x: u32, y: u32| [y << 16 | x, 0x3133_470a, 0x3039_3237];
    let mut identities = BTreeSet::new();
    let mut changed = [0_u32; 32];
    let mut compared = 0_u32;
    for y in 0..100 {
        for x in 0..100 {
            let Identity(own) = Identity::of_device(device(x, y));
            identities.insert(own);
            let others = [device(x + 1, y), device(x, y + 1)];
            let [first, second, third] = device(x, y);
            let others = others
                .into_iter()
                .chain([[first, second + 1, third], [first, second, third + 1]]);
            for other in others {
                let Identity(other) = Identity::of_device(other);
                for (bit, changed) in changed.iter_mut().enumerate() {
                    *changed += (own ^ other) >> bit & 1;
                }
                compared += 1;
            }
        }
    }
    assert_eq!(identities.len(), 10_000, "two chips of a wafer are one unit");
    for changed in changed {
        let share = f64::from(changed) / f64::from(compared);
        assert!((share - 0.5).abs() < 0.02, "{share}");
    }
    assert_ne!(Identity::of_device([1, 2, 3]), Identity::of_device([3, 2, 1]));
}
