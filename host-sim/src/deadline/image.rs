//! The programs for the chip: building them, and what their ELF files say.

use crate::hil::image::build_firmware;
use kit::error::{Error, Result};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};
use std::path::{Path, PathBuf};

/// The chip's flash (`memory.x`).
const FLASH: std::ops::Range<u64> = 0x0800_0000..0x0810_0000;
/// The chip's RAM (`memory.x`).
pub const RAM: std::ops::Range<u64> = 0x2000_0000..0x2002_0000;

/// The two programs.
#[derive(Clone, Debug)]
pub struct Images {
    /// The one that is flashed.
    pub deployed: PathBuf,
    /// The one that counts instructions, in the emulator.
    pub measuring: PathBuf,
}

impl Images {
    /// Builds both with the profile of the deployed image, where the sources are.
    ///
    /// They have a target directory of their own, since an outer Cargo may hold the lock of the usual one.
    ///
    /// # Errors
    /// If Cargo is missing or the build fails, with its first error.
    pub fn build() -> Result<Self> {
        let workspace = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
        let usual = std::env::var_os("CARGO_TARGET_DIR").map_or(workspace.join("target"), PathBuf::from);
        let directory = usual.join("measure");
        let directory = directory.display().to_string();
        let programs = build_firmware(&[
            "--bins",
            "--features",
            "measure",
            "--target-dir",
            directory.as_str(),
        ])?;
        let program = |name: &str| {
            let found = programs
                .iter()
                .find(|path| path.file_name().is_some_and(|file| file == name));
            found
                .cloned()
                .ok_or_else(|| Error::input("cargo build -p firmware", "no program", name))
        };
        Ok(Self {
            deployed: program("firmware")?,
            measuring: program("measure")?,
        })
    }
}

/// What an image takes of the chip's memories, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Code, constants, the table, and what initialises RAM.
    pub flash: u64,
    /// Static variables.
    pub ram: u64,
    /// Addresses that the stack has, down from the end: to the static variables below it, or to the beginning of RAM.
    pub stack: std::ops::Range<u64>,
}

/// Reads and checks an ELF file for this chip.
///
/// # Errors
/// A file that cannot be read, and one that is not a whole program for this chip.
pub fn footprint(path: &Path) -> Result<Footprint> {
    let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
    let wrong = |found: &str| {
        Error::input(
            path.display(),
            found,
            "the ELF file of an image for the STM32F405",
        )
    };
    let file = object::File::parse(&*bytes).map_err(|_| wrong("no ELF file"))?;
    if file.architecture() != object::Architecture::Arm {
        return Err(wrong("a program for another processor"));
    }
    let sections = || file.sections().filter(|section| section.address() != 0);
    let vectors = sections()
        .find(|section| section.name() == Ok(".vector_table") && section.address() == FLASH.start)
        .and_then(|section| section.data().ok());
    let Some((stack_start, _)) = vectors.and_then(<[u8]>::split_first_chunk) else {
        return Err(wrong("no vector table at the start of flash"));
    };
    let stack_start = u64::from(u32::from_le_bytes(*stack_start));
    let below = sections()
        .map(|section| section.address() + section.size())
        .filter(|end| RAM.contains(end) && *end <= stack_start);
    let stack = below.max().unwrap_or(RAM.start)..stack_start;
    let total = |wanted: &dyn Fn(u64, SectionKind) -> bool| -> u64 {
        sections()
            .filter(|section| wanted(section.address(), section.kind()))
            .map(|section| section.size())
            .sum()
    };
    Ok(Footprint {
        flash: total(&|address, kind| FLASH.contains(&address) || kind == SectionKind::Data),
        ram: total(&|address, _| RAM.contains(&address)),
        stack,
    })
}

/// Checks that an image is the measuring one: another would run for ever and say nothing.
///
/// # Errors
/// As [`footprint`], and for an image that does not measure.
pub fn check_measuring(path: &Path) -> Result<()> {
    let _ = footprint(path)?;
    let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
    let measures = object::File::parse(&*bytes).is_ok_and(|file| {
        file.symbols()
            .any(|symbol| symbol.name().is_ok_and(|name| name.contains("7measure")))
    });
    if measures {
        Ok(())
    } else {
        Err(Error::input(
            path.display(),
            "another program",
            "the image `measure` of the package `firmware`",
        ))
    }
}
