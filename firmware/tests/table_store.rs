//! Tables over the air: what is refused, what it costs, and what a power cut leaves.

use crate::flash::{ChipFlash, Flash, Lie};
use crate::readings::Readings;
use crate::signing::{TEST_SECRET, package, package_of, public, slot};
use crate::table_builder::{Contents, seal};
use embedded_storage::nor_flash::NorFlash;
use firmware::actor::Actor;
use firmware::decision::ACTIONS;
use firmware::health::{Health, WINDOW};
use firmware::link::{
    CHUNK_LEN, ModemFrame, Refusal, Trial, UnitFrame, UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::observation::INPUTS;
use firmware::session::{Request, Session};
use firmware::table::Table;
use firmware::table_store::package::{Content, Header, HeaderBytes, MAX_VERSION};
use firmware::table_store::{
    Key, MAX_ERASES, MAX_PACKAGE, MAX_TABLE, PackageError, SLOT_LEN, Slot, SlotFlash, TABLE_OFFSET,
    TableStore, inspect,
};
use firmware::tables::DISTILLED;
use firmware::unit::{Event, Unit};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

pub const KEY: Key = Key::BUILT_IN;

/// A store over this flash, as at a start.
pub fn boot<F: SlotFlash>(flash: F) -> TableStore<F> {
    TableStore::boot(flash, KEY, DISTILLED)
}

pub fn small_table(seed: u64) -> Vec<u8> {
    Contents::random(seed, &[INPUTS, ACTIONS]).bytes()
}

/// Sends a package as a modem would; the answer to the commit, or the first refusal.
pub fn update<F: SlotFlash>(store: &mut TableStore<F>, package: &[u8]) -> UpdateAnswer {
    let length = package.len() as u32;
    let mut answer = store.step(&UpdateFrame::Begin { length });
    while let UpdateAnswer::Continue { offset } = answer {
        if offset >= length {
            return store.step(&UpdateFrame::Commit);
        }
        answer = store.step(&chunk(package, offset));
    }
    answer
}

fn chunk(package: &[u8], offset: u32) -> UpdateFrame {
    let rest = &package[offset as usize..];
    let mut bytes = [0x5a; CHUNK_LEN];
    bytes[..rest.len().min(CHUNK_LEN)].copy_from_slice(&rest[..rest.len().min(CHUNK_LEN)]);
    UpdateFrame::Chunk { offset, bytes }
}

/// A window of a unit that does well.
pub fn window(checksum: u32) -> Health {
    Health {
        slots: WINDOW,
        ages: 4 * u64::from(WINDOW),
        frames: 7 * 256 * u64::from(WINDOW),
        sent: 4_000,
        acknowledged: 3_900,
        ..Health::of(checksum)
    }
}

/// A window of the running table.
pub fn passed<F: SlotFlash>(store: &TableStore<F>) -> Health {
    window(store.status().checksum)
}

/// Sends a package and lets its table pass its trial.
fn adopt<F: SlotFlash>(store: &mut TableStore<F>, package: &[u8]) -> UpdateAnswer {
    let answer = update(store, package);
    for _ in 0..2 {
        let window = passed(store);
        let _ = store.judge(&window);
    }
    answer
}

pub fn running<F: SlotFlash>(store: &TableStore<F>) -> Option<(u32, Vec<u8>)> {
    Some((store.running()?.version, store.running_bytes().to_vec()))
}

pub fn header(package: &[u8]) -> &HeaderBytes {
    package.as_chunks().0.first_chunk().unwrap()
}

#[test]
fn the_built_in_key_is_the_test_key() {
    assert_eq!(KEY.0, public(&TEST_SECRET));
    assert!(Key::IS_TEST && Key::KIND.contains("TEST"));
}

fn bytes(hex: &str) -> Vec<u8> {
    hex.as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

/// RFC 8032 section 7.1, test 3; and the same signature with the group's order added to its scalar.
#[test]
fn the_key_check_knows_the_standards_example() {
    let key = Key(
        bytes("fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025")
            .try_into()
            .unwrap(),
    );
    let signature: [u8; 64] = bytes(
        "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac\
         18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a",
    )
    .try_into()
    .unwrap();
    assert!(key.verifies(&[0xaf, 0x82], &signature));
    assert!(!key.verifies(&[0xaf, 0x83], &signature));

    let order = bytes("edd3f55c1a631258d69cf7a2def9de1400000000000000000000000000000010");
    let (mut second, mut carry) = (signature, 0);
    for (byte, order) in second[32..].iter_mut().zip(order) {
        let sum = u16::from(*byte) + u16::from(order) + carry;
        (*byte, carry) = (sum as u8, sum >> 8);
    }
    assert!(!key.verifies(&[0xaf, 0x82], &second), "a signature has one form");
}

/// Under a key of small order R = 1, s = 0 is a signature of many messages, and anybody can write it.
#[test]
fn keys_that_anybody_can_sign_for_verify_nothing() {
    let mut forged = [0; 64];
    forged[0] = 1;
    let prime = |first: u8| {
        let mut y = [0xff; 32];
        (y[0], y[31]) = (first, 0x7f);
        y
    };
    let eighth = |hex: &str| <[u8; 32]>::try_from(bytes(hex)).unwrap();
    let mut one = [0; 32];
    one[0] = 1;
    let small = [
        [0; 32],
        one,
        eighth("26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc05"),
        eighth("c7176a703d4dd84fba3c0b760d10670f2a2053fa2c39ccc64ec7fd7792ac037a"),
        prime(0xec),
        prime(0xed),
        prime(0xee),
    ];
    let mut accepted_by_equation = 0;
    for y in small {
        for sign in [0, 0x80] {
            let mut key = y;
            key[31] |= sign;
            for message in 0..16_u8 {
                accepted_by_equation += u32::from(salty::PublicKey::try_from(&key).is_ok_and(|key| {
                    let signature = salty::Signature::from(&forged);
                    key.verify(&[message], &signature).is_ok()
                }));
                assert!(!Key(key).verifies(&[message], &forged), "{key:02x?}");
            }
        }
    }
    println!("{accepted_by_equation} of 224 forged signatures fit the equation alone");
    assert!(accepted_by_equation > 50);
    // Neither does a number above the prime, nor one that is no point.
    assert!(!firmware::table_store::key::is_sound(&prime(0xf0)));
    assert!(firmware::table_store::key::is_sound(&prime(0xeb)));
    let mut two = [0; 32];
    two[0] = 2;
    assert!(firmware::table_store::key::is_sound(&two));
    assert!(salty::PublicKey::try_from(&two).is_err() && !Key(two).verifies(&[1], &forged));
}

#[test]
fn updates_alternate_between_the_slots_and_survive_a_restart() {
    let mut store = boot(ChipFlash::new());
    assert_eq!(store.running(), None, "the built-in table runs");
    for version in [1, 2, 7, 8, MAX_VERSION] {
        let table = if version == 7 {
            DISTILLED.to_vec()
        } else {
            small_table(u64::from(version))
        };
        let before = store.running().map(|stored| stored.slot);
        let answer = adopt(&mut store, &package(&table, version, &TEST_SECRET));
        assert_eq!(answer, UpdateAnswer::Stored { version });
        assert_ne!(store.running().map(|stored| stored.slot), before);
        assert_eq!(running(&store), Some((version, table.clone())));
        assert_eq!(store.status().trial, Trial::None);
        // An answer that was lost is given again, as often as it is asked for.
        for _ in 0..2 {
            assert_eq!(store.step(&UpdateFrame::Commit), UpdateAnswer::Stored { version });
        }
        store = boot(store.into_flash());
        assert_eq!(running(&store), Some((version, table)));
        assert_eq!(
            store.step(&UpdateFrame::Commit),
            UpdateAnswer::Refused(Refusal::NotBegun)
        );
    }
    assert_eq!((store.status().erases, store.flash().erases), (5, 5));
    for version in [MAX_VERSION, u32::MAX] {
        let answer = update(&mut store, &package(DISTILLED, version, &TEST_SECRET));
        assert_eq!(answer, UpdateAnswer::Refused(Refusal::Version), "{version}");
    }
    assert_eq!(store.flash().erases, 5, "nothing was erased for what is refused");
}

#[test]
fn every_flipped_bit_is_refused() {
    let good = package(DISTILLED, 9, &TEST_SECRET);
    let found = Header::check(header(&good), Content::Table, &KEY).unwrap();
    assert_eq!((found.version, found.length), (9, DISTILLED.len() as u32));
    let check = |package: &[u8]| {
        let mut slot = slot(package);
        slot.truncate(SLOT_LEN);
        inspect(&mut ChipFlash::with([&slot, &[]]), Slot::A, &KEY)
    };
    let stored = check(&good).unwrap();
    assert_eq!((stored.version, stored.confirmed), (9, true));
    let body = 128..good.len();
    let mut rng = Pcg64Mcg::new(77);
    let mut bits: Vec<(usize, u32)> = (0..128)
        .flat_map(|position| (0..8).map(move |bit| (position, bit)))
        .collect();
    for _ in 0..1_024 {
        bits.push((
            body.start + rng.next_u32() as usize % body.len(),
            rng.next_u32() % 8,
        ));
    }
    for (index, (position, bit)) in bits.into_iter().enumerate() {
        // Signatures take milliseconds without the chip's own multiplications, so of the header's bits every fourth is enough.
        if position < 128 && !index.is_multiple_of(4) {
            continue;
        }
        let mut damaged = good.clone();
        damaged[position] ^= 1 << bit;
        let refusal = check(&damaged).unwrap_err();
        if body.contains(&position) {
            assert_eq!(refusal, PackageError::Digest, "bit {bit} of byte {position}");
        }
    }
    // Who changes a table on purpose mends its checksum, and then its digest, too: the signature is left.
    let table = seal(
        [
            &DISTILLED[..40],
            &[DISTILLED[40] ^ 1],
            &DISTILLED[41..DISTILLED.len() - 4],
        ]
        .concat(),
    );
    assert!(Table::parse(&table).is_ok());
    let mut mended = package(&table, 9, &[7; 32]);
    assert_eq!(check(&mended), Err(PackageError::Signature));
    mended[64..128].copy_from_slice(&good[64..128]);
    assert_eq!(check(&mended), Err(PackageError::Signature));
    mended[..128].copy_from_slice(&good[..128]);
    assert_eq!(check(&mended), Err(PackageError::Digest));
}

#[test]
fn what_is_not_a_newer_package_of_this_key_is_refused_and_changes_nothing() {
    let old = small_table(1);
    let older = slot(&package(&small_table(9), 2, &TEST_SECRET));
    let mut store = boot(ChipFlash::with([&slot(&package(&old, 5, &TEST_SECRET)), &older]));
    let before = store.flash().bytes.clone();
    let good = |version| package(&small_table(2), version, &TEST_SECRET);
    let with = |change: &dyn Fn(&mut Contents)| {
        let mut contents = Contents::random(3, &[INPUTS, 16, ACTIONS]);
        change(&mut contents);
        package(&contents.bytes(), 6, &TEST_SECRET)
    };
    let changed = |at: usize, to: u8| {
        let mut package = good(6);
        package[at] = to;
        package
    };
    let longer = [good(6), vec![0; 100]].concat();
    let too_long = package(&vec![0; MAX_TABLE + 1], 6, &TEST_SECRET);
    assert_eq!(too_long.len(), MAX_PACKAGE + 1);
    // What the header alone says, and so before anything is erased.
    let cases = [
        ("older", good(4), Refusal::Version),
        ("the same version", good(5), Refusal::Version),
        ("no version", good(0), Refusal::Version),
        ("the last version", good(u32::MAX), Refusal::Version),
        (
            "another key",
            package(&small_table(2), 6, &[0x43; 32]),
            Refusal::Signature,
        ),
        ("another version", changed(8, 7), Refusal::Signature),
        ("another digest", changed(20, 7), Refusal::Signature),
        ("magic", changed(0, b'G'), Refusal::Header),
        ("format", changed(4, 1), Refusal::Header),
        ("no table", package(&[], 6, &TEST_SECRET), Refusal::Length),
        ("truncated", good(6)[..300].to_vec(), Refusal::Length),
        ("with more behind it", longer, Refusal::Length),
        (
            "length 0",
            package_of(0, &small_table(2), 6, &TEST_SECRET),
            Refusal::Length,
        ),
        (
            "a length beyond the slot",
            package_of(MAX_TABLE as u32 + 1, &small_table(2), 6, &TEST_SECRET),
            Refusal::Length,
        ),
        ("nothing", Vec::new(), Refusal::Length),
        ("too long", too_long, Refusal::Length),
        ("far too long", vec![0; 1 << 20], Refusal::Length),
    ];
    for (name, package, refusal) in cases {
        assert_eq!(
            update(&mut store, &package),
            UpdateAnswer::Refused(refusal),
            "{name}"
        );
        assert_eq!(running(&store), Some((5, old.clone())), "{name}");
    }
    assert_eq!((store.flash().erases, &store.flash().bytes), (0, &before));

    // What only the table says.
    let cases = [
        ("sub-channels", with(&|contents| contents.max_sub_channels = 17)),
        (
            "inputs",
            package(
                &Contents::random(3, &[INPUTS + 1, ACTIONS]).bytes(),
                6,
                &TEST_SECRET,
            ),
        ),
        ("table version", with(&|contents| contents.version = 99)),
        // Where the format before had the largest power: 127.996 dBm.
        ("power", with(&|contents| contents.reserved.0 = 0x7fff)),
        (
            "joiner levels",
            with(&|contents| contents.joiner_levels.swap(0, 1)),
        ),
    ];
    for (name, package) in cases {
        let answer = update(&mut store, &package);
        assert_eq!(answer, UpdateAnswer::Refused(Refusal::Table), "{name}");
        store = boot(store.into_flash());
        assert_eq!(running(&store), Some((5, old.clone())), "{name}, after a restart");
    }
    let mut swapped = good(6);
    swapped[200] ^= 1;
    assert_eq!(
        update(&mut store, &swapped),
        UpdateAnswer::Refused(Refusal::Digest)
    );
    assert_eq!(adopt(&mut store, &good(6)), UpdateAnswer::Stored { version: 6 });
    assert_eq!(running(&store), Some((6, small_table(2))));
}

#[test]
fn forged_updates_erase_nothing_and_true_ones_only_so_often() {
    let mut store = boot(ChipFlash::new());
    let mut rng = Pcg64Mcg::new(1);
    let mut forged = package(&small_table(1), 1, &TEST_SECRET);
    for round in 0..10_000 {
        let length = forged.len() as u32;
        assert_eq!(
            store.step(&UpdateFrame::Begin { length }),
            UpdateAnswer::Continue { offset: 0 }
        );
        // A whole header now and then: a signature check takes its time.
        if round % 50 == 0 {
            forged[64 + rng.next_u32() as usize % 64] ^= 1 << (rng.next_u32() % 8);
            assert_eq!(
                update(&mut store, &forged),
                UpdateAnswer::Refused(Refusal::Signature)
            );
        }
    }
    assert_eq!((store.flash().erases, store.flash().operations), (0, 0));

    // Whoever plays true headers again: as many erases as a unit allows from one start to the next.
    let mut refused = 0;
    for version in 1..=20 {
        let good = package(&small_table(1), version, &TEST_SECRET);
        let mut damaged = good.clone();
        damaged[200] ^= 1;
        let expected = if version <= u32::from(MAX_ERASES) {
            Refusal::Digest
        } else {
            refused += 1;
            Refusal::Worn
        };
        assert_eq!(update(&mut store, &damaged), UpdateAnswer::Refused(expected));
    }
    assert_eq!(refused, 12);
    assert_eq!(store.flash().erases, u32::from(MAX_ERASES));
    assert_eq!(store.status().erases, u32::from(MAX_ERASES));
    // And as many as the record has places for, ever.
    for _ in 0..100 {
        store = boot(store.into_flash());
        for version in 1..=u32::from(MAX_ERASES) {
            let mut damaged = package(&small_table(1), version, &TEST_SECRET);
            damaged[200] ^= 1;
            let _ = update(&mut store, &damaged);
        }
    }
    let places = firmware::table_store::record::PLACES;
    assert_eq!(store.flash().erases, places - 8);
    assert_eq!(boot(store.into_flash()).status().erases, places - 8);
}

#[test]
fn steps_out_of_order_are_answered() {
    let mut store = boot(ChipFlash::new());
    let refused = UpdateAnswer::Refused;
    let next = package(&small_table(1), 1, &TEST_SECRET);
    let length = next.len() as u32;
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::NotBegun));
    assert_eq!(store.step(&chunk(&next, 0)), refused(Refusal::NotBegun));
    let begin = UpdateFrame::Begin { length };
    assert_eq!(store.step(&begin), UpdateAnswer::Continue { offset: 0 });
    let order = [0, 0, 64, 224, 32, 64, 96, 96, 0, 128, 128, 96, 192, 160];
    let answers = [32, 32, 32, 32, 64, 96, 128, 128, 128, 160, 160, 160, 160, 192];
    for (offset, next_offset) in order.into_iter().zip(answers) {
        let answer = store.step(&chunk(&next, offset));
        assert_eq!(
            answer,
            UpdateAnswer::Continue { offset: next_offset },
            "chunk {offset}"
        );
    }
    let beyond = UpdateFrame::Chunk {
        offset: u32::MAX,
        bytes: [0; CHUNK_LEN],
    };
    assert_eq!(store.step(&beyond), UpdateAnswer::Continue { offset: 192 });
    // A modem may start over; what was written need not come again, and nothing is erased again.
    for _ in 0..3 {
        assert_eq!(store.step(&begin), UpdateAnswer::Continue { offset: 0 });
    }
    for (offset, next_offset) in [(0, 32), (32, 64), (64, 96), (96, 192)] {
        assert_eq!(
            store.step(&chunk(&next, offset)),
            UpdateAnswer::Continue { offset: next_offset }
        );
    }
    assert_eq!(store.flash().erases, 1);
    // Behind the package's end nothing is written.
    let mut end = 192;
    while end < length {
        assert!(matches!(
            store.step(&chunk(&next, end)),
            UpdateAnswer::Continue { .. }
        ));
        end += CHUNK_LEN as u32;
    }
    let operations = store.flash().operations;
    let behind = UpdateFrame::Chunk {
        offset: end,
        bytes: [0; CHUNK_LEN],
    };
    assert_eq!(store.step(&behind), UpdateAnswer::Continue { offset: end });
    assert_eq!(store.flash().operations, operations);
    // But with another package it is.
    let other = package(&small_table(2), 1, &TEST_SECRET);
    assert_eq!(update(&mut store, &other), UpdateAnswer::Stored { version: 1 });
    assert_eq!(store.flash().erases, 2);

    let mut store = boot(ChipFlash::new());
    assert_eq!(store.step(&begin), UpdateAnswer::Continue { offset: 0 });
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::Incomplete));
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::NotBegun));
    // All but the last chunk.
    let _ = store.step(&begin);
    for offset in (0..length - CHUNK_LEN as u32).step_by(CHUNK_LEN) {
        assert!(matches!(
            store.step(&chunk(&next, offset)),
            UpdateAnswer::Continue { .. }
        ));
    }
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::Incomplete));
}

