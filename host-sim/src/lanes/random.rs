//! Random numbers of many worlds at once: every lane is the keyed ChaCha8 stream of its world, word for word
//! ([`crate::stream`]).
//!
//! ChaCha8 because it is the product's generator already: a counter under a key, so streams of different keys need no
//! argument to be independent, and additions, rotations and exclusive ors alone, which every vector unit has. A draw costs
//! about 26 vector operations.

use super::{LANES, Row};
use crate::stream::{Role, WorldKey};

/// "expand 32-byte k" (D. Bernstein, ChaCha, a variant of Salsa20, 2008).
const CONSTANTS: [u32; 4] = [0x6170_7865, 0x3320_646e, 0x7962_2d32, 0x6b20_6574];

const DOUBLE_ROUNDS: usize = 4;

/// Words of a block.
const BLOCK: usize = 16;

/// Lanes that are worked on together: the widest vectors' length.
const PART: usize = 16;

/// One stream a lane.
#[derive(Clone, Debug)]
pub struct LaneStream {
    /// `[word][lane]`.
    key: [Row<u32>; 8],
    /// Of the next block, the same in all lanes.
    counter: u64,
    /// The present block.
    words: [Row<u32>; BLOCK],
    /// Words of it that were handed out.
    used: usize,
}

impl LaneStream {
    /// The streams of up to [`LANES`] worlds for one role. Lanes without a world have a stream that means nothing.
    pub fn new(keys: impl Iterator<Item = WorldKey>, role: Role, member: u32) -> Self {
        let mut key = [[0; LANES]; 8];
        for (lane, world) in keys.take(LANES).enumerate() {
            let bytes = world.bytes(role, member);
            for (row, word) in key.iter_mut().zip(bytes.as_chunks::<4>().0) {
                row[lane] = u32::from_le_bytes(*word);
            }
        }
        Self {
            key,
            counter: 0,
            words: [[0; LANES]; BLOCK],
            used: BLOCK,
        }
    }

    /// The next word of every lane's stream.
    #[inline(always)]
    pub fn next_row(&mut self) -> &Row<u32> {
        if self.used == BLOCK {
            self.next_block();
        }
        self.used += 1;
        &self.words[self.used - 1]
    }

    #[inline(always)]
    fn next_block(&mut self) {
        let counter = [self.counter as u32, (self.counter >> 32) as u32, 0, 0];
        // Part of a row at a time, so that all sixteen words stay in registers.
        for part in 0..LANES / PART {
            let first = part * PART;
            let mut words = [[0; PART]; BLOCK];
            for word in 0..4 {
                words[word] = [CONSTANTS[word]; PART];
                words[12 + word] = [counter[word]; PART];
            }
            for word in 0..8 {
                words[4 + word].copy_from_slice(&self.key[word][first..first + PART]);
            }
            for _ in 0..DOUBLE_ROUNDS {
                quarter_round::<0, 4, 8, 12>(&mut words);
                quarter_round::<1, 5, 9, 13>(&mut words);
                quarter_round::<2, 6, 10, 14>(&mut words);
                quarter_round::<3, 7, 11, 15>(&mut words);
                quarter_round::<0, 5, 10, 15>(&mut words);
                quarter_round::<1, 6, 11, 12>(&mut words);
                quarter_round::<2, 7, 8, 13>(&mut words);
                quarter_round::<3, 4, 9, 14>(&mut words);
            }
            for (row, words) in self.words.iter_mut().zip(&words) {
                row[first..first + PART].copy_from_slice(words);
            }
        }
        for word in 0..4 {
            add(&mut self.words[word], &[CONSTANTS[word]; LANES]);
            add(&mut self.words[12 + word], &[counter[word]; LANES]);
        }
        for word in 0..8 {
            add(&mut self.words[4 + word], &self.key[word]);
        }
        self.counter += 1;
        self.used = 0;
    }
}

#[inline(always)]
fn add(row: &mut Row<u32>, other: &Row<u32>) {
    for lane in 0..LANES {
        row[lane] = row[lane].wrapping_add(other[lane]);
    }
}

#[inline(always)]
fn quarter_round<const A: usize, const B: usize, const C: usize, const D: usize>(
    words: &mut [[u32; PART]; BLOCK],
) {
    let (mut a, mut b, mut c, mut d) = (words[A], words[B], words[C], words[D]);
    for lane in 0..PART {
        a[lane] = a[lane].wrapping_add(b[lane]);
        d[lane] = (d[lane] ^ a[lane]).rotate_left(16);
        c[lane] = c[lane].wrapping_add(d[lane]);
        b[lane] = (b[lane] ^ c[lane]).rotate_left(12);
        a[lane] = a[lane].wrapping_add(b[lane]);
        d[lane] = (d[lane] ^ a[lane]).rotate_left(8);
        c[lane] = c[lane].wrapping_add(d[lane]);
        b[lane] = (b[lane] ^ c[lane]).rotate_left(7);
    }
    (words[A], words[B], words[C], words[D]) = (a, b, c, d);
}

/// A word as a number in (0, 1): an odd multiple of 2^-24.
#[inline(always)]
pub fn unit_interval(word: u32) -> f32 {
    ((word >> 8) | 1) as i32 as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Purpose;
    use rand_core::Rng;

    #[test]
    fn every_lane_is_its_world_s_stream() {
        let keys = (0..LANES as u64).map(|world| WorldKey {
            seed: 0x0123_4567_89ab_cdef,
            purpose: Purpose::Training,
            world: world * 977,
        });
        let mut lanes = LaneStream::new(keys.clone(), Role::Identities, 5);
        let mut streams: Vec<_> = keys.map(|key| key.stream(Role::Identities, 5)).collect();
        for _ in 0..100 {
            let expected: Vec<u32> = streams.iter_mut().map(Rng::next_u32).collect();
            assert_eq!(lanes.next_row().as_slice(), expected);
        }
    }
}
