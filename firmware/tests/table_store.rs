//! Tables over the air: what is refused, and what a power cut leaves.

use crate::readings::Readings;
use crate::signing::{TEST_SECRET, package, public, slot};
use crate::table_builder::{Contents, seal};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use firmware::actor::Actor;
use firmware::decision::ACTIONS;
use firmware::link::{
    CHUNK_LEN, ModemFrame, Refusal, UnitFrame, UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::observation::INPUTS;
use firmware::session::{Request, Session};
use firmware::table::Table;
use firmware::table_store::package::Package;
use firmware::table_store::{Active, Key, PackageError, SLOT_LEN, Slot, SlotFlash, TableStore, inspect};
use firmware::tables::DISTILLED;
use firmware::unit::{Event, Unit};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

const KEY: Key = Key::BUILT_IN;

/// Bytes that one step of an erase clears before the power may fail.
const ERASE_STEP: usize = 1 << 10;

/// Two slots whose power fails in the middle of an operation, and stays off.
#[derive(Clone)]
struct SimulatedFlash {
    bytes: Vec<u8>,
    /// Words and erase steps until the power fails.
    operations_left: Option<u32>,
    operations: u32,
    rng: Pcg64Mcg,
}

impl SimulatedFlash {
    fn new() -> Self {
        Self {
            bytes: vec![0xff; 2 * SLOT_LEN],
            operations_left: None,
            operations: 0,
            rng: Pcg64Mcg::new(5),
        }
    }

    fn with(slots: [&[u8]; 2]) -> Self {
        Self {
            bytes: slots.concat(),
            ..Self::new()
        }
    }

    /// Programs towards `target`; a failing operation changes an arbitrary part of the bits.
    fn operate(&mut self, at: usize, target: &[u8]) -> Result<(), NorFlashErrorKind> {
        let fails = match &mut self.operations_left {
            Some(0) => return Err(NorFlashErrorKind::Other),
            Some(left) => {
                *left -= 1;
                *left == 0
            }
            None => false,
        };
        self.operations += 1;
        for (byte, target) in self.bytes[at..at + target.len()].iter_mut().zip(target) {
            let done = if fails { self.rng.next_u32() as u8 } else { 0xff };
            *byte = (*byte & !done) | (target & done);
        }
        if fails {
            Err(NorFlashErrorKind::Other)
        } else {
            Ok(())
        }
    }
}

impl ErrorType for SimulatedFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for SimulatedFlash {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }
    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for SimulatedFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SLOT_LEN;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        assert!(
            from.is_multiple_of(SLOT_LEN as u32) && to == from + SLOT_LEN as u32,
            "one whole slot"
        );
        (from as usize..to as usize)
            .step_by(ERASE_STEP)
            .try_for_each(|at| self.operate(at, &[0xff; ERASE_STEP]))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        assert!(
            offset.is_multiple_of(4) && bytes.len().is_multiple_of(4),
            "whole words"
        );
        bytes.chunks(4).enumerate().try_for_each(|(index, word)| {
            let at = offset as usize + 4 * index;
            assert_eq!(
                self.bytes[at..at + 4],
                [0xff; 4],
                "a word is programmed once after an erase"
            );
            self.operate(at, word)
        })
    }
}

impl SlotFlash for SimulatedFlash {
    fn slot(&self, slot: Slot) -> &[u8] {
        &self.bytes[slot.offset() as usize..][..SLOT_LEN]
    }
}

fn small_table(seed: u64) -> Vec<u8> {
    Contents::random(seed, &[INPUTS, ACTIONS]).bytes()
}

/// Sends a package as a modem would; the answer to the commit, or the first refusal.
fn update(store: &mut TableStore<SimulatedFlash>, package: &[u8]) -> UpdateAnswer {
    let length = package.len() as u32;
    let mut answer = store.step(&UpdateFrame::Begin { length });
    while let UpdateAnswer::Continue { offset } = answer {
        if offset >= length {
            return store.step(&UpdateFrame::Commit);
        }
        let rest = &package[offset as usize..];
        let mut bytes = [0x5a; CHUNK_LEN];
        bytes[..rest.len().min(CHUNK_LEN)].copy_from_slice(&rest[..rest.len().min(CHUNK_LEN)]);
        answer = store.step(&UpdateFrame::Chunk { offset, bytes });
    }
    answer
}

fn running(store: &TableStore<SimulatedFlash>) -> Option<(u32, Vec<u8>)> {
    let active = store.active()?;
    Some((
        active.version,
        active.table(store.flash().slot(active.slot)).to_vec(),
    ))
}

