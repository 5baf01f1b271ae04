//! What a run is told: a preset, then a file that may change some of its keys, then single `KEY=VALUE` settings.
//!
//! A preset under `trainer/presets/` names its algorithm, has that algorithm's section with every key, and under `scenario`
//! what differs from the simulator's preset that it starts from.

use super::learner::Learner;
use crate::evolution::{Evolution, EvolutionLearner};
use crate::maddpg::learner::MaddpgLearner;
use crate::maddpg::options::Maddpg;
use crate::ppo::{self, PpoLearner};
use host_sim::scenario::layers::{lay_over, overlay, parse, siblings, typed};
use host_sim::scenario::{self, Scenario};
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use toml::{Table, Value};

/// A configuration that comes with the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// A search without gradients: a baseline, and the quickest run.
    Evolution,
    /// The paper's modified MADDPG as printed: an update after every episode.
    Paper,
    /// The same with an update in every slot, as the authors' companion code has it.
    Companion,
    /// The modified MADDPG made to work with twenty vehicles.
    Freshlane,
    /// On-policy learning from the cell alone, for every load.
    Ppo,
    /// The same from a distilled actor on.
    FineTune,
}

/// A learning algorithm and its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Cross-entropy search over the actor's parameters.
    Evolution(Evolution),
    /// The paper's algorithm and its family.
    Maddpg(Maddpg),
    /// Proximal policy optimisation of one shared actor.
    Ppo(ppo::Recipe),
}

/// A checked configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// The cell to learn in.
    pub scenario: Scenario,
    /// How.
    pub algorithm: Algorithm,
}

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
            Self::Evolution => include_str!("../../presets/evolution.toml"),
            Self::Paper => include_str!("../../presets/paper.toml"),
            Self::Companion => include_str!("../../presets/companion.toml"),
            Self::Freshlane => include_str!("../../presets/freshlane.toml"),
            Self::Ppo => include_str!("../../presets/ppo.toml"),
            Self::FineTune => include_str!("../../presets/fine-tune.toml"),
        }
    }

    /// The scenario that it starts from.
    const fn scenario(self) -> scenario::Preset {
        match self {
            Self::Evolution
            | Self::Paper
            | Self::Companion
            | Self::Freshlane
            | Self::Ppo
            | Self::FineTune => scenario::Preset::Paper,
        }
    }

    /// All its keys, those of the scenario included.
    fn table(self) -> Result<Table> {
        let mut preset = parse("preset", self.text())?;
        let mut scenario = Table::new();
        let _none = scenario.insert("scenario".to_owned(), self.scenario().values().into());
        if let Some(changes) = preset.remove("scenario") {
            let mut layer = Table::new();
            let _none = layer.insert("scenario".to_owned(), changes);
            overlay(&mut scenario, layer, "", None, siblings)?;
        }
        preset.extend(scenario);
        Ok(preset)
    }
}

impl Algorithm {
    /// Its name in configurations, and of its section.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Evolution(_) => "evolution",
            Self::Maddpg(_) => "maddpg",
            Self::Ppo(_) => "ppo",
        }
    }

    /// Which losses, where users write them.
    pub fn losses_checksum(&self) -> Option<String> {
        match self {
            Self::Maddpg(options) => options.losses_checksum(),
            Self::Evolution(_) | Self::Ppo(_) => None,
        }
    }

    /// Reads the section of the algorithm of this name.
    fn read(name: &str, section: Value) -> Result<Self> {
        match name {
            "evolution" => Ok(Self::Evolution(typed(name, section)?)),
            "maddpg" => Ok(Self::Maddpg(typed(name, section)?)),
            "ppo" => Ok(Self::Ppo(typed(name, section)?)),
            other => Err(Error::input("algorithm", other, "evolution, maddpg or ppo")),
        }
    }

    /// Checks ranges, and options against each other and the scenario.
    fn check(&self, scenario: &Scenario) -> Result<()> {
        match self {
            Self::Evolution(evolution) => evolution.check(scenario),
            Self::Maddpg(maddpg) => maddpg.check(scenario),
            Self::Ppo(recipe) => recipe.check(scenario),
        }
    }
}

impl ConfigurationSource {
    /// Reads and checks the configuration.
    ///
    /// # Errors
    /// [`Error::Input`] names the file and line, the key or the setting.
    pub fn read(&self) -> Result<Configuration> {
        let mut table = self.preset.table()?;
        let name = match table.get("algorithm") {
            Some(Value::String(name)) => name.clone(),
            _ => String::new(),
        };
        lay_over(&mut table, self.file.as_deref(), &self.settings, siblings)?;
        let mut take = |key: &str| table.remove(key).unwrap_or(Value::Boolean(false));
        let asked = take("algorithm");
        if asked.as_str() != Some(&name) {
            return Err(Error::input(
                "algorithm",
                asked,
                format!("{name}, the algorithm of the preset"),
            ));
        }
        let values = take("scenario");
        let scenario: Scenario = typed("scenario", values.clone())?;
        if let Value::Table(values) = &values {
            scenario.check(values)?;
        }
        let algorithm = Algorithm::read(&name, take(&name))?;
        algorithm.check(&scenario)?;
        Ok(Configuration { scenario, algorithm })
    }
}

impl Configuration {
    /// The learner before its first episode.
    ///
    /// # Errors
    /// What the algorithm reads besides, such as an actor to begin with.
    pub fn learner(&self, seed: u64) -> Result<Box<dyn Learner>> {
        match &self.algorithm {
            Algorithm::Evolution(evolution) => Ok(Box::new(EvolutionLearner::new(
                self.scenario.clone(),
                evolution.clone(),
                seed,
            ))),
            Algorithm::Maddpg(maddpg) => Ok(Box::new(MaddpgLearner::new(&self.scenario, maddpg, seed))),
            Algorithm::Ppo(recipe) => {
                let learner = PpoLearner::new(self.scenario.clone(), recipe.clone(), seed)?;
                Ok(Box::new(learner))
            }
        }
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
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn presets_are_complete_and_valid() {
        for preset in Preset::value_variants() {
            let configuration = preset.with(&["scenario.cell.vehicles=7"]).unwrap();
            assert_eq!(configuration.scenario.cell.vehicles, 7);
            let written = serde_json::to_string(&configuration).unwrap();
            assert_eq!(
                serde_json::from_str::<Configuration>(&written).unwrap(),
                configuration
            );
        }
    }

    #[test]
    fn bad_settings_name_key_and_expectation() {
        let message = |setting: &str| Preset::Evolution.with(&[setting]).unwrap_err().to_string();
        assert!(
            message("evolution.poulation=3").starts_with(
                "--set evolution.poulation: found an unknown key, expected one of evolution.elite"
            )
        );
        assert_eq!(
            message("algorithm=ppo"),
            "algorithm: found \"ppo\", expected evolution, the algorithm of the preset"
        );
        assert_eq!(
            message("scenario.cell.vehicles=0"),
            "cell.vehicles: found 0, expected 1 to 10000 vehicles"
        );
        assert_eq!(
            message("evolution.hidden=16"),
            "--set evolution.hidden: found 16, expected a list such as [64, 64]"
        );
        assert_eq!(
            message("evolution.elite=900"),
            "evolution.elite: found 900, expected at most half of evolution.population, which is 40"
        );
    }
}
