//! Programs for the STM32F405: building them, and what their ELF files say.

pub mod build;

use kit::error::{Error, Result};
use object::elf::FileHeader32;
use object::read::elf::{ElfFile, ProgramHeader};
use object::{Architecture, Endianness, Object, ObjectSection, ObjectSymbol, SectionKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The chip's flash (`memory.x`).
const FLASH: Range<u64> = 0x0800_0000..0x0810_0000;
/// The chip's RAM (`memory.x`).
const RAM: Range<u64> = 0x2000_0000..0x2002_0000;

/// Where a boot loader starts a program (`maps/renewable/flash.x` of the package `firmware`).
pub const RENEWABLE: u64 = 0x0802_0000;

/// A whole program for this chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    path: PathBuf,
    footprint: Footprint,
    start: u64,
    flash: Vec<u8>,
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
        let file = ElfFile::<FileHeader32<Endianness>>::parse(bytes.as_slice()).map_err(|_| {
            // Of 64 bits, for example.
            match object::File::parse(bytes.as_slice()) {
                Ok(_) => wrong("a program for another processor"),
                Err(_) => wrong("no ELF file"),
            }
        })?;
        if file.architecture() != Architecture::Arm {
            return Err(wrong("a program for another processor"));
        }
        let (start, footprint) =
            footprint(&file).ok_or_else(|| wrong("no vector table at the start of flash"))?;
        let symbols = file.symbols();
        let symbols = symbols.filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address())));
        Ok(Self {
            path: path.to_owned(),
            footprint,
            start,
            flash: flash(&file, start)
                .ok_or_else(|| wrong("parts that are not in the file, or not in flash"))?,
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

    /// Where it begins in flash: at its beginning, or at [`RENEWABLE`].
    pub fn start(&self) -> u64 {
        self.start
    }

    /// What lies in flash, from [`Image::start`] on.
    pub fn flash(&self) -> &[u8] {
        &self.flash
    }

    /// The version that its build named; 0 if it named none.
    ///
    /// # Errors
    /// [`Error::Input`] for a program that holds none.
    pub fn version(&self) -> Result<u32> {
        let expected = "an image of the package `firmware`, which holds its version";
        let address = self.address("IMAGE_VERSION", expected)?;
        let place = address.checked_sub(self.start).map(|place| place as usize);
        let bytes = place.and_then(|place| self.flash.get(place..)?.first_chunk());
        bytes
            .map(|bytes| u32::from_le_bytes(*bytes))
            .ok_or_else(|| Error::input(self.path.display(), "a version outside flash", expected))
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

type Elf<'a> = ElfFile<'a, FileHeader32<Endianness>>;

/// What lies in flash from `start` on; erased bytes where nothing does.
fn flash(file: &Elf<'_>, start: u64) -> Option<Vec<u8>> {
    let mut flash = Vec::new();
    for part in file.elf_program_headers() {
        let data = part.data(file.endian(), file.data()).ok()?;
        if part.p_type(file.endian()) != object::elf::PT_LOAD || data.is_empty() {
            continue;
        }
        let address = u64::from(part.p_paddr(file.endian()));
        let first = usize::try_from(address.checked_sub(start)?).ok()?;
        let end = first + data.len();
        if !FLASH.contains(&(start + end as u64)) {
            return None;
        }
        if flash.len() < end {
            flash.resize(end, 0xff);
        }
        flash[first..end].copy_from_slice(data);
    }
    Some(flash)
}

/// Where the vector table is, and what the program takes. `None` for a file without one.
fn footprint(file: &Elf<'_>) -> Option<(u64, Footprint)> {
    let sections = || file.sections().filter(|section| section.address() != 0);
    let vectors = sections().find(|section| section.name() == Ok(".vector_table"))?;
    let start = vectors.address();
    if start != FLASH.start && start != RENEWABLE {
        return None;
    }
    let vectors = vectors.data().ok()?;
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
    let footprint = Footprint {
        flash: total(&|address, kind| FLASH.contains(&address) || kind == SectionKind::Data),
        ram: total(&|address, _| RAM.contains(&address)),
        stack,
    };
    Some((start, footprint))
}
