//! What the algorithm is told. Sources are those of the preset `paper`: "Table I" and "Algorithm 1" are the paper's, "chosen" it
//! leaves open.

use super::replay::{Return, most_transitions};
use crate::game::actions::ActionSpace;
use crate::game::reward::AgeReward;
use firmware::form::{ObservationForm, OutputForm};
use host_sim::scenario::Scenario;
use kit::choice::Choice;
use kit::error::{Error, Result};
use kit::{choices, keys};
use serde_json::json;
use std::path::PathBuf;

keys! {
    /// Parameters of the modified MADDPG and its family.
    pub struct Maddpg {
        /// What finds the gradients.
        #[key(source = "chosen")]
        #[serde(default)]
        pub backend: Backend,
        /// Folder of the run whose actors to go on from, of the same forms and widths: one for each vehicle, or one for all. Without one,
        /// random networks.
        #[key(source = "chosen")]
        pub first_actor: PathBuf,
        /// Folder of the run of this algorithm whose critics and their targets to go on from, of the same forms and widths. Beside a good
        /// actor, new critics wreck it.
        #[key(source = "chosen")]
        pub first_critics: PathBuf,
        /// Episodes of the run.
        #[key(range = 1.0..=1e8, unit = "episodes", source = "chosen, the paper's figures have no readable axis")]
        pub episodes: u64,
        /// Worlds that advance together.
        #[key(range = 1.0..=4096.0, unit = "worlds", source = "chosen")]
        pub worlds: u64,
        /// Slots of an episode, T in the paper.
        #[key(range = 1.0..=100_000.0, unit = "slots", source = "Table I")]
        pub slots: u32,
        /// When networks learn.
        #[key(source = "Algorithm 1")]
        pub updates: Updates,
        /// What an actor sees.
        #[key(
            choices = [
                ("paper", "Gains, interference in the slot before, and age, on 3 sub-channels."),
                ("firmware", "The firmware's encoding: how the ring's turn stands to the vehicle, on any number of sub-channels."),
                ("age-one-hot", "The age as one-hot without any phase, on 3 sub-channels, for research."),
            ],
            source = "the paper's state"
        )]
        pub observation: ObservationForm,
        /// What an actor does.
        #[key(
            choices = [
                ("sub-channel-and-power", "One of 3 sub-channels and power, both continuous, through tanh, as in the paper."),
                ("actions", "The firmware's actions: where the vehicle's place is, or where places are open."),
                ("sub-channels", "A choice among silence, full and low power on each of 3 sub-channels, for research."),
            ],
            source = "the paper's action"
        )]
        pub action: OutputForm,
        /// Whether the action "sub-channels" offers silence. The other forms always do: power may be 0 W.
        #[key(source = "chosen")]
        pub silence: bool,
        /// Whether one network serves all vehicles, instead of one for each.
        #[key(source = "the paper has one for each")]
        pub shared: bool,
        /// Widths of the actors' hidden layers.
        #[key(range = 1.0..=4096.0, longest = 8, unit = "widths", source = "Table I")]
        pub actor_hidden: Vec<usize>,
        /// Whether there are local critics.
        #[key(source = "the paper has them")]
        pub local_critics: bool,
        /// Widths of the local critics' hidden layers.
        #[key(range = 1.0..=4096.0, longest = 8, unit = "widths", source = "Table I")]
        pub local_critic_hidden: Vec<usize>,
        /// What the twin global critics see.
        #[key(source = "the paper's critic")]
        pub global_critic: CriticForm,
        /// Widths of the global critics' hidden layers; in the form "set", of what follows the sum.
        #[key(range = 1.0..=4096.0, longest = 8, unit = "widths", source = "Table I")]
        pub global_critic_hidden: Vec<usize>,
        /// Hidden width before the sum of the global critic "set".
        #[key(range = 1.0..=4096.0, source = "chosen")]
        pub set_hidden: usize,
        /// Width of the sum of the global critic "set".
        #[key(range = 1.0..=4096.0, source = "chosen")]
        pub set_sum: usize,
        /// Weight of the global term in the actors' gradient.
        #[key(source = "Algorithm 1")]
        pub global_weight: GlobalWeight,
        /// Weight of the local term in the actors' gradient.
        #[key(range = 0.0..=1e6, source = "Algorithm 1")]
        pub local_weight: f32,
        /// Learning rate of the actors at the start of the run.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub actor_learning_rate: f32,
        /// Learning rate of the critics at the start of the run.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub critic_learning_rate: f32,
        /// Learning rate of the actors at the end of the run.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub last_actor_learning_rate: f32,
        /// Learning rate of the critics at the end of the run.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub last_critic_learning_rate: f32,
        /// Factor by which the next slot's value is discounted.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub discount: f32,
        /// Steps of the return, at most the slots of an episode.
        #[key(range = 1.0..=100_000.0, unit = "slots", source = "chosen")]
        pub n_step: u32,
        /// What a world is worth at the end of an episode.
        #[key(source = "chosen; an episode's length is nothing that vehicles know")]
        pub time_limit: TimeLimit,
        /// Share by which an update moves the target networks, the factor of soft update.
        #[key(range = 0.0..=1.0, source = "Table I")]
        pub target_rate: f32,
        /// Every so many updates local critics and actors learn too, d in TD3.
        #[key(range = 1.0..=1000.0, unit = "updates", source = "TD3")]
        pub delay: u32,
        /// Size of a mini batch.
        #[key(range = 1.0..=65_536.0, unit = "transitions", source = "Table I")]
        pub batch: usize,
        /// Transitions that a gradient of the actors uses.
        #[key(range = 1.0..=65_536.0, unit = "transitions", source = "chosen")]
        pub actor_batch: usize,
        /// Size of the replay memory: at least one episode.
        #[key(range = 1.0..=1e9, unit = "transitions", source = "Table I")]
        pub replay: usize,
        /// Transitions before the first update.
        #[key(range = 0.0..=1e9, unit = "transitions", source = "chosen")]
        pub warm_up_slots: usize,
        /// Loss of the critics.
        #[key(source = "the paper's loss")]
        pub loss: Loss,
        /// Longest gradient of a network; 0 is no limit.
        #[key(range = 0.0..=1e6, source = "chosen")]
        pub gradient_clip: f32,
        /// Standard deviation of exploration, in units of tanh.
        #[key(range = 0.0..=10.0, source = "TD3")]
        pub noise: f32,
        /// Standard deviation of target smoothing, in units of tanh. For choices the probability of a draw
        /// from a softmax of twice the temperature.
        #[key(range = 0.0..=10.0, source = "TD3")]
        pub smoothing_noise: f32,
        /// Where the noise of target smoothing is cut, in units of tanh.
        #[key(range = 0.0..=10.0, source = "TD3")]
        pub smoothing_clip: f32,
        /// Weight of a choice's entropy in the gradient at the start of the run; it falls geometrically.
        #[key(range = 0.0..=10.0, source = "chosen")]
        pub entropy: f32,
        /// Weight of a choice's entropy in the gradient at the end of the run.
        #[key(range = 0.0..=10.0, source = "chosen")]
        pub last_entropy: f32,
        /// What the age is divided by in the own reward, which is minus the age.
        #[key(source = "the paper's reward")]
        pub age_scale: AgeScale,
        /// Where ages are cut in the own reward.
        #[key(range = 1.0..=100.0, unit = "slots", source = "Table I")]
        pub age_cap: f32,
        /// What a success adds to the own reward.
        #[key(range = 0.0..=1e3, source = "the paper's reward")]
        pub success_reward: f32,
        /// Load curriculum: share of the vehicles that takes part at first.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub first_share: f32,
        /// Load curriculum: share of the run after which all vehicles take part.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub all_vehicles_at: f32,
        /// Which ages an episode begins with.
        #[key(source = "chosen")]
        pub start_ages: StartAges,
        /// Share of the worlds whose vehicles begin in turn, falling to a quarter of it; other start ages
        /// vary then too. With 0 as with all, half of the others begin at the largest age.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub phase_resets: f32,
        /// Factor of the last layer's first weights, for choices.
        #[key(range = 0.0..=10.0, source = "chosen")]
        pub last_layer_scale: f32,
        /// First bias of silence, for choices.
        #[key(range = -100.0..=100.0, source = "chosen")]
        pub silence_bias: f32,
        /// First bias of full power, for choices; of sub-channels on the one that the vehicle sees first.
        #[key(range = -100.0..=100.0, source = "chosen")]
        pub full_power_bias: f32,
        /// First bias of contending at each of the joiner levels, for choices.
        #[key(range = -100.0..=100.0, source = "chosen")]
        pub joiner_bias: f32,
    }
}

