//! WebAssembly: vectors of 128 bits.

use super::{Products, Unit, lane_after_lane};
use crate::lanes::Row;
use crate::lanes::dense::{Block, Dense};
use pulp::wasm::Simd128;
use std::arch::wasm32::v128;

impl Unit for Simd128 {
    type Vector = v128;

    const WIDTH: usize = 4;

    #[inline(always)]
    fn splat(self, number: i32) -> v128 {
        self.simd128.i32x4_splat(number)
    }

    #[inline(always)]
    fn load(self, row: &Row<i32>, part: usize) -> v128 {
        pulp::cast(row.as_chunks::<4>().0[part])
    }

    #[inline(always)]
    fn store(self, row: &mut Row<i32>, part: usize, vector: v128) {
        row.as_chunks_mut::<4>().0[part] = pulp::cast(vector);
    }

    #[inline(always)]
    fn add(self, one: v128, other: v128) -> v128 {
        self.simd128.i32x4_add(one, other)
    }

    #[inline(always)]
    fn xor(self, one: v128, other: v128) -> v128 {
        self.simd128.v128_xor(one, other)
    }

    #[inline(always)]
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, vector: v128) -> v128 {
        let high = self.simd128.i32x4_shl(vector, LEFT as u32);
        let low = self.simd128.u32x4_shr(vector, RIGHT as u32);
        self.simd128.v128_or(high, low)
    }

    #[inline(always)]
    fn scale(self, sums: v128, multipliers: v128) -> v128 {
        let half = self.simd128.i64x2_splat(1 << 31);
        let low = self.simd128.i64x2_extmul_low_i32x4(sums, multipliers);
        let high = self.simd128.i64x2_extmul_high_i32x4(sums, multipliers);
        let low = self.simd128.i64x2_add(low, half);
        let high = self.simd128.i64x2_add(high, half);
        self.simd128.i32x4_shuffle::<1, 3, 5, 7>(low, high)
    }
}

impl Products<2> for Simd128 {
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
    fn add_products(self, sums: v128, activations: v128, weights: v128) -> v128 {
        let products = self.simd128.i32x4_dot_i16x8(activations, weights);
        self.simd128.i32x4_add(sums, products)
    }

    #[inline(always)]
    fn pack(self, [first, second]: [v128; 2]) -> v128 {
        let narrow = self.simd128.i16x8_narrow_i32x4(first, second);
        let bytes = self.simd128.u8x16_narrow_i16x8(narrow, narrow);
        let indices = const { lane_after_lane::<2>() };
        self.simd128.i8x16_swizzle(bytes, pulp::cast(indices))
    }
}
