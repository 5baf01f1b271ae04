//! What the algorithm is told. The presets `paper`, `companion` and `freshlane` say what each key means and where it is from.

use super::actions::ActionSet;
use crate::laboratory::forms::{ObservationForm, OutputForm};
use host_sim::scenario::Scenario;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fmt;

/// Parameters of the modified MADDPG and its family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the presets document every key")]
pub struct Maddpg {
    #[serde(default)]
    pub backend: Backend,
    pub episodes: u64,
    pub worlds: u64,
    pub slots: u32,
    pub updates: Updates,
    pub observation: ObservationForm,
    pub action: ActionForm,
    pub silence: bool,
    pub shared: bool,
    pub actor_hidden: Vec<usize>,
    pub local_critics: bool,
    pub local_critic_hidden: Vec<usize>,
    pub global_critic: CriticForm,
    pub global_critic_hidden: Vec<usize>,
    pub set_hidden: usize,
    pub set_sum: usize,
    pub gradient: GradientForm,
    pub temperature: f32,
    pub global_weight: GlobalWeight,
    pub local_weight: f32,
    pub actor_learning_rate: f32,
    pub critic_learning_rate: f32,
    pub last_actor_learning_rate: f32,
    pub last_critic_learning_rate: f32,
    pub discount: f32,
    pub n_step: u32,
    pub target_rate: f32,
    pub delay: u32,
    pub batch: usize,
    pub actor_batch: usize,
    pub replay: usize,
    pub warm_up_slots: usize,
    pub loss: Loss,
    pub gradient_clip: f32,
    pub noise: f32,
    pub smoothing_noise: f32,
    pub smoothing_clip: f32,
    pub entropy: f32,
    pub last_entropy: f32,
    pub age_scale: AgeScale,
    pub age_cap: f32,
    pub success_reward: f32,
    pub first_share: f32,
    pub all_vehicles_at: f32,
    pub phase_resets: f32,
    pub last_layer_scale: f32,
    pub silence_bias: f32,
    pub home_bias: f32,
    pub joiner_bias: f32,
}

/// What finds the gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// This crate's kernels: the same bits on every machine, all forms.
    #[default]
    Own,
    /// Burn's automatic differentiation: the paper's form, in a trainer built with the feature `burn`.
    Burn,
}

impl fmt::Display for Backend {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Own => "own",
            Self::Burn => "burn",
        })
    }
}

/// When networks learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Updates {
    /// Once after every episode, as Algorithm 1 is printed.
    Episode,
    /// Once after every slot, as the authors' companion code does.
    Slot,
}

/// What an actor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActionForm {
    /// The paper's: sub-channel and power, both continuous, through tanh.
    SubChannelAndPower,
    /// The firmware's actions.
    Actions,
    /// A choice among silence, full and low power on each sub-channel.
    SubChannels,
}

/// The form of the global critics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CriticForm {
    /// All observations and actions side by side, as in the paper.
    Flat,
    /// A sum over the vehicles of each sub-channel.
    Set,
}

/// How the critics' slopes reach the actors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GradientForm {
    /// Through the action itself: deterministic for continuous actions, straight through a Gumbel softmax for choices.
    Straight,
    /// The exact gradient over all actions of a choice, by what each would have been worth.
    AllActions,
}

/// Weight of the global term in the actors' gradient.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GlobalWeight {
    /// 1, as printed. The global reward is a mean over vehicles, so a vehicle's part in it counts 1/V.
    Printed,
    /// The number of vehicles, which undoes that.
    Vehicles,
}

/// What an age is divided by in the reward.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AgeScale {
    /// The number of vehicles, as in the paper.
    Vehicles,
    /// Ten slots.
    Ten,
}

/// Loss of the critics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// The square, as printed.
    Squared,
    /// Half the square up to 1, then linear (Huber 1964).
    Huber,
}

impl Loss {
    /// The loss of an error, and its slope.
    pub fn of(self, error: f32) -> (f32, f32) {
        match self {
            Self::Squared => (error * error, 2.0 * error),
            Self::Huber if error.abs() <= 1.0 => (0.5 * error * error, error),
            Self::Huber => (error.abs() - 0.5, error.signum()),
        }
    }
}

