//! Images over the air with the real boot loader's rules: what is refused, and what a power cut leaves, at every word that is written and
//! every step of an erase, in the unit and in the boot loader.

#[path = "../src/board/boot_state.rs"]
mod boot_state;

use crate::signing::{TEST_SECRET, image_package, package};
use boot_state::BootState;
use embassy_boot::{BootLoader, BootLoaderConfig, State};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use firmware::image_store::ImageStore;
use firmware::link::{CHUNK_LEN, Refusal, UpdateAnswer, UpdateFrame};
use firmware::table_store::package::HEADER_LEN;
use firmware::table_store::{Key, MAX_ERASES};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;

/// A small chip: an image of two sectors makes every turn of the exchange happen.
const SECTOR: usize = 256;
const WORD: usize = 4;
/// Bytes that one step of an erase clears before the power may fail.
const ERASE_STEP: usize = 64;
const ACTIVE: Range<usize> = 0..2 * SECTOR;
const ROOM: Range<usize> = ACTIVE.end..ACTIVE.end + 3 * SECTOR;
const STATE: Range<usize> = ROOM.end..ROOM.end + SECTOR;

/// What words and erase steps change, until the power fails.
#[derive(Clone, Debug)]
struct Memory {
    bytes: Vec<u8>,
    operations: u32,
    fails_at: Option<u32>,
    erases: u32,
    rng: Pcg64Mcg,
}

impl Memory {
    /// A failing operation changes an arbitrary part of the bits, and then the power is off.
    fn operate(&mut self, place: usize, target: &[u8]) -> Result<(), NorFlashErrorKind> {
        if self.fails_at.is_some_and(|fails| self.operations >= fails) {
            return Err(NorFlashErrorKind::Other);
        }
        self.operations += 1;
        let cut = self.fails_at == Some(self.operations);
        for (byte, target) in self.bytes[place..].iter_mut().zip(target) {
            let done = if cut { self.rng.next_u32() as u8 } else { 0xff };
            *byte = (*byte & !done) | (target & done);
        }
        if cut {
            Err(NorFlashErrorKind::Other)
        } else {
            Ok(())
        }
    }
}

type Chip = Rc<RefCell<Memory>>;

/// A part of the chip's flash.
#[derive(Clone, Debug)]
struct Part(Chip, Range<usize>);

impl ErrorType for Part {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Part {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let part = &self.0.borrow().bytes[self.1.clone()];
        bytes.copy_from_slice(&part[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.1.len()
    }
}

impl NorFlash for Part {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        assert!(
            from.is_multiple_of(SECTOR as u32)
                && to.is_multiple_of(SECTOR as u32)
                && to as usize <= self.1.len()
        );
        let mut memory = self.0.borrow_mut();
        memory.erases += 1;
        (from as usize..to as usize)
            .step_by(ERASE_STEP)
            .try_for_each(|offset| memory.operate(self.1.start + offset, &[0xff; ERASE_STEP]))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        assert!((offset as usize).is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD));
        let mut memory = self.0.borrow_mut();
        for (index, word) in bytes.chunks(WORD).enumerate() {
            let place = self.1.start + offset as usize + WORD * index;
            // Programming clears bits and sets none.
            let before = memory.bytes[place..place + WORD].to_vec();
            let target: Vec<u8> = before
                .iter()
                .zip(word)
                .map(|(before, bits)| before & bits)
                .collect();
            memory.operate(place, &target)?;
        }
        Ok(())
    }
}

/// An image as it lies in flash: its version is its first bytes.
fn image(version: u32) -> Vec<u8> {
    let mut bytes = vec![0; 2 * SECTOR - 12];
    Pcg64Mcg::new(u128::from(version)).fill_bytes(&mut bytes);
    bytes[..4].copy_from_slice(&version.to_le_bytes());
    bytes
}

/// A chip that runs version 1.
fn chip() -> Chip {
    let mut bytes = vec![0xff; STATE.end];
    let old = image(1);
    bytes[..old.len()].copy_from_slice(&old);
    Rc::new(RefCell::new(Memory {
        bytes,
        operations: 0,
        fails_at: None,
        erases: 0,
        rng: Pcg64Mcg::new(7),
    }))
}

