//! Quantities of the radio cell, each with its unit in its type.

use fixed::types::I8F8;

/// Most sub-channels a cell may have (chosen; LTE's narrowest carrier has 6 resource blocks, 5 MHz have 25).
pub const MAX_SUB_CHANNELS: usize = 16;

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

/// How many orthogonal sub-channels a cell has, 1 to [`MAX_SUB_CHANNELS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SubChannels(u8);

impl SubChannels {
    /// A single one.
    pub const ONE: Self = Self(1);

    /// So many, or `None` outside 1 to [`MAX_SUB_CHANNELS`].
    pub const fn new(count: usize) -> Option<Self> {
        if count >= 1 && count <= MAX_SUB_CHANNELS {
            #[allow(clippy::cast_possible_truncation, reason = "at most MAX_SUB_CHANNELS")]
            Some(Self(count as u8))
        } else {
            None
        }
    }

    /// How many.
    pub const fn count(self) -> usize {
        self.0 as usize
    }
}

/// One of a cell's orthogonal sub-channels, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SubChannel(u8);

impl SubChannel {
    /// The sub-channel with this index, or `None` from [`MAX_SUB_CHANNELS`] on.
    pub const fn new(index: u8) -> Option<Self> {
        if (index as usize) < MAX_SUB_CHANNELS {
            Some(Self(index))
        } else {
            None
        }
    }

    /// The index, below [`MAX_SUB_CHANNELS`].
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// Index of a 1 ms slot, as the cell counts them: the same for all vehicles, since their modems are synchronised (LTE's system frame
/// and subframe number). It wraps after 49.7 days, once in which all turns move together.
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

/// Age of information in slots (= ms): 1 in the slot after a success, one more in every further slot (the paper's eq. 4), saturating
/// at [`Age::MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Age(u16);

impl Age {
    /// The youngest possible age.
    pub const MIN: Self = Self(1);
    /// The time constraint T of the paper's Table I, 100 ms: where its ages saturate, and those of vehicles begin that were never
    /// received.
    pub const TIME_CONSTRAINT: Self = Self(100);
    /// Where ages saturate, 65.5 s: a vehicle that was never received.
    pub const MAX: Self = Self(u16::MAX);

    /// The age `slots` after a success, saturating at both ends.
    pub const fn after(slots: u32) -> Self {
        // Two selections and no early return: the same instructions for every age.
        let most = Self::MAX.0 as u32;
        let slots = if slots > most { most } else { slots };
        let slots = if slots == 0 { 1 } else { slots };
        #[allow(clippy::cast_possible_truncation, reason = "at most MAX")]
        Self(slots as u16)
    }

    /// The age one slot later without a success.
    #[must_use]
    pub const fn older(self) -> Self {
        Self::after((self.0 as u32).saturating_add(1))
    }

    /// The age in slots, from 1 on.
    pub const fn slots(self) -> u16 {
        self.0
    }
}

/// How much a vehicle's age counts against those of others when it contends, in 1/32: the base station gives weak vehicles more, since
/// each of their chances is worth less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Weight(pub u8);

impl Weight {
    /// As much as it is.
    pub const ONE: Self = Self(32);
}
