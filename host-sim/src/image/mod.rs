//! Programs for the STM32F405: building them, and what their ELF files say.

pub mod build;

use kit::error::{Error, Result};
use object::{Architecture, Object, ObjectSection, ObjectSymbol, SectionKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The chip's flash (`memory.x`).
const FLASH: Range<u64> = 0x0800_0000..0x0810_0000;
/// The chip's RAM (`memory.x`).
const RAM: Range<u64> = 0x2000_0000..0x2002_0000;

/// A whole program for this chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    path: PathBuf,
    footprint: Footprint,
    symbols: Vec<(String, u64)>,
}

/// What an image takes of the chip's memories, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Code, constants, the table, and what initialises RAM.
    pub flash: u64,
    /// Static variables.
    pub ram: u64,
    /// Addresses that the stack has, down from the end: to the static variables below it, or to the beginning of RAM.
    pub stack: Range<u64>,
}

impl Image {
    /// Reads and checks an ELF file.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, [`Error::Input`] if it is no whole program for this chip.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|source| Error::file(path, source))?;
        let wrong = |found: &str| {
            let expected = "the ELF file of an image for the STM32F405";
            Error::input(path.display(), found, expected)
        };
        let file = object::File::parse(bytes.as_slice()).map_err(|_| wrong("no ELF file"))?;
        if file.architecture() != Architecture::Arm {
            return Err(wrong("a program for another processor"));
        }
        let footprint = footprint(&file).ok_or_else(|| wrong("no vector table at the start of flash"))?;
        let symbols = file.symbols();
        let symbols = symbols.filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address())));
        Ok(Self {
            path: path.to_owned(),
            footprint,
            symbols: symbols.collect(),
        })
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it takes of the chip's memories.
    pub fn footprint(&self) -> &Footprint {
        &self.footprint
    }

    /// The address of the first symbol whose mangled name holds this one.
    ///
    /// # Errors
    /// [`Error::Input`] if there is none: this is another program than the one `expected` names.
    pub fn address(&self, name: &str, expected: &str) -> Result<u64> {
        let found = self.symbols.iter().find(|(symbol, _)| symbol.contains(name));
        found
            .map(|(_, address)| *address)
            .ok_or_else(|| Error::input(self.path.display(), "another program", expected))
    }
}

/// `None` for a file whose first words are no vector table.
fn footprint(file: &object::File<'_>) -> Option<Footprint> {
    let sections = || file.sections().filter(|section| section.address() != 0);
    let vectors = sections()
        .find(|section| section.name() == Ok(".vector_table") && section.address() == FLASH.start)?
        .data()
        .ok()?;
    let stack_start = u64::from(u32::from_le_bytes(*vectors.first_chunk()?));
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
    Some(Footprint {
        flash: total(&|address, kind| FLASH.contains(&address) || kind == SectionKind::Data),
        ram: total(&|address, _| RAM.contains(&address)),
        stack,
    })
}