choices! {
    /// What finds the gradients.
    pub enum Backend {
        /// This crate's kernels: the same bits on every machine, all forms.
        Own = "own",
        /// Burn's automatic differentiation: the paper's form, in a trainer built with the feature `burn`.
        Burn = "burn",
    }

    /// When networks learn.
    pub enum Updates {
        /// Once after every episode, as Algorithm 1 is printed.
        Episode = "episode",
        /// Once after every slot, as the authors' companion code does.
        Slot = "slot",
    }

    /// The form of the global critics.
    pub enum CriticForm {
        /// All observations and actions side by side, as in the paper.
        Flat = "flat",
        /// A sum over the cell's vehicles.
        Set = "set",
    }

    /// Weight of the global term in the actors' gradient.
    pub enum GlobalWeight {
        /// 1, as printed. The global reward is a mean over vehicles, so a vehicle's part in it counts 1/V.
        Printed = "printed",
        /// The number of vehicles, which undoes that.
        Vehicles = "vehicles",
        /// 0: the global critics learn, but actors climb their local critics alone, each vehicle for itself. So it is in the public
        /// code of the paper's group, where the global term is detached from the gradient.
        None = "none",
    }

    /// What a world is worth at the time limit.
    pub enum TimeLimit {
        /// What its critics say (Pardo et al., "Time limits in reinforcement learning", 2018).
        GoesOn = "goes-on",
        /// Nothing, as in the public code of the paper's group.
        Ends = "ends",
    }

    /// Ages at the beginning of an episode.
    pub enum StartAges {
        /// Drawn anew, as `phase_resets` says.
        Drawn = "drawn",
        /// Those that the episode before ended with; in the first one the largest. Places and links are new.
        Kept = "kept",
    }

    /// What an age is divided by in the reward.
    pub enum AgeScale {
        /// The number of vehicles, as in the paper.
        Vehicles = "vehicles",
        /// Ten slots.
        Ten = "ten",
    }

    /// Loss of the critics.
    pub enum Loss {
        /// The square, as printed.
        Squared = "squared",
        /// Half the square up to 1, then linear (Huber 1964).
        Huber = "huber",
    }
}