#[test]
fn damaged_slots_fall_back_to_the_other_and_then_to_the_built_in_table() {
    let (old, new) = (small_table(1), small_table(2));
    let (a, b) = (
        slot(&package(&old, 3, &TEST_SECRET)),
        slot(&package(&new, 4, &TEST_SECRET)),
    );
    let version = |a: &[u8], b: &[u8]| running(&boot(ChipFlash::with([a, b]))).map(|(version, _)| version);
    assert_eq!(version(&a, &b), Some(4));
    assert_eq!(version(&b, &a), Some(4));
    let mut damaged = b.clone();
    damaged[TABLE_OFFSET + 100] ^= 1;
    assert_eq!(version(&a, &damaged), Some(3));
    assert_eq!(version(&damaged, &damaged), None);
    let mut no_mark = b.clone();
    no_mark[..32].fill(0xff);
    assert_eq!(
        inspect(&mut ChipFlash::with([&no_mark, &[]]), Slot::A, &KEY),
        Err(PackageError::NotComplete)
    );
    assert_eq!(version(&a, &no_mark), Some(3));
    // A mark is set or not whichever of its bits has rotted.
    for mark in [0, 128, 192] {
        for bit in 0..256 {
            let mut rotten = b.clone();
            rotten[mark + bit / 8] ^= 1 << (bit % 8);
            assert_eq!(version(&a, &rotten), Some(4), "bit {bit} of the mark at {mark}");
        }
    }
    // A slot may hold what no update would take.
    for version in [0, u32::MAX] {
        let never = slot(&package(&new, version, &TEST_SECRET));
        let found = inspect(&mut ChipFlash::with([&never, &[]]), Slot::A, &KEY);
        assert_eq!(found, Err(PackageError::Version(version)));
    }
    // Of equal ones the first.
    let twin = slot(&package(&new, 3, &TEST_SECRET));
    assert_eq!(
        boot(ChipFlash::with([&a, &twin])).running().unwrap().slot,
        Slot::A
    );
    let other_key = TableStore::boot(ChipFlash::with([&a, &b]), Key(public(&[9; 32])), DISTILLED);
    assert_eq!(
        other_key.running(),
        None,
        "an image with another key runs its own table"
    );
}

