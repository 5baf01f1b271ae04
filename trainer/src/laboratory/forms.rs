//! What actors see and what they do: one definition for training and evaluation.

use crate::distil::{as_float, best_action};
use firmware::decision::{Action, Decision, PowerPlan, SUB_CHANNEL_CHOICES};
use firmware::measurement::Measurement;
use firmware::observation::{ONE, Observation};
use firmware::observation::{ONE_HOT_INPUTS, PAPER_INPUTS, UNIFORM_ONE};
use firmware::units::{Age, Dbm, Level, SUB_CHANNELS, SubChannel};
use host_sim::stream::Stream;
use serde::{Deserialize, Serialize};

/// What an actor sees of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationForm {
    /// The firmware's int8 encoding ([`Observation::encode`]) as floats: home sub-channel first, with the flag of the own
    /// turn. The clock's phase is thus offered; what to do with it is learned.
    Firmware,
    /// The age as one-hot without any phase, the firmware's gains, their flags and interferences, and the private uniform: for
    /// research on what the flag of the own turn is worth.
    AgeOneHot,
    /// The paper's state: gain on every sub-channel, interference on every sub-channel in the slot before, age.
    Paper,
}

impl ObservationForm {
    /// Number of inputs.
    pub const fn length(self) -> usize {
        self.in_table().inputs()
    }

    /// The same observation in a table, in int8.
    pub const fn in_table(self) -> firmware::form::ObservationForm {
        match self {
            Self::Firmware => firmware::form::ObservationForm::HomeFirst,
            Self::AgeOneHot => firmware::form::ObservationForm::AgeOneHot,
            Self::Paper => firmware::form::ObservationForm::Paper,
        }
    }

    /// What an input is when its code in a table is [`ONE`].
    pub fn at_code_one(self, input: usize) -> f32 {
        match (self, input) {
            (Self::Paper, PAPER_AGE) => f32::from(ONE) / f32::from(Age::MAX.slots()),
            (Self::AgeOneHot, ONE_HOT_UNIFORM) => f32::from(ONE) / f32::from(UNIFORM_ONE),
            _ => 1.0,
        }
    }

    /// Writes the inputs.
    ///
    /// # Panics
    /// If `inputs` has another length than [`ObservationForm::length`].
    pub fn write(self, measurement: &Measurement, required_sinr: Level, inputs: &mut [f32]) {
        match self {
            Self::Firmware => {
                let encoded = Observation::new(measurement).encode(required_sinr);
                inputs.copy_from_slice(&as_float(&encoded));
            }
            Self::AgeOneHot => inputs.copy_from_slice(&age_one_hot(measurement, required_sinr)),
            Self::Paper => inputs.copy_from_slice(&paper(measurement)),
        }
    }
}

/// Index of the private uniform in [`ObservationForm::AgeOneHot`].
const ONE_HOT_UNIFORM: usize = ONE_HOT_INPUTS - 1;

/// Index of the age in [`ObservationForm::Paper`].
const PAPER_AGE: usize = PAPER_INPUTS - 1;

/// The firmware's codes, but the uniform as it is.
fn age_one_hot(measurement: &Measurement, required_sinr: Level) -> [f32; ONE_HOT_INPUTS] {
    let observation = Observation::new(measurement);
    let mut inputs = as_float(&observation.encode_age_one_hot(required_sinr));
    inputs[ONE_HOT_UNIFORM] = observation.quantities().private_uniform() as f32 / 65_536.0;
    inputs
}

/// Gains as (dB - 35) / 20, interference over noise in 40 dB, and age in its largest: each about -1 to 1, the scaling
/// of the firmware's encoding. The paper gives none (chosen).
fn paper(measurement: &Measurement) -> [f32; PAPER_INPUTS] {
    let mut inputs = [0.0; PAPER_INPUTS];
    let (gain, rest) = inputs.split_at_mut(SUB_CHANNELS);
    let (interference, age) = rest.split_at_mut(SUB_CHANNELS);
    for (input, level) in gain.iter_mut().zip(measurement.gain()) {
        *input = (level.to_num::<f32>() - 35.0) / 20.0;
    }
    for (input, level) in interference.iter_mut().zip(measurement.interference()) {
        *input = level.to_num::<f32>() / 40.0;
    }
    age[0] = f32::from(measurement.age().slots()) / f32::from(Age::MAX.slots());
    inputs
}

/// What an actor's outputs mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "form", deny_unknown_fields)]
pub enum OutputForm {
    /// Scores of the firmware's actions, in the order of [`Action::ALL`]. Greedy: the largest. Exploring: drawn from their
    /// softmax.
    Actions,
    /// The paper's continuous action, both parts through tanh: sub-channel `floor(N (1 + a) / 2)` and power `p_max (1 + b) /
    /// 2` in mW; what rounds to nothing is silence. Exploring: with Gaussian noise on both parts.
    SubChannelAndPower {
        /// Standard deviation of the noise, in units of a and b.
        noise: f32,
    },
    /// Scores of silence, of full power on each sub-channel, and of the lowest joiner level on each, home first. Greedy and
    /// exploring as [`OutputForm::Actions`].
    SubChannels {
        /// Whether silence may be chosen.
        silence: bool,
    },
}

