//! The algorithm in the simulator's cell.

use super::learner::MaddpgLearner;
use super::options::{Maddpg, StartAges};
use crate::algorithm::{LearningAlgorithm, Task};
#[cfg(test)]
use crate::configuration::{Algorithm, Configuration, Preset};
use crate::forms;
use crate::game::actions::ActionSpace;
use crate::game::cell::{Cell, Outcome, Rules, Sensed};
use crate::game::reward::{AgeReward, Paying, RewardName};
use crate::game::{Shape, start_ages};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::random;
use crate::laboratory::state::State;
use firmware::form::{ObservationForm, OutputForm};
use firmware::units::Age;
use host_sim::environment::Environment;
use host_sim::scenario::Scenario;
use kit::error::Result;

impl LearningAlgorithm for Maddpg {
    fn episodes_mut(&mut self) -> &mut u64 {
        &mut self.episodes
    }

    fn forms(&self) -> (ObservationForm, OutputForm) {
        (self.observation, self.action)
    }

    fn losses_checksum(&self) -> Option<String> {
        Self::losses_checksum(self)
    }

    fn check(&self, scenario: &Scenario) -> Result<()> {
        Self::check(self, scenario)
    }

    fn learner(&self, task: Task<'_>, seed: u64) -> Result<Box<dyn Learner>> {
        let mut learner = MaddpgInCell::new(task.scenario, self, seed);
        learner.reward = task.reward;
        learner.learner.begin_from_others()?;
        Ok(Box::new(learner))
    }
}

/// The modified MADDPG at work in the cell.
pub struct MaddpgInCell {
    scenario: Scenario,
    options: Maddpg,
    /// What vehicles are paid for, unless the options say it.
    reward: Option<RewardName>,
    seed: u64,
    /// The algorithm itself.
    pub learner: MaddpgLearner,
    /// Ages in slots after the last episode, `[world][vehicle]`; empty where episodes begin with others.
    ages: Vec<f32>,
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
        let kept = match options.start_ages {
            StartAges::Drawn => 0,
            StartAges::Kept => shape.rows(),
        };
        Self {
            scenario: scenario.clone(),
            options: options.clone(),
            reward: None,
            seed,
            learner: MaddpgLearner::new(shape, options, seed),
            ages: vec![Age::TIME_CONSTRAINT.slots().into(); kept],
        }
    }

    /// Begins an episode's ages.
    fn begin(&self, environment: &mut Environment<'_>) {
        let (options, episode) = (&self.options, self.learner.done());
        match options.start_ages {
            StartAges::Drawn => {
                // Never less often than a quarter of the first share (chosen).
                let in_turn = options.phase_resets * (1.0 - self.learner.progress()).max(0.25);
                let mut stream = random::episode(self.seed, episode, START_AGES);
                start_ages::in_turn_or_else(in_turn, environment, &mut stream);
            }
            StartAges::Kept => {
                for (row, &age) in self.ages.iter().enumerate() {
                    let (world, vehicle) = self.place(row);
                    if vehicle < environment.vehicles() {
                        environment.set_age(world, vehicle, Age::after(age as u32));
                    }
                }
            }
        }
    }

    /// Keeps the ages that an episode ended with.
    fn keep(&mut self, environment: &Environment<'_>) {
        for row in 0..self.ages.len() {
            let (world, vehicle) = self.place(row);
            if vehicle < environment.vehicles() {
                self.ages[row] = environment.age(world, vehicle).slots().into();
            }
        }
    }

    /// World and vehicle of a row.
    fn place(&self, row: usize) -> (usize, usize) {
        let vehicles = self.scenario.cell.vehicles as usize;
        (row / vehicles, row % vehicles)
    }

    /// The shape of the ages that are kept.
    fn shape_of_ages(&self) -> [usize; 2] {
        [self.options.worlds as usize, self.scenario.cell.vehicles as usize]
    }
}

/// The tensor of a checkpoint that holds them.
const AGES: &str = "ages";

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
        self.begin(&mut environment);
        let rules = Paying {
            rules: OwnAge(options.reward(present)),
            name: self.reward,
            scale: 1.0,
        };
        let room = self.scenario.cell.vehicles as usize;
        let (observation, output) = (options.observation, options.output_form());
        let mut cell = Cell::new(environment, room, observation, output, rules);
        let metrics = self.learner.episode(&mut cell);
        self.keep(cell.environment());
        metrics
    }

    fn state(&self) -> State {
        let mut state = self.learner.state();
        if self.options.start_ages == StartAges::Kept {
            state.put(AGES, &self.shape_of_ages(), self.ages.clone());
        }
        state
    }

    fn parts_bytes(&self) -> u64 {
        self.learner.parts_bytes()
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        if self.options.start_ages == StartAges::Kept {
            self.ages = state.take_f32(AGES, &self.shape_of_ages())?;
        }
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