/// What was confirmed once never comes back, although both slots and then the record are lost.
#[test]
fn no_single_damage_brings_past_versions_back() {
    let mut store = boot(ChipFlash::new());
    for version in [4, 6] {
        let package = package(&small_table(u64::from(version)), version, &TEST_SECRET);
        assert_eq!(adopt(&mut store, &package), UpdateAnswer::Stored { version });
    }
    let flash = store.into_flash();
    let replayed = package(&small_table(5), 5, &TEST_SECRET);
    let next = package(&small_table(7), 7, &TEST_SECRET);
    let mut damages: Vec<(&str, ChipFlash)> = vec![("none", flash.clone())];
    for (name, range) in [
        ("the record", 0..SLOT_LEN),
        ("the older slot", SLOT_LEN..2 * SLOT_LEN),
        ("the newer slot", 2 * SLOT_LEN..3 * SLOT_LEN),
        ("both slots", SLOT_LEN..3 * SLOT_LEN),
    ] {
        for fill in [0xff, 0x00] {
            let mut damaged = flash.clone();
            damaged.bytes[range.clone()].fill(fill);
            damages.push((name, damaged));
        }
    }
    for (name, flash) in damages {
        let mut store = boot(flash);
        // A record of which every place is damaged has no room left, which refuses what is new as well.
        let refusal = update(&mut store, &replayed);
        assert_eq!(refusal, UpdateAnswer::Refused(Refusal::Version), "{name}");
        assert_eq!(store.status().floor, 6, "{name}");
        let answer = update(&mut store, &next);
        let full = store.status().erases > 100;
        assert!(
            answer == UpdateAnswer::Stored { version: 7 }
                || (full && answer == UpdateAnswer::Refused(Refusal::Worn)),
            "{name}: {answer:?}"
        );
    }
}

