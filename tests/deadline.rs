//! What a slot costs, pinned: bars that must hold, and golden numbers that a change must own up to.
//!
//! After a wanted change, `BLESS=1 cargo test -p system-tests --test deadline` writes the new numbers; say why in
//! CHANGELOG.md.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use firmware::tables::DISTILLED;
use host_sim::command::deadline::as_json;
use host_sim::deadline::cycles::AROUND_INFERENCE;
use host_sim::deadline::{Extent, Images, STEPS, report};
use host_sim::image::Image;

const EXTENT: Extent = Extent {
    seed: 1,
    // One in 16 has no measurement: well over 100,000 observations.
    slots: 110_000,
    sub_channels: 3,
    inputs: 500,
};

/// A number of the report, by how much it may differ from its golden value in percent, and the most it may be at all.
/// Instructions of the kernel itself are exact (`kernel.rs`); what the compiler makes of the rest moves a little with every
/// change of the sources.
const PINNED: [(&str, u64, u64); 9] = [
    ("inference_min_instructions", 1, 2_446),
    ("inference_max_instructions", 1, 2_446),
    ("slot_min_instructions", 10, 5_500),
    ("slot_max_instructions", 5, 5_500),
    ("net_7_64_32_4_instructions", 1, 3_100),
    ("net_7_1024_512_4_instructions", 1, 420_000),
    ("flash_bytes", 15, 64 << 10),
    ("ram_bytes", 5, 7 << 10),
    ("stack_bytes", 15, 8 << 10),
];

#[test]
fn a_slot_costs_what_is_claimed() {
    let images = Images::build(|_| {}).unwrap_or_else(|error| panic!("{error}"));
    let table = Table::parse(DISTILLED).unwrap();
    let mut steps = 0;
    let report = report(&images, &EXTENT, &table, |_| steps += 1).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(steps, STEPS);
    let json = as_json(&report, &EXTENT);
    for network in [&report.actor, &report.small, &report.paper] {
        let kernel = network.counts.kernel;
        assert_eq!(kernel.min, kernel.max, "{}", network.name);
    }
    let lines: Vec<String> = PINNED
        .iter()
        .map(|(key, ..)| format!("{key} {}\n", json[key]))
        .collect();
    let found = lines.concat();
    print!("{found}");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/deadline.txt");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(path, &found).unwrap();
    }
    let golden = std::fs::read_to_string(path).unwrap();
    assert_eq!(golden.lines().count(), PINNED.len(), "{path}");
    for ((key, percent, most), line) in PINNED.iter().zip(golden.lines()) {
        let value = json[key].as_u64().unwrap();
        let golden: u64 = line.strip_prefix(key).unwrap().trim().parse().unwrap();
        assert!(
            value.abs_diff(golden) * 100 <= golden * percent,
            "{key}: found {value}, golden {golden}, tolerance {percent} %; see this file for how to bless a wanted change"
        );
        assert!(value <= *most, "{key}: found {value}, at most {most}");
    }

    // Where it can be counted; the bars are `whole_slot.py`'s.
    for key in [
        "slot_with_interrupts_max_instructions",
        "slot_with_interrupts_exceptions",
        "slot_with_interrupts_max_cycles",
    ] {
        let counted = &json[key];
        println!("{key} {counted}");
        assert!(
            counted.is_null() == report.whole_slot.is_none()
                && (counted.is_null() || counted.as_u64() > Some(0)),
            "{key}"
        );
    }

    // Another table comes parsed, so the slot in which it does hardly takes longer.
    let activation = &json["stages"]["activation"]["max_instructions"];
    println!("activation {activation}");
    assert!(
        (1..=2_000).contains(&activation.as_u64().unwrap()),
        "{activation}"
    );

    // What export adds to an inference without an emulator.
    let around = report.slot.max - report.actor.counts.kernel.max;
    assert!(
        around < AROUND_INFERENCE && 5 * around > 3 * AROUND_INFERENCE,
        "{around}"
    );

    // What is no image for the chip, or the wrong one of the two, is refused before anything runs.
    let text = Image::read(path.as_ref()).unwrap_err().to_string();
    assert!(
        text.ends_with("found no ELF file, expected the ELF file of an image for the STM32F405"),
        "{text}"
    );
    let program = std::env::current_exe().unwrap();
    let text = Image::read(&program).unwrap_err().to_string();
    assert!(text.contains("found a program for another processor"), "{text}");
    let text = Images::read(system_tests::image::elf(), system_tests::image::elf())
        .unwrap_err()
        .to_string();
    assert!(text.contains("found another program"), "{text}");
}
