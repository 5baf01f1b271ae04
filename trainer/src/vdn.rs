//! Value decomposition networks (Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018): the
//! value of what all vehicles of a cell do is the sum of their own networks' values, so that each may choose by itself.
//!
//! One network for all vehicles, from an observation to the value of each action. What the team is paid, the mean of the vehicles'
//! rewards, and the target, the greatest sum a few slots later (Mnih et al. 2015, with targets that follow slowly), teach the sum; its
//! slope teaches every part. The network's values serve as an actor's scores: deployed, a vehicle takes the largest. Means over
//! vehicles stand for the sums here, so that values are as large in every cell.

use crate::algorithm::{LearningAlgorithm, Task};
use crate::first_networks::{self, Expected};
use crate::game::actions::ActionSpace;
use crate::game::cell::{Cell, Outcome, Rules, Sensed};
use crate::game::reward::{AgeReward, Paying, RewardName};
use crate::game::{Game, Shape, Tally, start_ages};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::maddpg::group::{Group, Role};
use crate::maddpg::replay::{Batch, Extent, Replay, Return, most_transitions};
use crate::network::Network;
use crate::network::categorical::largest;
use crate::network::optimiser::{Learned, Powers, Step};
use crate::network::perceptron::{Perceptron, Rows};
use crate::ppo::loss::huber;
use firmware::decision::ACTIONS;
use firmware::network::{MAX_LAYERS, MAX_WIDTH};
use firmware::observation::INPUTS;
use host_sim::scenario::Scenario;
use host_sim::stream::Stream;
use kit::error::{Error, Result};
use kit::keys;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

keys! {
    /// The learner's parameters.
    pub struct Vdn {
        /// Folder of the run whose actor to go on from: its scores are the first values. Without one, a random network.
        #[key(source = "chosen")]
        pub first_actor: PathBuf,
        /// Episodes of the run; each begins with fresh worlds.
        #[key(range = 1.0..=1e6, unit = "episodes", source = "chosen")]
        pub episodes: u64,
        /// Worlds that advance together.
        #[key(range = 1.0..=4096.0, unit = "worlds", source = "chosen")]
        pub worlds: u64,
        /// Slots of an episode; an update follows each.
        #[key(range = 1.0..=100_000.0, unit = "slots", source = "chosen")]
        pub slots: u32,
        /// Widths of the network's hidden layers.
        #[key(range = 1.0..=MAX_WIDTH as f64, longest = MAX_LAYERS - 1, unit = "widths", source = "chosen")]
        pub hidden: Vec<usize>,
        /// World-slots in an update.
        #[key(range = 1.0..=65_536.0, unit = "transitions", source = "chosen")]
        pub batch: usize,
        /// Size of the replay memory: at least one episode.
        #[key(range = 1.0..=1e9, unit = "transitions", source = "chosen")]
        pub replay: usize,
        /// World-slots before the first update.
        #[key(range = 0.0..=1e9, unit = "transitions", source = "chosen")]
        pub warm_up_slots: usize,
        /// Factor by which the next slot's value is discounted.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub discount: f32,
        /// Steps of the return, at most the slots of an episode.
        #[key(range = 1.0..=100_000.0, unit = "slots", source = "chosen")]
        pub steps: u32,
        /// Share by which an update moves the target network.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub target_rate: f32,
        /// Learning rates at the start and at the end, linear between; Adam.
        #[key(range = 1e-9..=1.0, source = "chosen")]
        pub learning_rate: [f32; 2],
        /// Largest norm of the gradient; 0 is no limit.
        #[key(range = 0.0..=1e6, source = "chosen")]
        pub gradient_limit: f32,
        /// Probabilities of a random action at the start and from `explored_at` on, linear between.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub exploration: [f32; 2],
        /// Share of the run after which exploration falls no further.
        #[key(range = 1e-6..=1.0, source = "chosen")]
        pub explored_at: f32,
        /// What the age is divided by in the reward, which is minus the age.
        #[key(range = 1.0..=1e4, unit = "slots", source = "chosen")]
        pub age_scale: f32,
        /// Where ages are cut in the reward.
        #[key(range = 1.0..=100.0, unit = "slots", source = "chosen")]
        pub age_cap: f32,
        /// What a success adds to the reward.
        #[key(range = 0.0..=1e3, source = "chosen")]
        pub success_reward: f32,
    }
}