/// Cuts the power at every write and erase of an update and of its trial, and starts again, twice.
fn cuts<const W: usize, const E: u8>(corrects_errors: bool, step: usize) {
    let (old, new) = (small_table(1), small_table(2));
    let before = Flash::<W, E>::with([
        &slot(&package(&small_table(0), 2, &TEST_SECRET)),
        &slot(&package(&old, 3, &TEST_SECRET)),
    ]);
    let next = package(&new, 4, &TEST_SECRET);
    let mut whole = boot(before.clone());
    assert_eq!(adopt(&mut whole, &next), UpdateAnswer::Stored { version: 4 });
    let operations = whole.flash().operations;
    let writes = (next.len() as u32).div_ceil(32) * 32 / W as u32;
    assert!(operations > writes + 16, "{operations}");
    assert_eq!(running(&boot(whole.into_flash())), Some((4, new.clone())));
    let (mut kept, mut adopted) = (0, 0);
    for cut in (1..=operations).step_by(step) {
        let mut flash = before.clone();
        flash.operations_left = Some(cut);
        flash.corrects_errors = corrects_errors;
        flash.rng = Pcg64Mcg::new(u128::from(cut));
        let mut store = boot(flash);
        let _ = adopt(&mut store, &next);
        assert!(running(&store) == Some((3, old.clone())) || running(&store) == Some((4, new.clone())));
        let mut store = boot(store.into_flash().powered_again());
        // What the unit runs is whole, whatever its flash reads as.
        for _ in 0..2 {
            let (version, table) = running(&store).expect("a valid table");
            match version {
                3 => assert_eq!(table, old, "cut {cut}"),
                4 => assert_eq!(table, new, "cut {cut}"),
                _ => panic!("cut {cut}: version {version}"),
            }
            drop(Actor::new(Table::parse(&table).unwrap()));
            store = boot(store.into_flash());
        }
        // And the update comes to its end: its trial goes on, or it can be done again, with this version or the next.
        for version in [4, 5] {
            let before = store.status();
            let answer = adopt(&mut store, &package(&new, version, &TEST_SECRET));
            let stored = answer == UpdateAnswer::Stored { version };
            let past = answer == UpdateAnswer::Refused(Refusal::Version);
            assert!(stored || past, "cut {cut}: {answer:?} after {before:?}");
            kept += u32::from(stored && version == 4);
            adopted += u32::from(past && version == 4);
        }
        assert_eq!(running(&store), Some((5, new.clone())), "cut {cut}");
        assert_eq!(running(&boot(store.into_flash())), Some((5, new.clone())));
    }
    println!(
        "words of {W}, erased {E:#04x}: {operations} cuts, {kept} before the end of the update, {adopted} after"
    );
    assert!(kept > adopted && adopted > 0);
}