impl OutputForm {
    /// Number of outputs.
    pub const fn length(self) -> usize {
        self.in_table().outputs()
    }

    /// The same outputs in a table, which is greedy.
    pub const fn in_table(self) -> firmware::form::OutputForm {
        match self {
            Self::Actions => firmware::form::OutputForm::Actions,
            Self::SubChannelAndPower { .. } => firmware::form::OutputForm::SubChannelAndPower,
            Self::SubChannels { silence: true } => firmware::form::OutputForm::SubChannels,
            Self::SubChannels { silence: false } => firmware::form::OutputForm::SendingSubChannels,
        }
    }

    /// The decision at the end of the network's outputs: greedy without a stream, exploring with one.
    pub fn decide(
        self,
        outputs: &[f32],
        measurement: &Measurement,
        plan: &PowerPlan,
        explore: Option<&mut Stream>,
    ) -> Decision {
        match self {
            Self::Actions => {
                let action = explore.map_or_else(|| best_action(outputs), |stream| sample(outputs, stream));
                plan.decision(action, &Observation::new(measurement))
            }
            Self::SubChannelAndPower { noise } => {
                let mut action = [libm::tanhf(outputs[0]), libm::tanhf(outputs[1])];
                if let Some(stream) = explore {
                    for part in &mut action {
                        *part = (*part + noise * stream.normal() as f32).clamp(-1.0, 1.0);
                    }
                }
                sub_channel_and_power(action, plan.max_power)
            }
            Self::SubChannels { silence } => {
                let least = usize::from(!silence);
                let score = |index: usize, explore: &mut Option<&mut Stream>| match explore {
                    Some(stream) => outputs[index] - libm::logf(stream.exponential()),
                    None => outputs[index],
                };
                let mut explore = explore;
                let mut best = (least, score(least, &mut explore));
                for index in least + 1..SUB_CHANNEL_CHOICES {
                    let score = score(index, &mut explore);
                    if score > best.1 {
                        best = (index, score);
                    }
                }
                plan.sub_channel_choice(best.0, &Observation::new(measurement))
            }
        }
    }
}

/// An action drawn from the softmax of its scores, by the Gumbel maximum.
pub fn sample(scores: &[f32], stream: &mut Stream) -> Action {
    let mut best = (Action::Silent, f32::NEG_INFINITY);
    for (action, &score) in Action::ALL.into_iter().zip(scores) {
        let perturbed = score - libm::logf(stream.exponential());
        if perturbed > best.1 {
            best = (action, perturbed);
        }
    }
    best.0
}

/// The decision of the paper's continuous action, whose parts lie in -1 to 1.
pub fn sub_channel_and_power([sub_channel, power]: [f32; 2], max_power: Dbm) -> Decision {
    let index = (SUB_CHANNELS as f32 * (1.0 + sub_channel) / 2.0) as usize;
    let share = (1.0 + power) / 2.0;
    let reduction = -2560.0 * libm::log10f(share);
    // A unit's power reaches down to -128 dBm; less is nothing.
    let bits = f32::from(max_power.to_bits()) - reduction;
    match SubChannel::new(index.min(SUB_CHANNELS - 1) as u8) {
        Some(sub_channel) if bits >= f32::from(i16::MIN) => Decision::Transmit {
            sub_channel,
            power: Dbm::from_bits(bits.floor() as i16),
        },
        _ => Decision::Silent,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random::initial;
    use firmware::decision::ACTIONS;

    #[test]
    fn continuous_actions_cover_silence_to_full_power_on_every_sub_channel() {
        let full = Dbm::from_bits(30 << 8);
        let decision = |a, b| sub_channel_and_power([a, b], full);
        let send = |index, bits| Decision::Transmit {
            sub_channel: SubChannel::new(index).unwrap(),
            power: Dbm::from_bits(bits),
        };
        assert_eq!(decision(-1.0, 1.0), send(0, 30 << 8));
        assert_eq!(decision(0.0, 1.0), send(1, 30 << 8));
        assert_eq!(decision(1.0, 1.0), send(2, 30 << 8));
        // Half the power is 3.0103 dB less: 770.6 steps of 1/256 dB, rounded down.
        assert_eq!(decision(1.0, 0.0), send(2, (30 << 8) - 771));
        assert_eq!(decision(0.0, -1.0), Decision::Silent);
    }

    #[test]
    fn sampling_follows_the_softmax() {
        let mut stream = initial(1, 0);
        let scores = [1.0, 0.0, -1.0, 2.0, 0.5, -9.0];
        let total: f32 = scores.iter().map(|&score| libm::expf(score)).sum();
        let mut counts = [0.0_f32; ACTIONS];
        for _ in 0..100_000 {
            counts[sample(&scores, &mut stream) as usize] += 1e-5;
        }
        for (count, score) in counts.iter().zip(scores) {
            // Five standard errors at most.
            assert!((count - libm::expf(score) / total).abs() < 0.008);
        }
    }
}
