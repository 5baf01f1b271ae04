//! What a table's network sees and what its outputs mean. Each form takes the same instructions for every measurement.
//!
//! The shipped table has [`ObservationForm::Ring`] and [`OutputForm::Actions`]; the others are for actors that were
//! trained in the paper's own form, or between the two.

use crate::decision::{ACTIONS, Action, Decision, PowerPlan, SUB_CHANNEL_CHOICES, better};
use crate::network::MAX_OUTPUTS;
use crate::observation::{INPUTS, ONE_HOT_INPUTS, Observation, PAPER_INPUTS};
use crate::units::{Dbm, Level, SubChannel};
use serde::{Deserialize, Serialize};

/// What a network sees of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum ObservationForm {
    /// [`Observation::encode`]: how the ring's turn stands to the vehicle, for any number of sub-channels.
    #[serde(rename = "firmware")]
    Ring = 0,
    /// [`Observation::encode_age_one_hot`]: nothing of the ring.
    AgeOneHot = 1,
    /// [`Observation::encode_paper`]: the paper's state.
    Paper = 2,
}

/// Most inputs of any form.
pub const MAX_INPUTS: usize = ONE_HOT_INPUTS;

impl ObservationForm {
    /// All of them, by their codes in a table.
    pub const ALL: [Self; 3] = [Self::Ring, Self::AgeOneHot, Self::Paper];

    /// Number of inputs.
    pub const fn inputs(self) -> usize {
        match self {
            Self::Ring => INPUTS,
            Self::AgeOneHot => ONE_HOT_INPUTS,
            Self::Paper => PAPER_INPUTS,
        }
    }

    /// Calls `then` with the inputs for this observation, as many as [`ObservationForm::inputs`] says: forms differ in their
    /// length, and nothing is copied.
    pub fn encode<T>(
        self,
        observation: &Observation,
        required_sinr: Level,
        then: impl FnOnce(&[i8]) -> T,
    ) -> T {
        match self {
            Self::Ring => then(&observation.encode(required_sinr)),
            Self::AgeOneHot => then(&observation.encode_age_one_hot(required_sinr)),
            Self::Paper => then(&observation.encode_paper()),
        }
    }
}

/// What a network's outputs mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum OutputForm {
    /// Scores of [`Action::ALL`].
    Actions = 0,
    /// Scores of the choices of [`PowerPlan::sub_channel_choice`].
    SubChannels = 1,
    /// The same, but silence is never chosen.
    SendingSubChannels = 2,
    /// The paper's continuous action: a and b before tanh, in steps of 1/[`CONTINUOUS_ONE`]. The sub-channel is floor(N (1 +
    /// tanh a) / 2), the power p_max (1 + tanh b) / 2 in mW.
    SubChannelAndPower = 3,
}

/// The output that stands for 1.0 in [`OutputForm::SubChannelAndPower`] (chosen: one step is at most 0.034 dB, and coarser than the
/// steps of any trained output layer must be).
pub const CONTINUOUS_ONE: i32 = 256;

impl OutputForm {
    /// All of them, by their codes in a table.
    pub const ALL: [Self; 4] = [
        Self::Actions,
        Self::SubChannels,
        Self::SendingSubChannels,
        Self::SubChannelAndPower,
    ];

    /// Number of outputs.
    pub const fn outputs(self) -> usize {
        match self {
            Self::Actions => ACTIONS,
            Self::SubChannels | Self::SendingSubChannels => SUB_CHANNEL_CHOICES,
            Self::SubChannelAndPower => 2,
        }
    }

    /// The same where silence may be chosen or not; only [`OutputForm::SubChannels`] exists without.
    #[must_use]
    pub const fn with_silence(self, silence: bool) -> Self {
        match self {
            Self::SubChannels if !silence => Self::SendingSubChannels,
            form => form,
        }
    }

