//! What the checks across crates share: the deployed image, an emulator to run it in, tables to run it with.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

pub mod browser;
pub mod image;
#[path = "../../firmware/tests/noise.rs"]
pub mod noise;
pub mod qemu;
#[path = "../../firmware/tests/signing.rs"]
pub mod signing;
#[path = "../../firmware/tests/table_builder.rs"]
pub mod table_builder;

pub use noise::below;

use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, JoinerProbability, Level, Period, SlotIndex, SubChannel};
use rand_core::Rng;
use std::path::PathBuf;

/// Where a program of the workspace lies. Cargo builds all of them before the tests of a whole workspace; it holds its lock while
/// tests run, so they cannot be built from here.
///
/// # Panics
/// If it is not built: a check that cannot run has failed.
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let path = test.ancestors().nth(2).unwrap().join(name);
    assert!(
        path.exists(),
        "{} is missing: cargo build -p {name}",
        path.display()
    );
    path
}

/// A valid measurement of `slot`, spread over everything that a cell brings: gains from -10 to 70 dB (and now and then any
/// level at all), interference up to 40 dB, every age, home and period.
pub fn random_measurement(rng: &mut impl Rng, slot: u32) -> Measurement {
    let wild = below(rng, 16) == 0;
    let level = |rng: &mut _, lowest: i32, highest: i32| {
        let (lowest, highest) = if wild {
            (lowest.min(0) * 12, i32::from(i16::MAX) / 256)
        } else {
            (lowest, highest)
        };
        let span = (highest - lowest).unsigned_abs() * 256;
        let bits = lowest * 256 + below(rng, span).cast_signed();
        Level::from_bits(bits.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16)
    };
    let acknowledged = match below(rng, 10) {
        0 => None,
        1 => Some(1 + below(rng, 100_000)),
        _ => Some(1 + below(rng, u32::from(Age::MAX.slots()))),
    };
    let broadcast = Broadcast {
        home: SubChannel::new(below(rng, 3) as u8).unwrap(),
        period: Period::new(1 + below(rng, 30) as u8).unwrap(),
        joiner_probability: JoinerProbability::from_code(below(rng, 256) as u8),
    };
    let gain = std::array::from_fn(|_| level(rng, -10, 70));
    let interference = std::array::from_fn(|_| level(rng, 0, 40));
    Measurement::new(
        SlotIndex(slot),
        gain,
        interference,
        acknowledged.map(|slots| SlotIndex(slot.wrapping_sub(slots))),
        broadcast,
    )
    .unwrap()
}
