//! The learner between two episodes, and what an episode does.

use super::Recipe;
use super::rollout::{Experience, play};
use super::rules::{CellPlace, Costs};
use super::update::{ActorCritic, Losses, Part};
use crate::algorithm::{LearningAlgorithm, Task};
use crate::first_networks::{self, Expected};
use crate::game::cell::{Cell, Rules as _};
use crate::game::reward::{Paying, RewardName};
use crate::game::{Tally, start_ages};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics, name};
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::mixture::Mixture;
use crate::network::Network;
use crate::network::optimiser::Powers;
use firmware::decision::{ACTIONS, Action};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::INPUTS;
use host_sim::scenario::Scenario;
use host_sim::stream::{Role, Stream};
use kit::error::Result;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

impl LearningAlgorithm for Recipe {
    fn episodes_mut(&mut self) -> &mut u64 {
        &mut self.episodes
    }

    fn vehicles(&self, _scenario: &Scenario) -> [u32; 2] {
        [self.min_vehicles, self.max_vehicles]
    }

    fn learns_in_mixtures(&self) -> bool {
        true
    }

    fn check(&self, _scenario: &Scenario) -> Result<()> {
        Self::check(self)
    }

    fn check_cells(&self, cells: &Mixture) -> Result<()> {
        Self::check_cells(self, cells)
    }

    fn learner(&self, task: Task<'_>, seed: u64) -> Result<Box<dyn Learner>> {
        let mut learner = PpoLearner::new(task.cells, self.clone(), seed)?;
        learner.reward = task.reward;
        Ok(Box::new(learner))
    }
}

/// Uses of the learner's streams.
enum Use {
    FirstActor = 0,
    FirstCritic = 1,
    Order = 2,
}

/// Member of a world's policy streams that draws a batch's size, start ages and actions.
const PLAY: u32 = 1;

/// What the actor sees, and what it does.
const OBSERVATION: ObservationForm = ObservationForm::Ring;
const OUTPUT: OutputForm = OutputForm::Actions;

/// Proximal policy optimisation at work in the cell.
pub struct PpoLearner {
    mixture: Mixture,
    recipe: Recipe,
    /// What vehicles are paid for, unless the recipe says it.
    reward: Option<RewardName>,
    seed: u64,
    counters: Counters,
    networks: ActorCritic,
}

/// Worlds that are played together.
struct Batch {
    /// Index of their cell.
    cell: usize,
    /// Index of the first.
    first: u64,
    scenario: Scenario,
    /// Draws the scenario, start ages and actions.
    stream: Stream,
    tally: Tally,
}

