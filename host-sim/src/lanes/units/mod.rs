//! The instructions of vector units that no loop over rows was found to make the compiler use, by name.
//!
//! A [`Kernel`] is written once over [`Unit`] and [`Products`] and compiled for each unit. Integers have no rounding: all units give
//! the same.

#[cfg(target_arch = "aarch64")]
pub mod arm;
mod plain;
#[cfg(target_arch = "wasm32")]
mod wasm;
#[cfg(target_arch = "x86_64")]
pub mod x86;

use super::dense::{Block, Dense};
use super::{Row, Vectors};

/// Vectors of 32-bit lanes.
pub trait Unit: Copy {
    /// `WIDTH` lanes.
    type Vector: Copy;

    /// Lanes of a vector.
    const WIDTH: usize;

    /// The same number in all lanes.
    fn splat(self, number: i32) -> Self::Vector;

    /// The `part`th vector of a row.
    fn load(self, row: &Row<i32>, part: usize) -> Self::Vector;

    /// The opposite.
    fn store(self, row: &mut Row<i32>, part: usize, vector: Self::Vector);

    /// Sums, without a carry out of a lane.
    fn add(self, one: Self::Vector, other: Self::Vector) -> Self::Vector;

    /// Bits that differ.
    fn xor(self, one: Self::Vector, other: Self::Vector) -> Self::Vector;

    /// All lanes' bits moved to the left by `LEFT`, and those that fall out put in at the right: that is, moved there by `RIGHT`, 32 less
    /// `LEFT`, which the compiler cannot know from it.
    fn rotate<const LEFT: i32, const RIGHT: i32>(self, vector: Self::Vector) -> Self::Vector;

    /// The upper halves of [`firmware::network::scaled_product`]: products in 1/2^32, rounded.
    fn scale(self, sums: Self::Vector, multipliers: Self::Vector) -> Self::Vector;
}

/// Products of activations and weights, of which a vector holds as many columns' as fit into its lanes: of weights side by side in each
/// lane, of activations in the order that the instructions take.
///
/// As many rows of a layer are worked on together: their results are the columns of a lane of the next layer.
pub trait Products<const COLUMNS: usize>: Copy {
    /// The unit whose vectors they are.
    type Unit: Unit;

    /// The unit.
    fn unit(self) -> Self::Unit;

    /// A layer for them.
    fn blocks(layer: &Dense) -> &[Block<COLUMNS>];

    /// Adds to each lane of the sums the products of its columns.
    fn add_products(
        self,
        sums: <Self::Unit as Unit>::Vector,
        activations: <Self::Unit as Unit>::Vector,
        weights: <Self::Unit as Unit>::Vector,
    ) -> <Self::Unit as Unit>::Vector;

    /// Activations of columns, clamped to 0 to 255, in one vector.
    fn pack(self, columns: [<Self::Unit as Unit>::Vector; COLUMNS]) -> <Self::Unit as Unit>::Vector;

    /// Scaled sums of columns, packed.
    #[inline(always)]
    fn scale_and_pack(
        self,
        mut sums: [<Self::Unit as Unit>::Vector; COLUMNS],
        multipliers: [<Self::Unit as Unit>::Vector; COLUMNS],
    ) -> <Self::Unit as Unit>::Vector {
        for column in 0..COLUMNS {
            sums[column] = self.unit().scale(sums[column], multipliers[column]);
        }
        self.pack(sums)
    }
}

/// In each 128 bits, where four lanes' bytes of the first column are followed by those of the next: the indices of the bytes of
/// lane after lane, each column in so many bytes. Indices of bytes that are 0 have the highest bit set.
const fn lane_after_lane<const COLUMNS: usize>() -> [u8; 16] {
    let mut indices = [0x80; 16];
    let mut place = 0;
    while place < 4 * COLUMNS {
        let (lane, column) = (place / COLUMNS, place % COLUMNS);
        indices[lane * 4 + column * (4 / COLUMNS)] = (column * 4 + lane) as u8;
        place += 1;
    }
    indices
}

/// The same where in each 128 bits the even lanes' bytes, two of each column after the other, are followed by the odd ones'.
#[allow(dead_code, reason = "of some architectures")]
const fn odd_after_even<const COLUMNS: usize>() -> [u8; 16] {
    let mut indices = [0x80; 16];
    let mut place = 0;
    while place < 4 * COLUMNS {
        let (lane, column) = (place / COLUMNS, place % COLUMNS);
        let from = lane % 2 * 2 * COLUMNS + 2 * column + lane / 2;
        indices[lane * 4 + column * (4 / COLUMNS)] = from as u8;
        place += 1;
    }
    indices
}

/// What can be done on any unit.
pub trait Kernel {
    /// Does it, with `PARTS` of a row's vectors at a time, and the rows of two blocks if `TWO` (chosen: that is eight sums, or sixteen where
    /// there are registers for them).
    fn run<P: Products<COLUMNS>, const COLUMNS: usize, const PARTS: usize, const TWO: bool>(
        self,
        products: P,
    );
}

impl Vectors {
    /// Runs a kernel on it.
    pub(super) fn compute(self, kernel: impl Kernel) {
        match (self.unit, self.bytes) {
            #[cfg(target_arch = "x86_64")]
            (_, Some(x86::Bytes::Zmm(bytes))) => bytes.run(kernel),
            #[cfg(target_arch = "x86_64")]
            (_, Some(x86::Bytes::Ymm(bytes))) => bytes.run(kernel),
            #[cfg(target_arch = "x86_64")]
            (Some(pulp::Arch::V4(unit)), _) => x86::Pairs512(unit).run(kernel),
            #[cfg(target_arch = "x86_64")]
            (Some(pulp::Arch::V3(unit)), _) => x86::Pairs256(unit).run(kernel),
            #[cfg(target_arch = "aarch64")]
            (_, Some(bytes)) => kernel.run::<_, 4, 4, false>(bytes),
            #[cfg(target_arch = "aarch64")]
            (Some(pulp::Arch::Neon(unit)), _) => kernel.run::<_, 2, 4, false>(unit),
            #[cfg(target_arch = "wasm32")]
            (Some(pulp::Arch::Simd128(unit)), _) => kernel.run::<_, 2, 4, false>(unit),
            _ => kernel.run::<_, 2, 1, false>(plain::Plain),
        }
    }
}