#[test]
fn the_built_in_key_is_the_test_key() {
    assert_eq!(KEY.0, public(&TEST_SECRET));
    assert!(Key::IS_TEST && Key::KIND.contains("TEST"));
}

/// RFC 8032 section 7.1, test 3; and the same signature with the group's order added to its scalar.
#[test]
fn the_key_check_knows_the_standards_example() {
    let bytes = |hex: &str| -> Vec<u8> {
        hex.as_bytes()
            .chunks(2)
            .map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap())
            .collect()
    };
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

#[test]
fn updates_alternate_between_the_slots_and_survive_a_restart() {
    let mut store = TableStore::boot(SimulatedFlash::new(), KEY);
    assert_eq!(store.active(), None, "the built-in table runs");
    for version in [1, 2, 7, 8, u32::MAX] {
        let table = if version == 7 {
            DISTILLED.to_vec()
        } else {
            small_table(u64::from(version))
        };
        let before = store.active().map(|active| active.slot);
        let answer = update(&mut store, &package(&table, version, &TEST_SECRET));
        assert_eq!(answer, UpdateAnswer::Activated { version });
        assert_ne!(store.active().map(|active| active.slot), before);
        assert_eq!(running(&store), Some((version, table.clone())));
        store = TableStore::boot(store.into_flash(), KEY);
        assert_eq!(running(&store), Some((version, table)));
    }
    let answer = update(&mut store, &package(DISTILLED, u32::MAX, &TEST_SECRET));
    assert_eq!(
        answer,
        UpdateAnswer::Refused(Refusal::Version),
        "no version is above the last"
    );
}

#[test]
fn every_flipped_bit_is_refused() {
    let good = package(DISTILLED, 9, &TEST_SECRET);
    assert_eq!(
        Package::check(&good, &KEY),
        Ok(Package {
            version: 9,
            table: DISTILLED
        })
    );
    let body = 16..good.len() - 64;
    let mut rng = Pcg64Mcg::new(77);
    let outside = (0..good.len()).filter(|position| !body.contains(position));
    let mut bits: Vec<(usize, u32)> = outside
        .flat_map(|position| (0..8).map(move |bit| (position, bit)))
        .collect();
    assert_eq!(bits.len(), 128 + 512);
    for _ in 0..4_096 {
        bits.push((
            body.start + rng.next_u32() as usize % body.len(),
            rng.next_u32() % 8,
        ));
    }
    let mut signature_checks = 0;
    for (index, (position, bit)) in bits.into_iter().enumerate() {
        let mut damaged = good.clone();
        damaged[position] ^= 1 << bit;
        let refusal = Package::check(&damaged, &KEY);
        assert!(refusal.is_err(), "bit {bit} of byte {position}");
        // A signature check takes milliseconds without the chip's own multiplications, so of the mended ones every eighth is enough.
        if index.is_multiple_of(8) && body.contains(&position) && position < body.end - 4 {
            // Who changes a table on purpose mends its checksum, too: then the signature alone is left. The table's own fields may
            // refuse it before.
            let table = seal(damaged[body.start..body.end - 4].to_vec());
            if table == DISTILLED {
                continue; // the flipped bit was in the length, which mending mends
            }
            damaged[body.clone()].copy_from_slice(&table);
            let refusal = Package::check(&damaged, &KEY).unwrap_err();
            assert!(
                matches!(refusal, PackageError::Signature | PackageError::Table(_)),
                "{refusal:?}"
            );
            signature_checks += u32::from(refusal == PackageError::Signature);
        }
    }
    println!("{signature_checks} refused by the signature alone");
    assert!(signature_checks > 100);
}

