//! The image under faults, in QEMU: a silent modem, noise, tables in flash, updates, a crash.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::actor::Actor;
use firmware::decision::ACTIONS;
use firmware::link::{
    CHUNK_LEN, ClockSource, ModemFrame, Refusal, Trial, UnitFrame, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::observation::{INPUTS, Observation};
use firmware::session::{Request, Session};
use firmware::table::Table;
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use host_sim::hil::emulator::{Emulator, Setup};
use rand_pcg::Pcg64Mcg;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use system_tests::noise::noise;
use system_tests::qemu::Qemu;
use system_tests::signing::{TEST_SECRET, package, slot};
use system_tests::table_builder::Contents;
use system_tests::{image, random_measurement_on};

const ANSWER_LIMIT: Duration = Duration::from_secs(20);
/// For an answer that must not come.
const SILENCE: Duration = Duration::from_millis(300);
/// The record of updates.
const RECORD: u32 = 0x0800_4000;
/// The first table slot.
const SLOT_A: u32 = 0x0800_8000;
/// The second.
const SLOT_B: u32 = 0x0800_c000;

fn wire(frame: &ModemFrame) -> Vec<u8> {
    encode(frame).unwrap().to_vec()
}

fn measured(rng: &mut Pcg64Mcg, slot: u32) -> Vec<u8> {
    wire(&ModemFrame::Measurement(
        (&random_measurement_on(rng, slot, 3)).into(),
    ))
}

fn session(table: &[u8]) -> Session<'_> {
    // The emulated chip's identity reads 0.
    Session::new(Unit::new(table, Identity::of_device([0; 3])))
}

/// The library's decisions for these bytes.
fn decisions(session: &mut Session<'_>, bytes: &[u8]) -> Vec<UnitFrame> {
    let requests = bytes.iter().filter_map(|&byte| session.byte(byte));
    requests
        .map(|request| match request {
            Request::Answer(firmware::link::UnitMessage::Decision(frame)) => frame,
            other => panic!("{other:?}"),
        })
        .collect()
}

#[test]
fn the_slot_timer_decides_for_a_silent_modem() {
    let mut unit = Qemu::boot_on_time(image::elf(), Vec::new());
    assert_eq!(unit.receive(SILENCE), None, "no slot has an index yet");
    let mut rng = Pcg64Mcg::new(1);
    let first = u32::MAX - 20;
    unit.send(&measured(&mut rng, first));
    let start = Instant::now();
    let mut last = first;
    for n in 0..400_u32 {
        let answer = unit
            .receive(ANSWER_LIMIT)
            .expect("the timer fires whatever the modem does");
        last = first.wrapping_add(n);
        let state = match n {
            0 => 0,
            1..100 => 1,
            _ => 3,
        };
        assert_eq!(
            (answer.slot, answer.state),
            (last, state),
            "{n} slots after the modem's last"
        );
        assert!(answer.transmit.is_none() || state != 3);
    }
    println!(
        "400 slots of 1 ms in {:.3} s of an emulator's time",
        start.elapsed().as_secs_f64()
    );
    // The modem returns a second later by its count, which a second frame confirms: that one makes the unit nominal.
    let back = last.wrapping_add(1_000);
    unit.send(&measured(&mut rng, back.wrapping_sub(1)));
    unit.send(&measured(&mut rng, back));
    let deadline = Instant::now() + ANSWER_LIMIT;
    while Instant::now() < deadline {
        let answer = unit.receive(ANSWER_LIMIT).unwrap();
        if answer.slot == back {
            assert_eq!(answer.state, 0);
            return;
        }
    }
    panic!("the modem's return was not heard");
}

/// Noise, delimited, and a valid frame after every three: what the unit answers is what the library answers.
fn fuzz(seed: u128, frames: u32) {
    let (mut unit, mut reference) = (Qemu::boot(image::elf()), session(DISTILLED));
    let mut rng = Pcg64Mcg::new(seed);
    let (mut sent, mut answered, mut slot) = (0, 0, 0_u32);
    let start = Instant::now();
    while sent < frames {
        let mut bytes = vec![0];
        // Short of the 256 bytes that the unit can take while it decides.
        while bytes.len() < 70 {
            let good = measured(&mut rng, slot.wrapping_add(1));
            // Two kinds of frames, of slots. Updates and slot lengths are fuzzed on the host, where time is not the machine's.
            bytes.extend(noise(&mut rng, &good, &[1, 6]));
            bytes.push(0);
            sent += 1;
        }
        let mut expected = decisions(&mut reference, &bytes);
        slot = reference
            .unit()
            .last_slot()
            .map_or(slot, |slot| slot.0)
            .wrapping_add(1);
        let good = measured(&mut rng, slot);
        sent += 1;
        let valid = decisions(&mut reference, &good);
        assert_eq!(valid.len(), 1);
        expected.extend(valid);
        bytes.extend(good);
        unit.send(&bytes);
        for expected in expected {
            assert_eq!(unit.receive(ANSWER_LIMIT), Some(expected), "after {bytes:02x?}");
            assert!(expected.decision().is_some(), "{expected:?}");
            answered += 1;
        }
    }
    assert_eq!(unit.receive(SILENCE), None, "an answer too many");
    println!(
        "{sent} frames, {answered} answers compared, {:.1} s",
        start.elapsed().as_secs_f64()
    );
}

