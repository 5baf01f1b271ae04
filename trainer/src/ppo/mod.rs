//! Learning from the cell alone, on policy: proximal policy optimisation (Schulman et al. 2017) of one actor that all
//! vehicles share, with a critic that sees the whole group (Yu et al., "The surprising effectiveness of PPO in cooperative
//! multi-agent games", NeurIPS 2022).
//!
//! Nothing is imitated. The actor's input is the firmware's encoding, which already says whether the age is a multiple of the
//! broadcast period; what to do with it is learned. Every sum has a fixed order, so that a seed gives the same network to
//! the last bit on any machine and any number of threads.

pub mod advantage;
pub mod central;
pub mod loss;
pub mod optimiser;
pub mod rollout;

use crate::network::{Adam, Network};
use central::CENTRAL_INPUTS;
use firmware::decision::{ACTIONS, Action};
use firmware::observation::INPUTS;
use host_sim::environment::Environment;
use host_sim::mobility::MobilitySource;
use host_sim::policy::power_plan;
use host_sim::scenario::Scenario;
use host_sim::stream::{Purpose, Role, Stream, WorldKey};
use optimiser::{Losses, Optimiser, Rates};
use rayon::prelude::*;
use rollout::{Batch, Experience, Tally};
use serde::{Deserialize, Serialize};

/// How to learn. All values are chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Widths of the actor's hidden layers.
    pub hidden: Vec<usize>,
    /// Widths of the critic's hidden layers.
    pub critic_hidden: Vec<usize>,
    /// Episodes; each begins with fresh worlds.
    pub episodes: u32,
    /// Batches of worlds in an episode; the worlds of one have the same number of vehicles.
    pub batches: u32,
    /// Worlds in a batch.
    pub worlds: u32,
    /// Updates in an episode.
    pub updates: u32,
    /// Slots played before each update.
    pub slots: u32,
    /// Times that each update goes over what was played.
    pub epochs: u32,
    /// Samples in an optimiser step.
    pub minibatch: usize,
    /// Fewest vehicles in a cell.
    pub min_vehicles: u32,
    /// Most vehicles in a cell: what the table will serve.
    pub max_vehicles: u32,
    /// Weight of the next slot's value.
    pub discount: f32,
    /// Weight of later differences in an advantage: lambda.
    pub trace: f32,
    /// Weight of each other group member's cost next to the own.
    pub team: f32,
    /// Cost of a slot: the age in periods, at most this.
    pub most_periods: f32,
    /// How far a probability ratio may leave 1.
    pub clip: f32,
    /// Largest norm of the actor's gradient.
    pub gradient_limit: f32,
    /// The actor's learning rate at the start and at the end; it changes linearly.
    pub learning_rate: [f32; 2],
    /// The critic's.
    pub critic_learning_rate: [f32; 2],
    /// Weight of the entropy at the start and at the end; it changes geometrically.
    pub entropy: [f32; 2],
    /// First scores of silence, of full power and of each joiner level.
    pub first_scores: [f32; 3],
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            hidden: vec![32, 32],
            critic_hidden: vec![64, 64],
            episodes: 60,
            batches: 12,
            worlds: 2,
            updates: 8,
            slots: 32,
            epochs: 3,
            minibatch: 4096,
            min_vehicles: 3,
            max_vehicles: 72,
            discount: 0.97,
            trace: 0.9,
            team: 0.5,
            most_periods: 8.0,
            clip: 0.2,
            gradient_limit: 0.5,
            learning_rate: [2e-3, 2e-5],
            critic_learning_rate: [2e-3, 1e-4],
            entropy: [2e-3, 3e-6],
            first_scores: [4.0, 2.0, 0.0],
        }
    }
}

/// What an episode was like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EpisodeSummary {
    /// Sums over what was played.
    pub tally: Tally,
    /// Means over the updates.
    pub losses: Losses,
}

/// A learner between two episodes.
pub struct Ppo {
    scenario: Scenario,
    recipe: Recipe,
    seed: u64,
    optimiser: Optimiser,
    done: u32,
}

