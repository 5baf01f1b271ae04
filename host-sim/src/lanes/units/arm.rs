//! AArch64: NEON, with byte products where the processor has them (from Armv8.2 on).

use super::{Products, Unit, lane_after_lane};
use crate::lanes::Row;
use crate::lanes::dense::{BYTES_BELOW, Block, Dense};
use pulp::aarch64::Neon;
use std::arch::aarch64::int32x4_t;

impl Unit for Neon {
    type Vector = int32x4_t;

    const WIDTH: usize = 4;

    #[inline(always)]
    fn splat(self, number: i32) -> int32x4_t {
        self.neon.vdupq_n_s32(number)
    }

    #[inline(always)]
    fn load(self, row: &Row<i32>, part: usize) -> int32x4_t {
        pulp::cast(row.as_chunks::<4>().0[part])
    }

    #[inline(always)]
    fn store(self, row: &mut Row<i32>, part: usize, vector: int32x4_t) {
        row.as_chunks_mut::<4>().0[part] = pulp::cast(vector);
    }

    #[inline(always)]
    fn add(self, one: int32x4_t, other: int32x4_t) -> int32x4_t {
        self.neon.vaddq_s32(one, other)
    }

    #[inline(always)]
    fn xor(self, one: int32x4_t, other: int32x4_t) -> int32x4_t {
        self.neon.veorq_s32(one, other)
    }

    #[inline(always)]
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, vector: int32x4_t) -> int32x4_t {
        if LEFT == 16 {
            return pulp::cast(self.neon.vrev32q_u16(pulp::cast(vector)));
        }
        let high = self.neon.vshlq_n_s32::<LEFT>(vector);
        // The bits from the right go in below those.
        self.neon.vsriq_n_s32::<RIGHT>(high, vector)
    }

    #[inline(always)]
    fn scale(self, sums: int32x4_t, multipliers: int32x4_t) -> int32x4_t {
        let low = self
            .neon
            .vmull_s32(self.neon.vget_low_s32(sums), self.neon.vget_low_s32(multipliers));
        let high = self.neon.vmull_high_s32(sums, multipliers);
        // Both round.
        let low = self.neon.vrshrn_n_s64::<32>(low);
        self.neon.vrshrn_high_n_s64::<32>(low, high)
    }
}

impl Products<2> for Neon {
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
    fn add_products(self, sums: int32x4_t, activations: int32x4_t, weights: int32x4_t) -> int32x4_t {
        let (activations, weights) = (pulp::cast(activations), pulp::cast(weights));
        let first = self.neon.vget_low_s16(activations);
        let sums = self.neon.vmlal_laneq_s16::<0>(sums, first, weights);
        self.neon.vmlal_high_laneq_s16::<1>(sums, activations, weights)
    }

    #[inline(always)]
    fn pack(self, [first, second]: [int32x4_t; 2]) -> int32x4_t {
        // One column after the other: an instruction multiplies all lanes of one.
        let narrow = self.neon.vqmovn_high_s32(self.neon.vqmovn_s32(first), second);
        pulp::cast(self.neon.vmovl_u8(self.neon.vqmovun_s16(narrow)))
    }
}

/// Byte products. Whoever has one has the instruction.
#[derive(Clone, Copy, Debug)]
pub struct NeonBytes(Neon);

impl NeonBytes {
    /// If the processor has the instruction.
    pub fn new(neon: Neon) -> Option<Self> {
        std::arch::is_aarch64_feature_detected!("dotprod").then_some(Self(neon))
    }
}

impl Products<4> for NeonBytes {
    type Unit = Neon;

    #[inline(always)]
    fn unit(self) -> Neon {
        self.0
    }

    #[inline(always)]
    fn blocks(layer: &Dense) -> &[Block<4>] {
        &layer.bytes
    }

    #[inline(always)]
    fn add_products(self, mut sums: int32x4_t, activations: int32x4_t, weights: int32x4_t) -> int32x4_t {
        #[allow(
            unsafe_code,
            reason = "`new` asked whether the processor has the instruction, which has no stable name"
        )]
        unsafe {
            std::arch::asm!(
                ".arch_extension dotprod",
                "sdot {0:v}.4s, {1:v}.16b, {2:v}.16b",
                inout(vreg) sums,
                in(vreg) activations,
                in(vreg) weights,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        sums
    }

    #[inline(always)]
    fn pack(self, [first, second, third, fourth]: [int32x4_t; 4]) -> int32x4_t {
        let neon = self.0.neon;
        let low = neon.vqmovn_high_s32(neon.vqmovn_s32(first), second);
        let high = neon.vqmovn_high_s32(neon.vqmovn_s32(third), fourth);
        let bytes = neon.vqmovun_high_s16(neon.vqmovun_s16(low), high);
        let indices = const { lane_after_lane::<4>() };
        let bytes = pulp::cast(neon.vqtbl1q_u8(bytes, pulp::cast(indices)));
        // 128 less, by the highest bit: the instruction takes bytes with a sign.
        const { assert!(BYTES_BELOW == 128) };
        neon.veorq_s32(bytes, neon.vdupq_n_s32(i32::from_ne_bytes([128; 4])))
    }
}