    /// The decision that a network's outputs stand for; those after [`OutputForm::outputs`] are ignored. Total.
    pub fn decision(
        self,
        outputs: &[i32; MAX_OUTPUTS],
        observation: &Observation,
        plan: &PowerPlan,
    ) -> Decision {
        let [first, second, ..] = *outputs;
        match self {
            Self::Actions => {
                let (scores, _) = outputs.split_first_chunk().unwrap_or((&[0; ACTIONS], &[]));
                plan.decision(Action::from_outputs(scores), observation)
            }
            Self::SubChannels => plan.sub_channel_choice(largest(outputs, 0), observation),
            Self::SendingSubChannels => plan.sub_channel_choice(largest(outputs, 1), observation),
            Self::SubChannelAndPower => sub_channel_and_power(first, second, observation),
        }
    }
}

/// Index of the largest score from `least` on; of equal ones the first.
fn largest(outputs: &[i32; MAX_OUTPUTS], least: usize) -> usize {
    let mut best = (least, i32::MIN);
    for (choice, &output) in outputs.iter().enumerate().take(SUB_CHANNEL_CHOICES).skip(least) {
        best = better(best, (choice, output));
    }
    best.0
}

/// Where 3 (1 + tanh a) / 2 reaches 2, in steps of a: atanh(1/3) = ln(2) / 2 is 88.7 of them; where it reaches 1, there are
/// as many below 0.
const THIRD: i32 = 89;

/// Powers that are less than full power by more than this are silence (chosen: 75 dB, where 1 + tanh b ends in f32).
const LEAST_POWER: u32 = 75 << 8;

/// From here on, 16, neither sub-channel nor power changes.
const LARGEST_OUTPUT: i32 = 16 * CONTINUOUS_ONE;

fn sub_channel_and_power(a: i32, b: i32, observation: &Observation) -> Decision {
    let index = u8::from(a > -THIRD).wrapping_add(u8::from(a >= THIRD));
    let reduction = reduction(b.clamp(-LARGEST_OUTPUT, LARGEST_OUTPUT));
    let power = Dbm::from_bits(
        observation
            .max_power()
            .to_bits()
            .saturating_sub_unsigned(reduction as u16),
    );
    match SubChannel::new(index).and_then(|sub_channel| observation.existing(sub_channel)) {
        Some(sub_channel) if reduction <= LEAST_POWER => Decision::Transmit { sub_channel, power },
        _ => Decision::Silent,
    }
}

/// Spacing of [`BEND`] in steps of b, as a power of two: 1/8 in x = 2 b.
const BEND_STEP_BITS: u32 = 5;

/// `BEND[i]` = 10 log10(1 + exp(-i / 8)) in 1/256 dB; 0 from [`NO_BEND`] on.
static BEND: [u16; NO_BEND + 2] = [
    771, 703, 640, 582, 527, 477, 430, 387, 348, 313, 280, 251, 224, 200, 178, 159, 141, 125, 111, 99, 88,
    78, 69, 61, 54, 48, 42, 37, 33, 29, 26, 23, 20, 18, 16, 14, 12, 11, 10, 8, 7, 7, 6, 5, 5, 4, 4, 3, 3, 2,
    2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0,
];
const NO_BEND: usize = 62;

/// How much less than full power (1 + tanh b) / 2 = 1 / (1 + exp(-2 b)) of it is, in 1/256 dB, for b within
/// [`LARGEST_OUTPUT`].
///
/// 10 log10(1 + exp(-2 b)) is a bend around 0, and for b below it a line on top. Measured against f64: at most 1.7 off
/// (`tests/form.rs`).
fn reduction(b: i32) -> u32 {
    let distance = b.unsigned_abs().wrapping_mul(2);
    // 10 / ln(10) dB in 1/256 dB for each step: 2560 / ln(10) / 256 = 284619 / 65536
    let line = distance.wrapping_mul(284_619) >> 16;
    let index = ((distance >> BEND_STEP_BITS) as usize).min(NO_BEND);
    let within = distance & ((1 << BEND_STEP_BITS) - 1);
    let left = u32::from(BEND.get(index).copied().unwrap_or(0));
    let right = u32::from(BEND.get(index.saturating_add(1)).copied().unwrap_or(0));
    let bend = left.wrapping_sub(left.wrapping_sub(right).wrapping_mul(within) >> BEND_STEP_BITS);
    // A mask and no branch: the same instructions for every output.
    bend.wrapping_add(line & (b >> 31).cast_unsigned())
}