#[test]
fn a_power_cut_anywhere_leaves_the_old_table_or_the_new_one() {
    cuts::<4, 0xff>(false, 1);
}

#[test]
fn so_it_does_with_erased_bytes_of_0() {
    cuts::<4, 0x00>(false, 1);
}

#[test]
fn so_it_does_with_words_of_any_size() {
    cuts::<1, 0xff>(false, 29);
    cuts::<8, 0xff>(true, 1);
    cuts::<16, 0xff>(true, 1);
    cuts::<32, 0xff>(true, 1);
    cuts::<8, 0x00>(false, 1);
    cuts::<32, 0x00>(true, 1);
}

#[test]
fn flash_that_lies_is_found_out() {
    let old = small_table(1);
    let start = || {
        ChipFlash::with([
            &slot(&package(&old, 3, &TEST_SECRET)),
            &slot(&package(DISTILLED, 2, &TEST_SECRET)),
        ])
    };
    let next = package(&small_table(2), 4, &TEST_SECRET);
    let slot_b = 2 * SLOT_LEN;
    for lie in [
        Lie::NoErase,
        Lie::NoWrite(0),
        Lie::NoWrite(slot_b),
        Lie::NoWrite(slot_b + TABLE_OFFSET),
        Lie::NoWrite(slot_b + TABLE_OFFSET + 64),
        Lie::StuckBit(0),
        Lie::StuckBit(slot_b + TABLE_OFFSET),
    ] {
        let mut flash = start();
        flash.lie = lie;
        let mut store = boot(flash);
        assert_eq!(
            update(&mut store, &next),
            UpdateAnswer::Refused(Refusal::Flash),
            "{lie:?}"
        );
        assert_eq!(running(&store), Some((3, old.clone())), "{lie:?}");
        let mut flash = store.into_flash();
        flash.lie = Lie::None;
        let mut store = boot(flash);
        assert_eq!(running(&store), Some((3, old.clone())), "{lie:?}");
        assert_eq!(
            adopt(&mut store, &next),
            UpdateAnswer::Stored { version: 4 },
            "{lie:?}"
        );
    }
    // A mark that is not taken: only the last step fails.
    let mut store = boot(start());
    let length = next.len() as u32;
    let mut answer = store.step(&UpdateFrame::Begin { length });
    while let UpdateAnswer::Continue { offset } = answer
        && offset < length
    {
        answer = store.step(&chunk(&next, offset));
    }
    let mut flash_lies = store.into_flash();
    flash_lies.lie = Lie::NoWrite(0);
    let mut store = boot(flash_lies);
    assert_eq!(
        store.step(&UpdateFrame::Commit),
        UpdateAnswer::Refused(Refusal::NotBegun)
    );
    assert_eq!(running(&store), Some((3, old)));
}

