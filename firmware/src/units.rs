//! Quantities of the radio cell, each with its unit in its type.

use fixed::types::I8F8;

/// Number of sub-channels a unit measures and may choose from (the paper's Table I: 3 resource blocks).
pub const SUB_CHANNELS: usize = 3;

/// A received level in dB above the base station's noise floor, in steps of 1/256 dB from -128 to +127.996 dB.
pub type Level = I8F8;

/// Transmit power in dBm, in steps of 1/256 dB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Dbm(i16);

impl Dbm {
    /// The power whose value in 1/256 dBm is `bits`.
    pub const fn from_bits(bits: i16) -> Self {
        Self(bits)
    }

    /// The value in 1/256 dBm.
    pub const fn to_bits(self) -> i16 {
        self.0
    }

    /// The value in dBm.
    pub const fn value(self) -> I8F8 {
        I8F8::from_bits(self.0)
    }
}

/// One of the cell's orthogonal sub-channels, `0..SUB_CHANNELS`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SubChannel(u8);

impl SubChannel {
    /// The sub-channel with this index, or `None` from [`SUB_CHANNELS`] on.
    pub const fn new(index: u8) -> Option<Self> {
        if (index as usize) < SUB_CHANNELS {
            Some(Self(index))
        } else {
            None
        }
    }

    /// The index, below [`SUB_CHANNELS`].
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// The sub-channel `offset` places on, around the end.
    #[must_use]
    pub const fn after(self, offset: usize) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "below SUB_CHANNELS")]
        Self((self.index().wrapping_add(offset) % SUB_CHANNELS) as u8)
    }
}

/// Index of a 1 ms slot since the modem started. It wraps after 49.7 days; only differences mean anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SlotIndex(pub u32);

impl SlotIndex {
    /// Slots from `earlier` to `self`, counted forwards through a wrap.
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// The slot after this one.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.wrapping_add(1))
    }
}

/// Age of information in slots (= ms): 1 in the slot after a success, one more in every further slot, saturating at
/// [`Age::MAX`] (the paper's eq. 4 and T = 100 ms).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Age(u8);

impl Age {
    /// The youngest possible age.
    pub const MIN: Self = Self(1);
    /// Where ages saturate: the time constraint T of Table I, 100 ms.
    pub const MAX: Self = Self(100);

    /// The age `slots` after a success, saturating at both ends.
    pub const fn after(slots: u32) -> Self {
        // Two selections and no early return: the same instructions for every age.
        let most = Self::MAX.0 as u32;
        let slots = if slots > most { most } else { slots };
        let slots = if slots == 0 { 1 } else { slots };
        #[allow(clippy::cast_possible_truncation, reason = "at most 100")]
        Self(slots as u8)
    }

    /// The age one slot later without a success.
    #[must_use]
    pub const fn older(self) -> Self {
        Self::after((self.0 as u32).saturating_add(1))
    }

    /// The age in slots, 1 to 100.
    pub const fn slots(self) -> u8 {
        self.0
    }
}

/// Slots between two turns of a vehicle on its home sub-channel, 1 to 100: the number of members of its group, which
/// the base station broadcasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Period(u8);

impl Period {
    /// The longest period: an age saturates there, so a longer one could not be told from it.
    pub const MAX: u8 = Age::MAX.0;

    /// A period of `slots`, or `None` outside 1 to 100.
    pub const fn new(slots: u8) -> Option<Self> {
        if slots >= 1 && slots <= Self::MAX {
            Some(Self(slots))
        } else {
            None
        }
    }

    /// The period in slots.
    pub const fn slots(self) -> u8 {
        self.0
    }
}

/// Probability with which the base station asks joiners to send in a slot, in 1/256, from 1/256 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JoinerProbability(u8);

impl JoinerProbability {
    /// Always send.
    pub const ONE: Self = Self(u8::MAX);

    /// The probability `(code + 1) / 256`: every code is valid.
    pub const fn from_code(code: u8) -> Self {
        Self(code)
    }

    /// The code on the wire.
    pub const fn code(self) -> u8 {
        self.0
    }

    /// The probability times 256, 1 to 256.
    pub const fn in_256ths(self) -> u16 {
        (self.0 as u16).saturating_add(1)
    }
}
