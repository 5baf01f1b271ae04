//! The library on processors that the image is not for: programs that link with their own memory maps and answer recorded frames as the host
//! does, byte for byte, in QEMU.
//!
//! After a wanted change of frames or decisions, `BLESS=1 cargo test -p system-tests --test any_chip recorded` records anew; say why in
//! CHANGELOG.md.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::link::{ModemFrame, encode};
use firmware::lots::Identity;
use firmware::session::{Request, Session};
use firmware::slot_clock::SlotLength;
use firmware::tables::DISTILLED;
use firmware::unit::{MAX_MISSED, Unit};
use object::{Object, ObjectSegment, ObjectSymbol};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{OnceLock, mpsc};
use std::time::Duration;
use system_tests::{below, chips, image, random_measurement_on};

/// Slots in the recording.
const SLOTS: u32 = 600;
/// For the next bytes of an answer; a loaded machine needs seconds to start an emulator.
const ANSWER_LIMIT: Duration = Duration::from_secs(60);
/// For bytes that must not come.
const SILENCE: Duration = Duration::from_millis(200);

/// A processor, the machine that has it, and its programs.
struct Chip {
    target: &'static str,
    qemu: &'static [&'static str],
    code: Range<u64>,
    ram: Range<u64>,
    dsp_extension: bool,
    /// The program on Embassy, which has a serial line and a timer; `bare` is there for each.
    embassy: Option<&'static str>,
}

const CHIPS: [Chip; 5] = [
    Chip {
        target: "thumbv6m-none-eabi",
        qemu: &["qemu-system-arm", "-machine", "microbit"],
        code: 0..256 << 10,
        ram: 0x2000_0000..0x2000_4000,
        dsp_extension: false,
        embassy: Some("cortex-m0"),
    },
    Chip {
        target: "thumbv7m-none-eabi",
        qemu: &["qemu-system-arm", "-machine", "mps2-an385"],
        code: 0..4 << 20,
        ram: 0x2000_0000..0x2001_0000,
        dsp_extension: false,
        embassy: None,
    },
    Chip {
        target: "thumbv7em-none-eabihf",
        qemu: &["qemu-system-arm", "-machine", "mps2-an386"],
        code: 0..4 << 20,
        ram: 0x2000_0000..0x2001_0000,
        dsp_extension: true,
        embassy: None,
    },
    Chip {
        target: "thumbv8m.main-none-eabihf",
        qemu: &["qemu-system-arm", "-machine", "mps2-an505"],
        code: 0x1000_0000..0x1040_0000,
        ram: 0x3800_0000..0x3801_0000,
        dsp_extension: true,
        embassy: Some("cortex-m33"),
    },
    Chip {
        target: "riscv32imc-unknown-none-elf",
        qemu: &["qemu-system-riscv32", "-machine", "sifive_e", "-bios", "none"],
        code: 0x2040_0000..0x2080_0000,
        ram: 0x8000_0000..0x8000_4000,
        dsp_extension: false,
        embassy: Some("riscv32"),
    },
];

impl Chip {
    /// The ELF file of a program for it.
    fn elf(&self, program: &str) -> PathBuf {
        built().join(self.target).join("release").join(program)
    }

    fn programs(&self) -> impl Iterator<Item = &'static str> {
        ["bare"].into_iter().chain(self.embassy)
    }
}

/// Where the programs are, once they are built.
fn built() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let targets = CHIPS.iter().map(|chip| chip.target);
        // All targets in one go: they keep all cores busy.
        chips::build("bare", targets);
        for chip in &CHIPS {
            if let Some(program) = chip.embassy {
                chips::build(program, [chip.target].into_iter());
            }
        }
        chips::directory()
    })
}

