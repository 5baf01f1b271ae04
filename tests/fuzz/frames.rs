//! The unit's line: frames whose checksum is right and whose fields are anybody's, ticks, and noise.
//!
//! An input is a list of steps: a length and so many bytes of fields, which are sealed as a modem would; a length of 0 is a tick of the
//! clock, one of 255 makes the next byte come as it is.

#[path = "../../firmware/tests/flash.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod flash;

use assignment::Result;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use firmware::decision::POWER_CEILING;
use firmware::image_store::{Exchange, ImageStore};
use firmware::link::{
    CHUNK_LEN, MAX_FRAME, MeasurementFrame, ModemFrame, UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table::CHECKSUM;
use firmware::table_store::{Key, SLOT_LEN, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use firmware::units::MAX_SUB_CHANNELS;
use flash::ChipFlash;
use rand_pcg::Pcg64Mcg;
use std::path::Path;
use system_tests::random_measurement;
use system_tests::signing::{TEST_SECRET, image_package, package};
use system_tests::table_builder::Contents;

const TICK: u8 = 0;
const RAW: u8 = 255;

/// The version of the image that runs, and of the only other one that was ever signed.
const IMAGES: [u32; 2] = [4, 5];

/// The version of the only table that was ever signed.
const TABLE: u32 = 3;

/// The unit's two stores, as its image hands updates to them.
struct Stores {
    tables: TableStore<ChipFlash>,
    images: ImageStore<Room, BootLoader>,
}

/// Flash of which the first sector is somebody else's.
struct Room(ChipFlash);

impl ErrorType for Room {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Room {
    const READ_SIZE: usize = ChipFlash::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> std::result::Result<(), NorFlashErrorKind> {
        self.0.read(offset + SLOT_LEN as u32, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity() - SLOT_LEN
    }
}

impl NorFlash for Room {
    const WRITE_SIZE: usize = ChipFlash::WRITE_SIZE;
    const ERASE_SIZE: usize = SLOT_LEN;

    fn erase(&mut self, from: u32, to: u32) -> std::result::Result<(), NorFlashErrorKind> {
        self.0.erase(from + SLOT_LEN as u32, to + SLOT_LEN as u32)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> std::result::Result<(), NorFlashErrorKind> {
        self.0.write(offset + SLOT_LEN as u32, bytes)
    }
}

/// A boot loader that does what it is asked.
struct BootLoader;

impl Exchange for BootLoader {
    fn is_on_trial(&mut self) -> Option<bool> {
        Some(false)
    }

    fn exchange_at_next_start(&mut self) -> Option<()> {
        Some(())
    }

    fn keep(&mut self) -> Option<()> {
        Some(())
    }
}

/// Lets a unit live through an input: it may answer a slot once, with a decision that is legal.
pub fn run(scene: &Path) -> Result<()> {
    let input =
        std::fs::read(scene.join("frames.bin")).map_err(|source| kit::error::Error::file(scene, source))?;
    let mut session = Session::new(Unit::new(DISTILLED, Identity(7)));
    let mut stores = Stores {
        tables: TableStore::boot(ChipFlash::new(), Key::BUILT_IN, DISTILLED),
        images: ImageStore::boot(Room(ChipFlash::new()), BootLoader, Key::BUILT_IN, IMAGES[0]),
    };
    let (mut answered, mut rest) = (None, input.as_slice());
    while let Some((&length, after)) = rest.split_first() {
        rest = after;
        match length {
            TICK => {
                let request = session.tick();
                take(request, &mut stores, &mut answered);
            }
            RAW => {
                if let Some((&byte, after)) = rest.split_first() {
                    rest = after;
                    let request = session.byte(byte);
                    take(request, &mut stores, &mut answered);
                }
            }
            length => {
                let (fields, after) = rest.split_at(rest.len().min(length.into()));
                rest = after;
                for byte in sealed(fields) {
                    let request = session.byte(byte);
                    take(request, &mut stores, &mut answered);
                }
            }
        }
        let _restart = session.timer_restart();
        if let Some(window) = session.full_window() {
            let _judged = stores.tables.judge(&window);
            stores.images.prove();
        }
    }
    Ok(())
}

/// Checks an answer, and hands on what is the store's.
fn take(request: Option<Request>, stores: &mut Stores, answered: &mut Option<u32>) {
    match request {
        None | Some(Request::Status(_)) => {
            let _status = stores.tables.status();
        }
        Some(Request::Answer(UnitMessage::Decision(decision))) => {
            assert_ne!(*answered, Some(decision.slot), "one slot twice in succession");
            *answered = Some(decision.slot);
            assert!(decision.state <= 3);
            if let Some((sub_channel, power)) = decision.transmit {
                assert!(usize::from(sub_channel) < MAX_SUB_CHANNELS);
                assert!(power <= POWER_CEILING.to_bits());
            }
        }
        Some(Request::Answer(message)) => {
            assert!(matches!(message, UnitMessage::Hello { .. }), "{message:?}")
        }
        Some(Request::Update(step)) => {
            let (answer, signed) = if stores.images.concerns(&step) {
                (stores.images.step(&step), IMAGES[1])
            } else {
                stores.images.abandon();
                (stores.tables.step(&step), TABLE)
            };
            if let UpdateAnswer::Stored { version } = answer {
                assert_eq!(version, signed, "only one package of each kind was ever signed");
            }
        }
    }
}

/// Fields under a checksum that fits, as they go over the line.
fn sealed(fields: &[u8]) -> Vec<u8> {
    let plain = [fields, &CHECKSUM.checksum(fields).to_le_bytes()].concat();
    let mut wire = vec![0; cobs::max_encoding_length(plain.len())];
    let length = cobs::encode(&plain, &mut wire);
    wire.truncate(length);
    wire.push(0);
    wire
}

/// A frame as a step of an input.
fn step(frame: &ModemFrame) -> Vec<u8> {
    let mut wire: Vec<u8> = encode(frame).unwrap().to_vec();
    let _delimiter = wire.pop();
    let fields = cobs::decode_in_place(&mut wire).unwrap() - 4;
    assert!(fields < MAX_FRAME && fields < usize::from(RAW));
    [&[fields as u8], &wire[..fields]].concat()
}

/// A drive with everything that a modem says, and a table and an image over the air.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut rng = Pcg64Mcg::new(1);
    let mut drive = Vec::new();
    for slot in 100..140 {
        let measured = MeasurementFrame::from(&random_measurement(&mut rng, slot));
        let frame = match slot % 8 {
            5 => ModemFrame::Missed { slot },
            6 => {
                drive.push(TICK);
                continue;
            }
            _ => ModemFrame::Measurement(measured),
        };
        drive.extend(step(&frame));
    }
    for frame in [
        ModemFrame::Status,
        ModemFrame::Identity { number: 9 },
        ModemFrame::SlotLength { microseconds: 1_000 },
    ] {
        drive.extend(step(&frame));
    }
    let table = Contents::random(1, &[firmware::observation::INPUTS, firmware::decision::ACTIONS]).bytes();
    let table = package(&table, TABLE, &TEST_SECRET);
    let image = image_package(&[0x5a; 200], IMAGES[1], &TEST_SECRET);
    let begin = |length: usize| UpdateFrame::Begin {
        length: length as u32,
    };
    let begin_image = |length: usize| UpdateFrame::BeginImage {
        length: length as u32,
    };
    vec![
        drive,
        update(begin(table.len()), &table),
        update(begin_image(image.len()), &image),
    ]
}

/// All steps of an update.
fn update(begin: UpdateFrame, package: &[u8]) -> Vec<u8> {
    let mut steps = step(&ModemFrame::Update(begin));
    for (index, chunk) in package.chunks(CHUNK_LEN).enumerate() {
        let mut bytes = [0; CHUNK_LEN];
        bytes[..chunk.len()].copy_from_slice(chunk);
        let offset = (CHUNK_LEN * index) as u32;
        steps.extend(step(&ModemFrame::Update(UpdateFrame::Chunk { offset, bytes })));
    }
    steps.extend(step(&ModemFrame::Update(UpdateFrame::Commit)));
    steps
}
