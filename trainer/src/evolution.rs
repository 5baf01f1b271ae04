//! Cross-entropy search (Rubinstein 1999): a normal distribution over the actor's parameters, drawn to its best samples.

use crate::algorithm::{LearningAlgorithm, Task};
use crate::first_networks::{self, Expected};
use crate::game::cell::{Cell, Unpaid};
use crate::game::reward::{Paying, RewardName};
use crate::game::{Game, Tally};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::network::Network;
use crate::network::perceptron::{Pass, Perceptron, Rows};
use firmware::form::{ObservationForm, OutputForm};
use firmware::ring::MAX_PLACES;
use host_sim::scenario::Scenario;
use host_sim::stream::Stream;
use kit::error::{Error, Result};
use kit::keys;
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::json;
use std::path::PathBuf;

keys! {
    /// The search's parameters.
    pub struct Evolution {
        /// Folder of the run whose actor the search begins around, such as one of `trainer distil`. Without one, around zero.
        #[key(source = "chosen")]
        pub first_actor: PathBuf,
        /// Generations.
        #[key(range = 1.0..=1e6, unit = "generations", source = "chosen")]
        pub episodes: u64,
        /// Widths of the actor's hidden layers.
        #[key(range = 1.0..=4096.0, longest = 8, unit = "widths", source = "chosen")]
        pub hidden: Vec<usize>,
        /// Actors tried in a generation, all on the same worlds.
        #[key(range = 2.0..=1e7, unit = "actors", source = "chosen")]
        pub population: u32,
        /// Best actors of a generation, from which the next one is drawn: at most half of it.
        #[key(range = 1.0..=1e6, unit = "actors", source = "chosen")]
        pub elite: u32,
        /// Worlds that each actor is tried in.
        #[key(range = 1.0..=1e6, unit = "worlds", source = "chosen")]
        pub worlds: u64,
        /// Slots of a world.
        #[key(range = 1.0..=1e6, unit = "slots", source = "chosen")]
        pub slots: u32,
        /// Standard deviation of a parameter in the first generation.
        #[key(range = 1e-6..=1e3, source = "chosen")]
        pub first_deviation: f32,
        /// Least standard deviation of a parameter in any generation.
        #[key(range = 1e-6..=1e3, source = "chosen")]
        pub least_deviation: f32,
        /// Bias of the action of silence in the first generation: an actor that always sends learns nothing
        /// from anybody.
        #[key(range = -1e6..=1e6, source = "chosen")]
        pub silence_bias: f32,
    }
}

impl LearningAlgorithm for Evolution {
    fn episodes_mut(&mut self) -> &mut u64 {
        &mut self.episodes
    }

    fn learner(&self, task: Task<'_>, seed: u64) -> Result<Box<dyn Learner>> {
        let learner = EvolutionLearner::new(task.scenario.clone(), self.clone(), task.reward, seed)?;
        Ok(Box::new(learner))
    }

    fn check(&self, scenario: &Scenario) -> Result<()> {
        let vehicles = scenario.cell.vehicles;
        if vehicles > u32::from(MAX_PLACES) {
            let expected = format!("at most {MAX_PLACES}, the places of a ring");
            return Err(Error::input("scenario.cell.vehicles", vehicles, expected));
        }
        if self.elite > self.population / 2 {
            let expected = format!(
                "at most half of evolution.population, which is {}",
                self.population
            );
            return Err(Error::input("evolution.elite", self.elite, expected));
        }
        Ok(())
    }
}

/// What the actor sees, and what it does.
const OBSERVATION: ObservationForm = ObservationForm::Ring;
const OUTPUT: OutputForm = OutputForm::Actions;

/// A normal distribution over parameter vectors, with independent components.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// Of each parameter.
    pub mean: Vec<f32>,
    /// Standard deviation of each parameter.
    pub deviation: Vec<f32>,
}

impl Search {
    /// One sample.
    pub fn draw(&self, stream: &mut Stream) -> Vec<f32> {
        let parameters = self.mean.iter().zip(&self.deviation);
        parameters
            .map(|(mean, deviation)| mean + deviation * stream.normal() as f32)
            .collect()
    }

