//! A new table is on trial until the unit did as well with it, and every table is read again while it runs.

use crate::flash::{ChipFlash, Flash};
use crate::readings::Readings;
use crate::signing::{TEST_SECRET, package, slot};
use crate::table_builder::Contents;
use crate::table_store::{boot, passed, running, small_table, update, window};
use firmware::decision::ACTIONS;
use firmware::health::{Health, WINDOW};
use firmware::link::{Refusal, Trial, UpdateAnswer, UpdateFrame};
use firmware::lots::Identity;
use firmware::observation::INPUTS;
use firmware::session::Session;
use firmware::table_store::{MAX_STARTS, MAX_TABLE, SLOT_LEN, Slot, SlotFlash, TABLE_OFFSET, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// A store that runs version 3, with version 4 on its way.
fn with_waiting() -> (TableStore<ChipFlash>, Vec<u8>, Vec<u8>) {
    let (old, new) = (small_table(1), small_table(2));
    let mut store = boot(ChipFlash::with([&slot(&package(&old, 3, &TEST_SECRET)), &[]]));
    let answer = update(&mut store, &package(&new, 4, &TEST_SECRET));
    assert_eq!(answer, UpdateAnswer::Stored { version: 4 });
    (store, old, new)
}

#[test]
fn a_table_is_confirmed_that_does_as_well_and_reverted_that_does_worse() {
    type Change = fn(&mut Health);
    let cases: [(&str, bool, Change); 12] = [
        ("the same", true, |_| {}),
        // 4 slots before, and 1.25 times that and half a frame of 7 slots are 8.5.
        ("8.5 slots old", true, |health| {
            health.ages = u64::from(WINDOW) * 17 / 2
        }),
        ("a bit more", false, |health| {
            health.ages = u64::from(WINDOW) * 17 / 2 + 1
        }),
        ("twice the age in twice the load", true, |health| {
            health.ages *= 2;
            health.frames *= 2;
        }),
        ("the same age in a quarter of the load", false, |health| {
            health.frames /= 4
        }),
        ("half of the acknowledged share", true, |health| {
            health.acknowledged = 1_950
        }),
        ("less", false, |health| health.acknowledged = 1_949),
        ("twice as many transmissions for it", true, |health| {
            health.sent = 8_000
        }),
        ("more", false, |health| health.sent = 8_001),
        ("too few to tell", true, |health| {
            (health.sent, health.acknowledged) = (99, 0)
        }),
        ("468 dropped frames", true, |health| health.dropped = WINDOW / 64),
        ("more of them", false, |health| health.dropped = WINDOW / 64 + 1),
    ];
    for (name, passes, change) in cases {
        let (mut store, old, new) = with_waiting();
        assert_eq!(
            running(&store),
            Some((3, old.clone())),
            "{name}: how does the old one do?"
        );
        assert_eq!(store.status().trial, Trial::Waiting(4));
        // Windows of tables that do not run say nothing.
        assert!(!store.judge(&window(7)));
        assert_eq!(store.status().trial, Trial::Waiting(4));
        assert!(store.judge(&passed(&store)), "{name}");
        assert_eq!(running(&store), Some((4, new.clone())), "{name}");
        assert_eq!((store.status().trial, store.status().floor), (Trial::Running, 3));
        // The one to fall back on must not be erased for the next.
        let next = package(&small_table(3), 5, &TEST_SECRET);
        assert_eq!(update(&mut store, &next), UpdateAnswer::Refused(Refusal::OnTrial));
        let mut verdict = passed(&store);
        change(&mut verdict);
        assert_eq!(store.judge(&verdict), !passes, "{name}");
        let expected = if passes { (4, new) } else { (3, old) };
        assert_eq!(running(&store), Some(expected.clone()), "{name}");
        assert_eq!(
            (store.status().trial, store.status().floor),
            (Trial::None, 4),
            "{name}"
        );
        // For good, and what failed once does not come again.
        let mut store = boot(store.into_flash());
        assert_eq!(running(&store), Some(expected), "{name}");
        assert_eq!(store.status().trial, Trial::None, "{name}");
        let again = package(&small_table(2), 4, &TEST_SECRET);
        assert_eq!(
            update(&mut store, &again),
            UpdateAnswer::Refused(Refusal::Version),
            "{name}"
        );
        assert_eq!(
            update(&mut store, &next),
            UpdateAnswer::Stored { version: 5 },
            "{name}"
        );
    }
    // Dropped frames are compared with those before.
    let mut before = window(1);
    before.dropped = 1_000;
    let mut now = before;
    now.dropped = 2_000 + WINDOW / 64;
    assert!(!now.is_worse_than(&before));
    now.dropped += 1;
    assert!(now.is_worse_than(&before));
    // So few transmissions before say nothing either.
    let (mut before, mut now) = (window(1), window(1));
    (before.sent, before.acknowledged) = (99, 99);
    now.acknowledged = 0;
    assert!(!now.is_worse_than(&before));
}

#[test]
fn a_known_unit_tries_at_once_and_a_waiting_table_can_be_replaced() {
    let mut store = boot(ChipFlash::new());
    assert!(!store.judge(&passed(&store)));
    let first = package(&small_table(1), 1, &TEST_SECRET);
    assert_eq!(update(&mut store, &first), UpdateAnswer::Stored { version: 1 });
    assert_eq!(
        running(&store),
        Some((1, small_table(1))),
        "on trial from the next slot on"
    );

    let (mut store, old, _) = with_waiting();
    let same = package(&small_table(5), 4, &TEST_SECRET);
    assert_eq!(update(&mut store, &same), UpdateAnswer::Refused(Refusal::Version));
    let next = package(&small_table(5), 5, &TEST_SECRET);
    assert_eq!(update(&mut store, &next), UpdateAnswer::Stored { version: 5 });
    assert_eq!(running(&store), Some((3, old)));
    assert!(store.judge(&passed(&store)));
    assert_eq!(running(&store), Some((5, small_table(5))));
}

/// What a slot still holds from before the confirmed table is never tried.
#[test]
fn a_table_without_a_verdict_that_is_older_is_left_alone() {
    for (version, waits) in [(4, Trial::None), (5, Trial::None), (6, Trial::Waiting(6))] {
        let mut unconfirmed = slot(&package(&small_table(2), version, &TEST_SECRET));
        unconfirmed[128..160].fill(0xff);
        let confirmed = slot(&package(&small_table(1), 5, &TEST_SECRET));
        let mut store = boot(ChipFlash::with([&confirmed, &unconfirmed]));
        assert_eq!(store.status().trial, waits, "{version}");
        assert_eq!(store.judge(&passed(&store)), waits != Trial::None);
    }
}

/// A table that stops its unit before the verdict, again and again.
#[test]
fn a_table_that_does_not_live_to_its_verdict_is_rejected() {
    let (mut store, old, new) = with_waiting();
    for start in 1..=MAX_STARTS {
        assert_eq!(running(&store), Some((3, old.clone())), "start {start}");
        assert!(store.judge(&passed(&store)));
        assert_eq!(running(&store), Some((4, new.clone())));
        store = boot(store.into_flash());
    }
    assert_eq!(store.status().trial, Trial::Waiting(4));
    assert!(!store.judge(&passed(&store)), "it had its starts");
    for _ in 0..2 {
        assert_eq!(running(&store), Some((3, old.clone())));
        assert_eq!((store.status().trial, store.status().floor), (Trial::None, 4));
        store = boot(store.into_flash());
    }
}

/// The session's own numbers, from its frames.
#[test]
fn a_session_counts_how_its_table_does() {
    let table = Contents::random(5, &[INPUTS, 16, ACTIONS]).bytes();
    let mut session = Session::new(Unit::new(&table, Identity(5)));
    let mut rng = Pcg64Mcg::new(2);
    let mut expected = Health::of(u32::from_le_bytes(*table.last_chunk().unwrap()));
    let mut acknowledged = None;
    for slot in 0..WINDOW + 40 {
        let measured = !slot.is_multiple_of(900);
        let age = 1 + rng.next_u32() % 40;
        let readings = Readings {
            slot,
            age: (slot > 50).then_some(age),
            gain: std::array::from_fn(|_| rng.next_u32() as i16),
            ..Readings::default()
        };
        assert_eq!(session.full_window(), None);
        let frame = if measured {
            firmware::link::ModemFrame::Measurement((&readings.measurement()).into())
        } else {
            firmware::link::ModemFrame::Missed { slot }
        };
        if slot % 1_000 == 0 {
            assert!([1, 2, 0].iter().all(|&byte| session.byte(byte).is_none()));
            expected.dropped += 1;
        }
        let wire = firmware::link::encode(&frame).unwrap();
        let answers: Vec<_> = wire.into_iter().filter_map(|byte| session.byte(byte)).collect();
        assert_eq!(answers.len(), 1);
        if measured {
            let firmware::session::Request::Answer(firmware::link::UnitMessage::Decision(frame)) = answers[0]
            else {
                panic!("{answers:?}")
            };
            expected.slots += 1;
            expected.ages += if slot > 50 { u64::from(age) } else { 65_535 };
            // 20 places on 3 sub-channels: 6.664 slots, as the reciprocal has it.
            expected.frames += 1706;
            expected.sent += u32::from(frame.transmit.is_some());
            let newest = (slot > 50).then(|| slot - age);
            expected.acknowledged += u32::from(newest.is_some() && newest != acknowledged);
            acknowledged = newest;
            expected.last_acknowledged = newest.map(firmware::units::SlotIndex);
        }
        if expected.slots == WINDOW {
            break;
        }
    }
    assert!(expected.sent > 1_000 && expected.acknowledged > 1_000 && expected.dropped > 20);
    assert_eq!(session.full_window(), Some(expected));
    assert_eq!(session.full_window(), None, "the next one begins");
    // Another table begins anew.
    let wire = firmware::link::encode(&firmware::link::ModemFrame::Missed { slot: 1 << 20 }).unwrap();
    let _: Vec<_> = wire.into_iter().filter_map(|byte| session.byte(byte)).collect();
    session.replace_table(DISTILLED);
    assert_eq!(session.unit().table().unwrap().bytes(), DISTILLED);
}

/// Calls until damage is found, at one a slot.
fn slots_until_found<F: SlotFlash>(store: &mut TableStore<F>) -> Option<u32> {
    (1..=200).find(|_| store.check_running())
}

#[test]
fn damage_to_the_running_table_is_found_within_200_slots_and_the_other_table_runs() {
    let (old, new) = (small_table(1), small_table(2));
    let start = || {
        boot(Flash::<4, 0xff>::with([
            &slot(&package(&old, 3, &TEST_SECRET)),
            &slot(&package(&new, 4, &TEST_SECRET)),
        ]))
    };
    let mut rng = Pcg64Mcg::new(4);
    let mut most = 0;
    for _ in 0..190 {
        let mut store = start();
        // Any phase of the reading.
        for _ in 0..rng.next_u32() % 50 {
            assert!(!store.check_running());
        }
        let at = 2 * SLOT_LEN + TABLE_OFFSET + rng.next_u32() as usize % new.len();
        store.flash_mut().bytes[at] ^= 1 << (rng.next_u32() % 8);
        most = most.max(slots_until_found(&mut store).expect("within 200 slots"));
        assert_eq!(running(&store), Some((3, old.clone())));
        assert!(slots_until_found(&mut store).is_none(), "the other one is whole");
    }
    println!("at most {most} slots for {} bytes", new.len());

    // The longest table, at its worst phase: damage behind the reading's place.
    let long = padded(MAX_TABLE);
    assert!(long.len() > MAX_TABLE - 700);
    let mut store = boot(Flash::<4, 0xff>::with([
        &slot(&package(&long, 3, &TEST_SECRET)),
        &[],
    ]));
    for _ in 0..2 {
        assert!(!store.check_running());
    }
    store.flash_mut().bytes[SLOT_LEN + TABLE_OFFSET + 100] ^= 1;
    let slots = slots_until_found(&mut store).expect("within 200 slots");
    assert!(slots > 160, "a test of the worst phase");
    println!("{slots} slots for {} bytes at the worst phase", long.len());
    assert_eq!(running(&store), None, "the built-in table runs");

    // On trial, the one before runs on, and the damaged one has no verdict.
    let (mut store, old, _) = with_waiting();
    assert!(store.judge(&passed(&store)));
    store.flash_mut().bytes[2 * SLOT_LEN + TABLE_OFFSET + 300] ^= 1;
    assert!(slots_until_found(&mut store).is_some());
    assert_eq!(
        (running(&store), store.status().trial),
        (Some((3, old)), Trial::None)
    );
    assert_eq!(
        store.step(&UpdateFrame::Commit),
        UpdateAnswer::Stored { version: 4 }
    );
}

#[test]
fn damage_to_the_built_in_table_is_found_too() {
    let mut damaged = DISTILLED.to_vec();
    damaged[1_500] ^= 1;
    let mut store = TableStore::boot(ChipFlash::new(), crate::table_store::KEY, damaged.leak());
    assert!(slots_until_found(&mut store).is_some_and(|slots| slots <= 24));
    assert_eq!(running(&store).is_none(), store.running_bytes() != DISTILLED);
    let mut whole = boot(ChipFlash::new());
    assert_eq!(slots_until_found(&mut whole), None);
    assert_eq!(whole.flash().mapped(Slot::A).len(), SLOT_LEN);
}

/// A table of about this length.
fn padded(length: usize) -> Vec<u8> {
    (1..=700)
        .map(|hidden| Contents::random(9, &[INPUTS, hidden, ACTIONS]).bytes())
        .take_while(|bytes| bytes.len() <= length)
        .last()
        .unwrap()
}