/// A cell of the mixture, as the critic sees it.
fn place(mixture: &Mixture, index: usize) -> CellPlace {
    match mixture.cells().len() {
        1 => CellPlace::default(),
        cells => CellPlace { index, cells },
    }
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
    /// Before the first episode: an actor that scores all observations nearly alike, or the recipe's first actor; a new critic, or the
    /// recipe's first.
    ///
    /// # Errors
    /// The file, and what is wrong with it.
    pub fn new(mixture: Mixture, recipe: Recipe, seed: u64) -> Result<Self> {
        let actor = if recipe.first_actor.as_os_str().is_empty() {
            prior(&recipe, &mut random::initial(seed, Use::FirstActor as u32))
        } else {
            first_actor(&recipe)?
        };
        let known = INPUTS + recipe.costs(place(&mixture, 0)).extra();
        let critic_widths = [&[known], &recipe.critic_hidden[..], &[1]].concat();
        let mut critic = Part::new(Network::random(
            &critic_widths,
            &mut random::initial(seed, Use::FirstCritic as u32),
        ));
        if !recipe.first_critics.as_os_str().is_empty() {
            first_critic(&recipe.first_critics, &mut critic)?;
        }
        Ok(Self {
            mixture,
            recipe,
            reward: None,
            seed,
            counters: Counters::default(),
            networks: ActorCritic {
                actor: Part::new(actor),
                critic,
            },
        })
    }

    /// The batches of an episode, those of each cell of the mixture one after the other.
    fn batches(&self) -> Vec<Batch> {
        let recipe = &self.recipe;
        let worlds = u64::from(recipe.worlds);
        let cells = self.mixture.split(recipe.batches as usize);
        (0..)
            .zip(cells)
            .map(|(batch, cell)| {
                let first = random::world(self.seed, self.counters.done, self.worlds(), batch * worlds);
                let mut stream = first.stream(Role::Policy, PLAY);
                Batch {
                    cell,
                    first: first.world,
                    scenario: self.mixture.cells()[cell].draw(&mut stream),
                    stream,
                    tally: Tally::default(),
                }
            })
            .collect()
    }

    /// The game of a batch, with random start ages, and what goes on beside it.
    fn game<'b>(&self, batch: &'b mut Batch) -> (Cell<'b, Paying<Costs>>, &'b mut Stream, &'b mut Tally) {
        let worlds = batch.first..batch.first + u64::from(self.recipe.worlds);
        let mut environment = random::worlds(&batch.scenario, self.seed, worlds);
        start_ages::for_every_load(&mut environment, &mut batch.stream);
        let rules = Paying {
            rules: self.recipe.costs(place(&self.mixture, batch.cell)),
            name: self.reward,
            scale: 1.0 - self.recipe.discount,
        };
        let cell = Cell::new(environment, 0, OBSERVATION, OUTPUT, rules);
        (cell, &mut batch.stream, &mut batch.tally)
    }

    /// Metrics with those of each cell.
    fn with_cells(&self, mut metrics: Metrics, batches: &[Batch]) -> Metrics {
        for (index, cell) in self.mixture.cells().iter().enumerate() {
            let mut tally = Tally::default();
            let own = batches.iter().filter(|batch| batch.cell == index);
            own.for_each(|batch| tally.merge(&batch.tally));
            for (name, value) in [
                (name::REWARD, tally.reward / tally.agent_slots),
                (name::AGE, tally.age / tally.agent_slots),
                (name::SUCCESSES, tally.received / tally.world_slots),
                (name::POWER, tally.power_mw / tally.agent_slots),
            ] {
                metrics = metrics.with(name::of_cell(name, &cell.name), value);
            }
        }
        metrics
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
        let cells: Vec<usize> = batches.iter().map(|batch| batch.cell).collect();
        let mut games: Vec<_> = batches.iter_mut().map(|batch| self.game(batch)).collect();
        let recipe = &self.recipe;
        let mut order = random::episode(self.seed, self.counters.done, Use::Order as u32);
        let mut losses = Losses::default();
        for update in 0..recipe.updates {
            let done = self.counters.done as f64 + f64::from(update) / f64::from(recipe.updates);
            let rates = recipe.rates(done / recipe.episodes as f64);
            let (actor, critic) = (&self.networks.actor.network, &self.networks.critic.network);
            let played: Vec<Experience> = games
                .par_iter_mut()
                .map(|(game, stream, tally)| play(game, actor, critic, recipe, stream, tally))
                .collect();
            let experience = Experience::join(cells.iter().copied().zip(played));
            losses.add(&self.networks.update(&experience, recipe, rates, &mut order));
        }
        drop(games);
        let mut tally = Tally::default();
        batches.iter().for_each(|batch| tally.merge(&batch.tally));
        self.counters.done += 1;
        self.counters.world_slots += tally.world_slots as u64;
        self.counters.steps += losses.steps as u64;
        let reward = tally.reward / tally.agent_slots;
        let metrics = tally
            .metrics(reward, self.counters.world_slots as f64, self.counters.steps)
            .with("actor_loss", losses.actor / losses.steps)
            .with("critic_loss", losses.critic / losses.steps)
            .with("entropy", losses.entropy / losses.steps)
            .with("clipped", losses.clipped / losses.steps);
        if self.mixture.is_mixed() {
            self.with_cells(metrics, &batches)
        } else {
            metrics
        }
    }

    fn state(&self) -> State {
        let mut state = State::new(json!(self.counters));
        for (name, part) in [("actor", &self.networks.actor), ("critic", &self.networks.critic)] {
            let (Part { network, adam }, widths) = (part, part.network.widths());
            put(&mut state, name, widths, &network.parameters);
            put(&mut state, &format!("{name}.mean"), widths, &adam.mean);
            put(&mut state, &format!("{name}.square"), widths, &adam.square);
            let Powers(first, second) = adam.powers;
            state.put(format!("{name}.decay"), &[2], vec![first as f32, second as f32]);
        }
        state
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        self.counters = state.counters()?;
        let ActorCritic { actor, critic } = &mut self.networks;
        restore_part(&mut state, "actor", actor)?;
        restore_part(&mut state, "critic", critic)?;
        state.finish()
    }

    fn actors(&self) -> Actors {
        let [least, most] = self.mixture.vehicles();
        Actors {
            form: ActorForm {
                observation: OBSERVATION,
                output: OUTPUT,
                noise: 0.0,
                min_vehicles: least,
                max_vehicles: most,
            },
            networks: vec![self.networks.actor.network.clone()],
        }
    }
}

