//! What vehicles are rewarded for, by name.

use firmware::units::Age;
use host_sim::scenario::Scenario;
use kit::choice::Choice;
use kit::error::{Error, Result};
use trainer::configuration::{Algorithm, ConfigurationSource, Preset};
use trainer::game::reward::AgeReward;

/// The names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Name {
    /// Its own age.
    Own,
    /// The mean of its world's vehicles.
    Team,
    /// The paper's.
    Paper,
}

impl Choice for Name {
    const ALL: &'static [Self] = &[Self::Own, Self::Team, Self::Paper];

    fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Team => "team",
            Self::Paper => "paper",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Own => "Its own age over 100 slots",
            Self::Team => "The mean of this over its world's vehicles",
            Self::Paper => {
                "The paper's own reward: its age over the number of vehicles, and what a reception adds"
            }
        }
    }
}

/// What a vehicle is rewarded for.
#[derive(Clone, Copy, Debug)]
pub struct Reward {
    /// What a vehicle's own age is worth.
    pub own: AgeReward,
    /// Whether everybody in a world gets the mean.
    pub shared: bool,
}

impl Reward {
    /// The reward of this name in worlds of a scenario.
    ///
    /// # Errors
    /// None, since presets are tested.
    pub fn new(name: Name, scenario: &Scenario) -> Result<Self> {
        let most = f32::from(Age::TIME_CONSTRAINT.slots());
        let own = AgeReward {
            scale: most,
            cap: most,
            success: 0.0,
        };
        Ok(match name {
            Name::Own => Self { own, shared: false },
            Name::Team => Self { own, shared: true },
            Name::Paper => Self {
                own: paper(scenario)?,
                shared: false,
            },
        })
    }
}

/// As the trainer's preset has it.
fn paper(scenario: &Scenario) -> Result<AgeReward> {
    let source = ConfigurationSource {
        preset: Preset::Paper,
        file: None,
        settings: Vec::new(),
    };
    match source.read()?.algorithm {
        Algorithm::Maddpg(options) => Ok(options.reward(scenario.cell.vehicles as usize)),
        _ => Err(Error::input("preset", "another algorithm", "the paper's")),
    }
}
