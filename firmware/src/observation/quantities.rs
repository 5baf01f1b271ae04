//! The arithmetic of an observation: each formula once, on plain integers. [`Observation`](super::Observation) calls it for
//! its vehicle, the simulator for a row of worlds, lane by lane; so nothing here branches on a value.

use crate::units::Level;

/// Length of the actor's input.
pub const INPUTS: usize = 22;

/// The int8 code of 1.0: inputs are in steps of 1/64 and saturate at -2 and +1.984.
pub const ONE: i8 = 64;

/// Slots that a vehicle keeps a place at least that it found by itself (chosen).
pub const LEAST_KEPT: i32 = 50;

/// Frames from which on ages no longer raise a priority (chosen: some 100 slots at 20 vehicles, the paper's time constraint).
const OLDEST_FRAMES: i32 = 15;

/// No sub-channel.
pub const NOWHERE: i32 = -1;

/// What a vehicle sees in a slot's sub-channels, taken in one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sight {
    /// The sub-channel that carries its own place, or [`NOWHERE`].
    pub own: i32,
    /// Its level there, in 1/256 dB; that of [`Sight::NOTHING`] where there is none.
    pub own_gain: i32,
    /// Of the open sub-channels the one that it likes best ([`liking`]), or [`NOWHERE`].
    pub best: i32,
    /// How much.
    pub best_liking: i32,
    /// Its level there.
    pub best_gain: i32,
    /// Of the sub-channels that carry others' places the one with its largest level, or [`NOWHERE`].
    pub guest: i32,
    /// Its level there.
    pub guest_gain: i32,
}

impl Sight {
    /// Before the first sub-channel.
    pub const NOTHING: Self = Self {
        own: NOWHERE,
        own_gain: Level::MIN.to_bits() as i32,
        best: NOWHERE,
        best_liking: i32::MIN,
        best_gain: Level::MIN.to_bits() as i32,
        guest: NOWHERE,
        guest_gain: Level::MIN.to_bits() as i32,
    };

    /// Takes in a sub-channel with the place that it carries and the vehicle's level on it. `own` is the vehicle's place, negative
    /// for none; `open` says that the one that is carried is nobody's; `liking` is [`liking`].
    #[inline(always)]
    #[must_use]
    pub const fn with(
        self,
        sub_channel: i32,
        place: i32,
        gain: i32,
        own: i32,
        open: bool,
        liking: i32,
    ) -> Self {
        let is_own = place == own;
        let is_best = open & (liking > self.best_liking);
        let is_guest = !(open | is_own) & (gain > self.guest_gain);
        Self {
            own: if is_own { sub_channel } else { self.own },
            own_gain: if is_own { gain } else { self.own_gain },
            best: if is_best { sub_channel } else { self.best },
            best_liking: if is_best { liking } else { self.best_liking },
            best_gain: if is_best { gain } else { self.best_gain },
            guest: if is_guest { sub_channel } else { self.guest },
            guest_gain: if is_guest { gain } else { self.guest_gain },
        }
    }
}

/// What one vehicle knows in one slot, in plain integers, with the reciprocals that stand for divisions. Levels are in
/// 1/256 dB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantities {
    /// The age of information in slots.
    pub age: i32,
    /// Sub-channels of the cell.
    pub sub_channels: i32,
    /// Places of the ring.
    pub places: i32,
    /// [`places_reciprocal`](crate::reciprocal::places_reciprocal) of them.
    pub places_reciprocal: i32,
    /// The ring's [`frame`](crate::ring::Ring::frame).
    pub frame: i32,
    /// The vehicle's place, negative if it has none.
    pub place: i32,
    /// 1 if it was handed out, else 0.
    pub assigned: i32,
    /// 1 if an acknowledgement may be under way, else 0.
    pub awaits: i32,
    /// Places that are handed out before the vehicle's own is; none says nothing.
    pub places_until_turn: i32,
    /// The weight of its age, in 1/32.
    pub weight: i32,
    /// The least priority with which to contend, at most [`Quantities::NEVER`].
    pub threshold: i32,
    /// 1 if gains still hold when they are used, else 0.
    pub gains_hold: i32,
    /// The slot's lot, uniform on 0 to 65535.
    pub lot: i32,
    /// What it sees.
    pub sight: Sight,
}

impl Quantities {
    /// A threshold that no priority reaches.
    pub const NEVER: i32 = i32::MAX;

    /// Whether the last success is more than `frames` ago.
    #[inline(always)]
    const fn older_than(&self, frames: i32) -> bool {
        self.age.wrapping_mul(self.sub_channels) > self.places.wrapping_mul(frames)
    }

    /// Whether a sub-channel carries the vehicle's own place.
    #[inline(always)]
    pub const fn own_turn(&self) -> bool {
        self.sight.own >= 0
    }