impl Maddpg {
    /// The actions of the actors.
    pub fn action_set(&self) -> ActionSet {
        match self.action {
            ActionForm::SubChannelAndPower => ActionSet::Continuous,
            ActionForm::Actions => ActionSet::FIRMWARE,
            ActionForm::SubChannels => ActionSet::SubChannels,
        }
    }

    /// The same for evaluation.
    pub fn output_form(&self) -> OutputForm {
        match self.action {
            ActionForm::SubChannelAndPower => OutputForm::SubChannelAndPower { noise: self.noise },
            ActionForm::Actions => OutputForm::Actions,
            ActionForm::SubChannels => OutputForm::SubChannels {
                silence: self.silence,
            },
        }
    }

    /// Checksum (CRC-64/XZ) of the module whose losses these networks step down, where users change them there: other losses make
    /// another run.
    pub fn losses_checksum(&self) -> Option<String> {
        let losses = include_bytes!("burn.rs");
        let checksum = || crc::Crc::<u64>::new(&crc::CRC_64_XZ).checksum(losses);
        (self.backend == Backend::Burn).then(|| format!("{:016x}", checksum()))
    }

    /// Vehicles in the first episode, of so many in the last.
    pub fn first_vehicles(&self, all: usize) -> usize {
        libm::roundf(self.first_share * all as f32).max(1.0) as usize
    }

    /// Checks ranges, and options against each other and the scenario.
    ///
    /// # Errors
    /// The first key that is out of its range, or the two that contradict each other.
    pub fn check(&self, scenario: &Scenario) -> Result<()> {
        let vehicles = scenario.cell.vehicles;
        for (key, value, most) in [
            ("episodes", self.episodes, 100_000_000),
            ("worlds", self.worlds, 4096),
            ("slots", self.slots.into(), 100_000),
            ("batch", self.batch as u64, 65_536),
            ("actor_batch", self.actor_batch as u64, 65_536),
            ("delay", self.delay.into(), 1000),
            ("set_hidden", self.set_hidden as u64, 4096),
            ("set_sum", self.set_sum as u64, 4096),
            ("n_step", self.n_step.into(), self.slots.into()),
        ] {
            if !(1..=most).contains(&value) {
                return Err(Error::input(
                    format!("maddpg.{key}"),
                    value,
                    format!("1 to {most}"),
                ));
            }
        }
        for (key, value, least, most) in [
            ("temperature", self.temperature, 1e-3, 1e3),
            ("local_weight", self.local_weight, 0.0, 1e6),
            ("actor_learning_rate", self.actor_learning_rate, 0.0, 1.0),
            ("critic_learning_rate", self.critic_learning_rate, 0.0, 1.0),
            (
                "last_actor_learning_rate",
                self.last_actor_learning_rate,
                0.0,
                1.0,
            ),
            (
                "last_critic_learning_rate",
                self.last_critic_learning_rate,
                0.0,
                1.0,
            ),
            ("discount", self.discount, 0.0, 1.0),
            ("target_rate", self.target_rate, 0.0, 1.0),
            ("gradient_clip", self.gradient_clip, 0.0, 1e6),
            ("noise", self.noise, 0.0, 10.0),
            ("smoothing_noise", self.smoothing_noise, 0.0, 10.0),
            ("smoothing_clip", self.smoothing_clip, 0.0, 10.0),
            ("entropy", self.entropy, 0.0, 10.0),
            ("last_entropy", self.last_entropy, 0.0, 10.0),
            ("age_cap", self.age_cap, 1.0, 100.0),
            ("success_reward", self.success_reward, 0.0, 1e3),
            ("first_share", self.first_share, 0.0, 1.0),
            ("all_vehicles_at", self.all_vehicles_at, 0.0, 1.0),
            ("phase_resets", self.phase_resets, 0.0, 1.0),
            ("last_layer_scale", self.last_layer_scale, 0.0, 10.0),
            ("silence_bias", self.silence_bias, -100.0, 100.0),
            ("home_bias", self.home_bias, -100.0, 100.0),
            ("joiner_bias", self.joiner_bias, -100.0, 100.0),
        ] {
            if !(least..=most).contains(&value) {
                let expected = format!("a number from {least} to {most}");
                return Err(Error::input(format!("maddpg.{key}"), value, expected));
            }
        }
        for (key, hidden) in [
            ("actor_hidden", &self.actor_hidden),
            ("local_critic_hidden", &self.local_critic_hidden),
            ("global_critic_hidden", &self.global_critic_hidden),
        ] {
            if !hidden.iter().all(|width| (1..=4096).contains(width)) || hidden.len() > 8 {
                let found = format!("{hidden:?}");
                return Err(Error::input(
                    format!("maddpg.{key}"),
                    found,
                    "at most 8 widths from 1 to 4096",
                ));
            }
        }
        if vehicles > 255 {
            return Err(Error::input(
                "cell.vehicles",
                vehicles,
                "at most 255 to learn with",
            ));
        }
        self.check_together()
    }

