//! The actions that an actor may have, and what they mean for each sub-channel.

use firmware::decision::ACTIONS;
use firmware::units::SUB_CHANNELS;

/// A form of action as critics see it: a vector, one-hot for actors that choose among few.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionSet {
    /// The paper's two continuous values: sub-channel and power.
    Continuous,
    /// So many actions, all on the vehicle's home sub-channel: those of the firmware, or of a toy.
    Home(usize),
    /// Silence, full power on each sub-channel, the lowest joiner level on each; home first.
    SubChannels,
}

/// What a vehicle does on one sub-channel if it may use all: nothing at all, full power, low power, or something elsewhere.
const KINDS: usize = 4;
const ELSEWHERE: usize = 3;

impl ActionSet {
    /// The firmware's actions.
    pub const FIRMWARE: Self = Self::Home(ACTIONS);

    /// Length of an action as a vector, and of an actor's output.
    pub const fn length(self) -> usize {
        match self {
            Self::Continuous => 2,
            Self::Home(count) => count,
            Self::SubChannels => 1 + 2 * SUB_CHANNELS,
        }
    }

    /// Whether an actor chooses one of few.
    pub fn is_choice(self) -> bool {
        self != Self::Continuous
    }

    /// On how many sub-channels, from home on, an action can make a difference.
    pub const fn places(self) -> usize {
        match self {
            Self::SubChannels => SUB_CHANNELS,
            Self::Continuous | Self::Home(_) => 1,
        }
    }

    /// How many different things can happen in one place.
    pub const fn kinds(self) -> usize {
        match self {
            Self::SubChannels => KINDS,
            Self::Continuous => 2,
            Self::Home(count) => count,
        }
    }

    /// What an action means in a place.
    pub const fn kind(self, action: usize, place: usize) -> usize {
        match self {
            Self::Continuous | Self::Home(_) => action,
            Self::SubChannels => match action {
                0 => 0,
                sending if (sending - 1) % SUB_CHANNELS == place => 1 + (sending - 1) / SUB_CHANNELS,
                _ => ELSEWHERE,
            },
        }
    }
}
