//! The firmware's forms of observations and outputs in f32: one definition for training and evaluation.

use crate::game::actions::ActionSpace;
use crate::network::categorical::largest;
use firmware::decision::{Action, Decision, PowerPlan};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::{
    ONE, ONE_HOT_INPUTS, Observation, PAPER_INPUTS, PAPER_SUB_CHANNELS, UNIFORM_ONE,
};
use firmware::units::{Age, Dbm, Level, MAX_SUB_CHANNELS, SubChannel};
use host_sim::scenario::Scenario;
use host_sim::stream::Stream;
use kit::error::{Error, Result};

/// Index of the lot in [`ObservationForm::AgeOneHot`].
const ONE_HOT_UNIFORM: usize = ONE_HOT_INPUTS - 1;

/// Index of the age in [`ObservationForm::Paper`].
const PAPER_AGE: usize = PAPER_INPUTS - 1;

/// Checks that actors of these forms know as many sub-channels as the cell has: `key` is what users call their number.
///
/// # Errors
/// [`Error::Input`] with the key.
pub fn check_sub_channels(
    key: &str,
    scenario: &Scenario,
    observation: ObservationForm,
    output: OutputForm,
) -> Result<()> {
    let found = scenario.radio.sub_channels as usize;
    let any_number = observation == ObservationForm::Ring && output == OutputForm::Actions;
    let expected = match any_number {
        true if found > MAX_SUB_CHANNELS => format!("at most {MAX_SUB_CHANNELS}, which units know"),
        false if found != PAPER_SUB_CHANNELS => format!(
            "{PAPER_SUB_CHANNELS}, which actors know unless their observation is \"firmware\" and their action \"actions\""
        ),
        _ => return Ok(()),
    };
    Err(Error::input(key, found, expected))
}

/// A table's inputs as the float network sees them.
pub fn as_float<const LENGTH: usize>(codes: &[i8; LENGTH]) -> [f32; LENGTH] {
    codes.map(real)
}

fn real(code: i8) -> f32 {
    f32::from(code) / f32::from(ONE)
}

/// What an input is when its code in a table is [`ONE`].
pub fn at_code_one(form: ObservationForm, input: usize) -> f32 {
    match (form, input) {
        (ObservationForm::Paper, PAPER_AGE) => f32::from(ONE) / f32::from(Age::TIME_CONSTRAINT.slots()),
        (ObservationForm::AgeOneHot, ONE_HOT_UNIFORM) => f32::from(ONE) / f32::from(UNIFORM_ONE),
        _ => 1.0,
    }
}

/// Writes a float network's inputs: the firmware's codes, but the lot of [`ObservationForm::AgeOneHot`] and all of
/// [`ObservationForm::Paper`] as they are, unrounded.
///
/// # Panics
/// If there are fewer inputs than the form has.
pub fn observe(form: ObservationForm, observation: &Observation, required_sinr: Level, inputs: &mut [f32]) {
    if form == ObservationForm::Paper {
        return paper(observation, inputs);
    }
    form.encode(observation, required_sinr, |codes| {
        for (input, &code) in inputs.iter_mut().zip(codes) {
            *input = real(code);
        }
    });
    if form == ObservationForm::AgeOneHot {
        inputs[ONE_HOT_UNIFORM] = observation.quantities().lot as f32 / 65_536.0;
    }
}

/// Gains as (dB - 35) / 20, interference over noise in 40 dB, and age in its largest: each about -1 to 1, the scaling
/// of the firmware's encoding. The paper gives none (chosen).
fn paper(observation: &Observation, inputs: &mut [f32]) {
    let (gain, rest) = inputs.split_at_mut(PAPER_SUB_CHANNELS);
    let (interference, age) = rest.split_at_mut(PAPER_SUB_CHANNELS);
    for (input, level) in gain.iter_mut().zip(observation.gain()) {
        *input = (level.to_num::<f32>() - 35.0) / 20.0;
    }
    for (input, level) in interference.iter_mut().zip(observation.interference()) {
        *input = level.to_num::<f32>() / 40.0;
    }
    age[0] = age_in_its_largest(observation);
}

/// The age over the paper's largest one, T, at most 1.
pub fn age_in_its_largest(observation: &Observation) -> f32 {
    let most = Age::TIME_CONSTRAINT;
    f32::from(observation.age().min(most).slots()) / f32::from(most.slots())
}

/// The action with the largest output; the first of equals, as in the firmware.
pub fn best_action(outputs: &[f32]) -> Action {
    Action::ALL
        .get(largest(outputs))
        .copied()
        .unwrap_or(Action::Silent)
}

/// The decision at the end of a float network's outputs: greedy without a stream, exploring with one, as [`ActionSpace::act`].
pub fn decide(
    form: OutputForm,
    outputs: &[f32],
    noise: f32,
    observation: &Observation,
    plan: &PowerPlan,
    explore: Option<&mut Stream>,
) -> Decision {
    // A silence that is never chosen is not drawn for.
    let first = usize::from(form == OutputForm::SendingSubChannels);
    let mut action = Vec::new();
    ActionSpace::from(form).act(&outputs[first..], noise, explore, &mut action);
    action[0] += first as f32;
    decision(form, &action, observation, plan)
}

/// What an action, as [`ActionSpace::act`] gives it, means to a vehicle.
pub fn decision(form: OutputForm, action: &[f32], observation: &Observation, plan: &PowerPlan) -> Decision {
    let choice = action[0] as usize;
    match form {
        OutputForm::Actions => {
            let action = Action::ALL.get(choice).copied().unwrap_or(Action::Silent);
            plan.decision(action, observation)
        }
        OutputForm::SubChannels | OutputForm::SendingSubChannels => {
            plan.sub_channel_choice(choice, observation)
        }
        OutputForm::SubChannelAndPower => {
            sub_channel_and_power([action[0], action[1]], observation.max_power())
        }
    }
}

/// The decision of the paper's continuous action, whose parts lie in -1 to 1: sub-channel `floor(N (1 + a) / 2)` and power
/// `p_max (1 + b) / 2` in mW; what rounds to nothing is silence.
fn sub_channel_and_power([sub_channel, power]: [f32; 2], max_power: Dbm) -> Decision {
    let index = (PAPER_SUB_CHANNELS as f32 * (1.0 + sub_channel) / 2.0) as usize;
    let share = (1.0 + power) / 2.0;
    let reduction = -2560.0 * libm::log10f(share);
    // A unit's power reaches down to -128 dBm; less is nothing.
    let bits = f32::from(max_power.to_bits()) - reduction;
    match SubChannel::new(index.min(PAPER_SUB_CHANNELS - 1) as u8) {
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
}
