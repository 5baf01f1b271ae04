//! A measurement as the actor sees it: how the ring's turn stands to its vehicle, encoded as int8. All normalisation lives here, so
//! training, simulation and deployment cannot differ in it.

mod quantities;

pub use crate::reciprocal::places_reciprocal;
pub use quantities::{INPUTS, LEAST_KEPT, NOWHERE, ONE, Quantities, Sight};

use crate::lots::Identity;
use crate::measurement::{Broadcast, Measurement, Place};
use crate::ring::{carrier, hop};
use crate::units::{Age, Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannel, Weight};
use quantities::{flag, gain_code, interference_code, saturate};
pub use quantities::{liking, place_lost, until_turn};

/// Sub-channels of a cell whose actors see and choose all of them one by one: the paper's Table I.
pub const PAPER_SUB_CHANNELS: usize = 3;

/// Ages that [`Observation::encode_age_one_hot`] tells apart; older ones are alike (chosen: seven frames of twenty vehicles).
pub const ONE_HOT_AGES: usize = 51;

/// Inputs of [`Observation::encode_age_one_hot`].
pub const ONE_HOT_INPUTS: usize = ONE_HOT_AGES + 3 * PAPER_SUB_CHANNELS + 1;

/// The code that stands there for a private uniform of 1.
pub const UNIFORM_ONE: i8 = i8::MAX;

/// Inputs of [`Observation::encode_paper`].
pub const PAPER_INPUTS: usize = 2 * PAPER_SUB_CHANNELS + 1;

/// What one vehicle knows in one slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    age: Age,
    quantities: Quantities,
    max_power: Dbm,
    gain: [Level; MAX_SUB_CHANNELS],
    interference: [Level; MAX_SUB_CHANNELS],
}

impl Observation {
    /// The view of a measurement from its vehicle.
    pub fn new(measurement: &Measurement, identity: Identity) -> Self {
        let broadcast = measurement.broadcast();
        Self::seen(
            measurement.slot(),
            measurement.all_gains(),
            measurement.all_interferences(),
            measurement.age(),
            measurement.place(),
            measurement.weight(),
            measurement.awaits_acknowledgement(),
            broadcast,
            identity,
        )
    }

    /// What a vehicle supposes in a slot without a measurement: this level on every sub-channel, and no interference.
    pub(crate) fn predicted(
        slot: SlotIndex,
        level: Level,
        age: Age,
        place: Option<Place>,
        broadcast: &Broadcast,
        identity: Identity,
    ) -> Self {
        let mut gain = [Level::ZERO; MAX_SUB_CHANNELS];
        for gain in gain.iter_mut().take(broadcast.ring.sub_channels().count()) {
            *gain = level;
        }
        Self::seen(
            slot,
            &gain,
            &[Level::ZERO; MAX_SUB_CHANNELS],
            age,
            place,
            Weight::ONE,
            false,
            broadcast,
            identity,
        )
    }

