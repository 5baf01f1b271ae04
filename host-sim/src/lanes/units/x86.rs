//! x86-64: AVX2 and AVX-512, with byte products (VNNI) where the processor has them.

use super::{Kernel, Products, Unit, lane_after_lane, odd_after_even};
use crate::lanes::Row;
use crate::lanes::dense::{Block, Dense};
use pulp::x86::{V3, V4};
use std::arch::x86_64::{__m256i, __m512i, _mm256_dpbusd_avx_epi32, _mm512_dpbusd_epi32};

impl Unit for V3 {
    type Vector = __m256i;

    const WIDTH: usize = 8;

    #[inline(always)]
    fn splat(self, number: i32) -> __m256i {
        self.avx._mm256_set1_epi32(number)
    }

    #[inline(always)]
    fn load(self, row: &Row<i32>, part: usize) -> __m256i {
        pulp::cast(row.as_chunks::<8>().0[part])
    }

    #[inline(always)]
    fn store(self, row: &mut Row<i32>, part: usize, vector: __m256i) {
        row.as_chunks_mut::<8>().0[part] = pulp::cast(vector);
    }

    #[inline(always)]
    fn add(self, one: __m256i, other: __m256i) -> __m256i {
        self.avx2._mm256_add_epi32(one, other)
    }

    #[inline(always)]
    fn xor(self, one: __m256i, other: __m256i) -> __m256i {
        self.avx2._mm256_xor_si256(one, other)
    }

    #[inline(always)]
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, vector: __m256i) -> __m256i {
        /// For whole bytes: where each comes from.
        const fn indices(bytes: u8) -> [u8; 16] {
            let mut indices = [0; 16];
            let mut byte = 0;
            while byte < 16 {
                indices[byte as usize] = byte / 4 * 4 + (byte + 4 - bytes) % 4;
                byte += 1;
            }
            indices
        }
        if LEFT % 8 == 0 {
            let indices = pulp::cast(const { indices((LEFT / 8) as u8) });
            return self
                .avx2
                ._mm256_shuffle_epi8(vector, self.avx2._mm256_broadcastsi128_si256(indices));
        }
        let high = self.avx2._mm256_slli_epi32::<LEFT>(vector);
        let low = self.avx2._mm256_srli_epi32::<RIGHT>(vector);
        self.avx2._mm256_or_si256(high, low)
    }

    #[inline(always)]
    fn scale(self, sums: __m256i, multipliers: __m256i) -> __m256i {
        let [even, odd] = self.rounded(sums, multipliers);
        let even = self.avx2._mm256_srli_epi64::<32>(even);
        self.avx2._mm256_blend_epi32::<0b1010_1010>(even, odd)
    }
}

/// Products of 64 bits, of which the upper halves count.
trait Halves: Unit {
    /// Sums times multipliers, and half of what the upper half counts in: of the even lanes and of the odd ones.
    fn rounded(self, sums: Self::Vector, multipliers: Self::Vector) -> [Self::Vector; 2];

    /// The upper halves, in each 128 bits of the one and then of the other.
    fn upper(self, one: Self::Vector, other: Self::Vector) -> Self::Vector;
}

/// Lanes 1 and 3 of either.
const UPPER: i32 = 0b11_01_11_01;

impl Halves for V3 {
    #[inline(always)]
    fn rounded(self, sums: __m256i, multipliers: __m256i) -> [__m256i; 2] {
        let half = self.avx._mm256_set1_epi64x(1 << 31);
        let odd = self.avx2._mm256_srli_epi64::<32>(sums);
        let even = self.avx2._mm256_mul_epi32(sums, multipliers);
        let odd = self.avx2._mm256_mul_epi32(odd, multipliers);
        let even = self.avx2._mm256_add_epi64(even, half);
        [even, self.avx2._mm256_add_epi64(odd, half)]
    }

    #[inline(always)]
    fn upper(self, one: __m256i, other: __m256i) -> __m256i {
        let [one, other] = [pulp::cast(one), pulp::cast(other)];
        pulp::cast(self.avx._mm256_shuffle_ps::<UPPER>(one, other))
    }
}

impl Products<2> for Pairs256 {
    type Unit = V3;

    #[inline(always)]
    fn unit(self) -> V3 {
        self.0
    }

    #[inline(always)]
    fn blocks(layer: &Dense) -> &[Block<2>] {
        &layer.pairs
    }

    #[inline(always)]
    fn add_products(self, sums: __m256i, activations: __m256i, weights: __m256i) -> __m256i {
        let products = self.0.avx2._mm256_madd_epi16(activations, weights);
        self.0.avx2._mm256_add_epi32(sums, products)
    }

    #[inline(always)]
    fn pack(self, [first, second]: [__m256i; 2]) -> __m256i {
        let words = self.0.avx2._mm256_packs_epi32(first, second);
        let bytes = self.0.avx2._mm256_packus_epi16(words, words);
        let indices = self
            .0
            .avx2
            ._mm256_broadcastsi128_si256(pulp::cast(const { lane_after_lane::<2>() }));
        self.0.avx2._mm256_shuffle_epi8(bytes, indices)
    }