/// What a modem sends: long slots, a number, and then slots of all kinds on a line that is not clean.
fn record() -> Vec<u8> {
    let wire = |frame: &ModemFrame| encode(frame).unwrap().to_vec();
    // Nothing is overdue on a loaded machine, and the lots are not the chip's own.
    let mut bytes = wire(&ModemFrame::SlotLength {
        microseconds: SlotLength::MAX_MICROSECONDS,
    });
    bytes.extend(wire(&ModemFrame::Identity { number: 4_711 }));
    let mut rng = Pcg64Mcg::new(600);
    // Across the index's end, and once long enough without a measurement to be silent.
    let silent = 300..301 + u32::from(MAX_MISSED);
    for index in 0..SLOTS {
        let slot = index.wrapping_sub(100);
        let sub_channels = if index % 20 == 19 {
            1 + below(&mut rng, 8)
        } else {
            3
        };
        let measurement = random_measurement_on(&mut rng, slot, sub_channels as usize);
        let measured = wire(&ModemFrame::Measurement((&measurement).into()));
        if silent.contains(&index) || below(&mut rng, 5) == 0 {
            bytes.extend(wire(&ModemFrame::Missed { slot }));
        } else {
            bytes.extend(&measured);
        }
        if below(&mut rng, 10) == 0 {
            // Too late or damaged: either way it has no answer.
            let mut again = measured;
            let position = below(&mut rng, again.len() as u32 - 1) as usize;
            again[position] ^= 1 << below(&mut rng, 8);
            bytes.extend(again);
        }
    }
    bytes
}

/// What the modem says until an answer is due, and the answer that the host's library gives.
struct Exchange {
    frames: Vec<u8>,
    answer: Vec<u8>,
}

/// The recording as exchanges. What comes behind the last answer has none.
fn exchanges(recorded: &[u8]) -> Vec<Exchange> {
    // The recording tells the unit its number.
    let mut session = Session::new(Unit::new(DISTILLED, Identity(0)));
    let (mut exchanges, mut frames) = (Vec::new(), Vec::new());
    for &byte in recorded {
        frames.push(byte);
        match session.byte(byte) {
            None => {}
            Some(Request::Answer(message)) => exchanges.push(Exchange {
                frames: std::mem::take(&mut frames),
                answer: encode(&message).unwrap().to_vec(),
            }),
            Some(other) => panic!("{other:?}"),
        }
    }
    exchanges.push(Exchange {
        frames,
        answer: Vec::new(),
    });
    exchanges
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(name)
}

#[test]
fn recorded_frames_have_their_recorded_answers() {
    let frames = record();
    let answers: Vec<Vec<u8>> = exchanges(&frames)
        .into_iter()
        .map(|exchange| exchange.answer)
        .collect();
    assert_eq!(answers.len(), SLOTS as usize + 1, "one answer for every slot");
    let answers = answers.concat();
    for (name, bytes) in [("slots.frames", &frames), ("slots.answers", &answers)] {
        if std::env::var_os("BLESS").is_some() {
            std::fs::write(golden(name), bytes).unwrap();
        }
        assert!(
            std::fs::read(golden(name)).unwrap() == *bytes,
            "{name} is not what the library makes of it; see this file for how to record anew after a wanted change"
        );
    }
}

#[test]
fn every_program_links_with_its_own_memory_map() {
    for chip in &CHIPS {
        for program in chip.programs() {
            let bytes = image::read(&chip.elf(program));
            let file = object::File::parse(&*bytes).unwrap();
            let place = format!("{program} for {}", chip.target);
            let mut code = 0;
            for segment in file.segments().filter(|segment| segment.size() > 0) {
                let range = segment.address()..segment.address() + segment.size();
                let inside = |memory: &Range<u64>| memory.start <= range.start && range.end <= memory.end;
                assert!(
                    inside(&chip.code) || inside(&chip.ram),
                    "{place}: {range:#x?} is in neither memory"
                );
                code += u64::from(inside(&chip.code)) * segment.size();
            }
            println!("{place}: {code} bytes of code and constants");
            assert!(
                code > 16 << 10,
                "{place}: {code} bytes cannot be the whole library"
            );
            assert!(
                chip.code.contains(&file.entry()),
                "{place}: begins at {:#x}",
                file.entry()
            );
            let kernel = file
                .symbols()
                .any(|symbol| symbol.name() == Ok("freshlane_hidden_layer"));
            assert_eq!(
                kernel, chip.dsp_extension,
                "{place}: the kernel is there where the processor has the instructions"
            );
        }
    }
}