impl LearningAlgorithm for Vdn {
    fn episodes_mut(&mut self) -> &mut u64 {
        &mut self.episodes
    }

    fn check(&self, scenario: &Scenario) -> Result<()> {
        let vehicles = scenario.cell.vehicles;
        if vehicles > u32::from(u8::MAX) {
            let expected = "at most 255 to learn with";
            return Err(Error::input("scenario.cell.vehicles", vehicles, expected));
        }
        if self.steps > self.slots {
            let expected = format!("at most vdn.slots, which is {}", self.slots);
            return Err(Error::input("vdn.steps", self.steps, expected));
        }
        let (worlds, slots) = (self.worlds as usize, self.slots as usize);
        let episode = worlds * slots;
        if self.replay < episode {
            let expected = format!("room for an episode of vdn.worlds x vdn.slots = {episode}");
            return Err(Error::input("vdn.replay", self.replay, expected));
        }
        let kept = most_transitions(self.replay, worlds, slots, self.steps as usize);
        if self.warm_up_slots > kept {
            let expected = format!("at most the {kept} transitions of the episodes that the replay holds");
            return Err(Error::input("vdn.warm_up_slots", self.warm_up_slots, expected));
        }
        Ok(())
    }

    fn learner(&self, task: Task<'_>, seed: u64) -> Result<Box<dyn Learner>> {
        let Task { scenario, reward, .. } = task;
        let shape = Shape {
            worlds: self.worlds as usize,
            agents: scenario.cell.vehicles as usize,
            known: INPUTS,
            observed: INPUTS,
            actions: ActionSpace::Choices(ACTIONS),
        };
        let mut learner = VdnLearner::new(shape, self, seed);
        if !self.first_actor.as_os_str().is_empty() {
            let expected = Expected {
                key: "vdn.first_actor",
                form: self.forms(),
                widths: learner.values.network.widths(),
                count: 1,
            };
            let first = first_networks::actors(&self.first_actor, expected)?.swap_remove(0);
            learner.values.learned = vec![Learned::new(first.parameters)];
        }
        let scenario = scenario.clone();
        Ok(Box::new(VdnInCell {
            scenario,
            reward,
            learner,
        }))
    }
}

/// Every vehicle is paid for its own age; what teaches is the mean.
struct OwnAge(AgeReward);

impl Rules for OwnAge {
    fn extra(&self) -> usize {
        0
    }

    fn know<'r>(&self, _world: &[Option<Sensed>], _extras: impl Iterator<Item = &'r mut [f32]>) {}

    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        for (outcome, reward) in world.iter().zip(rewards) {
            *reward = outcome.map_or(0.0, |outcome| self.0.of(outcome.age, outcome.received));
        }
    }
}

/// Members of the episode's streams.
const LEARNING: u32 = 0;
const START_AGES: u32 = 1;

/// The algorithm itself, in any game of choices.
pub struct VdnLearner {
    options: Vdn,
    seed: u64,
    values: Group,
    replay: Replay,
    extent: Extent,
    counters: Counters,
}

/// The algorithm at work in the cell.
struct VdnInCell {
    scenario: Scenario,
    /// What vehicles are paid for, unless the options say it.
    reward: Option<RewardName>,
    learner: VdnLearner,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Counters {
    done: u64,
    world_slots: u64,
    updates: u64,
}

/// What a checkpoint keeps besides tensors.
#[derive(Serialize, Deserialize)]
struct Saved {
    counters: Counters,
    replay: (u64, usize),
    values: Powers,
}

impl VdnLearner {
    /// Before the first episode of a game of this shape.
    pub fn new(shape: Shape, options: &Vdn, seed: u64) -> Self {
        let network = Perceptron::new(shape.observed, &options.hidden, shape.actions.length());
        let slots = options.slots as usize;
        let extent = Extent {
            episodes: options.replay / (slots * shape.worlds),
            slots,
            worlds: shape.worlds,
            vehicles: shape.agents,
            known: shape.known,
            observed: shape.observed,
            action: 1,
        };
        Self {
            options: options.clone(),
            seed,
            values: Group::new(network, true, shape.agents, &mut random::initial(seed, 0)),
            replay: Replay::new(extent),
            extent,
            counters: Counters::default(),
        }
    }

