//! Two time frame modified MADDPG (paper, Algorithm 1): twin global critics, a local critic for each vehicle, delayed policy
//! updates, target smoothing; and the options around it.
//!
//! Here are its parts, and an episode: played with the actors' exploring form, stored, and learned from in
//! the module `update`.

use super::critic::{Critic, CriticPass};
use super::flat_critic::FlatCritic;
use super::group::{Group, Role};
use super::options::{CriticForm, Maddpg, Updates};
use super::replay::{Batch, Extent, Replay};
use super::set_critic::SetCritic;
use crate::first_networks::{self, Expected};
use crate::game::actions::ActionSpace;
use crate::game::{Game, Shape, Tally};
use crate::laboratory::learner::Metrics;
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::network::Network;
use crate::network::optimiser::{Learned, Powers};
use crate::network::perceptron::{Perceptron, Rows};
use crate::network::pool::Pool;
use host_sim::stream::Stream;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// The member of the episode's stream that explores, draws batches and smooths targets.
pub(super) const LEARNING: u32 = 0;

/// The modified MADDPG at work.
pub struct MaddpgLearner {
    pub(super) options: Maddpg,
    pub(super) seed: u64,
    pub(super) space: ActionSpace,
    pub(super) actors: Group,
    pub(super) local_critics: Option<Group>,
    pub(super) critic: Box<dyn Critic>,
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

/// What a checkpoint keeps besides tensors.
#[derive(Serialize, Deserialize)]
struct Saved {
    counters: Counters,
    replay: (u64, usize),
    actors: Vec<Powers>,
    local_critics: Vec<Powers>,
    twins: [Powers; 2],
}

impl MaddpgLearner {
    /// Before the first episode of a game of this shape.
    pub fn new(shape: Shape, options: &Maddpg, seed: u64) -> Self {
        let mut stream = random::initial(seed, 0);
        let Shape {
            worlds,
            agents: vehicles,
            known,
            observed,
            actions: space,
        } = shape;
        let network = Perceptron::new(observed, &options.actor_hidden, space.length());
        let mut actors = Group::new(network, options.shared, vehicles, &mut stream);
        begin_actors(&mut actors, options, space);
        let local_critics = options.local_critics.then(|| {
            let hidden = &options.local_critic_hidden;
            let network = if space.is_choice() {
                Perceptron::new(observed, hidden, space.length())
            } else {
                Perceptron::new(observed + space.length(), hidden, 1)
            };
            Group::new(network, options.shared, vehicles, &mut stream)
        });
        let hidden = &options.global_critic_hidden;
        let critic: Box<dyn Critic> = match options.global_critic {
            CriticForm::Flat => Box::new(FlatCritic::new(vehicles, observed, space, hidden)),
            CriticForm::Set => {
                let (describe, sum) = (options.set_hidden, options.set_sum);
                Box::new(SetCritic::new(space.length(), known, describe, sum, hidden))
            }
        };
        let twins = [(); 2].map(|()| Learned::new(critic.initial(&mut stream)));
        let slots = options.slots as usize;
        let extent = Extent {
            episodes: options.replay / (slots * worlds),
            slots,
            worlds,
            vehicles,
            known,
            observed,
            action: space.values(),
        };
        Self {
            options: options.clone(),
            seed,
            space,
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

    /// Raises all hidden biases of a flat critic, of the actors and their critics so far that no unit is silent for a whole batch: what
    /// an update costs then is what `trainer bench` shows.
    pub fn wake(&mut self) {
        // Uniform weights let a unit vary by less than a sixth of what it is fed: five times that is ten times as much a layer.
        fn raise(network: &Perceptron, learned: &mut Learned) {
            let mut parameters = learned.parameters.clone();
            let mut height = 1.0;
            for layer in 0..network.layers() - 1 {
                height *= 10.0;
                parameters[network.biases(layer)]
                    .iter_mut()
                    .for_each(|bias| *bias += height);
            }
            *learned = Learned::new(parameters);
        }
        for group in std::iter::once(&mut self.actors).chain(&mut self.local_critics) {
            let Group { network, learned, .. } = group;
            learned.iter_mut().for_each(|learned| raise(network, learned));
        }
        if self.options.global_critic == CriticForm::Flat {
            let (extent, hidden) = (&self.extent, &self.options.global_critic_hidden);
            let flat = FlatCritic::new(extent.vehicles, extent.observed, self.space, hidden);
            self.twins.iter_mut().for_each(|twin| raise(&flat.network, twin));
        }
    }

    /// Goes on from the actors and the critics that the options name, if they do.
    ///
    /// # Errors
    /// What is not there, or of another form.
    pub fn begin_from_others(&mut self) -> Result<()> {
        let Maddpg {
            first_actor,
            first_critics,
            ..
        } = &self.options;
        if !first_actor.as_os_str().is_empty() {
            let expected = Expected {
                key: "maddpg.first_actor",
                form: (self.options.observation, self.options.output_form()),
                widths: self.actors.network.widths(),
                count: self.actors.learned.len(),
            };
            let networks = first_networks::actors(first_actor, expected)?;
            for (learned, network) in self.actors.learned.iter_mut().zip(networks) {
                *learned = Learned::new(network.parameters);
            }
        }
        if !first_critics.as_os_str().is_empty() {
            let key = "maddpg.first_critics";
            let mut state = first_networks::state(first_critics, key)?;
            let read = state
                .counters()
                .and_then(|saved| self.restore_critics(&mut state, &saved));
            read.map_err(|error| error.within(key))?;
        }
        Ok(())
    }

    fn restore_critics(&mut self, state: &mut State, saved: &Saved) -> Result<()> {
        if let Some(critics) = &mut self.local_critics {
            restore("local_critics", &mut critics.learned, &saved.local_critics, state)?;
        }
        restore("global_critics", &mut self.twins, &saved.twins, state)
    }

    /// Where the time went.
    pub fn times(&self) -> Times {
        self.times
    }

    /// Episodes so far.
    pub fn done(&self) -> u64 {
        self.counters.done
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
    pub fn present(&self) -> usize {
        let all = self.extent.vehicles;
        let first = self.options.first_vehicles(all);
        let part = if self.options.all_vehicles_at > 0.0 {
            (self.progress() / self.options.all_vehicles_at).min(1.0)
        } else {
            1.0
        };
        all.min(first + ((all - first + 1) as f32 * part) as usize)
    }

    /// Plays one episode of a game that has just begun, with [`MaddpgLearner::present`] agents, learning meanwhile.
    pub fn episode(&mut self, game: &mut dyn Game) -> Metrics {
        let present = self.present();
        let mut stream = random::episode(self.seed, self.counters.done, LEARNING);
        self.losses = Losses::default();
        let mut played = Tally::default();
        self.replay.begin(present);
        self.know(game);
        let mut ended = vec![false; game.shape().rows()];
        for _ in 0..self.extent.slots {
            let actions = self.explore(present, &mut stream);
            let start = Instant::now();
            let (room, rewards) = self.replay.outcome();
            room.copy_from_slice(&actions);
            let mut tally = Tally::default();
            game.step(&actions, rewards, &mut tally);
            game.ended(&mut ended);
            self.times.environment += start.elapsed();
            played.merge(&tally);
            self.replay.advance(&ended);
            self.know(game);
            if self.options.updates == Updates::Slot {
                self.update(&mut stream);
            }
        }
        if self.options.updates == Updates::Episode {
            self.update(&mut stream);
        }
        self.counters.done += 1;
        self.counters.slots += played.world_slots as u64;
        self.metrics(&played, present)
    }

    fn metrics(&self, played: &Tally, present: usize) -> Metrics {
        let losses = &self.losses;
        let reward = played.reward / played.agent_slots;
        played
            .metrics(reward, self.counters.slots as f64, self.counters.updates)
            .with("vehicles", present as f64)
            .with("global_loss", losses.global / f64::from(losses.global_count))
            .with("local_loss", losses.local / f64::from(losses.delayed_count))
            .with("entropy", losses.entropy / f64::from(losses.delayed_count))
    }

    fn know(&mut self, game: &dyn Game) {
        let start = Instant::now();
        game.know(self.replay.known());
        self.times.environment += start.elapsed();
    }

    /// Actions of all vehicles for the slot at hand, as the game takes them.
    fn explore(&mut self, present: usize, stream: &mut Stream) -> Vec<f32> {
        let width = self.extent.known;
        let rows = Rows {
            values: self.replay.known(),
            stride: width,
            width: self.extent.observed,
        };
        let outputs = self.actors.outputs(Role::Learner, &[rows]);
        let mut actions = Vec::with_capacity(outputs.len());
        for (row, outputs) in outputs.chunks_exact(self.space.length()).enumerate() {
            if row % self.extent.vehicles < present {
                self.space
                    .act(outputs, self.options.noise, Some(stream), &mut actions);
            } else {
                actions.extend(std::iter::repeat_n(0.0, self.extent.action));
            }
        }
        actions
    }

    /// The actors as they stand: one for all vehicles, or one for each.
    pub fn networks(&self) -> Vec<Network> {
        let widths = self.actors.network.widths();
        let learned = self.actors.learned.iter();
        learned
            .map(|learned| Network::new(widths, learned.parameters.clone()))
            .collect()
    }

    /// See [`crate::laboratory::learner::Learner::state`].
    pub fn state(&self) -> State {
        let mut state = State::default();
        let mut save = |name: &str, learned: &[Learned]| -> Vec<Powers> {
            let each = learned.iter().enumerate();
            each.map(|(index, learned)| learned.save(&format!("{name}.{index}"), &mut state))
                .collect()
        };
        let actors = save("actors", &self.actors.learned);
        let local = self
            .local_critics
            .as_ref()
            .map_or(&[][..], |critics| &critics.learned);
        let local_critics = save("local_critics", local);
        let twins = save("global_critics", &self.twins);
        let saved = Saved {
            counters: self.counters,
            replay: self.replay.save(&mut state),
            actors,
            local_critics,
            twins: [twins[0], twins[1]],
        };
        state.counters = serde_json::json!(saved);
        state
    }

    /// See [`crate::laboratory::learner::Learner::parts_bytes`].
    pub fn parts_bytes(&self) -> u64 {
        self.replay.bytes()
    }

    /// See [`crate::laboratory::learner::Learner::restore`].
    ///
    /// # Errors
    /// The tensor or counter that does not fit.
    pub fn restore(&mut self, mut state: State) -> Result<()> {
        let saved: Saved = state.counters()?;
        restore("actors", &mut self.actors.learned, &saved.actors, &mut state)?;
        self.restore_critics(&mut state, &saved)?;
        self.replay.load(&mut state, saved.replay)?;
        self.counters = saved.counters;
        state.finish()
    }

    /// One update of the global critics and, every `delay`-th time, of local critics and actors.
    fn update(&mut self, stream: &mut Stream) {
        let start = Instant::now();
        self.learn(stream);
        self.times.learning += start.elapsed();
    }
}

/// Reads networks from a state.
fn restore(name: &str, learned: &mut [Learned], powers: &[Powers], state: &mut State) -> Result<()> {
    if learned.len() != powers.len() {
        let found = format!("{} networks", powers.len());
        return Err(Error::input(name, found, learned.len()));
    }
    for (index, (learned, &powers)) in learned.iter_mut().zip(powers).enumerate() {
        learned.load(&format!("{name}.{index}"), state, powers)?;
    }
    Ok(())
}

/// Scales the last layer down and biases it towards silence and full power: an actor that always sends learns nothing.
fn begin_actors(actors: &mut Group, options: &Maddpg, space: ActionSpace) {
    let network = &actors.network;
    let last = network.layers() - 1;
    let (weights, biases) = (network.weights(last), network.biases(last));
    for learned in &mut actors.learned {
        let mut parameters = learned.parameters.clone();
        parameters[weights.clone()]
            .iter_mut()
            .for_each(|weight| *weight *= options.last_layer_scale);
        if space.is_choice() {
            let biases = &mut parameters[biases.clone()];
            biases[0] = options.silence_bias;
            for (action, bias) in biases.iter_mut().enumerate().skip(1) {
                *bias = match (space, action) {
                    (_, 1) => options.full_power_bias,
                    (ActionSpace::SubChannels, 4) | (ActionSpace::Choices(_), _) => options.joiner_bias,
                    _ => 0.0,
                };
            }
            if space == ActionSpace::SubChannels && !options.silence {
                biases[0] = NEVER;
            }
        }
        *learned = Learned::new(parameters);
    }
}

/// A score that no other comes near: the action is never chosen.
const NEVER: f32 = -1e9;
