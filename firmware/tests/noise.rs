//! What may come over a bad line instead of a frame.

use firmware::table::CHECKSUM;
use rand_core::Rng;

/// The kind of a measurement, and the bytes before its levels (`firmware/src/link/measurement.rs`).
const MEASUREMENT: u8 = 6;
const FIXED: usize = 25;

/// Bytes that are hardly ever a frame: meaningless ones, meaningless fields (of these kinds of frames and one that there is not) under a
/// checksum that fits, and a good frame with a bit flipped, its beginning lost, or bytes between.
pub fn noise(rng: &mut impl Rng, good: &[u8], kinds: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; below(rng, 60) as usize];
    rng.fill_bytes(&mut bytes);
    let mut wire = good.to_vec();
    let position = below(rng, wire.len() as u32 - 1) as usize;
    match below(rng, 5) {
        0 => return bytes,
        1 => {
            bytes.truncate(50);
            if let Some(kind) = bytes.first_mut() {
                *kind = kinds
                    .get(usize::from(*kind) % (kinds.len() + 1))
                    .copied()
                    .unwrap_or(0x46);
            }
            // Otherwise hardly any would have the length of its number of sub-channels.
            if let [MEASUREMENT, count, flags, ..] = bytes.as_mut_slice()
                && *flags & 0x80 == 0
            {
                (*count, *flags) = (*count % 7, *flags & 0x1f);
                let length = FIXED + 4 * usize::from(*count);
                bytes.resize(length, 0x11);
            }
            return sealed(&bytes);
        }
        2 => wire[position] ^= 1 << below(rng, 8),
        3 => drop(wire.drain(..=position)),
        _ => wire.splice(position..position, bytes).for_each(drop),
    }
    wire
}

/// Uniform on `0..limit`, to within 2^-32.
pub fn below(rng: &mut impl Rng, limit: u32) -> u32 {
    ((u64::from(rng.next_u32()) * u64::from(limit)) >> 32) as u32
}

/// Fields under a checksum that fits, stuffed and without a delimiter.
fn sealed(fields: &[u8]) -> Vec<u8> {
    let plain = [fields, &CHECKSUM.checksum(fields).to_le_bytes()].concat();
    let mut wire = vec![0; plain.len() + 2];
    let length = cobs::encode(&plain, &mut wire);
    wire.truncate(length);
    wire
}
