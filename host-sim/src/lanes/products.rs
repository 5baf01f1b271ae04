//! Sums of products of small integers: what a network's dense layer is made of.
//!
//! Vector units multiply two pairs of 16-bit integers and add the products in one instruction, which no loop over rows was
//! found to make the compiler use, so it is asked for by name here. Integers have no rounding: all ways give the same.

use super::{LANES, Row, Vectors};

/// Rows of a layer that are worked on together, so that sums stay in registers.
pub const QUAD: usize = 4;

/// Two 16-bit integers in a word, the first in the lower half.
#[inline(always)]
pub fn pair(first: i32, second: i32) -> i32 {
    (first & 0xffff) | (second << 16)
}

impl Vectors {
    /// Adds to four rows the products of their weights and the activations: `weights` are `[column pair][row]`, activations
    /// `[column pair][world]`, both [`pair`]s.
    #[inline(always)]
    pub fn add_products(
        self,
        sums: &mut [Row<i32>; QUAD],
        weights: &[[i32; QUAD]],
        activations: &[Row<i32>],
    ) {
        #[cfg(target_arch = "x86_64")]
        match self.0 {
            Some(pulp::Arch::V4(unit)) => {
                return unit.vectorize(
                    #[inline(always)]
                    || wide_512(unit, sums, weights, activations),
                );
            }
            Some(pulp::Arch::V3(unit)) => {
                return unit.vectorize(
                    #[inline(always)]
                    || wide_256(unit, sums, weights, activations),
                );
            }
            _ => {}
        }
        for (weights, activations) in weights.iter().zip(activations) {
            for (sums, &weights) in sums.iter_mut().zip(weights) {
                let (first, second) = (i32::from(weights as i16), weights >> 16);
                for lane in 0..LANES {
                    let (even, odd) = (i32::from(activations[lane] as i16), activations[lane] >> 16);
                    sums[lane] = sums[lane].wrapping_add(even * first + odd * second);
                }
            }
        }
    }
}

/// As it stands for one width: rows of `$parts` vectors.
#[cfg(target_arch = "x86_64")]
macro_rules! wide {
    ($name:ident, $unit:ty, $vector:ty, $parts:expr, $features:ident . $splat:ident, $integers:ident . $add:ident, $products:ident . $multiply:ident) => {
        #[inline(always)]
        fn $name(
            unit: $unit,
            sums: &mut [Row<i32>; QUAD],
            weights: &[[i32; QUAD]],
            activations: &[Row<i32>],
        ) {
            let mut wide: [[$vector; $parts]; QUAD] = sums.map(|row| pulp::cast(row));
            for (weights, activations) in weights.iter().zip(activations) {
                let activations: [$vector; $parts] = pulp::cast(*activations);
                for row in 0..QUAD {
                    let weights = unit.$features.$splat(weights[row]);
                    for part in 0..$parts {
                        let products = unit.$products.$multiply(activations[part], weights);
                        wide[row][part] = unit.$integers.$add(wide[row][part], products);
                    }
                }
            }
            *sums = wide.map(|row| pulp::cast(row));
        }
    };
}

#[cfg(target_arch = "x86_64")]
wide!(
    wide_512,
    pulp::x86::V4,
    std::arch::x86_64::__m512i,
    LANES / 16,
    avx512f._mm512_set1_epi32,
    avx512f._mm512_add_epi32,
    avx512bw._mm512_madd_epi16
);

#[cfg(target_arch = "x86_64")]
wide!(
    wide_256,
    pulp::x86::V3,
    std::arch::x86_64::__m256i,
    LANES / 8,
    avx._mm256_set1_epi32,
    avx2._mm256_add_epi32,
    avx2._mm256_madd_epi16
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_width_sums_the_same_products() {
        let mut word = 1_u32;
        let mut next = || {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::from((word >> 16) as i16) >> 4
        };
        let weights: Vec<[i32; QUAD]> = (0..37)
            .map(|_| std::array::from_fn(|_| pair(next(), next())))
            .collect();
        let activations: Vec<Row<i32>> = (0..37)
            .map(|_| std::array::from_fn(|_| pair(next(), next())))
            .collect();
        let start = [[0; LANES]; QUAD].map(|row| row.map(|_| next()));
        let mut expected = start;
        for (weights, activations) in weights.iter().zip(&activations) {
            for row in 0..QUAD {
                for lane in 0..LANES {
                    let halves = |word: i32| [i32::from(word as i16), word >> 16];
                    let [a, b] = halves(weights[row]);
                    let [x, y] = halves(activations[lane]);
                    expected[row][lane] += a * x + b * y;
                }
            }
        }
        for vectors in [Vectors::plain(), Vectors::widest()] {
            let mut sums = start;
            vectors.add_products(&mut sums, &weights, &activations);
            assert_eq!(sums, expected);
        }
    }
}
