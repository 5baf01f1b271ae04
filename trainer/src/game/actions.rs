//! What agents may do, and what it means on each sub-channel.

use crate::network::categorical::{draw, largest};
use firmware::decision::ACTIONS;
use firmware::form::OutputForm;
use firmware::observation::PAPER_SUB_CHANNELS;
use host_sim::stream::Stream;

/// The actions of an agent. Critics see one as a vector, one-hot where it is a choice; games take a choice as its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionSpace {
    /// The paper's two continuous values: sub-channel and power.
    Continuous,
    /// A choice of so many: the firmware's actions, or a toy's.
    Choices(usize),
    /// Silence, full power on each sub-channel, the lowest joiner level on each; first the one that the vehicle sees first.
    SubChannels,
}

/// What a vehicle does on one sub-channel if it may use all: nothing at all, full power, low power, or something elsewhere.
const KINDS: usize = 4;
const ELSEWHERE: usize = 3;

impl From<OutputForm> for ActionSpace {
    fn from(form: OutputForm) -> Self {
        match form {
            OutputForm::SubChannelAndPower => Self::Continuous,
            OutputForm::Actions => Self::Choices(ACTIONS),
            OutputForm::SubChannels | OutputForm::SendingSubChannels => Self::SubChannels,
        }
    }
}

impl ActionSpace {
    /// Appends the action of an actor with these outputs: greedy without a stream; with one a choice is drawn from the softmax of its
    /// scores, and continuous values, which went through tanh, get Gaussian noise of this standard deviation.
    pub fn act(self, outputs: &[f32], noise: f32, explore: Option<&mut Stream>, action: &mut Vec<f32>) {
        match (self, explore) {
            (Self::Continuous, None) => action.extend(outputs.iter().map(|&output| libm::tanhf(output))),
            (Self::Continuous, Some(stream)) => action.extend(
                outputs
                    .iter()
                    .map(|&output| (libm::tanhf(output) + noise * stream.normal() as f32).clamp(-1.0, 1.0)),
            ),
            (_, None) => action.push(largest(outputs) as f32),
            (_, Some(stream)) => action.push(draw(outputs, stream) as f32),
        }
    }

    /// Values of an action as a game takes it.
    pub const fn values(self) -> usize {
        match self {
            Self::Continuous => 2,
            Self::Choices(_) | Self::SubChannels => 1,
        }
    }

    /// Length of an action as a vector, and of an actor's output.
    pub const fn length(self) -> usize {
        match self {
            Self::Continuous => 2,
            Self::Choices(count) => count,
            Self::SubChannels => 1 + 2 * PAPER_SUB_CHANNELS,
        }
    }

    /// Whether an actor chooses one of few.
    pub fn is_choice(self) -> bool {
        self != Self::Continuous
    }

    /// On how many sub-channels, from that on, an action can make a difference.
    pub const fn places(self) -> usize {
        match self {
            Self::SubChannels => PAPER_SUB_CHANNELS,
            Self::Continuous | Self::Choices(_) => 1,
        }
    }

    /// How many different things can happen in one place.
    pub const fn kinds(self) -> usize {
        match self {
            Self::SubChannels => KINDS,
            Self::Continuous => 2,
            Self::Choices(count) => count,
        }
    }

    /// What an action means in a place.
    pub const fn kind(self, action: usize, place: usize) -> usize {
        match self {
            Self::Continuous | Self::Choices(_) => action,
            Self::SubChannels => match action {
                0 => 0,
                sending if (sending - 1) % PAPER_SUB_CHANNELS == place => {
                    1 + (sending - 1) / PAPER_SUB_CHANNELS
                }
                _ => ELSEWHERE,
            },
        }
    }
}
