//! The algorithm in the simulator's cell.

use super::learner::MaddpgLearner;
use super::options::Maddpg;
#[cfg(test)]
use crate::configuration::{Algorithm, Configuration, Preset};
use crate::forms;
use crate::game::actions::ActionSpace;
use crate::game::cell::{Cell, Outcome, Rules, Sensed};
use crate::game::reward::AgeReward;
use crate::game::{Shape, start_ages};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::random;
use crate::laboratory::state::State;
use host_sim::scenario::Scenario;
use kit::error::Result;

/// The modified MADDPG at work in the cell.
pub struct MaddpgInCell {
    scenario: Scenario,
    options: Maddpg,
    seed: u64,
    /// The algorithm itself.
    pub learner: MaddpgLearner,
}

/// Every vehicle is paid for its own age; the global reward is the mean.
#[derive(Clone, Copy)]
struct OwnAge(AgeReward);

/// Values that critics know besides the observation: the age in its largest, and in twenty slots up to twenty.
const EXTRA: usize = 2;

/// The slots in twenties of the second.
const YOUNG: f32 = 20.0;

impl Rules for OwnAge {
    fn extra(&self) -> usize {
        EXTRA
    }

    fn know<'r>(&self, world: &[Option<Sensed>], extras: impl Iterator<Item = &'r mut [f32]>) {
        for (sensed, extra) in world.iter().zip(extras) {
            if let Some(sensed) = sensed {
                extra[0] = forms::age_in_its_largest(&sensed.observation);
                extra[1] = f32::from(sensed.observation.age().slots()).min(YOUNG) / YOUNG;
            }
        }
    }

    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        for (outcome, reward) in world.iter().zip(rewards) {
            if let Some(outcome) = outcome {
                *reward = self.0.of(outcome.age, outcome.received);
            }
        }
    }
}

/// The member of the episode's stream that draws start ages.
const START_AGES: u32 = 1;

impl MaddpgInCell {
    /// Before the first episode.
    pub fn new(scenario: &Scenario, options: &Maddpg, seed: u64) -> Self {
        let observed = options.observation.inputs();
        let shape = Shape {
            worlds: options.worlds as usize,
            agents: scenario.cell.vehicles as usize,
            known: observed + EXTRA,
            observed,
            actions: ActionSpace::from(options.action),
        };
        Self {
            scenario: scenario.clone(),
            options: options.clone(),
            seed,
            learner: MaddpgLearner::new(shape, options, seed),
        }
    }
}

impl Learner for MaddpgInCell {
    fn length(&self) -> u64 {
        self.options.episodes
    }

    fn done(&self) -> u64 {
        self.learner.done()
    }

    fn advance(&mut self) -> Metrics {
        let (present, options) = (self.learner.present(), &self.options);
        let mut scenario = self.scenario.clone();
        scenario.cell.vehicles = present as u32;
        let episode = self.learner.done();
        let first = episode * options.worlds;
        let mut environment = random::worlds(&scenario, self.seed, first..first + options.worlds);
        // Never less often than a quarter of the first share (chosen).
        let in_turn = options.phase_resets * (1.0 - self.learner.progress()).max(0.25);
        let mut stream = random::episode(self.seed, episode, START_AGES);
        start_ages::in_turn_or_else(in_turn, &mut environment, &mut stream);
        let rules = OwnAge(options.reward(present));
        let room = self.scenario.cell.vehicles as usize;
        let (observation, output) = (options.observation, options.output_form());
        let mut cell = Cell::new(environment, room, observation, output, rules);
        self.learner.episode(&mut cell)
    }

    fn state(&self) -> State {
        self.learner.state()
    }

    fn restore(&mut self, state: State) -> Result<()> {
        self.learner.restore(state)
    }

    fn actors(&self) -> Actors {
        let (options, vehicles) = (&self.options, self.scenario.cell.vehicles);
        Actors {
            form: ActorForm {
                observation: options.observation,
                output: options.output_form(),
                noise: options.noise,
                min_vehicles: options.first_vehicles(vehicles as usize) as u32,
                max_vehicles: vehicles,
            },
            networks: self.learner.networks(),
        }
    }
}

#[cfg(test)]
impl MaddpgInCell {
    /// The learner of a preset with `KEY=VALUE` settings and seed 1, for tests.
    pub(super) fn of_preset(preset: Preset, settings: &[&str]) -> Self {
        match preset.with(settings) {
            Ok(Configuration {
                algorithm: Algorithm::Maddpg(options),
                scenario,
                ..
            }) => Self::new(&scenario, &options, 1),
            other => panic!("{other:?}"),
        }
    }
}
