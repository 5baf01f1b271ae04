//! Where the algorithm plays: the cell, or a toy whose best play is known.

use super::actions::ActionSet;
use super::options::{ActionForm, AgeScale, Maddpg};
use crate::laboratory::forms::{ObservationForm, sub_channel_and_power};
use crate::laboratory::random;
use firmware::decision::{Action, Decision, PowerPlan};
use firmware::observation::Observation;
use firmware::units::{Age, Level, SUB_CHANNELS};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::policy::power_plan;
use host_sim::scenario::Scenario;
use host_sim::stream::{Purpose, Stream};

/// How an episode begins.
#[derive(Clone, Copy, Debug)]
pub struct Beginning {
    /// Its index, which chooses its worlds.
    pub episode: u64,
    /// How many vehicles take part.
    pub present: usize,
    /// Probability with which a world's vehicles begin in turn, each with its own phase.
    pub in_turn: f32,
}

/// A game in which episodes are played.
pub trait Arena: Send + Sync {
    /// Vehicles that a world has room for.
    fn vehicles(&self) -> usize;

    /// Values that a vehicle observes.
    fn observed(&self) -> usize;

    /// Values that a critic knows of a vehicle: those that it observes, and more.
    fn known(&self) -> usize;

    /// What vehicles may do.
    fn actions(&self) -> ActionSet;

    /// Sets an episode up and hands its worlds to `player`.
    fn play(&self, beginning: &Beginning, player: &mut dyn FnMut(&mut dyn Worlds));
}

/// The worlds of one episode, which advance together.
pub trait Worlds {
    /// Writes every vehicle's home sub-channel, `[world][vehicle]`.
    fn homes(&self, homes: &mut [u8]);

    /// Writes what is known of every vehicle, `[world][vehicle][known]`; zeros for an absent one.
    fn know(&self, known: &mut [f32]);

    /// Carries out a slot's actions, `[world][vehicle][value]`, where a choice is its index, and writes every vehicle's own
    /// reward, `[world][vehicle]`; zeros for an absent one.
    fn step(&mut self, actions: &[f32], rewards: &mut [f32]) -> Tally;
}

/// Sums over the vehicles and worlds of one slot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Ages after the slot, in slots.
    pub age: f64,
    /// Vehicles that were received.
    pub received: f64,
    /// Power in mW.
    pub power: f64,
}

/// The simulator's cell.
pub struct CellArena {
    /// Its scenario.
    pub scenario: Scenario,
    /// What the algorithm was told.
    pub options: Maddpg,
    /// Seed of the run.
    pub seed: u64,
}

/// Values that critics know besides the observation: the age in its largest, and in twenty slots up to twenty.
const EXTRA: usize = 2;

/// The slots in twenties of the second.
const YOUNG: f32 = 20.0;

impl Arena for CellArena {
    fn vehicles(&self) -> usize {
        self.scenario.cell.vehicles as usize
    }

    fn observed(&self) -> usize {
        self.options.observation.length()
    }

    fn known(&self) -> usize {
        self.observed() + EXTRA
    }

    fn actions(&self) -> ActionSet {
        self.options.action_set()
    }

    fn play(&self, beginning: &Beginning, player: &mut dyn FnMut(&mut dyn Worlds)) {
        let mut scenario = self.scenario.clone();
        scenario.cell.vehicles = beginning.present as u32;
        let worlds = self.options.worlds;
        let first = beginning.episode * worlds;
        let source = Grid;
        let environment = Environment::new(
            &scenario,
            &source,
            self.seed,
            Purpose::Training,
            first..first + worlds,
        );
        let mut cells = Cells {
            decisions: Decisions::new(worlds as usize, beginning.present),
            environment,
            plan: power_plan(&scenario),
            required: scenario.radio.required_level(),
            room: self.vehicles(),
            present: beginning.present,
            arena: self,
        };
        cells.start_ages(
            beginning,
            &mut random::episode(self.seed, beginning.episode, START_AGES),
        );
        player(&mut cells);
    }
}

/// The member of the episode's stream that draws start ages.
const START_AGES: u32 = 1;

/// The cells of an episode.
struct Cells<'a> {
    environment: Environment<'a>,
    decisions: Decisions,
    plan: PowerPlan,
    required: Level,
    room: usize,
    present: usize,
    arena: &'a CellArena,
}

