//! The learner between two episodes, and what an episode does.

use super::Recipe;
use super::cell::{CellArena, Tally};
use super::central::CENTRAL_INPUTS;
use super::optimiser::{Losses, Optimiser};
use super::rollout::{Experience, play};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::forms::{ObservationForm, OutputForm};
use crate::laboratory::learner::{Learner, Metrics, name};
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::network::{Adam, Network};
use crate::run_folder::RunFolder;
use firmware::decision::{ACTIONS, Action};
use firmware::observation::INPUTS;
use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::scenario::Scenario;
use host_sim::stream::{Purpose, Role, Stream};
use kit::error::{Error, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Uses of the learner's streams.
enum Use {
    FirstActor = 0,
    FirstCritic = 1,
    Order = 2,
}

/// Member of a world's policy streams that draws a batch's size, start ages and actions.
const PLAY: u32 = 1;

/// Proximal policy optimisation at work in the cell.
pub struct PpoLearner {
    scenario: Scenario,
    recipe: Recipe,
    seed: u64,
    counters: Counters,
    optimiser: Optimiser,
}

/// What besides the networks must be saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Counters {
    done: u64,
    world_slots: u64,
    steps: u64,
}

impl PpoLearner {
    /// Before the first episode: an actor that scores all observations nearly alike, or the recipe's first actor.
    ///
    /// # Errors
    /// The first actor's file, and what is wrong with it.
    pub fn new(scenario: Scenario, recipe: Recipe, seed: u64) -> Result<Self> {
        let actor = if recipe.first_actor.as_os_str().is_empty() {
            prior(&recipe, &mut random::initial(seed, Use::FirstActor as u32))
        } else {
            first_actor(&recipe)?
        };
        let critic_widths = widths(CENTRAL_INPUTS, &recipe.critic_hidden, 1);
        let critic = Network::random(
            &critic_widths,
            &mut random::initial(seed, Use::FirstCritic as u32),
        );
        Ok(Self {
            scenario,
            recipe,
            seed,
            counters: Counters::default(),
            optimiser: Optimiser {
                actor_adam: Adam::new(&actor),
                critic_adam: Adam::new(&critic),
                actor,
                critic,
            },
        })
    }

    /// The scenario of each batch of an episode, and the stream that plays it.
    fn batches(&self) -> Vec<(Scenario, Stream)> {
        let recipe = &self.recipe;
        let worlds = u64::from(recipe.worlds);
        (0..u64::from(recipe.batches))
            .map(|batch| {
                let first = random::world(self.seed, self.counters.done, self.worlds(), batch * worlds);
                let mut stream = first.stream(Role::Policy, PLAY);
                let mut scenario = self.scenario.clone();
                let sizes = recipe.max_vehicles - recipe.min_vehicles + 1;
                scenario.cell.vehicles = recipe.min_vehicles + stream.below(sizes);
                (scenario, stream)
            })
            .collect()
    }

    /// Worlds of an episode.
    fn worlds(&self) -> u64 {
        u64::from(self.recipe.batches) * u64::from(self.recipe.worlds)
    }
}

impl Learner for PpoLearner {
    fn length(&self) -> u64 {
        self.recipe.episodes
    }

    fn done(&self) -> u64 {
        self.counters.done
    }

