//! The deployed image, built as its users build it.

use object::{Object, ObjectSection, ObjectSymbol, SectionKind};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const TARGET: &str = "thumbv7em-none-eabihf";

fn workspace() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Where `memory.x` puts the stack.
pub const STACK: u64 = 0x2000_0000;
/// How much it gives it.
pub const STACK_LENGTH: usize = 8 << 10;

/// The image's ELF file, built once for each test program.
///
/// It has a target directory of its own: the outer Cargo holds the lock of the usual one while tests run.
///
/// # Panics
/// If the build fails, with Cargo's own words.
pub fn elf() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| build("release", "firmware", &[]))
}

/// The same with logging over RTT.
///
/// # Panics
/// If the build fails, with Cargo's own words.
pub fn elf_with_defmt() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| build("defmt", "firmware", &["--features", "defmt"]))
}

/// The image that links only if it cannot panic.
///
/// # Panics
/// If the build fails, with the linker's own words.
pub fn proof_elf() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| build("proof", "no-panic-proof", &["--features", "no-panic-proof"]))
}

/// The image that the boot loader starts, of version 7.
///
/// # Panics
/// If the build fails, with Cargo's own words.
pub fn renewable_elf() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| build("renewable", "renewable", &["--features", "image-update"]))
}

/// The boot loader.
///
/// # Panics
/// If the build fails, with Cargo's own words.
pub fn boot_loader_elf() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| build("boot-loader", "boot-loader", &["--features", "image-update"]))
}

/// Builds a variant and keeps it under its own name. Variants share what they depend on, so one directory serves them all;
/// the lock keeps another test program from building its variant over this one before it is copied.
fn build(name: &str, program: &str, arguments: &[&str]) -> PathBuf {
    // A test program lies in TARGET/PROFILE/deps, wherever the caller has put TARGET.
    let test_program = std::env::current_exe().unwrap();
    let directory = test_program.ancestors().nth(3).unwrap().join("image");
    std::fs::create_dir_all(&directory).unwrap();
    let lock = std::fs::File::create(directory.join("variants.lock")).unwrap();
    lock.lock().unwrap();
    let output = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args([
            "build",
            "-p",
            "firmware",
            "--bin",
            program,
            "--profile",
            "firmware",
            "--target",
            TARGET,
        ])
        .args(arguments)
        .arg("--target-dir")
        .arg(&directory)
        // The tests sign with the test key.
        .env_remove("FRESHLANE_TABLE_KEY")
        .env("FRESHLANE_IMAGE_VERSION", "7")
        .current_dir(workspace())
        .output()
        .unwrap_or_else(|error| panic!("cargo does not start: {error}"));
    assert!(
        output.status.success(),
        "the image does not build (`rustup target add {TARGET}` if the target is missing):\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let built = directory.join(TARGET).join("firmware").join(program);
    // Under another program's eyes the old copy must stay whole: replace it in one step.
    let (fresh, path) = (directory.join(format!("{name}.new")), directory.join(name));
    std::fs::copy(&built, &fresh)
        .and_then(|_| std::fs::rename(&fresh, &path))
        .unwrap();
    path
}

/// The image's bytes.
///
/// # Panics
/// If the file cannot be read.
pub fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A section as it lies in memory.
#[derive(Clone, Debug)]
pub struct Section {
    /// Its name.
    pub name: String,
    /// Its address when the image runs.
    pub address: u64,
    /// Its length in memory.
    pub length: u64,
    /// Its contents; empty for zeroed memory.
    pub contents: Vec<u8>,
    /// Where its contents begin in the file.
    pub file_offset: Option<usize>,
    /// Code, read-only data, data or zeroed memory.
    pub kind: SectionKind,
}

/// The sections that take memory on the chip.
///
/// # Panics
/// If the file is no ELF.
pub fn sections(elf: &[u8]) -> Vec<Section> {
    let file = object::File::parse(elf).unwrap_or_else(|error| panic!("no ELF: {error}"));
    file.sections()
        .filter(|section| section.address() != 0 && section.size() != 0)
        .map(|section| Section {
            name: section.name().unwrap_or("?").to_owned(),
            address: section.address(),
            length: section.size(),
            contents: section.data().unwrap_or(&[]).to_vec(),
            file_offset: section.file_range().map(|(offset, _)| offset as usize),
            kind: section.kind(),
        })
        .collect()
}

/// The names of all symbols, as the linker knows them.
///
/// # Panics
/// If the file is no ELF.
pub fn symbols(elf: &[u8]) -> Vec<String> {
    let file = object::File::parse(elf).unwrap_or_else(|error| panic!("no ELF: {error}"));
    file.symbols()
        .filter_map(|symbol| symbol.name().ok().map(str::to_owned))
        .collect()
}

/// Where in the file the built-in table begins. The linker keeps no symbol for it, so it is found by its bytes.
///
/// # Panics
/// If the table is not in read-only memory exactly once.
pub fn table_offset(elf: &[u8]) -> usize {
    let table = firmware::tables::DISTILLED;
    let offsets: Vec<usize> = sections(elf)
        .iter()
        .filter_map(|section| Some((section, section.file_offset?)))
        .flat_map(|(section, start)| {
            let windows = section.contents.windows(table.len());
            let found = windows.enumerate().filter(|(_, window)| *window == table);
            found.map(move |(offset, _)| start + offset).collect::<Vec<_>>()
        })
        .collect();
    let [offset] = offsets.as_slice() else {
        panic!(
            "the built-in table of {} bytes is in the image {} times, expected once",
            table.len(),
            offsets.len()
        );
    };
    *offset
}
