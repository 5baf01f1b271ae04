//! What a run is told: a preset, then a file that may change some of its keys, then single `KEY=VALUE` settings.
//!
//! A preset under `trainer/presets/` names its algorithm, has that algorithm's section with every key, and under `scenario`
//! what differs from the simulator's preset that it starts from. With `base = "NAME"` it lies over another preset, and says what
//! differs.

use crate::algorithm::{LearningAlgorithm, Task};
use crate::evolution::Evolution;
use crate::forms;
use crate::game::reward::{self, RewardName};
use crate::laboratory::learner::Learner;
use crate::maddpg::options::Maddpg;
use crate::mixture::{self, CellSource, MixedCell, Mixture};
use crate::ppo;
use crate::vdn::Vdn;
use host_sim::scenario::{self, Scenario};
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::keys::Key;
use kit::layers::{Layers, parse};
use kit::{choices, keys};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use toml::{Table, Value};

choices! {
    /// A configuration that comes with the program.
    pub enum Preset {
        /// A search without gradients: a baseline, and the quickest run.
        Evolution = "evolution",
        /// The paper's modified MADDPG as printed: an update after every episode.
        Paper = "paper",
        /// The same with an update in every slot, as the authors' companion code has it.
        Companion = "companion",
        /// The public code of the paper's group as it is: no global term, larger noise, smaller critics, nothing after the time limit.
        CompanionCode = "companion-code",
        /// The modified MADDPG made to work with twenty vehicles.
        Freshlane = "freshlane",
        /// On-policy learning from the cell alone, for every load.
        Ppo = "ppo",
        /// The same from a distilled actor on.
        FineTune = "fine-tune",
        /// Proximal policy optimisation of a reward that all share, with a critic that sees the whole cell.
        Mappo = "mappo",
        /// The same with a critic that sees what the vehicle sees.
        Ippo = "ippo",
        /// Values of all vehicles that add up to the cell's.
        Vdn = "vdn",
    }
}

/// The learning algorithms: the section of keys that a configuration has for each, which is its name there.
macro_rules! algorithms {
    ($(
        $(#[doc = $meaning:literal])+
        $section:ident: $variant:ident($options:ty),
    )+) => {
        keys! {
            /// What presets, files and settings say: of the algorithms' sections, the one of the preset's algorithm.
            pub struct Layout {
                /// Learning algorithm: the name of its section. The preset settles it.
                #[key(source = "the preset")]
                algorithm: String,
                $(
                    $(#[doc = $meaning])+
                    $section: Option<$options>,
                )+
                /// Cells to learn in instead of `scenario` alone: an array of tables, each with a preset of the simulator and a
                /// weight. What is set under `scenario` lies over each preset, a cell's own settings over that. None: `scenario`
                /// alone.
                #[key(longest = mixture::CELLS, source = "chosen")]
                mixture: Option<Vec<CellSource>>,
                /// What vehicles are paid for.
                #[key(choices = reward::keyed(), source = "chosen")]
                reward: String,
                /// The cell to learn in.
                scenario: Scenario,
            }
        }

        /// A learning algorithm and its parameters.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        pub enum Algorithm {
            $(
                $(#[doc = $meaning])+
                $variant($options),
            )+
        }

        impl Layout {
            /// The algorithm whose section is there.
            fn take_algorithm(&mut self) -> Option<Algorithm> {
                $(
                    if let Some(options) = self.$section.take() {
                        return Some(Algorithm::$variant(options));
                    }
                )+
                None
            }
        }

        impl Algorithm {
            /// Its name in configurations, and of its section.
            pub const fn name(&self) -> &'static str {
                match self {
                    $(Self::$variant(_) => stringify!($section),)+
                }
            }

            /// What it says of itself.
            pub fn options(&self) -> &dyn LearningAlgorithm {
                match self {
                    $(Self::$variant(options) => options,)+
                }
            }

            /// The same, to be changed.
            pub fn options_mut(&mut self) -> &mut dyn LearningAlgorithm {
                match self {
                    $(Self::$variant(options) => options,)+
                }
            }
        }
    };
}

algorithms! {
    /// Cross-entropy search over the parameters of one small actor that all vehicles share.
    evolution: Evolution(Evolution),
    /// The paper's modified multi-agent DDPG and its family.
    maddpg: Maddpg(Maddpg),
    /// Proximal policy optimisation of one actor that all vehicles share, with a critic that sees the whole cell.
    ppo: Ppo(ppo::Recipe),
    /// Value decomposition networks: one network of values that all vehicles share.
    vdn: Vdn(Vdn),
}

/// A checked configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// The cell to learn in.
    pub scenario: Scenario,
    /// Cells to learn in instead, if there are any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mixture: Vec<MixedCell>,
    /// What vehicles are paid for, unless the algorithm's own keys say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reward: Option<RewardName>,
    /// How.
    pub algorithm: Algorithm,
}

/// Names the preset that a preset lies over.
const BASE: &str = "base";

/// The command that lists all keys.
pub(crate) const EXPLAIN: &str = "trainer explain";

/// Where a configuration comes from.
#[derive(Clone, Debug)]
pub struct ConfigurationSource {
    /// The lowest layer.
    pub preset: Preset,
    /// A TOML file whose keys replace the preset's.
    pub file: Option<PathBuf>,
    /// `KEY=VALUE` settings, such as `scenario.cell.vehicles=5`, which replace both.
    pub settings: Vec<String>,
}

