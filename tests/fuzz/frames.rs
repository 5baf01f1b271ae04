//! The unit's line: frames whose checksum is right and whose fields are anybody's, ticks, and noise.
//!
//! An input is a list of steps: a length and so many bytes of fields, which are sealed as a modem would; a length of 0 is a tick of the
//! clock, one of 255 makes the next byte come as it is.

#[path = "../../firmware/tests/flash.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod flash;

use assignment::Result;
use firmware::decision::POWER_CEILING;
use firmware::link::{
    MAX_FRAME, MeasurementFrame, ModemFrame, UnitMessage, UpdateAnswer, UpdateFrame, encode,
};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::table::CHECKSUM;
use firmware::table_store::{Key, TableStore};
use firmware::tables::DISTILLED;
use firmware::unit::Unit;
use firmware::units::MAX_SUB_CHANNELS;
use flash::ChipFlash;
use rand_pcg::Pcg64Mcg;
use std::path::Path;
use system_tests::random_measurement;
use system_tests::signing::{TEST_SECRET, package};
use system_tests::table_builder::Contents;

const TICK: u8 = 0;
const RAW: u8 = 255;

/// Lets a unit live through an input: it may answer a slot once, with a decision that is legal.
pub fn run(scene: &Path) -> Result<()> {
    let input =
        std::fs::read(scene.join("frames.bin")).map_err(|source| kit::error::Error::file(scene, source))?;
    let mut session = Session::new(Unit::new(DISTILLED, Identity(7)));
    let mut store = TableStore::boot(ChipFlash::new(), Key::BUILT_IN, DISTILLED);
    let (mut answered, mut rest) = (None, input.as_slice());
    while let Some((&length, after)) = rest.split_first() {
        rest = after;
        match length {
            TICK => {
                let request = session.tick();
                take(request, &mut store, &mut answered);
            }
            RAW => {
                if let Some((&byte, after)) = rest.split_first() {
                    rest = after;
                    let request = session.byte(byte);
                    take(request, &mut store, &mut answered);
                }
            }
            length => {
                let (fields, after) = rest.split_at(rest.len().min(length.into()));
                rest = after;
                for byte in sealed(fields) {
                    let request = session.byte(byte);
                    take(request, &mut store, &mut answered);
                }
            }
        }
        let _restart = session.timer_restart();
        if let Some(window) = session.full_window() {
            let _judged = store.judge(&window);
        }
    }
    Ok(())
}

/// Checks an answer, and hands on what is the store's.
fn take(request: Option<Request>, store: &mut TableStore<ChipFlash>, answered: &mut Option<u32>) {
    match request {
        None | Some(Request::Status(_)) => {
            let _status = store.status();
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
            if let UpdateAnswer::Stored { version } = store.step(&step) {
                assert_eq!(version, 3, "only one package was ever signed");
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

/// A drive with everything that a modem says, and a table over the air.
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
    let package = package(&table, 3, &TEST_SECRET);
    let mut update = step(&ModemFrame::Update(UpdateFrame::Begin {
        length: package.len() as u32,
    }));
    for (index, chunk) in package.chunks(32).enumerate() {
        let mut bytes = [0; 32];
        bytes[..chunk.len()].copy_from_slice(chunk);
        let offset = 32 * index as u32;
        update.extend(step(&ModemFrame::Update(UpdateFrame::Chunk { offset, bytes })));
    }
    update.extend(step(&ModemFrame::Update(UpdateFrame::Commit)));
    vec![drive, update]
}