#[test]
fn the_library_depends_on_portable_crates_alone() {
    let portable: BTreeSet<&str> = [
        "crc",
        "embedded-storage",
        "fixed",
        "heapless",
        "micromath",
        "nalgebra",
        "postcard",
        "rand_core",
        "salty",
        "serde",
    ]
    .into();
    for chip in &CHIPS {
        let direct = chips::dependencies("firmware", chip.target, Some(1));
        assert_eq!(
            direct.iter().map(String::as_str).collect::<BTreeSet<_>>(),
            portable,
            "for {}",
            chip.target
        );
        // What a program must choose by itself.
        let all = chips::dependencies("firmware", chip.target, None);
        for name in [
            "cortex-m",
            "cortex-m-rt",
            "critical-section",
            "portable-atomic",
            "rtic",
            "stm32f4",
            "defmt-rtt",
        ] {
            assert!(
                !all.contains(name),
                "{name} is in the library for {}",
                chip.target
            );
        }
    }
}

/// A running emulator with its standard streams as the line to the modem. Dropping it ends it.
struct Machine {
    process: Child,
    received: mpsc::Receiver<Vec<u8>>,
}

impl Machine {
    fn boot(chip: &Chip, program: &str, serial: &str) -> Self {
        let (name, arguments) = chip.qemu.split_first().unwrap();
        let mut process = Command::new(name)
            .args(arguments)
            .args(["-display", "none", "-monitor", "none", "-serial", serial])
            .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
            .arg(chip.elf(program))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{name} does not start (./test chip installs it): {error}"));
        let (mut output, (sender, received)) = (process.stdout.take().unwrap(), mpsc::channel());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(length @ 1..) = output.read(&mut bytes) {
                if sender.send(bytes[..length].to_vec()).is_err() {
                    break;
                }
            }
        });
        Self { process, received }
    }

    /// Plays the modem, which waits for a slot's answer before the next slot begins.
    fn converse(&mut self, exchanges: &[Exchange], place: &str) {
        let input = self.process.stdin.as_mut().unwrap();
        for (slot, exchange) in exchanges.iter().enumerate() {
            input.write_all(&exchange.frames).unwrap();
            input.flush().unwrap();
            let mut found = Vec::new();
            while found.len() < exchange.answer.len() {
                let bytes = self.received.recv_timeout(ANSWER_LIMIT);
                found.extend(
                    bytes.unwrap_or_else(|_| {
                        panic!("{place}: slot {slot}: {} bytes, then nothing", found.len())
                    }),
                );
            }
            assert!(
                found == exchange.answer,
                "{place}: slot {slot}: found {found:?}, expected {:?}",
                exchange.answer
            );
        }
        let more = self.received.recv_timeout(SILENCE);
        assert!(more.is_err(), "{place}: behind the last answer: {more:?}");
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn every_chip_answers_as_the_host_does() {
    let exchanges = exchanges(&record());
    for chip in &CHIPS {
        // The bare program talks on the console of the emulator, the others on a serial line.
        let serials = [("bare", "null")]
            .into_iter()
            .chain(chip.embassy.map(|program| (program, "stdio")));
        for (program, serial) in serials {
            let place = format!("{program} on {}", chip.qemu[2]);
            let begin = std::time::Instant::now();
            Machine::boot(chip, program, serial).converse(&exchanges, &place);
            println!("{place}: {SLOTS} slots, {:.1} s", begin.elapsed().as_secs_f64());
        }
    }
}