#[test]
fn what_is_not_a_newer_package_of_this_key_is_refused_and_changes_nothing() {
    let old = small_table(1);
    let mut store = TableStore::boot(
        SimulatedFlash::with([&slot(&package(&old, 5, &TEST_SECRET)), &[0xff; SLOT_LEN]]),
        KEY,
    );
    let good = |version| package(&small_table(2), version, &TEST_SECRET);
    let with = |change: &dyn Fn(&mut Contents)| {
        let mut contents = Contents::random(3, &[INPUTS, 16, ACTIONS]);
        change(&mut contents);
        package(&contents.bytes(), 6, &TEST_SECRET)
    };
    let mut other_magic = good(6);
    other_magic[0] = b'G';
    let mut other_format = good(6);
    other_format[4] = 2;
    let cases = [
        ("older", good(4), Refusal::Version),
        ("the same version", good(5), Refusal::Version),
        ("no version", good(0), Refusal::Version),
        (
            "another key",
            package(&small_table(2), 6, &[0x43; 32]),
            Refusal::Signature,
        ),
        ("magic", other_magic, Refusal::Header),
        ("format", other_format, Refusal::Header),
        (
            "sub-channels",
            with(&|contents| contents.max_sub_channels = 17),
            Refusal::Table,
        ),
        (
            "inputs",
            package(
                &Contents::random(3, &[INPUTS + 1, ACTIONS]).bytes(),
                6,
                &TEST_SECRET,
            ),
            Refusal::Table,
        ),
        (
            "outputs",
            package(
                &Contents::random(3, &[INPUTS, ACTIONS + 1]).bytes(),
                6,
                &TEST_SECRET,
            ),
            Refusal::Table,
        ),
        (
            "table version",
            with(&|contents| contents.version = 99),
            Refusal::Table,
        ),
        ("truncated", good(6)[..100].to_vec(), Refusal::Incomplete),
        ("nothing", Vec::new(), Refusal::Length),
        ("too long", vec![0; SLOT_LEN], Refusal::Length),
    ];
    for (name, package, refusal) in cases {
        assert_eq!(
            update(&mut store, &package),
            UpdateAnswer::Refused(refusal),
            "{name}"
        );
        assert_eq!(running(&store), Some((5, old.clone())), "{name}");
        store = TableStore::boot(store.into_flash(), KEY);
        assert_eq!(running(&store), Some((5, old.clone())), "{name}, after a restart");
    }
    // Every length that a transfer may break off at.
    let whole = good(6);
    for length in 0..whole.len() {
        assert!(Package::check(&whole[..length], &KEY).is_err(), "{length} bytes");
    }
    assert!(matches!(
        update(&mut store, &whole),
        UpdateAnswer::Activated { version: 6 }
    ));
}

#[test]
fn steps_out_of_order_are_answered() {
    let mut store = TableStore::boot(SimulatedFlash::new(), KEY);
    let (refused, bytes) = (UpdateAnswer::Refused, [1; CHUNK_LEN]);
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::NotBegun));
    assert_eq!(
        store.step(&UpdateFrame::Chunk { offset: 0, bytes }),
        refused(Refusal::NotBegun)
    );
    let begin = UpdateFrame::Begin { length: 300 };
    assert_eq!(store.step(&begin), UpdateAnswer::Continue { offset: 0 });
    for (offset, next) in [(0, 32), (0, 32), (64, 32), (u32::MAX, 32), (32, 64)] {
        let answer = store.step(&UpdateFrame::Chunk { offset, bytes });
        assert_eq!(answer, UpdateAnswer::Continue { offset: next }, "chunk {offset}");
    }
    assert_eq!(
        store.step(&begin),
        UpdateAnswer::Continue { offset: 0 },
        "a modem may start over"
    );
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::Incomplete));
    assert_eq!(store.step(&UpdateFrame::Commit), refused(Refusal::NotBegun));
}

#[test]
fn damaged_slots_fall_back_to_the_other_and_then_to_the_built_in_table() {
    let (old, new) = (small_table(1), small_table(2));
    let (a, b) = (
        slot(&package(&old, 3, &TEST_SECRET)),
        slot(&package(&new, 4, &TEST_SECRET)),
    );
    let boot = |a: &[u8], b: &[u8]| {
        running(&TableStore::boot(SimulatedFlash::with([a, b]), KEY)).map(|(version, _)| version)
    };
    assert_eq!(boot(&a, &b), Some(4));
    assert_eq!(boot(&b, &a), Some(4));
    let mut damaged = b.clone();
    damaged[200] ^= 1;
    assert_eq!(boot(&a, &damaged), Some(3));
    assert_eq!(boot(&damaged, &damaged), None);
    let mut no_marker = b.clone();
    no_marker[0] = 0xff;
    assert_eq!(
        inspect(Slot::B, &no_marker, &KEY),
        Err(PackageError::NotActivated)
    );
    assert_eq!(boot(&a, &no_marker), Some(3));
    let other_key = TableStore::boot(SimulatedFlash::with([&a, &b]), Key(public(&[9; 32])));
    assert_eq!(
        other_key.active(),
        None,
        "an image with another key runs its own table"
    );
}