    #[allow(
        clippy::too_many_arguments,
        reason = "a slot's readings, with or without a measurement"
    )]
    #[inline(always)]
    fn seen(
        slot: SlotIndex,
        gain: &[Level; MAX_SUB_CHANNELS],
        interference: &[Level; MAX_SUB_CHANNELS],
        age: Age,
        place: Option<Place>,
        weight: Weight,
        awaits: bool,
        broadcast: &Broadcast,
        identity: Identity,
    ) -> Self {
        let ring = &broadcast.ring;
        let (sub_channels, places) = (ring.sub_channels(), i32::from(ring.places()));
        let own = place.map_or(NOWHERE, |place| i32::from(place.index));
        let (first, hop) = (i32::from(ring.first_place(slot)), hop(slot, sub_channels));
        let (mut sight, mut next) = (Sight::NOTHING, first);
        // Kept from the optimiser, which would make a loop for either case, of different length.
        let gains_hold = core::hint::black_box(i32::from(broadcast.gains_hold));
        let lot = (identity.lot(slot) >> 16) as i32;
        for offset in 0..sub_channels.count() {
            let sub_channel = carrier(offset, hop, sub_channels);
            let level = gain.get(sub_channel).copied().unwrap_or(Level::MIN);
            let level = i32::from(level.to_bits());
            let liking = liking(
                level,
                gains_hold,
                lot,
                i32::from(broadcast.salt),
                sub_channel as i32,
            );
            let open = broadcast.open.contains(sub_channel);
            sight = sight.with(sub_channel as i32, next, level, own, open, liking);
            let after = next.wrapping_add(1);
            next = if after == places { 0 } else { after };
        }
        Self {
            age,
            quantities: Quantities {
                age: i32::from(age.slots()),
                sub_channels: sub_channels.count() as i32,
                places,
                places_reciprocal: places_reciprocal(ring.places()),
                frame: ring.frame(),
                place: own,
                assigned: i32::from(place.is_some_and(|place| place.assigned)),
                awaits: i32::from(awaits),
                gains_hold,
                places_until_turn: until_turn(own, first, places),
                weight: i32::from(weight.0),
                threshold: broadcast.threshold.min(Quantities::NEVER as u32) as i32,
                lot,
                sight,
            },
            max_power: broadcast.max_power,
            gain: *gain,
            interference: *interference,
        }
    }

    /// The age of information.
    pub const fn age(&self) -> Age {
        self.age
    }

    /// What the vehicle may send with at most.
    pub const fn max_power(&self) -> Dbm {
        self.max_power
    }

    /// Level at the base station at full power, by sub-channel.
    pub const fn gain(&self) -> &[Level; MAX_SUB_CHANNELS] {
        &self.gain
    }

    /// Noise plus interference in the slot before, by sub-channel.
    pub const fn interference(&self) -> &[Level; MAX_SUB_CHANNELS] {
        &self.interference
    }

    /// The same in plain integers: whose turn it is, and what to draw from.
    #[inline(always)]
    pub const fn quantities(&self) -> &Quantities {
        &self.quantities
    }

    /// The actor's input, in steps of 1/64.
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0 | flag: a sub-channel carries the vehicle's own place |
    /// | 1 | flag: the vehicle has no turn ([`Quantities::turn_lost`]) |
    /// | 2, 3 | flags: no success for a frame, for three |
    /// | 4 | flag: the place was handed out |
    /// | 5 | flag: an acknowledgement may be under way |
    /// | 6 | age in five frames, at most 2 |
    /// | 7 | frame in 20 slots |
    /// | 8 | (gain in dB / 10 - 3.5) / 2 where its place is, the least one if nowhere |
    /// | 9 | flag: that reaches `required_sinr` |
    /// | 10, 11 | the same of the largest gain on an open sub-channel |
    /// | 12 | flag: gains still hold when they are used |
    /// | 13 | flag: the vehicle is called to contend ([`Quantities::is_called`]) |
    /// | 14 | how far its priority is above the threshold, in four doublings |
    /// | 15 | weight of its age, over 4 |
    /// | 16, 17 | flags: its level when contending is not the lowest, is one of the upper two ([`Quantities::level`]) |
    /// | 18 | flag: some sub-channel is open |
    /// | 19 | share of the ring until its turn; without a meaning if it has no place |
    /// | 20 | flag: its level is the highest |
    /// | 21 | flag: it may be a guest in another's place ([`Quantities::is_guest`]) |
    pub fn encode(&self, required_sinr: Level) -> [i8; INPUTS] {
        self.quantities
            .encode(i32::from(required_sinr.to_bits()))
            .map(|input| input as i8)
    }

    /// The sub-channel that an actor of [`PAPER_SUB_CHANNELS`] sees first: by its place, so that neighbours in the ring differ.
    pub fn home(&self) -> usize {
        // None is a negative place: no branch.
        self.quantities.place.max(0) as usize % PAPER_SUB_CHANNELS
    }

    /// The sub-channel that stands `offset` places behind the first one in the order that an actor of [`PAPER_SUB_CHANNELS`] sees.
    pub(crate) fn seen_at(&self, offset: usize) -> SubChannel {
        let index = self.home().wrapping_add(offset) % PAPER_SUB_CHANNELS;
        SubChannel::new(index as u8).unwrap_or(FIRST)
    }

    /// This sub-channel if the cell has it.
    pub(crate) fn existing(&self, sub_channel: SubChannel) -> Option<SubChannel> {
        ((sub_channel.index() as i32) < self.quantities.sub_channels).then_some(sub_channel)
    }

    /// The input of an actor that is to find a phase by itself, in a cell of [`PAPER_SUB_CHANNELS`].
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0-50 | flags: the age is 1, 2, ... 50, at least 51 |
    /// | 51-53 | gains as in [`Observation::encode`], from the sub-channel on that is the remainder of the vehicle's place |
    /// | 54-56 | flags: they reach `required_sinr` |
    /// | 57-59 | interference in 40 dB |
    /// | 60 | the lot, [`UNIFORM_ONE`] for 1 |
    pub fn encode_age_one_hot(&self, required_sinr: Level) -> [i8; ONE_HOT_INPUTS] {
        let age = usize::from(self.age.slots()).min(ONE_HOT_AGES);
        let level = |levels: &[Level; MAX_SUB_CHANNELS], offset: usize| {
            levels
                .get(self.seen_at(offset).index())
                .map_or(0, |level| i32::from(level.to_bits()))
        };
        let sub_channels = 0..PAPER_SUB_CHANNELS;
        let gains = sub_channels.clone().map(|offset| level(&self.gain, offset));
        let noises = sub_channels.map(|offset| level(&self.interference, offset));
        let required = i32::from(required_sinr.to_bits());
        let uniform = self.quantities.lot.wrapping_mul(i32::from(UNIFORM_ONE));
        let rest = gains
            .clone()
            .map(gain_code)
            .chain(gains.map(|gain| flag(gain >= required)))
            .chain(noises.map(interference_code))
            .chain([saturate(uniform.wrapping_add(1 << 15) >> 16)]);
        let mut inputs = [0; ONE_HOT_INPUTS];
        let (ages, others) = inputs.split_at_mut(ONE_HOT_AGES);
        for (slots, input) in (1..).zip(ages) {
            *input = flag(slots == age) as i8;
        }
        for (input, value) in others.iter_mut().zip(rest) {
            *input = value as i8;
        }
        inputs
    }

    /// The paper's state, rounded to the nearest code (or 0.12 of one further off), in the cell's order of sub-channels.
    ///
    /// # Shape
    ///
    /// | index | input |
    /// |---|---|
    /// | 0-2 | (gain in dB - 35) / 20 |
    /// | 3-5 | interference in 40 dB |
    /// | 6 | age, one code a slot |
    pub fn encode_paper(&self) -> [i8; PAPER_INPUTS] {
        let [gain_0, gain_1, gain_2, ..] = self.gain.map(|level| i32::from(level.to_bits()));
        let [noise_0, noise_1, noise_2, ..] = self.interference.map(|level| i32::from(level.to_bits()));
        // Half a code more, then rounded down.
        let gain = |level: i32| gain_code(level.wrapping_add(HALF_A_GAIN_CODE));
        let interference = |level: i32| interference_code(level.wrapping_add(HALF_AN_INTERFERENCE_CODE));
        let most = Age::TIME_CONSTRAINT.slots();
        [
            gain(gain_0),
            gain(gain_1),
            gain(gain_2),
            interference(noise_0),
            interference(noise_1),
            interference(noise_2),
            i32::from(self.age.slots().min(most)),
        ]
        .map(|input| input as i8)
    }
}

/// The first sub-channel, which every cell has.
const FIRST: SubChannel = match SubChannel::new(0) {
    Some(first) => first,
    None => unreachable!(),
};

/// Half a code of a gain and of an interference, 10/64 dB and 20/64 dB, in 1/256 dB.
const HALF_A_GAIN_CODE: i32 = 40;
const HALF_AN_INTERFERENCE_CODE: i32 = 80;
