//! The ring: whose turn it is on which sub-channel, from the slot's index alone.
//!
//! A cell's places stand in a ring. Every slot hands the next places to its sub-channels, one each, so a ring of M places on N
//! sub-channels comes round every M / N slots, also where that is no whole number, and for any load. All sub-channels hop together
//! from slot to slot, so that a vehicle that stands in a fade does not stay in it.
//!
//! Vehicles own places, handed out at association (5G's configured grants) or found by themselves. Places that are nobody's are open:
//! there, whoever has none or is late contends.

use crate::reciprocal::{places_reciprocal, reciprocal};
use crate::units::{SlotIndex, SubChannels};

/// A ring and the sub-channels that it goes round on, as the base station announces it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ring {
    places: u16,
    sub_channels: SubChannels,
}

/// Most places in a ring (chosen: 2,000 vehicles with as many open places).
pub const MAX_PLACES: u16 = 4000;

impl Ring {
    /// A ring of `places`. `None` if there are fewer than sub-channels, or more than [`MAX_PLACES`].
    pub const fn new(places: u16, sub_channels: SubChannels) -> Option<Self> {
        if places as usize >= sub_channels.count() && places <= MAX_PLACES {
            Some(Self { places, sub_channels })
        } else {
            None
        }
    }

    /// How many places.
    pub const fn places(&self) -> u16 {
        self.places
    }

    /// The sub-channels.
    pub const fn sub_channels(&self) -> SubChannels {
        self.sub_channels
    }

    /// The first of the places that a slot hands out: `N * slot` modulo their number. The same instructions for every slot and every
    /// ring.
    pub fn first_place(&self, slot: SlotIndex) -> u16 {
        let places = u32::from(self.places);
        let reciprocal = fine_reciprocal(self.places);
        // A rough remainder, the remainder of that, and that of as many slots as come to less than a ring.
        let slots = reduced(slot.0, places, reciprocal);
        let slots = remainder(slots, places, reciprocal);
        let passed = slots.wrapping_mul(self.sub_channels.count() as u32);
        remainder(passed, places, reciprocal) as u16
    }

    /// How many slots the ring takes to come round, in 1/256; at most 2.2e-4 of them too many, or one too few.
    pub fn frame(&self) -> i32 {
        i32::from(self.places).wrapping_mul(reciprocal(self.sub_channels.count() as u16)) >> 8
    }
}

/// The sub-channels of a slot whose places are nobody's, as the base station announces them: one bit each, the first sub-channel's the
/// lowest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Open(pub u16);

impl Open {
    /// Whether a sub-channel is among them.
    #[inline(always)]
    pub const fn contains(self, sub_channel: usize) -> bool {
        self.0 >> (sub_channel & 15) & 1 > 0
    }
}

/// By how many sub-channels all have hopped together in a slot: a hash of its index (Fibonacci hashing, Knuth, The Art of Computer
/// Programming 3, 6.4), since no frame is a multiple of that.
pub const fn hop(slot: SlotIndex, sub_channels: SubChannels) -> usize {
    let hash = slot.0.wrapping_mul(0x9e37_79b1) >> 16;
    (hash as usize).wrapping_mul(sub_channels.count()) >> 16
}

/// The sub-channel that carries the place `offset` behind a slot's first one, both below the number of sub-channels; where all have
/// hopped by `hop`.
pub const fn carrier(offset: usize, hop: usize, sub_channels: SubChannels) -> usize {
    let sum = offset.wrapping_add(hop);
    let over = sum.wrapping_sub(sub_channels.count());
    if sum < sub_channels.count() { sum } else { over }
}

/// 2^31 over a number of places, at most 3 too small: three of Newton's steps, of which each squares the relative error, from one within
/// 1/15. A divider's time depends on its operands, a multiplier's does not.
fn fine_reciprocal(places: u16) -> u32 {
    let mut reciprocal = i64::from(places_reciprocal(places)) << 7;
    for _ in 0..3 {
        let error = (1_i64 << 31).wrapping_sub(reciprocal.wrapping_mul(places.into()));
        let (factor, error) = (reciprocal as u32, error as i32);
        reciprocal = reciprocal.wrapping_add(i64::from(factor).wrapping_mul(error.into()) >> 31);
    }
    reciprocal as u32
}

/// Less than `dividend` by a multiple of `divisor`, and below 8 times that: its reciprocal is at most 3 too small, and half a dividend below
/// 2^31.
fn reduced(dividend: u32, divisor: u32, reciprocal: u32) -> u32 {
    let quotient = (u64::from(dividend).wrapping_mul(reciprocal.into()) >> 31) as u32;
    dividend.wrapping_sub(quotient.wrapping_mul(divisor))
}

/// `dividend` modulo `divisor`, for a dividend below 2^16: the quotient is at most one too small.
fn remainder(dividend: u32, divisor: u32, reciprocal: u32) -> u32 {
    let rest = reduced(dividend, divisor, reciprocal);
    let less = rest.wrapping_sub(divisor);
    // All bits set where the divisor does not fit: a mask and no branch.
    let keep = (less.cast_signed() >> 31).cast_unsigned();
    less.wrapping_add(divisor & keep)
}