    /// Moves to mean and deviation of the `elite` samples of the highest score; of equal scores the earlier sample. No
    /// deviation falls below the least, which should itself fall slowly (Szita and Lorincz 2006).
    pub fn learn(&mut self, samples: &[Vec<f32>], scores: &[f64], elite: usize, least_deviation: f32) {
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]));
        order.truncate(elite);
        let count = elite as f64;
        let parameters = self.mean.iter_mut().zip(&mut self.deviation);
        for (index, (known_mean, known_deviation)) in parameters.enumerate() {
            let values = || order.iter().map(|&sample| f64::from(samples[sample][index]));
            let mean = values().sum::<f64>() / count;
            let variance = values().map(|value| (value - mean) * (value - mean)).sum::<f64>() / count;
            *known_mean = mean as f32;
            *known_deviation = (libm::sqrt(variance) as f32).max(least_deviation);
        }
    }
}

/// The search at work in the cell.
pub struct EvolutionLearner {
    scenario: Scenario,
    evolution: Evolution,
    /// What actors are scored by; without one, by the mean age.
    reward: Option<RewardName>,
    seed: u64,
    done: u64,
    search: Search,
}

impl EvolutionLearner {
    /// Before the first generation: all parameters around zero, but silence preferred; or around those of the first actor.
    ///
    /// # Errors
    /// The first actor's file, and what is wrong with it.
    pub fn new(
        scenario: Scenario,
        evolution: Evolution,
        reward: Option<RewardName>,
        seed: u64,
    ) -> Result<Self> {
        let widths = widths(&evolution.hidden);
        let count = Perceptron::of_widths(&widths).parameters();
        let mean = if evolution.first_actor.as_os_str().is_empty() {
            let mut mean = vec![0.0; count];
            mean[count - OUTPUT.outputs()] = evolution.silence_bias;
            mean
        } else {
            let expected = Expected {
                key: "evolution.first_actor",
                form: (OBSERVATION, OUTPUT),
                widths: &widths,
                count: 1,
            };
            parameters_by_inputs(&first_networks::actors(&evolution.first_actor, expected)?[0])
        };
        let search = Search {
            mean,
            deviation: vec![evolution.first_deviation; count],
        };
        Ok(Self {
            scenario,
            evolution,
            reward,
            seed,
            done: 0,
            search,
        })
    }
}

/// A network's parameters as the search has them, layer by layer: weights `[inputs][outputs]`, then biases.
fn parameters_by_inputs(network: &Network) -> Vec<f32> {
    let layers = network.layers().enumerate();
    layers
        .flat_map(|(index, layer)| [network.weights_by_inputs(index), layer.biases.to_vec()].concat())
        .collect()
}

/// Inputs, hidden layers, actions.
fn widths(hidden: &[usize]) -> Vec<usize> {
    [&[OBSERVATION.inputs()], hidden, &[OUTPUT.outputs()]].concat()
}

/// Plays one actor greedily for so many slots.
fn play(game: &mut impl Game, network: &Network, slots: u32) -> Tally {
    let shape = game.shape();
    let (mut known, mut rewards) = (vec![0.0; shape.rows() * shape.known], vec![0.0; shape.rows()]);
    let (mut pass, mut tally) = (Pass::default(), Tally::default());
    for _ in 0..slots {
        game.know(&mut known);
        let _columns = network.forward_batch(Rows::all(&known, shape.known), &mut pass);
        let mut actions = Vec::with_capacity(rewards.len());
        for scores in pass.output_lines().chunks_exact(shape.actions.length()) {
            shape.actions.act(scores, 0.0, None, &mut actions);
        }
        game.step(&actions, &mut rewards, &mut tally);
    }
    tally
}

impl Learner for EvolutionLearner {
    fn length(&self) -> u64 {
        self.evolution.episodes
    }

    fn done(&self) -> u64 {
        self.done
    }