#[test]
fn a_power_cut_anywhere_leaves_the_old_table_or_the_new_one() {
    let (old, new) = (small_table(1), small_table(2));
    let before = SimulatedFlash::with([
        &slot(&package(&small_table(0), 2, &TEST_SECRET)),
        &slot(&package(&old, 3, &TEST_SECRET)),
    ]);
    let next = package(&new, 4, &TEST_SECRET);
    let mut whole = TableStore::boot(before.clone(), KEY);
    assert_eq!(update(&mut whole, &next), UpdateAnswer::Activated { version: 4 });
    let operations = whole.flash().operations;
    assert!(operations > 100, "{operations}");
    let mut activated = 0;
    for cut in 1..=operations {
        for seed in 0..2 {
            let mut flash = before.clone();
            flash.operations_left = Some(cut);
            flash.rng = Pcg64Mcg::new(seed);
            let mut store = TableStore::boot(flash, KEY);
            assert!(matches!(update(&mut store, &next), UpdateAnswer::Refused(_)));
            assert_eq!(
                running(&store),
                Some((3, old.clone())),
                "cut {cut}: the unit goes on without power for its flash"
            );

            let mut flash = store.into_flash();
            flash.operations_left = None;
            let mut store = TableStore::boot(flash, KEY);
            let (version, table) = running(&store).expect("a valid table");
            match version {
                3 => assert_eq!(table, old, "cut {cut}"),
                4 => assert_eq!(table, new, "cut {cut}"),
                _ => panic!("cut {cut}: version {version}"),
            }
            activated += u32::from(version == 4);
            // And the update can be done again.
            if version == 3 {
                assert_eq!(update(&mut store, &next), UpdateAnswer::Activated { version: 4 });
            }
            assert_eq!(running(&store), Some((4, new.clone())));
            Actor::new(Table::parse(&new).unwrap());
        }
    }
    println!("{operations} cuts x 2, {activated} of them after the activation");
}

#[test]
fn an_active_slot_says_where_its_table_is() {
    let active = Active {
        slot: Slot::A,
        version: 1,
        table_len: DISTILLED.len(),
    };
    assert_eq!(
        active.table(&slot(&package(DISTILLED, 1, &TEST_SECRET))),
        DISTILLED
    );
    assert_eq!(
        active.table(&[0; 40]),
        [0_u8; 0],
        "too short is empty, which no check passes"
    );
}

/// The whole way, as the image goes it: frames in, decisions and answers out, the new table from one slot to the next.
#[test]
fn slots_are_decided_through_an_update() {
    let new = Contents::random(8, &[INPUTS, 16, ACTIONS]).bytes();
    let next = package(&new, 1, &TEST_SECRET);
    let mut store = TableStore::boot(SimulatedFlash::new(), KEY);
    let mut session = Session::new(Unit::new(DISTILLED, Identity(1)));
    let mut references = [DISTILLED, &new].map(|table| Unit::new(table, Identity(1)));
    let mut rng = Pcg64Mcg::new(3);
    let (mut step, mut activated, mut differing) = (
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
        let expected = UnitFrame::from(&reports[usize::from(activated)].unwrap());
        let mut wire = encode(&ModemFrame::Measurement((&measurement).into()))
            .unwrap()
            .to_vec();
        if !activated {
            wire.extend(encode(&ModemFrame::Update(step)).unwrap());
        }
        let mut decided = Vec::new();
        for byte in wire {
            match session.byte(byte) {
                None => {}
                Some(Request::Answer(UnitMessage::Decision(frame))) => decided.push(frame),
                Some(Request::Answer(other)) => panic!("{other:?}"),
                Some(Request::Update(step_of_modem)) => match store.step(&step_of_modem) {
                    UpdateAnswer::Continue { offset } if offset < next.len() as u32 => {
                        let mut bytes = [0; CHUNK_LEN];
                        let rest = &next[offset as usize..];
                        let length = rest.len().min(CHUNK_LEN);
                        bytes[..length].copy_from_slice(&rest[..length]);
                        step = UpdateFrame::Chunk { offset, bytes };
                    }
                    UpdateAnswer::Continue { .. } => step = UpdateFrame::Commit,
                    UpdateAnswer::Activated { version: 1 } => {
                        session.replace_table(&new);
                        activated = true;
                    }
                    other => panic!("{other:?}"),
                },
            }
        }
        assert_eq!(decided, [expected], "slot {slot}");
    }
    assert!(activated && differing > 50, "{differing}");
    assert_eq!(running(&store), Some((1, new.clone())));
}

#[test]
fn steps_at_random_never_touch_the_running_table() {
    let old = small_table(1);
    let active = slot(&package(&old, 5, &TEST_SECRET));
    let mut store = TableStore::boot(SimulatedFlash::with([&active, &[0xff; SLOT_LEN]]), KEY);
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
            1 => UpdateFrame::Begin { length: random },
            2 | 3 => UpdateFrame::Commit,
            _ => UpdateFrame::Chunk { offset, bytes },
        };
        assert!(
            !matches!(store.step(&step), UpdateAnswer::Activated { .. }),
            "the version is too low"
        );
    }
    assert_eq!(running(&store), Some((5, old)));
    assert_eq!(
        store.flash().slot(Slot::A),
        active,
        "not a bit of the running slot has changed"
    );
}
