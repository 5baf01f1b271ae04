//! The boot loader and the image that it starts, as far as QEMU's flash goes: it is read and never written. What the flash does to an
//! exchange, `firmware/tests/image_store.rs` has.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::link::{CHUNK_LEN, ModemFrame, Refusal, UpdateAnswer, UpdateFrame, encode};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table::Table;
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use host_sim::image::{Image, RENEWABLE};
use rand_pcg::Pcg64Mcg;
use std::path::Path;
use std::time::Duration;
use system_tests::qemu::Qemu;
use system_tests::{image, random_measurement};
use trainer::signing::TableKey;

const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// The boot loader's state, sector 4.
const STATE: u32 = 0x0801_0000;
/// What embassy-boot writes there when images are to be exchanged.
const EXCHANGE: [u8; 4] = [0xf0; 4];

fn renewable() -> Image {
    Image::read(image::renewable_elf()).unwrap()
}

/// The boot loader with the image behind it, and its state.
fn start(state: &[u8], folder: &Path) -> Qemu {
    let image = renewable();
    let mut files = Vec::new();
    // QEMU's blank flash reads 0.
    let mut sector = vec![0xff; 64 << 10];
    sector[..state.len()].copy_from_slice(state);
    for (address, bytes) in [(RENEWABLE as u32, image.flash()), (STATE, &sector)] {
        let path = folder.join(format!("{address:x}"));
        std::fs::write(&path, bytes).unwrap();
        files.push((address, path));
    }
    Qemu::boot_with(image::boot_loader_elf(), files)
}

fn step(unit: &mut Qemu, step: UpdateFrame) -> UpdateAnswer {
    unit.send(&encode(&ModemFrame::Update(step)).unwrap());
    unit.receive_update(ANSWER_LIMIT).0
}

#[test]
fn the_image_behind_the_boot_loader_answers_as_the_library_does() {
    let folder = tempfile::tempdir().unwrap();
    let mut unit = start(&[], folder.path());
    let mut library = Session::new(Unit::new(DISTILLED, Identity::of_device([0; 3])));
    let mut rng = Pcg64Mcg::new(5);
    for slot in 0..300 {
        let measurement = random_measurement(&mut rng, slot);
        let frame = encode(&ModemFrame::Measurement((&measurement).into())).unwrap();
        unit.send(&frame);
        let expected = frame.iter().find_map(|&byte| library.byte(byte));
        let found = unit.receive(ANSWER_LIMIT).unwrap();
        assert_eq!(
            expected,
            Some(Request::Answer(firmware::link::UnitMessage::Decision(found)))
        );
    }
    let status = unit.status(ANSWER_LIMIT);
    assert_eq!((status.image.version, status.image.on_trial), (7, false));
    assert_eq!(status.table.checksum, Table::parse(DISTILLED).unwrap().checksum());

    // A signed image of a version that is not newer, and one whose bytes the flash does not take.
    let key = TableKey::test();
    let package = key.sign_image(&renewable()).unwrap();
    let length = package.len() as u32;
    let mut answer = step(&mut unit, UpdateFrame::BeginImage { length });
    for bytes in package.as_chunks::<CHUNK_LEN>().0.iter().take(4) {
        let UpdateAnswer::Continue { offset } = answer else {
            panic!("{answer:?}")
        };
        answer = step(
            &mut unit,
            UpdateFrame::Chunk {
                offset,
                bytes: *bytes,
            },
        );
    }
    assert_eq!(answer, UpdateAnswer::Refused(Refusal::Version));
    assert_eq!(
        step(&mut unit, UpdateFrame::Begin { length: 3_000 }),
        UpdateAnswer::Continue { offset: 0 },
        "tables as ever"
    );
    unit.assert_stack_is_within_budget();
}

#[test]
fn an_exchange_that_the_flash_does_not_make_leaves_the_image_running() {
    let folder = tempfile::tempdir().unwrap();
    let mut unit = start(&EXCHANGE, folder.path());
    assert!(unit.status(ANSWER_LIMIT).image.on_trial);
    assert_eq!(
        step(&mut unit, UpdateFrame::BeginImage { length: 60_000 }),
        UpdateAnswer::Refused(Refusal::OnTrial)
    );
}

#[test]
fn an_image_that_stands_alone_takes_no_other() {
    let mut unit = Qemu::boot(image::elf());
    assert_eq!(
        step(&mut unit, UpdateFrame::BeginImage { length: 60_000 }),
        UpdateAnswer::Refused(Refusal::NoBootLoader)
    );
    let text = TableKey::test()
        .sign_image(&Image::read(image::elf()).unwrap())
        .unwrap_err();
    assert!(
        text.to_string()
            .contains("found an image that stands alone, expected one that a boot loader starts"),
        "{text}"
    );
}