fn part(chip: &Chip, range: Range<usize>) -> Part {
    Part(chip.clone(), range)
}

/// The boot loader's turn.
fn start(chip: &Chip) -> Option<State> {
    let mut loader = BootLoader::new(BootLoaderConfig {
        active: part(chip, ACTIVE),
        dfu: part(chip, ROOM),
        state: part(chip, STATE),
    });
    loader.prepare_boot(&mut [0; 32]).ok()
}

/// The running image's version, and whether it is on trial.
fn status(chip: &Chip) -> (u32, bool) {
    (active(chip).unwrap(), unit(chip).is_on_trial())
}

/// The version that would run, if the image of it is whole.
fn active(chip: &Chip) -> Option<u32> {
    let bytes = &chip.borrow().bytes[ACTIVE];
    let version = u32::from_le_bytes(*bytes.first_chunk().unwrap());
    let whole = image(version);
    bytes.starts_with(&whole).then_some(version)
}

type Store = ImageStore<Part, BootState<Part>>;

/// The unit's turn.
fn unit(chip: &Chip) -> Store {
    let version = active(chip).unwrap();
    ImageStore::boot(
        part(chip, ROOM),
        BootState(part(chip, STATE)),
        Key::BUILT_IN,
        version,
    )
}

fn chunk(package: &[u8], offset: u32) -> UpdateFrame {
    let rest = &package[offset as usize..];
    let mut bytes = [0x5a; CHUNK_LEN];
    bytes[..rest.len().min(CHUNK_LEN)].copy_from_slice(&rest[..rest.len().min(CHUNK_LEN)]);
    UpdateFrame::Chunk { offset, bytes }
}

/// Sends a package as a modem would; the answer to the commit, or the first refusal.
fn update(store: &mut Store, package: &[u8]) -> UpdateAnswer {
    let length = package.len() as u32;
    let mut answer = store.step(&UpdateFrame::BeginImage { length });
    while let UpdateAnswer::Continue { offset } = answer {
        let step = if offset >= length {
            UpdateFrame::Commit
        } else {
            chunk(package, offset)
        };
        answer = store.step(&step);
        assert_eq!(store.concerns(&step), !matches!(answer, UpdateAnswer::Refused(_)));
    }
    answer
}

fn renewed(version: u32) -> Vec<u8> {
    image_package(&image(version), version, &TEST_SECRET)
}

#[test]
fn an_image_is_exchanged_tried_and_kept_or_taken_back() {
    let chip = chip();
    let mut store = unit(&chip);
    assert_eq!(status(&chip), (1, false));
    assert_eq!(
        update(&mut store, &renewed(2)),
        UpdateAnswer::Stored { version: 2 }
    );
    // Its answer was lost.
    assert_eq!(
        store.step(&UpdateFrame::Commit),
        UpdateAnswer::Stored { version: 2 }
    );
    assert_eq!(active(&chip), Some(1), "nothing happens before the start");

    assert_eq!(start(&chip), Some(State::Swap));
    assert_eq!(status(&chip), (2, true));
    // A start before it has proved itself.
    let _ = start(&chip);
    assert_eq!(status(&chip), (1, false));

    assert_eq!(
        update(&mut unit(&chip), &renewed(2)),
        UpdateAnswer::Stored { version: 2 }
    );
    let _ = start(&chip);
    let mut store = unit(&chip);
    assert_eq!(
        update(&mut store, &renewed(3)),
        UpdateAnswer::Refused(Refusal::OnTrial),
        "the room holds what a start would bring back"
    );
    store.prove();
    assert!(!store.is_on_trial());
    let _ = start(&chip);
    let mut store = unit(&chip);
    assert_eq!(status(&chip), (2, false));
    assert_eq!(
        update(&mut store, &renewed(2)),
        UpdateAnswer::Refused(Refusal::Version)
    );
    assert_eq!(
        update(&mut store, &renewed(3)),
        UpdateAnswer::Stored { version: 3 }
    );
}

