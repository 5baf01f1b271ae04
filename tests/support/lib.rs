//! What the checks across crates share: the deployed image, an emulator to run it in, tables to run it with.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

pub mod browser;
pub mod chips;
pub mod image;
#[path = "../../firmware/tests/noise.rs"]
pub mod noise;
pub mod qemu;
pub mod schema;
#[path = "../../firmware/tests/signing.rs"]
pub mod signing;
#[path = "../../firmware/tests/table_builder.rs"]
pub mod table_builder;

pub use noise::below;

use firmware::measurement::{Broadcast, Measurement, Place, Readings};
use firmware::ring::{MAX_PLACES, Open, Ring};
use firmware::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannels, Weight};
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

/// A valid measurement of `slot` in a cell of any number of sub-channels.
pub fn random_measurement(rng: &mut impl Rng, slot: u32) -> Measurement {
    let count = 1 + below(rng, MAX_SUB_CHANNELS as u32);
    random_measurement_on(rng, slot, count as usize)
}

/// A valid measurement of `slot` in a cell of so many sub-channels, spread over everything that it brings: gains from -10 to 70 dB (and now
/// and then any level at all), interference up to 40 dB, every age, place and threshold.
///
/// # Panics
/// If there is no such cell.
pub fn random_measurement_on(rng: &mut impl Rng, slot: u32, sub_channels: usize) -> Measurement {
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
        _ => Some(1 + below(rng, 100)),
    };
    let gain: Vec<Level> = (0..sub_channels).map(|_| level(rng, -10, 70)).collect();
    let interference: Vec<Level> = (0..sub_channels).map(|_| level(rng, 0, 40)).collect();
    let least = sub_channels as u32;
    let most = if wild { u32::from(MAX_PLACES) + 1 } else { 60 };
    let places = least + below(rng, most - least);
    let place = (below(rng, 4) > 0).then(|| Place {
        index: below(rng, places) as u16,
        assigned: below(rng, 2) == 0,
    });
    Measurement::new(&Readings {
        slot: SlotIndex(slot),
        gain: &gain,
        interference: &interference,
        last_acknowledged: acknowledged.map(|slots| SlotIndex(slot.wrapping_sub(slots))),
        place,
        weight: Weight(below(rng, 256) as u8),
        awaits_acknowledgement: below(rng, 4) == 0,
        broadcast: Broadcast {
            ring: Ring::new(places as u16, SubChannels::new(sub_channels).unwrap()).unwrap(),
            open: Open(below(rng, 1 << 16) as u16),
            // Priorities are below 2^27.
            threshold: rng.next_u32() >> below(rng, 32),
            salt: below(rng, 256) as u8,
            gains_hold: below(rng, 2) == 0,
            max_power: Dbm::from_bits(below(rng, 40 << 8) as i16),
        },
    })
    .unwrap()
}
