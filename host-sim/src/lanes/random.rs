//! Random numbers of many worlds at once: every lane is the keyed ChaCha8 stream of its world, word for word
//! ([`crate::stream`]).
//!
//! ChaCha8 because it is the product's generator already: a counter under a key, so streams of different keys need no
//! argument to be independent, and additions, rotations and exclusive ors alone, which every vector unit has. A draw costs
//! 26 vector operations where a rotation is one, 35 where it is three.

use super::units::{Kernel, Products, Unit};
use super::{LANES, Row, Vectors};
use crate::stream::{Role, WorldKey};

/// "expand 32-byte k" (D. Bernstein, ChaCha, a variant of Salsa20, 2008).
const CONSTANTS: [i32; 4] = [0x6170_7865, 0x3320_646e, 0x7962_2d32, 0x6b20_6574];

const DOUBLE_ROUNDS: usize = 4;

/// Words of a block.
const BLOCK: usize = 16;

/// One stream a lane.
#[derive(Clone, Debug)]
pub struct LaneStream {
    /// What makes the blocks.
    vectors: Vectors,
    role: Role,
    member: u32,
    /// Lanes with a world.
    lanes: usize,
    /// `[word][lane]`.
    key: [Row<i32>; 8],
    /// Of the next block, the same in all lanes.
    counter: u64,
    /// The present block.
    words: [Row<i32>; BLOCK],
    /// Words of it that were handed out.
    used: usize,
}

impl LaneStream {
    /// The streams of up to [`LANES`] worlds for one role. Lanes without a world have a stream that means nothing.
    pub fn new(keys: impl Iterator<Item = WorldKey>, role: Role, member: u32) -> Self {
        let mut streams = Self {
            vectors: Vectors::widest(),
            role,
            member,
            lanes: 0,
            key: [[0; LANES]; 8],
            counter: 0,
            words: [[0; LANES]; BLOCK],
            used: BLOCK,
        };
        streams.reset(keys);
        streams
    }

    /// The same for worlds by the row.
    pub fn rows(keys: &[WorldKey], role: Role, member: u32) -> Vec<Self> {
        let rows = keys.chunks(LANES);
        rows.map(|keys| Self::new(keys.iter().copied(), role, member))
            .collect()
    }

    /// Goes on with other worlds' streams from their beginning.
    pub fn reset(&mut self, keys: impl Iterator<Item = WorldKey>) {
        (self.lanes, self.counter, self.used) = (0, 0, BLOCK);
        for (lane, world) in keys.take(LANES).enumerate() {
            self.lanes = lane + 1;
            let bytes = world.bytes(self.role, self.member);
            for (row, word) in self.key.iter_mut().zip(bytes.as_chunks::<4>().0) {
                row[lane] = i32::from_le_bytes(*word);
            }
        }
    }

    /// The same for worlds by the row.
    pub fn reset_rows(rows: &mut [Self], keys: &[WorldKey]) {
        for (row, keys) in rows.iter_mut().zip(keys.chunks(LANES)) {
            row.reset(keys.iter().copied());
        }
    }

    /// The next word of every lane's stream.
    #[inline(always)]
    pub fn next_row(&mut self) -> &Row<u32> {
        if self.used == BLOCK {
            self.next_block();
        }
        self.used += 1;
        pulp::bytemuck::cast_ref(&self.words[self.used - 1])
    }

    #[inline(never)]
    fn next_block(&mut self) {
        let counter = [self.counter as i32, (self.counter >> 32) as i32, 0, 0];
        self.vectors.compute(NextBlock {
            lanes: self.lanes,
            key: &self.key,
            counter,
            words: &mut self.words,
        });
        self.counter += 1;
        self.used = 0;
    }
}

/// A block of every lane's stream.
struct NextBlock<'a> {
    lanes: usize,
    key: &'a [Row<i32>; 8],
    counter: [i32; 4],
    words: &'a mut [Row<i32>; BLOCK],
}

impl Kernel for NextBlock<'_> {
    #[inline(always)]
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize, const TWO: bool>(
        self,
        products: P,
    ) {
        let unit = products.unit();
        // A vector of each word at a time, so that all sixteen stay in registers.
        for part in 0..self.lanes.div_ceil(P::Unit::WIDTH) {
            let mut start = [unit.splat(0); BLOCK];
            for word in 0..4 {
                start[word] = unit.splat(CONSTANTS[word]);
                start[12 + word] = unit.splat(self.counter[word]);
            }
            for word in 0..8 {
                start[4 + word] = unit.load(&self.key[word], part);
            }
            let mut words = start;
            for _ in 0..DOUBLE_ROUNDS {
                quarter_round::<_, 0, 4, 8, 12>(unit, &mut words);
                quarter_round::<_, 1, 5, 9, 13>(unit, &mut words);
                quarter_round::<_, 2, 6, 10, 14>(unit, &mut words);
                quarter_round::<_, 3, 7, 11, 15>(unit, &mut words);
                quarter_round::<_, 0, 5, 10, 15>(unit, &mut words);
                quarter_round::<_, 1, 6, 11, 12>(unit, &mut words);
                quarter_round::<_, 2, 7, 8, 13>(unit, &mut words);
                quarter_round::<_, 3, 4, 9, 14>(unit, &mut words);
            }
            for word in 0..BLOCK {
                let sum = unit.add(words[word], start[word]);
                unit.store(&mut self.words[word], part, sum);
            }
        }
    }
}

#[inline(always)]
fn quarter_round<U: Unit, const A: usize, const B: usize, const C: usize, const D: usize>(
    unit: U,
    words: &mut [U::Vector; BLOCK],
) {
    words[A] = unit.add(words[A], words[B]);
    words[D] = unit.rotate::<16, 16>(unit.xor(words[D], words[A]));
    words[C] = unit.add(words[C], words[D]);
    words[B] = unit.rotate::<12, 20>(unit.xor(words[B], words[C]));
    words[A] = unit.add(words[A], words[B]);
    words[D] = unit.rotate::<8, 24>(unit.xor(words[D], words[A]));
    words[C] = unit.add(words[C], words[D]);
    words[B] = unit.rotate::<7, 25>(unit.xor(words[B], words[C]));
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
        for vectors in Vectors::all() {
            let mut lanes = LaneStream::new(keys.clone(), Role::Identities, 5);
            lanes.vectors = vectors;
            let mut streams: Vec<_> = keys.clone().map(|key| key.stream(Role::Identities, 5)).collect();
            for _ in 0..100 {
                let expected: Vec<u32> = streams.iter_mut().map(Rng::next_u32).collect();
                assert_eq!(lanes.next_row().as_slice(), expected, "{}", vectors.name());
            }
        }
    }
}