/// The whole way, as the image goes it: frames in, decisions and answers out, the new table from one slot to the next.
#[test]
fn slots_are_decided_through_an_update() {
    let new = Contents::random(8, &[INPUTS, 16, ACTIONS]).bytes();
    let next = package(&new, 1, &TEST_SECRET);
    let mut store = boot(ChipFlash::new());
    let mut session = Session::new(Unit::new(DISTILLED, Identity(1)));
    let before = window(Table::parse(DISTILLED).unwrap().checksum());
    assert!(!store.judge(&before), "nothing waits");
    let mut references = [DISTILLED, &new].map(|table| Unit::new(table, Identity(1)));
    let mut rng = Pcg64Mcg::new(3);
    let (mut step, mut runs_new, mut differing) = (
        UpdateFrame::Begin {
            length: next.len() as u32,
        },
        false,
        0,
    );
    for slot in 0..600_u32 {
        let readings = Readings {
            slot,
            gain: std::array::from_fn(|_| rng.next_u32() as i16),
            age: Some(1 + rng.next_u32() % 100),
            ..Readings::default()
        };
        let measurement = readings.measurement();
        let reports = references
            .each_mut()
            .map(|unit| unit.slot(&Event::Measured(measurement)));
        differing += u32::from(reports[0] != reports[1]);
        let expected = UnitFrame::from(&reports[usize::from(runs_new)].unwrap());
        let mut wire = encode(&ModemFrame::Measurement((&measurement).into()))
            .unwrap()
            .to_vec();
        if !runs_new {
            wire.extend(encode(&ModemFrame::Update(step)).unwrap());
        }
        let mut decided = Vec::new();
        for byte in wire {
            match session.byte(byte) {
                None => {}
                Some(Request::Answer(UnitMessage::Decision(frame))) => decided.push(frame),
                Some(Request::Answer(other)) => panic!("{other:?}"),
                Some(Request::Status(counters)) => panic!("{counters:?}"),
                Some(Request::Update(step_of_modem)) => match store.step(&step_of_modem) {
                    UpdateAnswer::Continue { offset } if offset < next.len() as u32 => {
                        step = chunk(&next, offset)
                    }
                    UpdateAnswer::Continue { .. } => step = UpdateFrame::Commit,
                    UpdateAnswer::Stored { version: 1 } => {
                        session.run_table(Table::parse(&new));
                        runs_new = true;
                    }
                    other => panic!("{other:?}"),
                },
            }
        }
        assert_eq!(decided, [expected], "slot {slot}");
    }
    assert!(runs_new && differing > 50, "{differing}");
    assert_eq!(running(&store), Some((1, new.clone())));
    assert_eq!(store.status().trial, Trial::Running);
}

