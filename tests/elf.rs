//! The image as it will be flashed: where it lies, what it takes, what it must not contain.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::tables::DISTILLED;
use object::SectionKind;
use system_tests::image::{STACK, STACK_LENGTH, Section, elf, proof_elf, read, sections, symbols};

const FLASH: std::ops::Range<u64> = 0x0800_0000..0x0810_0000;
const RAM: std::ops::Range<u64> = 0x2000_0000..0x2002_0000;

/// Most flash that the image may take with its table: 64 KiB of 1 MiB, so the limit guards against accidents (formatting, a
/// second copy of the table), not against the chip.
const FLASH_BUDGET: u64 = 64 << 10;
/// Most RAM with the whole stack.
const RAM_BUDGET: u64 = 16 << 10;
/// Most bytes of a built-in table.
const TABLE_BUDGET: usize = 8 << 10;
/// Where tables that came over the air lie, and their record: sectors 1 to 3 (RM0090 table 5).
const TABLE_STORE: std::ops::Range<u64> = 0x0800_4000..0x0801_0000;

fn word(section: &Section, index: usize) -> u32 {
    let bytes = &section.contents[4 * index..4 * index + 4];
    u32::from_le_bytes(bytes.try_into().unwrap())
}

#[test]
fn the_chip_finds_stack_and_entry() {
    let sections = sections(&read(elf()));
    let vectors = sections
        .iter()
        .find(|section| section.name == ".vector_table")
        .expect("no vector table: the image is empty");
    assert_eq!(
        vectors.address, FLASH.start,
        "the chip reads its vectors at the start of flash"
    );
    assert_eq!(
        u64::from(word(vectors, 0)),
        STACK + STACK_LENGTH as u64,
        "the stack grows down to the bottom of RAM, below the statics"
    );
    let reset = word(vectors, 1);
    assert_eq!(reset & 1, 1, "the reset vector {reset:#x} lacks the Thumb bit");
    let code = sections
        .iter()
        .find(|section| section.kind == SectionKind::Text)
        .expect("no code");
    assert!(
        (code.address..code.address + code.length).contains(&u64::from(reset & !1)),
        "the reset vector {reset:#x} is outside the code"
    );
    // USART1 is interrupt 37 (RM0090 table 62), after 16 vectors of the core's own.
    let (line, next) = (word(vectors, 16 + 37), word(vectors, 16 + 38));
    assert_ne!(
        line, next,
        "the serial line's interrupt has no handler of its own"
    );
}

#[test]
fn flash_and_ram_are_within_budget() {
    let sections = sections(&read(elf()));
    let total = |wanted: &dyn Fn(&Section) -> bool| -> u64 {
        sections
            .iter()
            .filter(|section| wanted(section))
            .map(|section| section.length)
            .sum()
    };
    let flash = total(&|section| FLASH.contains(&section.address) || section.kind == SectionKind::Data);
    let statics = total(&|section| RAM.contains(&section.address));
    let ram = statics + STACK_LENGTH as u64;
    println!(
        "flash {flash} bytes with a table of {}, RAM {ram} bytes, {statics} of them statics",
        DISTILLED.len()
    );
    assert!(
        flash > 4 << 10,
        "{flash} bytes of flash cannot be the whole image"
    );
    assert!(
        flash <= FLASH_BUDGET,
        "{flash} bytes of flash, budget {FLASH_BUDGET}"
    );
    assert!(ram <= RAM_BUDGET, "{ram} bytes of RAM, budget {RAM_BUDGET}");
    assert!(
        DISTILLED.len() <= TABLE_BUDGET,
        "a table of {} bytes, budget {TABLE_BUDGET}",
        DISTILLED.len()
    );
    for section in &sections {
        let end = section.address + section.length;
        assert!(
            (FLASH.contains(&section.address) && end <= FLASH.end)
                || (RAM.contains(&section.address) && end <= RAM.end),
            "{} at {:#x} is in neither memory",
            section.name,
            section.address
        );
    }
}

#[test]
fn the_image_leaves_the_table_slots_and_the_stack_alone() {
    for section in sections(&read(elf())) {
        let range = section.address..section.address + section.length;
        let touches = |other: &std::ops::Range<u64>| range.start < other.end && other.start < range.end;
        assert!(!touches(&TABLE_STORE), "{} lies in the table store", section.name);
        // An overflowing stack leaves RAM at its lower end, where nothing is mapped; it never reaches the statics above.
        assert!(
            !touches(&(STACK..STACK + STACK_LENGTH as u64)),
            "{} lies in the stack",
            section.name
        );
    }
    assert_eq!(STACK, RAM.start);
}

#[test]
fn an_image_with_the_test_key_says_so() {
    let image = read(elf());
    let says = |text: &str| image.windows(text.len()).any(|window| window == text.as_bytes());
    assert!(says("table key: TEST, not for release"));
    assert!(!says("table key: release"));
}

#[test]
fn the_decision_path_links_without_a_panic() {
    let proof = symbols(&read(proof_elf()));
    for fragment in ["9panicking", "13unwrap_failed", "__rust_alloc", "__rdl_"] {
        let found: Vec<_> = proof.iter().filter(|name| name.contains(fragment)).collect();
        assert!(found.is_empty(), "the proof image has {found:?}");
    }
}

#[test]
fn the_image_does_not_allocate_or_compute_in_double_precision() {
    let symbols = symbols(&read(elf()));
    assert!(
        symbols.iter().any(|name| name == "USART1"),
        "the image has lost its symbols"
    );
    for (fragment, what) in [
        ("__rust_alloc", "allocates"),
        ("__rust_realloc", "allocates"),
        ("__rust_dealloc", "allocates"),
        ("__rdl_", "allocates"),
        ("__aeabi_dadd", "computes in f64"),
        ("__aeabi_dmul", "computes in f64"),
        ("__aeabi_ddiv", "computes in f64"),
    ] {
        let found: Vec<_> = symbols.iter().filter(|name| name.contains(fragment)).collect();
        assert!(found.is_empty(), "the image {what}: {found:?}");
    }
}