    #[inline(always)]
    fn scale_and_pack(self, [first, second]: [__m256i; 2], multipliers: [__m256i; 2]) -> __m256i {
        let [first_even, first_odd] = self.0.rounded(first, multipliers[0]);
        let [second_even, second_odd] = self.0.rounded(second, multipliers[1]);
        let even = self.0.upper(first_even, second_even);
        let odd = self.0.upper(first_odd, second_odd);
        let words = self.0.avx2._mm256_packs_epi32(even, odd);
        let bytes = self.0.avx2._mm256_packus_epi16(words, words);
        let indices = self
            .0
            .avx2
            ._mm256_broadcastsi128_si256(pulp::cast(const { odd_after_even::<2>() }));
        self.0.avx2._mm256_shuffle_epi8(bytes, indices)
    }
}

impl Unit for V4 {
    type Vector = __m512i;

    const WIDTH: usize = 16;

    #[inline(always)]
    fn splat(self, number: i32) -> __m512i {
        self.avx512f._mm512_set1_epi32(number)
    }

    #[inline(always)]
    fn load(self, row: &Row<i32>, part: usize) -> __m512i {
        pulp::cast(row.as_chunks::<16>().0[part])
    }

    #[inline(always)]
    fn store(self, row: &mut Row<i32>, part: usize, vector: __m512i) {
        row.as_chunks_mut::<16>().0[part] = pulp::cast(vector);
    }

    #[inline(always)]
    fn add(self, one: __m512i, other: __m512i) -> __m512i {
        self.avx512f._mm512_add_epi32(one, other)
    }

    #[inline(always)]
    fn xor(self, one: __m512i, other: __m512i) -> __m512i {
        self.avx512f._mm512_xor_si512(one, other)
    }

    #[inline(always)]
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, vector: __m512i) -> __m512i {
        self.avx512f._mm512_rol_epi32::<LEFT>(vector)
    }

    #[inline(always)]
    fn scale(self, sums: __m512i, multipliers: __m512i) -> __m512i {
        let [even, odd] = self.rounded(sums, multipliers);
        // The even lanes' upper halves, beside the odd ones'.
        self.avx512f
            ._mm512_mask_shuffle_epi32::<0b11_11_01_01>(odd, 0b0101_0101_0101_0101, even)
    }
}

impl Halves for V4 {
    #[inline(always)]
    fn rounded(self, sums: __m512i, multipliers: __m512i) -> [__m512i; 2] {
        let half = self.avx512f._mm512_set1_epi64(1 << 31);
        let odd = self.avx512f._mm512_srli_epi64::<32>(sums);
        let even = self.avx512f._mm512_mul_epi32(sums, multipliers);
        let odd = self.avx512f._mm512_mul_epi32(odd, multipliers);
        let even = self.avx512f._mm512_add_epi64(even, half);
        [even, self.avx512f._mm512_add_epi64(odd, half)]
    }

    #[inline(always)]
    fn upper(self, one: __m512i, other: __m512i) -> __m512i {
        let [one, other] = [pulp::cast(one), pulp::cast(other)];
        pulp::cast(self.avx512f._mm512_shuffle_ps::<UPPER>(one, other))
    }
}

impl Products<2> for Pairs512 {
    type Unit = V4;

    #[inline(always)]
    fn unit(self) -> V4 {
        self.0
    }

    #[inline(always)]
    fn blocks(layer: &Dense) -> &[Block<2>] {
        &layer.pairs
    }

    #[inline(always)]
    fn add_products(self, sums: __m512i, activations: __m512i, weights: __m512i) -> __m512i {
        let products = self.0.avx512bw._mm512_madd_epi16(activations, weights);
        self.0.avx512f._mm512_add_epi32(sums, products)
    }

    #[inline(always)]
    fn pack(self, [first, second]: [__m512i; 2]) -> __m512i {
        let words = self.0.avx512bw._mm512_packs_epi32(first, second);
        let bytes = self.0.avx512bw._mm512_packus_epi16(words, words);
        let indices = self
            .0
            .avx512f
            ._mm512_broadcast_i32x4(pulp::cast(const { lane_after_lane::<2>() }));
        self.0.avx512bw._mm512_shuffle_epi8(bytes, indices)
    }

    #[inline(always)]
    fn scale_and_pack(self, [first, second]: [__m512i; 2], multipliers: [__m512i; 2]) -> __m512i {
        let [first_even, first_odd] = self.0.rounded(first, multipliers[0]);
        let [second_even, second_odd] = self.0.rounded(second, multipliers[1]);
        let even = self.0.upper(first_even, second_even);
        let odd = self.0.upper(first_odd, second_odd);
        let words = self.0.avx512bw._mm512_packs_epi32(even, odd);
        let bytes = self.0.avx512bw._mm512_packus_epi16(words, words);
        let indices = self
            .0
            .avx512f
            ._mm512_broadcast_i32x4(pulp::cast(const { odd_after_even::<2>() }));
        self.0.avx512bw._mm512_shuffle_epi8(bytes, indices)
    }
}

/// Products of pairs in 256-bit vectors (AVX2).
#[derive(Clone, Copy)]
pub struct Pairs256(pub V3);

