//! Worlds side by side: a value of [`LANES`] worlds is a row, and every step of the slot loop works on whole rows.
//!
//! Rows are plain arrays and loops over them plain Rust, which the compiler turns into vector instructions. [`Vectors`]
//! chooses the widest unit of the machine at run time. All arithmetic is lane by lane, in the order that the source says:
//! nothing is fused or reassociated, so every width gives the same bits.

mod dense;
mod logarithm;
mod normal;
mod power;
mod random;
mod rounding;
mod rows;
mod units;
mod vectors;

pub use dense::{Activations, Dense, DenseRow};
pub use logarithm::{DECIBELS_PER_OCTAVE, decibels, log2};
pub use normal::normals;
pub use power::ratio;
pub use random::{LaneStream, unit_interval};
pub use rounding::floor;
pub use rows::Rows;
pub use vectors::Vectors;

/// Worlds of a row (chosen: two to eight vectors of every machine's width).
pub const LANES: usize = 32;

/// Worlds up to which costly loops go through so many lanes and no more, as for a single world on a page (chosen: two vectors of 128
/// bits).
pub const FEW: usize = 8;

/// One value in every world of a row.
pub type Row<T> = [T; LANES];

/// A row of narrow numbers as wide ones. A loop and no closure, which would not always be inlined, and then lose the vector unit.
#[inline(always)]
pub fn widened<T: Copy + Into<i32>>(row: &Row<T>) -> Row<i32> {
    let mut wide = [0; LANES];
    for lane in 0..LANES {
        wide[lane] = row[lane].into();
    }
    wide
}