#[test]
fn what_is_not_wanted_erases_nothing() {
    let chip = chip();
    let mut store = unit(&chip);
    let good = renewed(2);
    let refused = |store: &mut Store, package: &[u8]| match update(store, package) {
        UpdateAnswer::Refused(refusal) => refusal,
        other => panic!("{other:?}"),
    };
    let other_key = image_package(&image(2), 2, &[0x43; 32]);
    assert_eq!(refused(&mut store, &other_key), Refusal::Signature);
    assert_eq!(
        refused(&mut store, &package(&image(2), 2, &TEST_SECRET)),
        Refusal::Header,
        "a table's"
    );
    assert_eq!(refused(&mut store, &renewed(1)), Refusal::Version);
    assert_eq!(refused(&mut store, &good[..good.len() - 1]), Refusal::Length);
    let long = image_package(&vec![0; 2 * SECTOR + 1], 2, &TEST_SECRET);
    assert_eq!(refused(&mut store, &long), Refusal::Length);
    let longest = UpdateFrame::BeginImage {
        length: long.len() as u32 - 1,
    };
    assert_eq!(store.step(&longest), UpdateAnswer::Continue { offset: 0 });
    store.abandon();
    assert_eq!(refused(&mut store, &good[..HEADER_LEN]), Refusal::Length);
    for step in [
        UpdateFrame::Commit,
        chunk(&good, 0),
        UpdateFrame::Begin { length: 500 },
    ] {
        assert_eq!(store.step(&step), UpdateAnswer::Refused(Refusal::NotBegun));
    }
    assert_eq!(chip.borrow().erases, 0);

    let _ = store.step(&UpdateFrame::BeginImage {
        length: good.len() as u32,
    });
    assert_eq!(
        store.step(&UpdateFrame::Commit),
        UpdateAnswer::Refused(Refusal::Incomplete)
    );
    let mut other = good.clone();
    *other.last_mut().unwrap() ^= 1;
    assert_eq!(refused(&mut store, &other), Refusal::Digest);
    assert_eq!(chip.borrow().erases, 2);
    let erases = |store: &mut Store| {
        std::iter::repeat_with(|| refused(store, &other)).find(|&why| why != Refusal::Digest)
    };
    assert_eq!(erases(&mut store), Some(Refusal::Worn));
    assert_eq!(chip.borrow().erases, u32::from(MAX_ERASES));
    let _ = start(&chip);
    assert_eq!(active(&chip), Some(1));
}

/// The power comes back, if it had failed.
fn is_back(chip: &Chip) -> bool {
    let mut memory = chip.borrow_mut();
    let failed = memory.fails_at.is_some_and(|at| memory.operations >= at);
    if failed {
        memory.fails_at = None;
    }
    failed
}

/// Starts until an image runs, and gives its version.
fn running(chip: &Chip) -> u32 {
    let _ = start(chip);
    if is_back(chip) {
        start(chip).unwrap();
    }
    let version = active(chip);
    version
        .filter(|version| [1, 2].contains(version))
        .expect("a whole image")
}

/// An update and what follows, with the power failing at one operation of all; whether it failed.
fn play(package: &[u8], fails_at: u32, proves_itself: bool) -> bool {
    let chip = chip();
    chip.borrow_mut().fails_at = Some(fails_at);
    let _ = update(&mut unit(&chip), package);
    let _ = is_back(&chip);
    if running(&chip) == 1 {
        // In the update, or behind the last word of the exchange: then the image has had its start.
        assert!(
            chip.borrow().fails_at.is_none(),
            "without a failure an update comes"
        );
        assert_eq!(
            update(&mut unit(&chip), package),
            UpdateAnswer::Stored { version: 2 }
        );
        assert_eq!(running(&chip), 2, "another try succeeds");
    }
    let mut store = unit(&chip);
    if proves_itself {
        store.prove();
        let kept = !store.is_on_trial();
        let _ = is_back(&chip);
        assert!(running(&chip) == 2 || !kept, "what was kept stays");
    } else {
        assert!(store.is_on_trial());
        assert_eq!(running(&chip), 1, "what has not proved itself goes");
    }
    chip.borrow().fails_at.is_none()
}

#[test]
fn power_that_fails_at_any_word_leaves_a_whole_image() {
    let package = renewed(2);
    for proves_itself in [true, false] {
        let cuts = (1..)
            .take_while(|&cut| play(&package, cut, proves_itself))
            .count();
        println!("{cuts} places, proves itself: {proves_itself}");
        assert!(cuts > 400, "{cuts}");
    }
}