impl Cells<'_> {
    /// Start ages of each world: everybody in turn (some of them lost), or else half the worlds all at the largest age, a
    /// quarter packed as three a slot, a quarter uniform up to 29 slots (chosen).
    fn start_ages(&mut self, beginning: &Beginning, stream: &mut Stream) {
        for world in 0..self.environment.worlds() {
            let in_turn = stream.uniform() < beginning.in_turn;
            let kind = stream.uniform();
            let lost_share = f64::from(0.1 * stream.uniform());
            if !in_turn && kind < 0.5 {
                continue;
            }
            let mut order: Vec<usize> = (0..self.present).collect();
            for last in (1..order.len()).rev() {
                order.swap(last, stream.below(last as u32 + 1) as usize);
            }
            let mut turn = [0; SUB_CHANNELS];
            for (place, &vehicle) in order.iter().enumerate() {
                let Some(broadcast) = self.environment.broadcast(world, vehicle) else {
                    continue;
                };
                let turn = &mut turn[broadcast.home.index()];
                *turn += 1;
                let slots = if in_turn && stream.chance(lost_share) {
                    if stream.chance(0.5) {
                        u32::from(Age::MAX.slots())
                    } else {
                        *turn + u32::from(broadcast.period.slots())
                    }
                } else if in_turn {
                    *turn
                } else if kind < 0.75 {
                    1 + (place / SUB_CHANNELS) as u32
                } else {
                    1 + stream.below(29)
                };
                self.environment.set_age(world, vehicle, Age::after(slots));
            }
        }
    }

    fn decision(&self, world: usize, vehicle: usize, action: &[f32]) -> Decision {
        let Some(measurement) = self.environment.measurement(world, vehicle) else {
            return Decision::Silent;
        };
        match self.arena.options.action {
            ActionForm::SubChannelAndPower => {
                sub_channel_and_power([action[0], action[1]], self.plan.max_power)
            }
            ActionForm::Actions => {
                let index = action[0] as usize;
                let action = Action::ALL.get(index).copied().unwrap_or(Action::Silent);
                self.plan.decision(action, &Observation::new(&measurement))
            }
            ActionForm::SubChannels => self
                .plan
                .sub_channel_choice(action[0] as usize, &Observation::new(&measurement)),
        }
    }

    fn reward(&self, age: Age, received: bool) -> f32 {
        let options = &self.arena.options;
        let scale = match options.age_scale {
            AgeScale::Vehicles => self.present as f32,
            AgeScale::Ten => 10.0,
        };
        let age = f32::from(age.slots()).min(options.age_cap);
        -age / scale + if received { options.success_reward } else { 0.0 }
    }
}

impl Worlds for Cells<'_> {
    fn homes(&self, homes: &mut [u8]) {
        for (row, home) in homes.iter_mut().enumerate() {
            let (world, vehicle) = (row / self.room, row % self.room);
            let broadcast = (vehicle < self.present)
                .then(|| self.environment.broadcast(world, vehicle))
                .flatten();
            *home = broadcast.map_or(0, |broadcast| broadcast.home.index() as u8);
        }
    }

    fn know(&self, known: &mut [f32]) {
        let form: ObservationForm = self.arena.options.observation;
        for (row, values) in known.chunks_exact_mut(self.arena.known()).enumerate() {
            let (world, vehicle) = (row / self.room, row % self.room);
            let measurement = (vehicle < self.present)
                .then(|| self.environment.measurement(world, vehicle))
                .flatten();
            let Some(measurement) = measurement else {
                values.fill(0.0);
                continue;
            };
            let (observed, extra) = values.split_at_mut(form.length());
            form.write(&measurement, self.required, observed);
            let age = f32::from(measurement.age().slots());
            extra[0] = age / f32::from(Age::MAX.slots());
            extra[1] = age.min(YOUNG) / YOUNG;
        }
    }

    fn step(&mut self, actions: &[f32], rewards: &mut [f32]) -> Tally {
        let length = actions.len() / rewards.len();
        let mut tally = Tally::default();
        for (row, action) in actions.chunks_exact(length).enumerate() {
            let (world, vehicle) = (row / self.room, row % self.room);
            if vehicle < self.present {
                let decision = self.decision(world, vehicle, action);
                if let Decision::Transmit { power, .. } = decision {
                    tally.power += libm::exp10(power.value().to_num::<f64>() / 10.0);
                }
                self.decisions.set(world, vehicle, decision);
            }
        }
        self.environment.step(&self.decisions);
        for (row, reward) in rewards.iter_mut().enumerate() {
            let (world, vehicle) = (row / self.room, row % self.room);
            *reward = 0.0;
            if vehicle < self.present {
                let age = self.environment.age(world, vehicle);
                let received = self.environment.received(world, vehicle);
                *reward = self.reward(age, received);
                tally.age += f64::from(age.slots());
                tally.received += f64::from(u8::from(received));
            }
        }
        tally
    }
}
