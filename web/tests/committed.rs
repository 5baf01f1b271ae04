//! The committed page: built from these sources, and small.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::Write;
use std::path::Path;

fn page() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/page"))
}

#[test]
fn the_program_is_built_from_the_sources_beside_it() {
    let program = fs::read(page().join("freshlane.wasm")).unwrap();
    let sources = freshlane_web::SOURCES.as_bytes();
    assert!(
        program.windows(sources.len()).any(|window| window == sources),
        "web/page/freshlane.wasm is not built from '{}': run web/build and commit it",
        freshlane_web::SOURCES
    );
}

#[test]
fn the_page_is_below_two_megabytes_compressed() {
    let mut archive = GzEncoder::new(Vec::new(), Compression::best());
    for entry in fs::read_dir(page()).unwrap() {
        archive
            .write_all(&fs::read(entry.unwrap().path()).unwrap())
            .unwrap();
    }
    let bytes = archive.finish().unwrap().len();
    println!("{bytes} bytes compressed");
    assert!((10_000..2_000_000).contains(&bytes), "{bytes} bytes");
}
