//! Without any vector unit's instructions by name: what the others are compared with.

use super::{Products, Unit};
use crate::lanes::Row;
use crate::lanes::dense::{Block, Dense};
use firmware::network::scaled_product;

/// Four lanes.
#[derive(Clone, Copy)]
pub struct Plain;

const WIDTH: usize = 4;

impl Unit for Plain {
    type Vector = [i32; WIDTH];

    const WIDTH: usize = WIDTH;

    #[inline(always)]
    fn splat(self, number: i32) -> Self::Vector {
        [number; WIDTH]
    }

    #[inline(always)]
    fn load(self, row: &Row<i32>, part: usize) -> Self::Vector {
        row.as_chunks().0[part]
    }

    #[inline(always)]
    fn store(self, row: &mut Row<i32>, part: usize, vector: Self::Vector) {
        row.as_chunks_mut().0[part] = vector;
    }

    #[inline(always)]
    fn add(self, mut one: Self::Vector, other: Self::Vector) -> Self::Vector {
        for lane in 0..WIDTH {
            one[lane] = one[lane].wrapping_add(other[lane]);
        }
        one
    }

    #[inline(always)]
    fn xor(self, mut one: Self::Vector, other: Self::Vector) -> Self::Vector {
        for lane in 0..WIDTH {
            one[lane] ^= other[lane];
        }
        one
    }

    #[inline(always)]
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, mut vector: Self::Vector) -> Self::Vector {
        for lane in 0..WIDTH {
            vector[lane] = vector[lane].rotate_left(LEFT as u32);
        }
        vector
    }

    #[inline(always)]
    fn scale(self, mut sums: Self::Vector, multipliers: Self::Vector) -> Self::Vector {
        for lane in 0..WIDTH {
            let product = scaled_product(sums[lane].into(), multipliers[lane].into());
            sums[lane] = (product >> 32) as i32;
        }
        sums
    }
}

impl Products<2> for Plain {
    type Unit = Self;

    #[inline(always)]
    fn unit(self) -> Self {
        self
    }

    #[inline(always)]
    fn blocks(layer: &Dense) -> &[Block<2>] {
        &layer.pairs
    }

    #[inline(always)]
    fn add_products(
        self,
        mut sums: [i32; WIDTH],
        activations: [i32; WIDTH],
        weights: [i32; WIDTH],
    ) -> [i32; WIDTH] {
        for lane in 0..WIDTH {
            let first = i32::from(activations[lane] as i16) * i32::from(weights[lane] as i16);
            let second = (activations[lane] >> 16) * (weights[lane] >> 16);
            sums[lane] = sums[lane].wrapping_add(first).wrapping_add(second);
        }
        sums
    }

    #[inline(always)]
    fn pack(self, [mut first, second]: [[i32; WIDTH]; 2]) -> [i32; WIDTH] {
        for lane in 0..WIDTH {
            first[lane] = first[lane].clamp(0, 255) | second[lane].clamp(0, 255) << 16;
        }
        first
    }
}