    /// Plays one episode of a game that has just begun, learning meanwhile.
    pub fn episode(&mut self, game: &mut dyn Game) -> Metrics {
        let mut stream = random::episode(self.seed, self.counters.done, LEARNING);
        let (mut tally, mut ended) = (Tally::default(), vec![false; game.shape().rows()]);
        let (mut losses, mut updates) = (0.0, 0_u64);
        self.replay.begin(self.extent.vehicles);
        game.know(self.replay.known());
        for _ in 0..self.options.slots {
            let actions = self.explore(&mut stream);
            let (room, rewards) = self.replay.outcome();
            room.copy_from_slice(&actions);
            game.step(&actions, rewards, &mut tally);
            game.ended(&mut ended);
            self.replay.advance(&ended);
            game.know(self.replay.known());
            if let Some(loss) = self.learn(&mut stream) {
                losses += f64::from(loss);
                updates += 1;
            }
        }
        let exploration = f64::from(self.exploration());
        self.counters.done += 1;
        self.counters.world_slots += tally.world_slots as u64;
        self.counters.updates += updates;
        let Counters {
            world_slots,
            updates: all,
            ..
        } = self.counters;
        let reward = tally.reward / tally.agent_slots;
        tally
            .metrics(reward, world_slots as f64, all)
            .with("loss", losses / updates as f64)
            .with("exploration", exploration)
    }

    /// The network, whose outputs are an actor's scores.
    pub fn network(&self) -> Network {
        let learned = &self.values.learned[0];
        Network::new(self.values.network.widths(), learned.parameters.clone())
    }

    /// How many actions there are.
    fn actions(&self) -> usize {
        self.values.network.outputs()
    }

    /// The part of what is known that the network sees.
    fn seen<'k>(&self, known: &'k [f32]) -> Rows<'k> {
        Rows {
            values: known,
            stride: self.extent.known,
            width: self.extent.observed,
        }
    }

    /// Share of the run that is done, from 0 to 1.
    fn progress(&self) -> f32 {
        self.counters.done as f32 / self.options.episodes as f32
    }

    /// Probability of a random action.
    fn exploration(&self) -> f32 {
        let [first, last] = self.options.exploration;
        first + (last - first) * (self.progress() / self.options.explored_at).min(1.0)
    }

    /// Every vehicle's best action by its own values, now and then a random one, `[world][vehicle]`.
    fn explore(&mut self, stream: &mut Stream) -> Vec<f32> {
        let known = Rows {
            values: self.replay.known(),
            stride: self.extent.known,
            width: self.extent.observed,
        };
        let outputs = self.values.outputs(Role::Learner, &[known]);
        let (exploration, actions) = (f64::from(self.exploration()), self.actions());
        let choose = |values: &[f32]| {
            if stream.chance(exploration) {
                stream.below(actions as u32) as f32
            } else {
                largest(values) as f32
            }
        };
        outputs.chunks_exact(actions).map(choose).collect()
    }

    /// Moves the vehicles' mean value towards the mean reward and the greatest mean later; gives the loss.
    fn learn(&mut self, stream: &mut Stream) -> Option<f32> {
        let options = &self.options;
        let sought = Return {
            steps: options.steps as usize,
            discount: options.discount,
            ends_at_limit: false,
        };
        if self.replay.transitions(sought.steps) < options.warm_up_slots.max(1) {
            return None;
        }
        let mut batch = Batch::default();
        self.replay.sample(options.batch, sought, stream, &mut batch);
        let (later, now) = (self.seen(&batch.later), self.seen(&batch.known));
        let (actions, vehicles) = (self.actions(), self.extent.vehicles);
        let later = self.values.outputs(Role::Target, &[later]);
        let now = self.values.forward(&[now]);
        let (mut slopes, mut loss) = (vec![0.0; now.len()], 0.0);
        let part = 1.0 / vehicles as f32;
        for (sample, weight) in batch.later_weight.iter().enumerate() {
            let rows = sample * vehicles..(sample + 1) * vehicles;
            let taken = |row: usize| row * actions + batch.actions[row] as usize;
            let (mut value, mut target) = (0.0, 0.0);
            for row in rows.clone() {
                let greatest = later[row * actions + largest(&later[row * actions..][..actions])];
                target += part * (batch.rewards[row] + weight * greatest);
                value += part * now[taken(row)];
            }
            let (error, slope) = huber(value, target);
            loss += error / options.batch as f32;
            rows.for_each(|row| slopes[taken(row)] = slope * part / options.batch as f32);
        }
        let [first, last] = options.learning_rate;
        let step = Step {
            learning_rate: first + (last - first) * self.progress(),
            target_rate: options.target_rate,
            scale: 1.0,
        };
        self.values.learn(&slopes, step, options.gradient_limit);
        Some(loss)
    }
}

