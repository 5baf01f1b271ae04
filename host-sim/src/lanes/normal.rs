//! Normal numbers in every lane.

use super::{LANES, Row, log2, unit_interval};

/// Two independent standard normal numbers a lane, made of two random words (Box and Muller 1958).
pub fn normals(first: &Row<u32>, second: &Row<u32>) -> [Row<f32>; 2] {
    let (mut cosines, mut sines) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let radius = libm::sqrtf(-2.0 * std::f32::consts::LN_2 * log2(unit_interval(first[lane])));
        let (sine, cosine) = libm::sincosf(std::f32::consts::TAU * unit_interval(second[lane]));
        cosines[lane] = radius * cosine;
        sines[lane] = radius * sine;
    }
    [cosines, sines]
}