impl Default for Backend {
    fn default() -> Self {
        Self::ALL[0]
    }
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
    /// What the actors' outputs mean.
    pub fn output_form(&self) -> OutputForm {
        self.action.with_silence(self.silence)
    }

    /// What so many vehicles get for their ages.
    pub fn reward(&self, vehicles: usize) -> AgeReward {
        AgeReward {
            scale: match self.age_scale {
                AgeScale::Vehicles => vehicles as f32,
                AgeScale::Ten => 10.0,
            },
            cap: self.age_cap,
            success: self.success_reward,
        }
    }

    /// How far a return looks ahead.
    pub(super) fn sought(&self) -> Return {
        Return {
            steps: self.n_step as usize,
            discount: self.discount,
            ends_at_limit: self.time_limit == TimeLimit::Ends,
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

    /// Checks keys against each other and the scenario.
    ///
    /// # Errors
    /// Two keys that contradict each other.
    pub fn check(&self, scenario: &Scenario) -> Result<()> {
        let vehicles = scenario.cell.vehicles;
        if vehicles > 255 {
            return Err(Error::input(
                "scenario.cell.vehicles",
                vehicles,
                "at most 255 to learn with",
            ));
        }
        if self.global_weight == GlobalWeight::None && !self.local_critics {
            return Err(Error::input(
                "maddpg",
                "maddpg.global_weight = \"none\" with maddpg.local_critics = false",
                "one of the two terms: actors have nothing else to learn from",
            ));
        }
        if self.start_ages == StartAges::Kept && self.phase_resets != 0.0 {
            return Err(Error::input(
                "maddpg",
                format!(
                    "maddpg.phase_resets = {} with maddpg.start_ages = \"kept\"",
                    self.phase_resets
                ),
                "0, or maddpg.start_ages = \"drawn\"",
            ));
        }
        if self.n_step > self.slots {
            let expected = format!("at most maddpg.slots, which is {}", self.slots);
            return Err(Error::input("maddpg.n_step", self.n_step, expected));
        }
        if self.backend == Backend::Burn {
            self.check_burn()?;
        }
        let choice = ActionSpace::from(self.action).is_choice();
        let continuous = "maddpg.action = \"sub-channel-and-power\"";
        let contradiction = |found: String, expected: &str| Err(Error::input("maddpg", found, expected));
        if self.action == OutputForm::SendingSubChannels {
            return contradiction(
                "maddpg.action = \"sending-sub-channels\"".to_owned(),
                "maddpg.action = \"sub-channels\" with maddpg.silence = false",
            );
        }
        if self.action != OutputForm::Actions && self.global_critic == CriticForm::Set {
            return contradiction(
                "maddpg.global_critic = \"set\" with another maddpg.action than \"actions\"".to_owned(),
                "maddpg.action = \"actions\", or maddpg.global_critic = \"flat\"",
            );
        }
        if !self.silence && self.action != OutputForm::SubChannels {
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
            ("full_power_bias", self.full_power_bias),
            ("joiner_bias", self.joiner_bias),
        ] {
            if !choice && value != 0.0 {
                let found = format!("maddpg.{key} = {value} with {continuous}");
                return contradiction(found, "an action that is a choice, or 0");
            }
        }
        let (worlds, slots) = (self.worlds as usize, self.slots as usize);
        let episode = worlds * slots;
        if self.replay < episode {
            let found = format!(
                "maddpg.replay = {} with maddpg.worlds x maddpg.slots = {episode}",
                self.replay
            );
            return contradiction(found, "room for at least one episode");
        }
        let kept = most_transitions(self.replay, worlds, slots, self.n_step as usize);
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
