// Which public keys can be trusted at all. The build script includes this file too.

/// The points of small order by their y-coordinate, little-endian with the sign of x left out: 0, 1, the two of order 8, and -1; 0 and 1
/// once more as they should not be written. Multiples of such a point take 1 to 8 values, so a signature that fits one message fits many.
///
/// Source: Ed25519's cofactor is 8 (RFC 8032 section 5.1); the same list stands in libsodium's `ge25519_has_small_order`.
const SMALL_ORDER: [[u8; 32]; 7] = [
    [0; 32],
    [
        1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    ],
    [
        0x26, 0xe8, 0x95, 0x8f, 0xc2, 0xb2, 0x27, 0xb0, 0x45, 0xc3, 0xf4, 0x89, 0xf2, 0xef, 0x98, 0xf0, 0xd5,
        0xdf, 0xac, 0x05, 0xd3, 0xc6, 0x33, 0x39, 0xb1, 0x38, 0x02, 0x88, 0x6d, 0x53, 0xfc, 0x05,
    ],
    [
        0xc7, 0x17, 0x6a, 0x70, 0x3d, 0x4d, 0xd8, 0x4f, 0xba, 0x3c, 0x0b, 0x76, 0x0d, 0x10, 0x67, 0x0f, 0x2a,
        0x20, 0x53, 0xfa, 0x2c, 0x39, 0xcc, 0xc6, 0x4e, 0xc7, 0xfd, 0x77, 0x92, 0xac, 0x03, 0x7a,
    ],
    near_the_prime(0xec),
    near_the_prime(0xed),
    near_the_prime(0xee),
];

/// Numbers around 2^255 - 19, whose last byte but the first is the largest.
const fn near_the_prime(first: u8) -> [u8; 32] {
    let mut bytes = [0xff; 32];
    bytes[0] = first;
    bytes[31] = 0x7f;
    bytes
}

/// Whether nobody but the owner of its secret half can sign for this key: no point of small order, and y below the prime, as RFC
/// 8032 section 5.1.3 wants it. That it is a point at all its decoding says.
#[allow(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "constant bounds of arrays, in a function that the build evaluates"
)]
#[inline(never)]
pub const fn is_sound(key: &[u8; 32]) -> bool {
    let mut y = *key;
    y[31] &= 0x7f;
    let mut point = 0;
    while point < SMALL_ORDER.len() {
        let mut at = 0;
        while at < y.len() && y[at] == SMALL_ORDER[point][at] {
            at += 1;
        }
        if at == y.len() {
            return false;
        }
        point += 1;
    }
    let prime = near_the_prime(0xed);
    let mut at = y.len() - 1;
    while at > 0 && y[at] == prime[at] {
        at -= 1;
    }
    y[at] < prime[at]
}
