//! From the network's output to a sub-channel and a power. Total: every output gives a legal decision.

use crate::observation::{Observation, PAPER_SUB_CHANNELS};
use crate::units::{Dbm, Level, SubChannel};

/// The most that leaves a unit, whatever a table, a base station or an error says: the last thing that a decision passes on its way to the
/// modem ([`UnitFrame`](crate::link::UnitFrame)). 33 dBm of EIRP is what ETSI EN 302 571 (section 4.2.3) allows at 5.9 GHz; a product sets
/// what it is certified for, less its antenna's gain.
pub const POWER_CEILING: Dbm = Dbm::from_bits(33 * 256);

/// Number of joiner levels.
pub const JOINER_LEVELS: usize = 4;

/// Number of actions, and of the network's outputs.
pub const ACTIONS: usize = 3 + JOINER_LEVELS;

/// Number of choices of a vehicle that may send on any sub-channel ([`PowerPlan::sub_channel_choice`]).
pub const SUB_CHANNEL_CHOICES: usize = 1 + 2 * PAPER_SUB_CHANNELS;

/// What a vehicle may do in a slot; the index is the network's output row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Action {
    /// Send nothing (0 W).
    Silent = 0,
    /// Send at full power where one's own place is.
    FullPower = 1,
    /// Send where the gain is largest of the sub-channels on which the vehicle may contend, so as to be received at the plan's first
    /// joiner level.
    Joiner1 = 2,
    /// The same at the second level.
    Joiner2 = 3,
    /// The same at the third level.
    Joiner3 = 4,
    /// The same at the fourth level.
    Joiner4 = 5,
    /// Send where the gain is largest of the sub-channels that carry others' places, so as to be received at the first joiner level: an
    /// owner who sends there captures the receiver, and the guest takes a place that its owner leaves.
    Guest = 6,
}

impl Action {
    /// All actions in the order of the network's outputs.
    pub const ALL: [Self; ACTIONS] = [
        Self::Silent,
        Self::FullPower,
        Self::Joiner1,
        Self::Joiner2,
        Self::Joiner3,
        Self::Joiner4,
        Self::Guest,
    ];

    /// The joiner actions from the lowest level up.
    pub const JOINERS: [Self; JOINER_LEVELS] = [Self::Joiner1, Self::Joiner2, Self::Joiner3, Self::Joiner4];

    /// The action with the largest output; of equal ones the first, so silence wins every tie.
    pub fn from_outputs(outputs: &[i32; ACTIONS]) -> Self {
        let mut best = (Self::Silent, i32::MIN);
        for (action, &output) in Self::ALL.into_iter().zip(outputs) {
            best = better(best, (action, output));
        }
        best.0
    }
}

/// Of the best choice so far and the next, each with its output, the one with the larger output; of equal ones the first. The simulator
/// calls it for a row of worlds, lane by lane.
#[inline(always)]
pub fn better<T>(best: (T, i32), next: (T, i32)) -> (T, i32) {
    if next.1 > best.1 { next } else { best }
}

/// One slot's decision: at most one sub-channel (the paper's C3), and exactly 0 W or a power up to the plan's maximum (C4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Decision {
    /// 0 W.
    Silent,
    /// Send.
    Transmit {
        /// On this sub-channel.
        sub_channel: SubChannel,
        /// With this power.
        power: Dbm,
    },
}

/// How actions become power. A table carries one, since its network was trained with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerPlan {
    /// Levels, in dB over noise at the base station, at which joiners aim to be received; each captures the receiver
    /// from all lower ones together.
    pub joiner_levels: [Level; JOINER_LEVELS],
}

impl PowerPlan {
    /// The decision that carries out `action`: silence where there is no sub-channel for it.
    pub fn decision(&self, action: Action, observation: &Observation) -> Decision {
        let sight = &observation.quantities().sight;
        // By indexing: one way for all actions takes the same number of instructions for each.
        let best = (sight.best, sight.best_gain);
        let (own, guest) = ((sight.own, sight.own_gain), (sight.guest, sight.guest_gain));
        let places = [best, own, best, best, best, best, guest];
        let (sub_channel, gain) = places.get(action as usize).copied().unwrap_or(best);
        let aim = i32::from(self.aim(action).to_bits());
        let power = power(observation.max_power(), gain, aim) as i16;
        match SubChannel::new(sub_channel as u8) {
            Some(sub_channel) if action != Action::Silent => Decision::Transmit {
                sub_channel,
                power: Dbm::from_bits(power),
            },
            _ => Decision::Silent,
        }
    }

    /// The level at which an action aims to be received; without meaning for silence.
    pub fn aim(&self, action: Action) -> Level {
        // By indexing: one way for all actions takes the same number of instructions for each.
        let [first, second, third, fourth] = self.joiner_levels;
        let aims = [FULL_POWER, FULL_POWER, first, second, third, fourth, first];
        aims.get(action as usize).copied().unwrap_or(FULL_POWER)
    }

    /// The decision of a vehicle that may send on any of [`PAPER_SUB_CHANNELS`]: 0 is silence, 1 to 3 full power on the sub-channels in
    /// the order in which it sees them, 4 to 6 the first joiner level there. What is larger is silence, and so is a sub-channel that the cell does not have.
    pub fn sub_channel_choice(&self, choice: usize, observation: &Observation) -> Decision {
        let [first, ..] = self.joiner_levels;
        let sending = choice.wrapping_sub(1);
        let (offset, aim) = if sending < PAPER_SUB_CHANNELS {
            (sending, FULL_POWER)
        } else {
            (sending.wrapping_sub(PAPER_SUB_CHANNELS), first)
        };
        let sub_channel = observation.seen_at(offset);
        let gain = observation.gain().get(sub_channel.index()).copied();
        let gain = i32::from(gain.unwrap_or(Level::MIN).to_bits());
        let power = power(observation.max_power(), gain, i32::from(aim.to_bits()));
        match observation.existing(sub_channel) {
            Some(sub_channel) if choice > 0 && choice < SUB_CHANNEL_CHOICES => Decision::Transmit {
                sub_channel,
                power: Dbm::from_bits(power as i16),
            },
            _ => Decision::Silent,
        }
    }
}

/// The power, in 1/256 dBm, to be received at the level `aim` by a base station that would receive full power at `gain`, both
/// in 1/256 dB: full power if that is not enough. The simulator calls it for a row of worlds, lane by lane.
#[inline(always)]
pub fn power(max_power: Dbm, gain: i32, aim: i32) -> i32 {
    let reduction = gain.wrapping_sub(aim).clamp(0, i32::from(i16::MAX));
    i32::from(max_power.to_bits())
        .wrapping_sub(reduction)
        .max(i32::from(i16::MIN))
}

/// No level is above the largest, so aiming there takes full power.
const FULL_POWER: Level = Level::MAX;