    fn advance(&mut self) -> Metrics {
        let Evolution {
            population,
            elite,
            worlds,
            slots,
            least_deviation,
            ..
        } = self.evolution;
        let widths = widths(&self.evolution.hidden);
        let mut stream = random::episode(self.seed, self.done, 0);
        let samples: Vec<Vec<f32>> = (0..population).map(|_| self.search.draw(&mut stream)).collect();
        // The same worlds for all.
        let first = random::world(self.seed, self.done, worlds, 0).world;
        let played: Vec<Tally> = samples
            .par_iter()
            .map(|sample| {
                let environment = random::worlds(&self.scenario, self.seed, first..first + worlds);
                let rules = Paying {
                    rules: Unpaid,
                    name: self.reward,
                    scale: 1.0,
                };
                let mut cell = Cell::new(environment, 0, OBSERVATION, OUTPUT, rules);
                play(&mut cell, &Network::by_inputs(&widths, sample), slots)
            })
            .collect();
        let ages: Vec<f64> = played.iter().map(|sum| sum.age / sum.agent_slots).collect();
        let scores: Vec<f64> = match self.reward {
            None => ages.iter().map(|age| -age).collect(),
            Some(_) => played.iter().map(|sum| sum.reward / sum.agent_slots).collect(),
        };
        let left = 1.0 - self.done as f32 / self.evolution.episodes as f32;
        let least = (self.evolution.first_deviation * left).max(least_deviation);
        self.search.learn(&samples, &scores, elite as usize, least);
        self.done += 1;
        let mut all = Tally::default();
        played.iter().for_each(|sum| all.merge(sum));
        let age = all.age / all.agent_slots;
        let vehicles = f64::from(self.scenario.cell.vehicles);
        let deviations = &self.search.deviation;
        let deviation =
            deviations.iter().map(|&value| f64::from(value)).sum::<f64>() / deviations.len() as f64;
        let reward = match self.reward {
            None => -age / vehicles + 0.05 * all.received / all.agent_slots,
            Some(_) => all.reward / all.agent_slots,
        };
        let slots = self.done as f64 * all.world_slots;
        all.metrics(reward, slots, self.done)
            .with("best_age_ms", ages.iter().copied().fold(f64::INFINITY, f64::min))
            .with("mean_deviation", deviation)
    }

    fn state(&self) -> State {
        let mut state = State::new(json!({ "done": self.done }));
        let count = [self.search.mean.len()];
        state.put("mean", &count, self.search.mean.clone());
        state.put("deviation", &count, self.search.deviation.clone());
        state
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        #[derive(Deserialize)]
        struct Counters {
            done: u64,
        }
        let count = [self.search.mean.len()];
        self.done = state.counters::<Counters>()?.done;
        self.search.mean = state.take_f32("mean", &count)?;
        self.search.deviation = state.take_f32("deviation", &count)?;
        state.finish()
    }

    fn actors(&self) -> Actors {
        let vehicles = self.scenario.cell.vehicles;
        Actors {
            form: ActorForm {
                observation: OBSERVATION,
                output: OUTPUT,
                noise: 0.0,
                min_vehicles: vehicles,
                max_vehicles: vehicles,
            },
            networks: vec![Network::by_inputs(
                &widths(&self.evolution.hidden),
                &self.search.mean,
            )],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game::toy::Turns;

    #[test]
    fn the_toy_is_played_within_half_a_percent_of_the_best() {
        const SLOTS: u32 = 20;
        let widths = [9, 2];
        let mean_age = |parameters: &[f32]| {
            let tally = play(
                &mut Turns::new(16),
                &Network::by_inputs(&widths, parameters),
                SLOTS,
            );
            tally.age / tally.agent_slots
        };
        for seed in 0..5 {
            let count = Perceptron::of_widths(&widths).parameters();
            let mut search = Search {
                mean: vec![0.0; count],
                deviation: vec![1.0; count],
            };
            for generation in 0..80 {
                let mut stream = random::episode(seed, generation, 0);
                let samples: Vec<Vec<f32>> = (0..200).map(|_| search.draw(&mut stream)).collect();
                let scores: Vec<f64> = samples.iter().map(|sample| -mean_age(sample)).collect();
                search.learn(&samples, &scores, 20, (1.0 - generation as f32 / 80.0).max(0.2));
            }
            let (found, best) = (mean_age(&search.mean), Turns::best_age(SLOTS));
            // What is missing is one lost slot from one or two of the sixteen starts.
            assert!(found <= 1.005 * best, "seed {seed}: {found} of {best}");
        }
    }
}
