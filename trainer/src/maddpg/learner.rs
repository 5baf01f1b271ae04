//! Two time frame modified MADDPG (paper, Algorithm 1): twin global critics, a local critic for each vehicle, delayed policy
//! updates, target smoothing; and the options around it.
//!
//! Here are its parts, and an episode: played with the actors' exploring form, stored, and learned from in
//! the module `update`.

use super::actions::ActionSet;
use super::arena::{Arena, CellArena, Tally, Worlds};
use super::choice::sample;
use super::critic::{Critic, CriticPass};
use super::flat_critic::FlatCritic;
use super::group::{Group, Role, Rows};
use super::optimiser::Learned;
use super::options::{CriticForm, Maddpg, Updates};
use super::perceptron::Perceptron;
use super::pool::Pool;
use super::replay::{Batch, Extent, Replay};
use super::set_critic::SetCritic;
#[cfg(test)]
use crate::laboratory::configuration::{Algorithm, Configuration, Preset};
use crate::laboratory::random;
use host_sim::scenario::Scenario;
use host_sim::stream::Stream;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The member of the episode's stream that explores, draws batches and smooths targets.
pub(super) const LEARNING: u32 = 0;

/// The modified MADDPG at work.
pub struct MaddpgLearner {
    pub(super) options: Maddpg,
    pub(super) seed: u64,
    pub(super) arena: Arc<dyn Arena>,
    pub(super) set: ActionSet,
    pub(super) actors: Group,
    pub(super) local_critics: Option<Group>,
    pub(super) critic: Critic,
    pub(super) twins: [Learned; 2],
    pub(super) passes: [CriticPass; 2],
    pub(super) gradients: Pool<Vec<f32>>,
    pub(super) replay: Replay,
    pub(super) batch: Batch,
    pub(super) extent: Extent,
    pub(super) counters: Counters,
    pub(super) losses: Losses,
    times: Times,
}

/// Where a run's time went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    /// In the environment: observing and stepping.
    pub environment: Duration,
    /// In updates.
    pub learning: Duration,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Counters {
    pub done: u64,
    pub updates: u64,
    pub slots: u64,
}

/// Sums over the updates of an episode.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Losses {
    pub global: f64,
    pub global_count: u32,
    pub local: f64,
    pub entropy: f64,
    pub delayed_count: u32,
}

impl MaddpgLearner {
    /// For the simulator's cell.
    pub fn new(scenario: &Scenario, options: &Maddpg, seed: u64) -> Self {
        let arena = CellArena {
            scenario: scenario.clone(),
            options: options.clone(),
            seed,
        };
        Self::in_arena(Arc::new(arena), options, seed)
    }

    /// For any arena.
    pub fn in_arena(arena: Arc<dyn Arena>, options: &Maddpg, seed: u64) -> Self {
        let mut stream = random::initial(seed, 0);
        let set = arena.actions();
        let (vehicles, observed, known) = (arena.vehicles(), arena.observed(), arena.known());
        let network = Perceptron::new(observed, &options.actor_hidden, set.length());
        let mut actors = Group::new(network, options.shared, vehicles, &mut stream);
        begin_actors(&mut actors, options, set);
        let local_critics = options.local_critics.then(|| {
            let hidden = &options.local_critic_hidden;
            let network = if set.is_choice() {
                Perceptron::new(observed, hidden, set.length())
            } else {
                Perceptron::new(observed + set.length(), hidden, 1)
            };
            Group::new(network, options.shared, vehicles, &mut stream)
        });
        let hidden = &options.global_critic_hidden;
        let critic = match options.global_critic {
            CriticForm::Flat => Critic::Flat(FlatCritic::new(vehicles, observed, set.length(), hidden)),
            CriticForm::Set => Critic::Set(SetCritic::new(
                set,
                known,
                options.set_hidden,
                options.set_sum,
                hidden,
            )),
        };
        let twins = [(); 2].map(|()| Learned::new(critic.initial(&mut stream)));
        let (slots, worlds) = (options.slots as usize, options.worlds as usize);
        let extent = Extent {
            episodes: options.replay / (slots * worlds),
            slots,
            worlds,
            vehicles,
            known,
            observed,
            action: if set.is_choice() { 1 } else { set.length() },
        };
        Self {
            options: options.clone(),
            seed,
            arena,
            set,
            actors,
            local_critics,
            critic,
            twins,
            passes: Default::default(),
            gradients: Pool::default(),
            replay: Replay::new(extent),
            batch: Batch::default(),
            extent,
            counters: Counters::default(),
            losses: Losses::default(),
            times: Times::default(),
        }
    }