    /// Whether the last success is more than a frame ago.
    #[inline(always)]
    pub const fn late(&self) -> bool {
        self.older_than(1)
    }

    /// Whether the last success is more than three frames ago.
    #[inline(always)]
    pub const fn overdue(&self) -> bool {
        self.older_than(3)
    }

    /// Whether the vehicle has no turn: no place, or one that it found by itself and lost again ([`place_lost`]).
    #[inline(always)]
    pub const fn turn_lost(&self) -> bool {
        let lost = place_lost(self.age, self.sub_channels, self.places);
        (self.place < 0) | ((self.assigned == 0) & lost)
    }

    /// How much the vehicle should be heard now, for it and for the base station alike: its weighed age, with its lot to part equals. Whose
    /// turn will come has less, the less the sooner, and nothing in the half frame after a success (chosen; prototype in the
    /// hard cell).
    #[inline(always)]
    pub const fn priority(&self) -> i32 {
        // Older ones count as these many: who can hardly be heard must not take everybody's turns.
        let oldest = self.frame.wrapping_mul(OLDEST_FRAMES) >> 8;
        let age = if self.age < oldest { self.age } else { oldest };
        let age = if age < 4095 { age } else { 4095 };
        let weighed = age
            .wrapping_mul(self.weight)
            .wrapping_mul((self.lot >> 10).wrapping_add(1024))
            >> 4;
        // In 1/256 of a frame, at most one.
        let until = self.places_until_turn.wrapping_mul(self.places_reciprocal) >> 16;
        let until = if until < 256 { until } else { 256 };
        let patience = if self.gains_hold > 0 { 115 } else { 70 };
        let owner = (weighed >> 8).wrapping_mul(until.wrapping_add(256).wrapping_mul(patience) >> 8);
        let young = self.age.wrapping_mul(self.sub_channels).wrapping_mul(2) < self.places;
        let owner = if young { 0 } else { owner };
        if self.turn_lost() { weighed } else { owner }
    }

    /// Whether the vehicle is asked to contend.
    #[inline(always)]
    pub const fn is_called(&self) -> bool {
        self.priority() >= self.threshold
    }

    /// Whether a gain carries a report alone, as far as the vehicle knows: it hopes so where gains do not hold. Both are in 1/256 dB.
    #[inline(always)]
    pub const fn reaches(&self, gain: i32, required_sinr: i32) -> bool {
        (gain >= required_sinr) | (self.gains_hold == 0)
    }

    /// Whether it may be a guest where another one's place is: its gain suffices there, and its priority is 8/3 of the threshold or more
    /// (chosen: in the hard cell 5/2 and 4 do alike and 3/2 worse; three eighths need no division). `required_sinr` is in 1/256 dB.
    #[inline(always)]
    pub const fn is_guest(&self, required_sinr: i32) -> bool {
        let starves = (self.priority() >> 3).wrapping_mul(3) >= self.threshold;
        let reaches = (self.sight.guest >= 0) & (self.sight.guest_gain >= required_sinr);
        starves & reaches & (self.gains_hold > 0)
    }

    /// At which of the four levels to be received when contending: the lot's last bits, which part nobody's priorities. The highest where
    /// gains do not hold, so that a lower one cannot be aimed at.
    #[inline(always)]
    pub const fn level(&self) -> i32 {
        // Bits and no branch.
        self.lot & 3 | 1_i32.wrapping_sub(self.gains_hold).wrapping_mul(3)
    }

    /// How far the priority is above the threshold, in sixteenths of a doubling.
    #[inline(always)]
    const fn call(&self) -> i32 {
        doublings(self.priority()).wrapping_sub(doublings(self.threshold))
    }

    /// The age in five frames, in 1/64, at most 2.
    #[inline(always)]
    const fn age_code(&self) -> i32 {
        let most = self.places.wrapping_mul(10);
        let turns = self.age.wrapping_mul(self.sub_channels);
        let turns = if turns < most { turns } else { most };
        // In frames in 1/1024, times 12.8.
        ((turns.wrapping_mul(self.places_reciprocal) >> 14).wrapping_mul(AGE_CODES)) >> 16
    }