    fn advance(&mut self) -> Metrics {
        let mut batches = self.batches();
        let mut arenas: Vec<(CellArena<'_>, &mut Stream)> = batches
            .iter_mut()
            .enumerate()
            .map(|(batch, (scenario, stream))| {
                let worlds = u64::from(self.recipe.worlds);
                let first = random::world(
                    self.seed,
                    self.counters.done,
                    self.worlds(),
                    batch as u64 * worlds,
                )
                .world;
                let worlds = first..first + worlds;
                let environment = Environment::new(scenario, &Grid, self.seed, Purpose::Training, worlds);
                (CellArena::new(environment, self.recipe.costs(), stream), stream)
            })
            .collect();
        let recipe = &self.recipe;
        let mut order = random::episode(self.seed, self.counters.done, Use::Order as u32);
        let mut losses = Losses::default();
        for update in 0..recipe.updates {
            let done = self.counters.done as f64 + f64::from(update) / f64::from(recipe.updates);
            let rates = recipe.rates(done / recipe.episodes as f64);
            let (actor, critic) = (&self.optimiser.actor, &self.optimiser.critic);
            let played: Vec<Experience> = arenas
                .par_iter_mut()
                .map(|(arena, stream)| play(arena, actor, critic, recipe, stream))
                .collect();
            losses.add(
                &self
                    .optimiser
                    .update(&Experience::join(played), recipe, rates, &mut order),
            );
        }
        let mut tally = Tally::default();
        arenas.iter().for_each(|(arena, _)| tally.merge(&arena.tally));
        self.counters.done += 1;
        self.counters.world_slots += tally.world_slots as u64;
        self.counters.steps += losses.steps as u64;
        Metrics::default()
            .with(name::REWARD, tally.reward / tally.count)
            .with(name::AGE, tally.age / tally.count)
            .with(name::SUCCESSES, tally.received / tally.world_slots)
            .with(name::POWER, tally.power_mw / tally.count)
            .with(name::SLOTS, self.counters.world_slots as f64)
            .with(name::UPDATES, self.counters.steps as f64)
            .with("actor_loss", losses.actor / losses.steps)
            .with("critic_loss", losses.critic / losses.steps)
            .with("entropy", losses.entropy / losses.steps)
            .with("clipped", losses.clipped / losses.steps)
    }

    fn state(&self) -> State {
        let mut state = State::new(json!(self.counters));
        for (name, network) in self.optimiser.networks() {
            for (index, layer) in network.layers.iter().enumerate() {
                let shape = [layer.inputs, layer.outputs];
                state.put(format!("{name}.{index}.weights"), &shape, layer.weights.clone());
                state.put(
                    format!("{name}.{index}.biases"),
                    &shape[1..],
                    layer.biases.clone(),
                );
            }
        }
        for (name, adam) in self.optimiser.adams() {
            state.put(format!("{name}.decay"), &[2], vec![adam.decay.0, adam.decay.1]);
        }
        state
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        self.counters = state.counters()?;
        for (name, network) in self.optimiser.networks_mut() {
            for (index, layer) in network.layers.iter_mut().enumerate() {
                let shape = [layer.inputs, layer.outputs];
                layer.weights = state.take_f32(&format!("{name}.{index}.weights"), &shape)?;
                layer.biases = state.take_f32(&format!("{name}.{index}.biases"), &shape[1..])?;
            }
        }
        for (name, adam) in self.optimiser.adams_mut() {
            let decay = state.take_f32(&format!("{name}.decay"), &[2])?;
            adam.decay = (decay[0], decay[1]);
        }
        state.finish()
    }

    fn actors(&self) -> Actors {
        Actors {
            form: ActorForm {
                observation: ObservationForm::Firmware,
                output: OutputForm::Actions,
                min_vehicles: self.recipe.min_vehicles,
                max_vehicles: self.recipe.max_vehicles,
            },
            networks: vec![self.optimiser.actor.clone()],
        }
    }
}

/// An actor whose first decisions are draws from the recipe's first scores, whatever it sees.
fn prior(recipe: &Recipe, stream: &mut Stream) -> Network {
    let mut actor = Network::random(&widths(INPUTS, &recipe.hidden, ACTIONS), stream);
    if let Some(last) = actor.layers.last_mut() {
        last.weights.iter_mut().for_each(|weight| *weight *= 0.1);
        let [silent, full_power, joiner] = recipe.first_scores;
        last.biases.fill(joiner);
        last.biases[Action::Silent as usize] = silent;
        last.biases[Action::FullPower as usize] = full_power;
    }
    actor
}

/// The actor to go on from, with its scores made sharper or, so that it explores, blunter.
fn first_actor(recipe: &Recipe) -> Result<Network> {
    let folder = RunFolder::new(&recipe.first_actor);
    if !folder.actors().exists() {
        let found = format!("{}, which does not exist", folder.actors().display());
        let expected = "the folder of a run, such as `trainer distil` leaves";
        return Err(Error::input("ppo.first_actor", found, expected));
    }
    let actors = folder.read_actors()?;
    let mut actor = actors.network(0).clone();
    let (found, expected) = (actor.widths(), widths(INPUTS, &recipe.hidden, ACTIONS));
    if !actors.shared() || found != expected {
        let found = format!("{} of widths {found:?}", actors.networks.len());
        let expected = format!("one of widths {expected:?} as ppo.hidden says");
        return Err(Error::input(folder.actors().display(), found, expected));
    }
    if let Some(last) = actor.layers.last_mut() {
        let parameters = last.weights.iter_mut().chain(&mut last.biases);
        parameters.for_each(|parameter| *parameter *= recipe.first_actor_sharpness);
    }
    Ok(actor)
}

fn widths(inputs: usize, hidden: &[usize], outputs: usize) -> Vec<usize> {
    let mut widths = vec![inputs];
    widths.extend(hidden);
    widths.push(outputs);
    widths
}