#[test]
fn noise_never_makes_an_illegal_or_a_wrong_answer() {
    fuzz(0xf022, 10_000);
}

/// The whole run: `cargo test -p system-tests --test faults -- --ignored hundred_thousand --nocapture`.
#[test]
#[ignore = "tens of seconds"]
fn a_hundred_thousand_frames_of_noise() {
    fuzz(1, 100_000);
}

/// Runs an image with these slots against the library with this table.
fn runs(slots: [&[u8]; 2], directory: &Path, table: &[u8]) -> Qemu {
    let files = [directory.join("record"), directory.join("a"), directory.join("b")];
    // The emulator's flash is 0 where nothing is loaded, as a chip's never is.
    let [a, b] = slots;
    for (file, bytes) in files.iter().zip([&[0xff; 16 << 10], a, b]) {
        std::fs::write(file, bytes).unwrap();
    }
    let [record, a, b]: [PathBuf; 3] = files;
    let mut unit = Qemu::boot_with(image::elf(), vec![(RECORD, record), (SLOT_A, a), (SLOT_B, b)]);
    let (mut reference, mut rng) = (session(table), Pcg64Mcg::new(4));
    for slot in 0..200 {
        let bytes = measured(&mut rng, slot);
        unit.send(&bytes);
        let expected = decisions(&mut reference, &bytes);
        assert_eq!(unit.receive(ANSWER_LIMIT).as_slice(), expected);
    }
    unit
}

#[test]
fn a_signed_table_in_flash_runs_and_a_damaged_one_does_not() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    // Decides otherwise than the built-in table, or the test would see nothing.
    let other = Contents::random(8, &[INPUTS, 16, ACTIONS]).bytes();
    let mut rng = Pcg64Mcg::new(4);
    let differs = (0..200).any(|slot| {
        let observation = Observation::new(&random_measurement_on(&mut rng, slot, 3), Identity(0));
        let decide = |table| Actor::new(Table::parse(table).unwrap()).decide(&observation);
        decide(&other) != decide(DISTILLED)
    });
    assert!(differs);

    let (old, new) = (
        slot(&package(DISTILLED, 2, &TEST_SECRET)),
        slot(&package(&other, 3, &TEST_SECRET)),
    );
    let foreign = slot(&package(&other, 4, &[7; 32]));
    let mut damaged = new.clone();
    damaged[384 + 90] ^= 0x10;
    let empty = vec![0xff; 16 << 10];
    drop(runs([&new, &old], directory, &other));
    drop(runs([&empty, &new], directory, &other));
    drop(runs([&damaged, &old], directory, DISTILLED));
    drop(runs([&foreign, &new], directory, &other));
    // Signatures are checked while the unit is built: the deepest that the stack gets.
    runs([&foreign, &damaged], directory, DISTILLED).assert_stack_is_within_budget();
}

#[test]
fn tables_of_every_form_decide_as_the_library_does() {
    let directory = tempfile::tempdir().unwrap();
    let empty = vec![0xff; 16 << 10];
    let outputs = (0..4).map(|output| (2, output));
    for (observation, output) in outputs.chain([(1, 0), (1, 3)]) {
        let table = Contents::in_form(12, observation, output).bytes();
        let signed = slot(&package(&table, 2, &TEST_SECRET));
        drop(runs([&signed, &empty], directory.path(), &table));
    }
}