    /// Where the time went.
    pub fn times(&self) -> Times {
        self.times
    }

    /// Updates so far.
    pub fn updates(&self) -> u64 {
        self.counters.updates
    }

    /// Share of the run that is done, from 0 to 1.
    pub(super) fn progress(&self) -> f32 {
        self.counters.done as f32 / self.options.episodes as f32
    }

    /// Vehicles in the next episode: the load grows over the run's first part.
    pub(super) fn present(&self) -> usize {
        let all = self.arena.vehicles();
        let first = self.options.first_vehicles(all);
        let part = if self.options.all_vehicles_at > 0.0 {
            (self.progress() / self.options.all_vehicles_at).min(1.0)
        } else {
            1.0
        };
        all.min(first + ((all - first + 1) as f32 * part) as usize)
    }

    /// Plays one episode in these worlds, learning meanwhile.
    pub(super) fn play(&mut self, worlds: &mut dyn Worlds, present: usize, stream: &mut Stream) -> Played {
        let mut played = Played::default();
        worlds.homes(self.replay.begin(present));
        self.know(worlds);
        for _ in 0..self.extent.slots {
            let actions = self.explore(present, stream);
            let start = Instant::now();
            let (room, rewards) = self.replay.outcome();
            room.copy_from_slice(&actions);
            let tally = worlds.step(&actions, rewards);
            played.reward += rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
            self.times.environment += start.elapsed();
            played.tally.age += tally.age;
            played.tally.received += tally.received;
            played.tally.power += tally.power;
            self.replay.advance();
            self.know(worlds);
            if self.options.updates == Updates::Slot {
                self.update(stream);
            }
        }
        if self.options.updates == Updates::Episode {
            self.update(stream);
        }
        played
    }

    fn know(&mut self, worlds: &dyn Worlds) {
        let start = Instant::now();
        worlds.know(self.replay.known());
        self.times.environment += start.elapsed();
    }

    /// Actions of all vehicles for the slot at hand, as the arena takes them.
    fn explore(&mut self, present: usize, stream: &mut Stream) -> Vec<f32> {
        let width = self.extent.known;
        let rows = Rows {
            values: self.replay.known(),
            stride: width,
            width: self.extent.observed,
        };
        let outputs = self.actors.outputs(Role::Learner, &[rows]);
        let length = self.set.length();
        let mut actions = Vec::with_capacity(outputs.len());
        for (row, outputs) in outputs.chunks_exact(length).enumerate() {
            let absent = row % self.extent.vehicles >= present;
            if self.set.is_choice() {
                let action = if absent { 0 } else { sample(outputs, stream) };
                actions.push(action as f32);
            } else if absent {
                actions.extend([0.0; 2]);
            } else {
                actions.extend(outputs.iter().map(|&output| {
                    let noise = self.options.noise * stream.normal() as f32;
                    (libm::tanhf(output) + noise).clamp(-1.0, 1.0)
                }));
            }
        }
        actions
    }

    /// One update of the global critics and, every `delay`-th time, of local critics and actors.
    fn update(&mut self, stream: &mut Stream) {
        let start = Instant::now();
        self.learn(stream);
        self.times.learning += start.elapsed();
    }
}

/// Sums over an episode.
#[derive(Default)]
pub(super) struct Played {
    pub tally: Tally,
    pub reward: f64,
}

/// Scales the last layer down and biases it towards silence and home: an actor that always sends learns nothing.
fn begin_actors(actors: &mut Group, options: &Maddpg, set: ActionSet) {
    let network = &actors.network;
    let last = network.layers() - 1;
    let (weights, biases) = (network.weights(last), network.biases(last));
    for learned in &mut actors.learned {
        let mut parameters = learned.parameters.clone();
        parameters[weights.clone()]
            .iter_mut()
            .for_each(|weight| *weight *= options.last_layer_scale);
        if set.is_choice() {
            let biases = &mut parameters[biases.clone()];
            biases.fill(0.0);
            biases[0] = options.silence_bias;
            for (action, bias) in biases.iter_mut().enumerate().skip(1) {
                *bias = match (set, action) {
                    (_, 1) => options.home_bias,
                    (ActionSet::SubChannels, 4) | (ActionSet::Home(_), _) => options.joiner_bias,
                    _ => 0.0,
                };
            }
            if set == ActionSet::SubChannels && !options.silence {
                biases[0] = NEVER;
            }
        }
        *learned = Learned::new(parameters);
    }
}

/// A score that no other comes near: the action is never chosen.
const NEVER: f32 = -1e9;

#[cfg(test)]
impl MaddpgLearner {
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