    fn check_together(&self) -> Result<()> {
        if self.backend == Backend::Burn {
            self.check_burn()?;
        }
        let choice = self.action_set().is_choice();
        let continuous = "maddpg.action = \"sub-channel-and-power\"";
        let contradiction = |found: String, expected: &str| Err(Error::input("maddpg", found, expected));
        if !choice && self.gradient == GradientForm::AllActions {
            let found = format!("maddpg.gradient = \"all-actions\" with {continuous}");
            return contradiction(
                found,
                "an action that is a choice, or maddpg.gradient = \"straight\"",
            );
        }
        if !choice && self.global_critic == CriticForm::Set {
            let found = format!("maddpg.global_critic = \"set\" with {continuous}");
            return contradiction(
                found,
                "an action that is a choice, or maddpg.global_critic = \"flat\"",
            );
        }
        if !self.silence && self.action != ActionForm::SubChannels {
            let found = "maddpg.silence = false with another maddpg.action than \"sub-channels\"".to_owned();
            return contradiction(
                found,
                "maddpg.silence = true, or maddpg.action = \"sub-channels\"",
            );
        }
        for (key, value) in [
            ("entropy", self.entropy),
            ("last_entropy", self.last_entropy),
            ("silence_bias", self.silence_bias),
            ("home_bias", self.home_bias),
            ("joiner_bias", self.joiner_bias),
        ] {
            if !choice && value != 0.0 {
                let found = format!("maddpg.{key} = {value} with {continuous}");
                return contradiction(found, "an action that is a choice, or 0");
            }
        }
        let episode = self.worlds as usize * self.slots as usize;
        if self.replay < episode {
            let found = format!(
                "maddpg.replay = {} with maddpg.worlds x maddpg.slots = {episode}",
                self.replay
            );
            return contradiction(found, "room for at least one episode");
        }
        // Whole episodes, without the slots from which n steps lead beyond their end.
        let starts = self.worlds as usize * (self.slots + 1 - self.n_step) as usize;
        let kept = self.replay / episode * starts;
        for (key, needed) in [("warm_up_slots", self.warm_up_slots), ("batch", self.batch)] {
            if needed > kept {
                let found = format!("maddpg.{key} = {needed} with maddpg.replay = {}", self.replay);
                let expected =
                    format!("at most the {kept} transitions of the episodes that the replay holds");
                return contradiction(found, &expected);
            }
        }
        Ok(())
    }

    /// Burn repeats the paper's form and no other.
    fn check_burn(&self) -> Result<()> {
        if !cfg!(feature = "burn") {
            return Err(Error::input(
                "maddpg.backend",
                "burn",
                "own, or a trainer built with `cargo build --release -p trainer --features burn`",
            ));
        }
        let values = serde_json::to_value(self).unwrap_or_default();
        for (key, expected) in [
            ("action", json!("sub-channel-and-power")),
            ("global_critic", json!("flat")),
            ("shared", json!(false)),
            ("loss", json!("squared")),
            ("first_share", json!(1.0)),
        ] {
            let found = &values[key];
            if *found != expected {
                return Err(Error::input(
                    "maddpg",
                    format!("maddpg.{key} = {found} with maddpg.backend = \"burn\""),
                    format!("maddpg.{key} = {expected}, or maddpg.backend = \"own\""),
                ));
            }
        }
        Ok(())
    }
}