    /// The actor's input in steps of 1/64, each in the range of i8; for its shape see
    /// [`Observation::encode`](super::Observation::encode). `required_sinr` is in 1/256 dB.
    #[inline(always)]
    pub fn encode(&self, required_sinr: i32) -> [i32; INPUTS] {
        let sight = &self.sight;
        [
            flag(self.own_turn()),
            flag(self.turn_lost()),
            flag(self.late()),
            flag(self.overdue()),
            flag(self.assigned > 0),
            flag(self.awaits > 0),
            saturate(self.age_code()),
            // 64 / 20 codes a slot, which is 256.
            saturate(self.frame.wrapping_mul(819) >> 16),
            gain_code(sight.own_gain),
            flag(sight.own_gain >= required_sinr),
            gain_code(sight.best_gain),
            flag(sight.best_gain >= required_sinr),
            flag(self.gains_hold > 0),
            flag(self.is_called()),
            saturate(self.call()),
            saturate(self.weight >> 1),
            flag(self.level() > 0),
            flag(self.level() > 1),
            flag(sight.best >= 0),
            saturate((self.places_until_turn.wrapping_mul(self.places_reciprocal)) >> 18),
            flag(self.level() > 2),
            flag(self.is_guest(required_sinr)),
        ]
    }
}

/// Whether a place that a vehicle found by itself is lost, for it and for the base station alike: without success for seven frames and
/// [`LEAST_KEPT`] slots (chosen; measured best from 5 to 60 vehicles).
#[inline(always)]
pub const fn place_lost(age: i32, sub_channels: i32, places: i32) -> bool {
    (age.wrapping_mul(sub_channels) > places.wrapping_mul(7)) & (age > LEAST_KEPT)
}

/// How much a vehicle likes an open sub-channel: by its gain if gains still hold, otherwise by its lot and the broadcast salt, so that the
/// base station knows it. `gains_hold` is 0 or 1.
#[inline(always)]
pub const fn liking(gain: i32, gains_hold: i32, lot: i32, salt: i32, sub_channel: i32) -> i32 {
    // Two rounds of multiplication (the constants of MurmurHash3): a single one ranks many sub-channels much alike for every lot.
    let salted = lot
        .wrapping_add(salt.wrapping_mul(0x3c6f))
        .wrapping_add(sub_channel.wrapping_mul(0x9e37));
    let mixed = salted.wrapping_mul(0x85eb_ca6b_u32.cast_signed());
    let mixed = (mixed ^ mixed >> 13).wrapping_mul(0xc2b2_ae35_u32.cast_signed());
    let mixed = mixed >> 16 & 0x7fff;
    // A mask and no choice, of which a loop over sub-channels would be made twice.
    let mask = gains_hold.wrapping_neg();
    gain & mask | mixed & !mask
}

/// How many places are handed out before one that is `place`, where `first` is the next, of so many; all of them before one that the ring
/// does not have.
#[inline(always)]
pub const fn until_turn(place: i32, first: i32, places: i32) -> i32 {
    let ahead = place.wrapping_sub(first);
    let ahead = if ahead < 0 {
        ahead.wrapping_add(places)
    } else {
        ahead
    };
    if place < places { ahead } else { places }
}

/// Codes of an age a frame, in 1/64: 64 / 5 = 12.8.
const AGE_CODES: i32 = 819;

/// Codes of a gain in 1/256 dB, in 1/65536: 64 / 20 a dB, to 2e-4.
const GAIN_CODES: i32 = 819;

/// What the gain's code is at 0 dB, below 0: 64 x 3.5 / 2.
const GAIN_OFFSET: i32 = 112;

/// Codes of an interference in 1/256 dB, in 1/65536: 64 / 40 a dB, to 1e-3.
const INTERFERENCE_CODES: i32 = 410;

/// The logarithm to the base 2 in sixteenths of a number that is at least 16: straight between powers and rounded down, so at most 2.4
/// too small. The same instructions for every number.
#[inline(always)]
const fn doublings(number: i32) -> i32 {
    let number = if number < 16 { 16 } else { number };
    let exponent = 31_i32.wrapping_sub(number.leading_zeros().cast_signed());
    let mantissa = number >> exponent.wrapping_sub(4) & 15;
    exponent.wrapping_mul(16).wrapping_add(mantissa)
}

/// The input for a yes or a no.
#[inline(always)]
pub(super) const fn flag(condition: bool) -> i32 {
    // No branch: `bool as i32` is 0 or 1.
    (condition as i32).wrapping_mul(ONE as i32)
}

/// The nearest number in the range of i8.
#[inline(always)]
pub(super) fn saturate(value: i32) -> i32 {
    value.clamp(i32::from(i8::MIN), i32::from(i8::MAX))
}

/// Code of a gain in 1/256 dB: 64 (dB / 10 - 3.5) / 2 = 3.2 dB - 112, rounded down; at most 1.06 steps off.
#[inline(always)]
pub(super) fn gain_code(gain: i32) -> i32 {
    saturate((gain.wrapping_mul(GAIN_CODES) >> 16).wrapping_sub(GAIN_OFFSET))
}

/// Code of an interference in 1/256 dB: 64 dB / 40 = 1.6 dB, rounded down.
#[inline(always)]
pub(super) fn interference_code(interference: i32) -> i32 {
    saturate(interference.wrapping_mul(INTERFERENCE_CODES) >> 16)
}