impl Preset {
    const fn text(self) -> &'static str {
        match self {
            Self::Evolution => include_str!("../presets/evolution.toml"),
            Self::Paper => include_str!("../presets/paper.toml"),
            Self::Companion => include_str!("../presets/companion.toml"),
            Self::CompanionCode => include_str!("../presets/companion-code.toml"),
            Self::Freshlane => include_str!("../presets/freshlane.toml"),
            Self::Ppo => include_str!("../presets/ppo.toml"),
            Self::FineTune => include_str!("../presets/fine-tune.toml"),
            Self::Mappo => include_str!("../presets/mappo.toml"),
            Self::Ippo => include_str!("../presets/ippo.toml"),
            Self::Vdn => include_str!("../presets/vdn.toml"),
        }
    }

    /// All its values, those of the scenario included.
    ///
    /// # Errors
    /// A preset that is no TOML.
    pub fn values(self) -> Result<Table> {
        Ok(self
            .layers(scenario::Preset::Paper, Layout::KEYS)?
            .values()
            .clone())
    }

    /// Its layers over a scenario.
    fn layers(self, scenario: scenario::Preset, keys: &[Key]) -> Result<Layers<'_>> {
        let mut layers = Layers::new(keys, EXPLAIN);
        let scenario = Value::Table(scenario.values());
        layers.lay(Table::from_iter([("scenario".to_owned(), scenario)]), None)?;
        self.lay_over(&mut layers)?;
        Ok(layers)
    }

    /// Lays its values over others, those of the preset that it is based on first.
    fn lay_over(self, layers: &mut Layers<'_>) -> Result<()> {
        let mut own = parse("preset", self.text())?;
        if let Some(base) = own.remove(BASE) {
            Self::of_name("preset", base.as_str().unwrap_or_default())?.lay_over(layers)?;
        }
        layers.lay(own, None)
    }
}

impl ConfigurationSource {
    /// Reads and checks the configuration.
    ///
    /// # Errors
    /// [`Error::Input`] names the file and line, the key or the setting.
    pub fn read(&self) -> Result<Configuration> {
        let preset = self.preset.values()?;
        let in_preset = |key: &&Key| preset.contains_key(key.name);
        let keys: Vec<Key> = Layout::KEYS.iter().filter(in_preset).copied().collect();
        let layers = |base| {
            let mut layers = self.preset.layers(base, &keys)?;
            layers.lay_over(self.file.as_deref(), &self.settings)?;
            Ok(layers)
        };
        let lowest = layers(scenario::Preset::Paper)?;
        let mut layout: Layout = lowest.read()?;
        let algorithm = layout.take_algorithm();
        let algorithm =
            algorithm.ok_or_else(|| Error::input("preset", "no algorithm", "the section of one"))?;
        let Layout {
            algorithm: asked,
            mixture,
            reward,
            scenario,
            ..
        } = layout;
        if asked != algorithm.name() {
            let expected = format!("{}, the algorithm of the preset", algorithm.name());
            return Err(Error::input("algorithm", format!("\"{asked}\""), expected));
        }
        scenario.check()?;
        let (observation, output) = algorithm.options().forms();
        let key = "scenario.radio.sub_channels";
        forms::check_sub_channels(key, &scenario, observation, output)
            .and_then(|()| algorithm.options().check(&scenario))
            .map_err(|error| lowest.located(error))?;
        let mixture = match mixture.unwrap_or_default() {
            cells if cells.is_empty() => Vec::new(),
            cells => {
                let common = |preset| Ok(section(layers(preset)?.values(), "scenario"));
                let read = Mixture::read(&cells, algorithm.options().vehicles(&scenario), common);
                read.map_err(|error| lowest.located(error))?.cells().to_vec()
            }
        };
        let configuration = Configuration {
            scenario,
            mixture,
            reward: reward::of_key("reward", &reward)?,
            algorithm,
        };
        configuration.check().map_err(|error| lowest.located(error))?;
        Ok(configuration)
    }
}

/// A section's values.
fn section(values: &Table, name: &str) -> Table {
    values
        .get(name)
        .and_then(Value::as_table)
        .cloned()
        .unwrap_or_default()
}

impl Configuration {
    /// The cells to learn in: those of the mixture, or the scenario alone.
    pub fn cells(&self) -> Mixture {
        match self.mixture.as_slice() {
            [] => Mixture::alone(&self.scenario, self.algorithm.options().vehicles(&self.scenario)),
            cells => Mixture::of(cells.to_vec()),
        }
    }

    /// Checks what depends on the cells.
    fn check(&self) -> Result<()> {
        let algorithm = self.algorithm.options();
        let (observation, output) = algorithm.forms();
        for (index, cell) in self.mixture.iter().enumerate() {
            let key = format!("{}: radio.sub_channels", mixture::place(index));
            forms::check_sub_channels(&key, &cell.scenario, observation, output)?;
        }
        if !self.mixture.is_empty() && !algorithm.learns_in_mixtures() {
            let expected = format!(
                "none with {}, which learns in `scenario` alone; ppo learns in mixtures",
                self.algorithm.name()
            );
            return Err(Error::input(
                "mixture",
                format!("{} cells", self.mixture.len()),
                expected,
            ));
        }
        algorithm.check_cells(&self.cells())
    }

    /// The learner before its first episode.
    ///
    /// # Errors
    /// What the algorithm reads besides, such as an actor to begin with.
    pub fn learner(&self, seed: u64) -> Result<Box<dyn Learner>> {
        let task = Task {
            scenario: &self.scenario,
            cells: self.cells(),
            reward: self.reward,
        };
        self.algorithm.options().learner(task, seed)
    }
}

#[cfg(test)]
impl Preset {
    /// This preset with `KEY=VALUE` settings, for tests.
    pub fn with(self, settings: &[&str]) -> Result<Configuration> {
        ConfigurationSource {
            preset: self,
            file: None,
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
        }
        .read()
    }
}

#[cfg(test)]
mod tests;