/// Puts a network's parameters, or their moments, into a state, layer by layer, weights `[inputs][outputs]`.
fn put(state: &mut State, name: &str, widths: &[usize], parameters: &[f32]) {
    let network = Network::new(widths, parameters.to_vec());
    for (index, layer) in network.layers().enumerate() {
        let shape = [layer.inputs, layer.outputs];
        state.put(
            format!("{name}.{index}.weights"),
            &shape,
            network.weights_by_inputs(index),
        );
        state.put(
            format!("{name}.{index}.biases"),
            &shape[1..],
            layer.biases.to_vec(),
        );
    }
}

/// Takes them out again.
fn take(state: &mut State, name: &str, widths: &[usize]) -> Result<Vec<f32>> {
    let mut parameters = Vec::new();
    for (index, shape) in widths.windows(2).enumerate() {
        parameters.extend(state.take_f32(&format!("{name}.{index}.weights"), shape)?);
        parameters.extend(state.take_f32(&format!("{name}.{index}.biases"), &shape[1..])?);
    }
    Ok(Network::by_inputs(widths, &parameters).parameters)
}

/// Inputs, hidden layers, actions.
fn actor_widths(recipe: &Recipe) -> Vec<usize> {
    [&[INPUTS], &recipe.hidden[..], &[ACTIONS]].concat()
}

/// An actor whose first decisions are draws from the recipe's first scores, whatever it sees.
fn prior(recipe: &Recipe, stream: &mut Stream) -> Network {
    let mut actor = Network::random(&actor_widths(recipe), stream);
    let (weights, biases) = actor.last_mut();
    weights.iter_mut().for_each(|weight| *weight *= 0.1);
    let [silent, full_power, joiner] = recipe.first_scores;
    biases.fill(joiner);
    biases[Action::Silent as usize] = silent;
    biases[Action::FullPower as usize] = full_power;
    actor
}

/// The actor to go on from, with its scores made sharper or, so that it explores, blunter.
fn first_actor(recipe: &Recipe) -> Result<Network> {
    let expected = Expected {
        key: "ppo.first_actor",
        form: (OBSERVATION, OUTPUT),
        widths: &actor_widths(recipe),
        count: 1,
    };
    let mut actor = first_networks::actors(&recipe.first_actor, expected)?.swap_remove(0);
    let (weights, biases) = actor.last_mut();
    for parameter in weights.iter_mut().chain(biases) {
        *parameter *= recipe.first_actor_sharpness;
    }
    Ok(actor)
}

/// The critic to go on from, as that run's checkpoint has it, with the moments of its gradient.
fn first_critic(folder: &Path, critic: &mut Part) -> Result<()> {
    let mut state = first_networks::state(folder, FIRST_CRITICS)?;
    restore_part(&mut state, "critic", critic).map_err(|error| error.within(FIRST_CRITICS))
}

const FIRST_CRITICS: &str = "ppo.first_critics";

/// Goes back to a part of a state.
fn restore_part(state: &mut State, name: &str, Part { network, adam }: &mut Part) -> Result<()> {
    let widths = network.widths().to_vec();
    network.parameters = take(state, name, &widths)?;
    adam.mean = take(state, &format!("{name}.mean"), &widths)?;
    adam.square = take(state, &format!("{name}.square"), &widths)?;
    let decay = state.take_f32(&format!("{name}.decay"), &[2])?;
    adam.powers = Powers(decay[0].into(), decay[1].into());
    Ok(())
}