impl Learner for VdnInCell {
    fn length(&self) -> u64 {
        self.learner.options.episodes
    }

    fn done(&self) -> u64 {
        self.learner.counters.done
    }

    fn advance(&mut self) -> Metrics {
        let VdnLearner { options, seed, .. } = &self.learner;
        let (episode, worlds) = (self.done(), options.worlds);
        let first = random::world(*seed, episode, worlds, 0).world;
        let scenario = self.scenario.clone();
        let mut environment = random::worlds(&scenario, *seed, first..first + worlds);
        start_ages::for_every_load(&mut environment, &mut random::episode(*seed, episode, START_AGES));
        let rules = Paying {
            rules: OwnAge(AgeReward {
                scale: options.age_scale,
                cap: options.age_cap,
                success: options.success_reward,
            }),
            name: self.reward,
            scale: 1.0,
        };
        let (observation, output) = options.forms();
        let mut cell = Cell::new(environment, 0, observation, output, rules);
        self.learner.episode(&mut cell)
    }

    fn state(&self) -> State {
        let mut state = State::default();
        let VdnLearner {
            counters,
            replay,
            values,
            ..
        } = &self.learner;
        let saved = Saved {
            counters: *counters,
            replay: replay.save(&mut state),
            values: values.learned[0].save("values", &mut state),
        };
        state.counters = json!(saved);
        state
    }

    fn parts_bytes(&self) -> u64 {
        self.learner.replay.bytes()
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        let saved: Saved = state.counters()?;
        let learner = &mut self.learner;
        learner.values.learned[0].load("values", &mut state, saved.values)?;
        learner.replay.load(&mut state, saved.replay)?;
        learner.counters = saved.counters;
        state.finish()
    }

    fn actors(&self) -> Actors {
        let (observation, output) = self.learner.options.forms();
        let vehicles = self.scenario.cell.vehicles;
        Actors {
            form: ActorForm {
                observation,
                output,
                noise: 0.0,
                min_vehicles: vehicles,
                max_vehicles: vehicles,
            },
            networks: vec![self.learner.network()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::{Algorithm, Preset};
    use crate::game::toy::Turns;

    fn options(settings: &[&str]) -> Vdn {
        match Preset::Vdn.with(settings).unwrap().algorithm {
            Algorithm::Vdn(options) => options,
            other => panic!("{}", other.name()),
        }
    }

    #[test]
    fn the_best_play_of_a_toy_is_found() {
        const SLOTS: u32 = 12;
        let options = options(&[
            "vdn.episodes=300",
            "vdn.worlds=16",
            "vdn.slots=12",
            "vdn.replay=4096",
            "vdn.warm_up_slots=192",
            "vdn.batch=64",
            "vdn.discount=0.8",
            "vdn.steps=1",
            "vdn.target_rate=0.05",
            "vdn.learning_rate=[1e-2, 1e-4]",
            "vdn.exploration=[0.3, 0.05]",
        ]);
        let best = Turns::best_age(SLOTS);
        for seed in 1..=3 {
            let toy = || Turns::new(16).paying(false, 0.25);
            let mut learner = VdnLearner::new(toy().shape(), &options, seed);
            while learner.counters.done < options.episodes {
                let _metrics = learner.episode(&mut toy());
            }
            let network = learner.network();
            let age = Turns::mean_age(SLOTS, |observed, _| network.forward(observed));
            assert!(age <= 1.02 * best, "seed {seed}: {age}, the best is {best}");
        }
    }

    #[test]
    fn a_restored_run_continues_bit_for_bit() {
        let learner = || {
            let settings = [
                "vdn.worlds=2",
                "vdn.slots=20",
                "vdn.replay=80",
                "vdn.warm_up_slots=10",
                "vdn.batch=8",
            ];
            Preset::Vdn.with(&settings).unwrap().learner(4).unwrap()
        };
        let (mut whole, mut first, mut second) = (learner(), learner(), learner());
        let metrics: Vec<Metrics> = (0..4).map(|_| whole.advance()).collect();
        assert_eq!([first.advance(), first.advance()], metrics[..2]);
        second.restore(first.state()).unwrap();
        assert_eq!([second.advance(), second.advance()], metrics[2..]);
        assert_eq!(second.state(), whole.state());
        assert_ne!(first.actors(), whole.actors());
    }
}