impl Ppo {
    /// A learner with random networks.
    pub fn new(scenario: &Scenario, recipe: &Recipe, seed: u64) -> Self {
        let mut stream = stream(seed, u64::MAX, 0);
        let mut actor = Network::random(&widths(INPUTS, &recipe.hidden, ACTIONS), &mut stream);
        // Nearly the same scores everywhere: the first decisions are the prior's.
        if let Some(last) = actor.layers.last_mut() {
            last.weights.iter_mut().for_each(|weight| *weight *= 0.1);
            let [silent, full_power, joiner] = recipe.first_scores;
            last.biases.fill(joiner);
            last.biases[Action::Silent as usize] = silent;
            last.biases[Action::FullPower as usize] = full_power;
        }
        Self::from_actor(scenario, recipe, seed, actor)
    }

    /// A learner that goes on from an actor.
    pub fn from_actor(scenario: &Scenario, recipe: &Recipe, seed: u64, actor: Network) -> Self {
        let mut stream = stream(seed, u64::MAX, 1);
        let critic = Network::random(&widths(CENTRAL_INPUTS, &recipe.critic_hidden, 1), &mut stream);
        Self {
            scenario: scenario.clone(),
            recipe: recipe.clone(),
            seed,
            optimiser: Optimiser {
                actor_adam: Adam::new(&actor),
                critic_adam: Adam::new(&critic),
                actor,
                critic,
            },
            done: 0,
        }
    }

    /// The actor.
    pub fn actor(&self) -> &Network {
        &self.optimiser.actor
    }

    /// Episodes done.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// Plays and learns from one episode.
    pub fn episode(&mut self) -> EpisodeSummary {
        let recipe = &self.recipe;
        let batch = |index: u32| u64::from(self.done) * u64::from(recipe.batches) + u64::from(index);
        let mut streams: Vec<Stream> = (0..recipe.batches)
            .map(|index| stream(self.seed, batch(index), 2))
            .collect();
        let scenarios: Vec<Scenario> = streams
            .iter_mut()
            .map(|stream| {
                let mut scenario = self.scenario.clone();
                scenario.cell.vehicles =
                    recipe.min_vehicles + stream.below(recipe.max_vehicles - recipe.min_vehicles + 1);
                scenario
            })
            .collect();
        let mut batches: Vec<Batch<'_>> = scenarios
            .iter()
            .zip(streams)
            .zip(0..)
            .map(|((scenario, stream), index)| {
                let first = batch(index) * u64::from(recipe.worlds);
                let environment = Environment::new(
                    scenario,
                    &MobilitySource::Grid,
                    self.seed,
                    Purpose::Training,
                    first..first + u64::from(recipe.worlds),
                );
                Batch::new(environment, power_plan(scenario), stream)
            })
            .collect();
        let mut order = stream(self.seed, u64::from(self.done), 3);
        let mut summary = EpisodeSummary::default();
        for update in 0..recipe.updates {
            let progress = (f64::from(self.done) + f64::from(update) / f64::from(recipe.updates)) / f64::from(recipe.episodes);
            let (actor, critic) = (&self.optimiser.actor, &self.optimiser.critic);
            let played: Vec<Experience> = batches
                .par_iter_mut()
                .map(|batch| batch.play(actor, critic, recipe))
                .collect();
            let experience = Experience::join(played);
            let losses = self.optimiser.update(&experience, recipe, recipe.rates(progress), &mut order);
            summary.add(&experience.tally, &losses, recipe.updates);
        }
        self.done += 1;
        summary
    }
}

impl Recipe {
    fn rates(&self, progress: f64) -> Rates {
        let linear = |[first, last]: [f32; 2]| first + (last - first) * progress as f32;
        let [first, last] = self.entropy;
        Rates {
            actor: linear(self.learning_rate),
            critic: linear(self.critic_learning_rate),
            entropy: first * libm::pow(f64::from(last / first), progress) as f32,
        }
    }
}

impl EpisodeSummary {
    fn add(&mut self, tally: &Tally, losses: &Losses, updates: u32) {
        self.tally.merge(tally);
        let share = 1.0 / f64::from(updates);
        self.losses.actor += losses.actor * share;
        self.losses.critic += losses.critic * share;
        self.losses.entropy += losses.entropy * share;
        self.losses.clipped += losses.clipped * share;
        self.losses.steps += losses.steps;
    }
}

fn widths(inputs: usize, hidden: &[usize], outputs: usize) -> Vec<usize> {
    [inputs].into_iter().chain(hidden.iter().copied()).chain([outputs]).collect()
}

/// A stream of decisions, which no world has.
fn stream(seed: u64, world: u64, member: u32) -> Stream {
    WorldKey {
        seed,
        purpose: Purpose::Training,
        world,
    }
    .stream(Role::Policy, member)
}