#[test]
fn steps_at_random_never_touch_the_running_table() {
    let old = small_table(1);
    let active = slot(&package(&old, 5, &TEST_SECRET));
    let mut store = boot(ChipFlash::with([&active, &[]]));
    let next = package(&small_table(2), 4, &TEST_SECRET);
    let mut rng = Pcg64Mcg::new(12);
    for _ in 0..20_000 {
        let random = rng.next_u32();
        let offset = match random % 4 {
            0 => rng.next_u32(),
            _ => (random / 4 % 700) & !31,
        };
        let mut bytes = [random as u8; CHUNK_LEN];
        if let Some(chunk) = next.get(offset as usize..).and_then(|rest| rest.first_chunk()) {
            bytes = *chunk;
        }
        let step = match rng.next_u32() % 200 {
            0 => UpdateFrame::Begin { length: random % 700 },
            1 => UpdateFrame::Begin {
                length: next.len() as u32,
            },
            2 | 3 => UpdateFrame::Commit,
            _ => UpdateFrame::Chunk { offset, bytes },
        };
        assert!(
            !matches!(store.step(&step), UpdateAnswer::Stored { .. }),
            "the version is too low"
        );
    }
    assert_eq!(running(&store), Some((5, old)));
    assert_eq!(
        store.flash().mapped(Slot::A),
        active,
        "not a bit of the running slot has changed"
    );
    assert_eq!(store.flash().erases, 0);
    assert_eq!(ChipFlash::WRITE_SIZE, 4);
}