/// QEMU has no flash controller, so an update gets as far as the first write that must be read back. On the host the same code
/// goes all the way (`firmware/tests/table_store.rs`).
#[test]
fn an_update_that_the_flash_does_not_take_is_refused_while_slots_are_decided() {
    let directory = tempfile::tempdir().unwrap();
    let active = slot(&package(DISTILLED, 2, &TEST_SECRET));
    let empty = vec![0xff; 16 << 10];
    let mut unit = runs([&active, &empty], directory.path(), DISTILLED);
    let next = package(DISTILLED, 3, &TEST_SECRET);
    let mut rng = Pcg64Mcg::new(6);
    let mut slot = 199;
    let mut step = |unit: &mut Qemu, step: UpdateFrame| {
        slot += 1;
        unit.send(&[wire(&ModemFrame::Update(step)), measured(&mut rng, slot)].concat());
        let (answer, mut decisions) = unit.receive_update(ANSWER_LIMIT);
        if decisions.is_empty() {
            decisions.extend(unit.receive(ANSWER_LIMIT));
        }
        assert_eq!(
            decisions
                .iter()
                .map(|frame| (frame.slot, frame.state))
                .collect::<Vec<_>>(),
            [(slot, 0)]
        );
        answer
    };
    let length = next.len() as u32;
    assert_eq!(
        step(&mut unit, UpdateFrame::Commit),
        UpdateAnswer::Refused(Refusal::NotBegun)
    );
    let too_long = UpdateFrame::Begin { length: 1 << 20 };
    assert_eq!(step(&mut unit, too_long), UpdateAnswer::Refused(Refusal::Length));
    assert_eq!(
        step(&mut unit, UpdateFrame::Begin { length }),
        UpdateAnswer::Continue { offset: 0 }
    );
    // The header is checked before the flash is touched.
    let chunk = |index: usize| UpdateFrame::Chunk {
        offset: (CHUNK_LEN * index) as u32,
        bytes: *next[CHUNK_LEN * index..].first_chunk::<CHUNK_LEN>().unwrap(),
    };
    for index in 0..3 {
        let offset = (CHUNK_LEN * (index + 1)) as u32;
        assert_eq!(step(&mut unit, chunk(index)), UpdateAnswer::Continue { offset });
    }
    assert_eq!(step(&mut unit, chunk(3)), UpdateAnswer::Refused(Refusal::Flash));
    assert_eq!(
        step(&mut unit, chunk(3)),
        UpdateAnswer::Refused(Refusal::NotBegun)
    );
    // What the library says of itself, the image says.
    let status = unit.status(ANSWER_LIMIT);
    assert_eq!((status.table.version, status.table.trial), (2, Trial::None));
    assert_eq!(status.table.checksum, Table::parse(DISTILLED).unwrap().checksum());
    assert_eq!((status.counters.slots, status.counters.degraded), (208, 0));
    assert_eq!(status.counters.doubted_frames, 0);
    assert_eq!(status.clock, ClockSource::Emulated);
    println!("{status:?}");
    assert!(
        (1_000..8_192 - 1_536).contains(&status.stack_bytes),
        "{}",
        status.stack_bytes
    );
}

#[test]
fn a_crash_is_reported_with_what_the_emulator_wrote() {
    let mut elf = image::read(image::elf());
    let sections = image::sections(&elf);
    let vectors = sections
        .iter()
        .find(|section| section.name == ".vector_table")
        .unwrap();
    // Reset and hard fault lead to where no memory is: a fault within a fault, which locks the core up.
    for vector in [1, 3] {
        let place = vectors.file_offset.unwrap() + 4 * vector;
        elf[place..place + 4].copy_from_slice(&0x4000_0001_u32.to_le_bytes());
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("crashing");
    std::fs::write(&path, elf).unwrap();
    let setup = Setup {
        name: "unit 7".to_owned(),
        elf: path,
        ..Setup::default()
    };
    let error = Emulator::boot(&setup).unwrap_err().to_string();
    assert!(
        error.starts_with("unit 7: found qemu-system-arm gone") && error.contains("ockup"),
        "{error}"
    );
    assert_eq!(error.lines().count(), 1, "{error}");
}

#[cfg(target_os = "linux")]
fn runs_still(process: u32) -> bool {
    // A zombie has ended.
    let status = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    status
        .rsplit(") ")
        .next()
        .is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z'))
}

/// Only the next test runs this, as a process of its own.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "a part of another test"]
fn parent_that_is_killed() {
    let setup = Setup {
        name: "orphan".to_owned(),
        elf: image::elf().to_owned(),
        ..Setup::default()
    };
    let emulator = Emulator::boot(&setup).unwrap();
    println!("\nemulator {}", emulator.process_id());
    std::thread::sleep(Duration::from_secs(60));
}

#[cfg(target_os = "linux")]
#[test]
fn no_emulator_outlives_its_parent() {
    use std::io::{BufRead, BufReader};
    let setup = Setup {
        name: "child".to_owned(),
        elf: image::elf().to_owned(),
        ..Setup::default()
    };
    let emulator = Emulator::boot(&setup).unwrap();
    let process = emulator.process_id();
    assert!(runs_still(process));
    drop(emulator);
    assert!(!runs_still(process), "dropped");

    let mut parent = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "parent_that_is_killed", "--ignored", "--nocapture"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(parent.stdout.take().unwrap()).lines();
    let process = lines
        .map_while(Result::ok)
        .find_map(|line| line.strip_prefix("emulator ")?.parse().ok())
        .expect("the parent boots an emulator");
    assert!(runs_still(process));
    parent.kill().unwrap();
    parent.wait().unwrap();
    let deadline = Instant::now() + Duration::from_secs(10);
    while runs_still(process) {
        assert!(
            Instant::now() < deadline,
            "the emulator outlives its killed parent"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}