/// Products of pairs in 512-bit vectors (AVX-512).
#[derive(Clone, Copy)]
pub struct Pairs512(pub V4);

/// Byte products of either width.
#[derive(Clone, Copy, Debug)]
pub enum Bytes {
    /// Of 256 bits.
    Ymm(Bytes256),
    /// Of 512 bits.
    Zmm(Bytes512),
}

/// Byte products of 256-bit vectors (AVX-VNNI). Whoever has one has the instruction.
#[derive(Clone, Copy, Debug)]
pub struct Bytes256(V3);

/// Byte products of 512-bit vectors (AVX-512 VNNI). Whoever has one has the instruction.
#[derive(Clone, Copy, Debug)]
pub struct Bytes512(V4);

impl Bytes256 {
    /// If the processor has the instruction.
    pub fn new(unit: V3) -> Option<Self> {
        is_x86_feature_detected!("avxvnni").then_some(Self(unit))
    }
}

impl Bytes512 {
    /// If the processor has the instruction.
    pub fn new(unit: V4) -> Option<Self> {
        is_x86_feature_detected!("avx512vnni").then_some(Self(unit))
    }
}

/// Kernels compiled for the products' instructions.
macro_rules! compiled {
    ($products:ident, $columns:literal, $parts:literal, $two:literal, $features:literal) => {
        impl $products {
            /// Runs a kernel.
            #[inline(always)]
            pub(super) fn run(self, kernel: impl Kernel) {
                #[target_feature(enable = $features)]
                fn compiled<K: Kernel>(products: $products, kernel: K) {
                    kernel.run::<_, $columns, $parts, $two>(products);
                }
                #[allow(unsafe_code, reason = "whoever has the products has the features")]
                unsafe {
                    compiled(self, kernel);
                }
            }
        }
    };
}

compiled!(Pairs256, 2, 4, false, "avx2");
compiled!(Pairs512, 2, 2, true, "avx512f,avx512bw");
compiled!(Bytes256, 4, 2, false, "avx2,avxvnni");
compiled!(Bytes512, 4, 2, true, "avx512f,avx512bw,avx512vnni");

/// Byte products of either width: the library of safe vectors leaves the instruction out.
macro_rules! byte_products {
    ($products:ident, $unit:ident, $vector:ident, $instruction:ident,
     $packs:ident . $narrow:ident, $narrow_unsigned:ident, $shuffle:ident, $broadcasts:ident . $broadcast:ident) => {
        impl Products<4> for $products {
            type Unit = $unit;

            #[inline(always)]
            fn unit(self) -> $unit {
                self.0
            }

            #[inline(always)]
            fn blocks(layer: &Dense) -> &[Block<4>] {
                &layer.bytes
            }

            #[inline(always)]
            fn add_products(self, sums: $vector, activations: $vector, weights: $vector) -> $vector {
                #[allow(unsafe_code, reason = "whoever has the products has the instruction")]
                unsafe {
                    $instruction(sums, activations, weights)
                }
            }

            #[inline(always)]
            fn pack(self, [first, second, third, fourth]: [$vector; 4]) -> $vector {
                let (packs, broadcasts) = (self.0.$packs, self.0.$broadcasts);
                let low = packs.$narrow(first, second);
                let high = packs.$narrow(third, fourth);
                let indices = broadcasts.$broadcast(pulp::cast(const { lane_after_lane::<4>() }));
                packs.$shuffle(packs.$narrow_unsigned(low, high), indices)
            }

            #[inline(always)]
            fn scale_and_pack(self, sums: [$vector; 4], multipliers: [$vector; 4]) -> $vector {
                let (packs, broadcasts) = (self.0.$packs, self.0.$broadcasts);
                let [first_even, first_odd] = self.0.rounded(sums[0], multipliers[0]);
                let [second_even, second_odd] = self.0.rounded(sums[1], multipliers[1]);
                let [third_even, third_odd] = self.0.rounded(sums[2], multipliers[2]);
                let [fourth_even, fourth_odd] = self.0.rounded(sums[3], multipliers[3]);
                let even = packs.$narrow(
                    self.0.upper(first_even, second_even),
                    self.0.upper(third_even, fourth_even),
                );
                let odd = packs.$narrow(
                    self.0.upper(first_odd, second_odd),
                    self.0.upper(third_odd, fourth_odd),
                );
                let indices = broadcasts.$broadcast(pulp::cast(const { odd_after_even::<4>() }));
                packs.$shuffle(packs.$narrow_unsigned(even, odd), indices)
            }
        }
    };
}

byte_products!(
    Bytes256,
    V3,
    __m256i,
    _mm256_dpbusd_avx_epi32,
    avx2._mm256_packs_epi32,
    _mm256_packus_epi16,
    _mm256_shuffle_epi8,
    avx2._mm256_broadcastsi128_si256
);
byte_products!(
    Bytes512,
    V4,
    __m512i,
    _mm512_dpbusd_epi32,
    avx512bw._mm512_packs_epi32,
    _mm512_packus_epi16,
    _mm512_shuffle_epi8,
    avx512f._mm512_broadcast_i32x4
);
