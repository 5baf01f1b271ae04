//! The cell as an arena: worlds with the same number of vehicles, and what they cost.

use super::central::GroupCounts;
use super::rollout::Arena;
use crate::distil::{as_float, start_ages};
use firmware::decision::{Action, Decision, PowerPlan};
use firmware::observation::Observation;
use firmware::units::{Level, SUB_CHANNELS};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::power_plan;
use host_sim::stream::Stream;

/// Sums over vehicle-slots, for people.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// World-slots.
    pub world_slots: f64,
    /// Vehicle-slots.
    pub count: f64,
    /// Of ages after the slot.
    pub age: f64,
    /// Of rewards.
    pub reward: f64,
    /// Of successful transmissions.
    pub received: f64,
    /// Of transmit powers in mW.
    pub power_mw: f64,
}

impl Tally {
    /// Adds another.
    pub fn merge(&mut self, other: &Self) {
        self.world_slots += other.world_slots;
        self.count += other.count;
        self.age += other.age;
        self.reward += other.reward;
        self.received += other.received;
        self.power_mw += other.power_mw;
    }
}

/// What a vehicle's reward is made of.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    /// Weight of each other group member's cost next to the own.
    pub team: f32,
    /// Cost of a slot: the age in periods, at most this.
    pub most_periods: f32,
    /// Cost of a transmission. Where everybody sends and nobody is heard, only this tells anybody to stop.
    pub transmission: f32,
    /// Rewards are multiplied by this; 1 less the discount makes a value a mean cost.
    pub scale: f32,
}

/// Worlds of one scenario that are played at the same time; an agent is a vehicle, `[world][vehicle]`.
pub struct CellArena<'s> {
    environment: Environment<'s>,
    costs: Costs,
    required: Level,
    plan: PowerPlan,
    observed: Vec<Observation>,
    decisions: Decisions,
    /// What happened so far.
    pub tally: Tally,
}

impl<'s> CellArena<'s> {
    /// Takes fresh worlds, and gives their vehicles random ages.
    pub fn new(mut environment: Environment<'s>, costs: Costs, stream: &mut Stream) -> Self {
        for world in 0..environment.worlds() {
            let homes: Vec<Option<usize>> = (0..environment.vehicles())
                .map(|vehicle| environment.broadcast(world, vehicle))
                .map(|broadcast| broadcast.map(|broadcast| broadcast.home.index()))
                .collect();
            start_ages(&homes, stream, |vehicle, age| {
                environment.set_age(world, vehicle, age);
            });
        }
        Self {
            costs,
            required: environment.scenario().radio.required_level(),
            plan: power_plan(environment.scenario()),
            observed: Vec::new(),
            decisions: Decisions::new(environment.worlds(), environment.vehicles()),
            tally: Tally::default(),
            environment,
        }
    }
}

impl Arena for CellArena<'_> {
    fn agents(&self) -> usize {
        self.environment.worlds() * self.environment.vehicles()
    }

    fn observe(&mut self, inputs: &mut Vec<f32>, views: &mut Vec<f32>) {
        self.observed.clear();
        for world in 0..self.environment.worlds() {
            let first = self.observed.len();
            // The recipe's check leaves no group so large that a vehicle hears nothing.
            let measured = (0..self.environment.vehicles())
                .filter_map(|vehicle| self.environment.measurement(world, vehicle));
            self.observed
                .extend(measured.map(|measurement| Observation::new(&measurement)));
            let observed = &self.observed[first..];
            let counts = GroupCounts::new(observed.iter());
            for observation in observed {
                let encoded = as_float(&observation.encode(self.required));
                inputs.extend(encoded);
                counts.append_view(observation, &encoded, views);
            }
        }
    }

    fn step(&mut self, actions: &[u8], rewards: &mut Vec<f32>, weights: &mut Vec<f32>) {
        let vehicles = self.environment.vehicles();
        for (agent, (observation, &action)) in self.observed.iter().zip(actions).enumerate() {
            let decision = self.plan.decision(Action::ALL[usize::from(action)], observation);
            self.decisions.set(agent / vehicles, agent % vehicles, decision);
            if let Decision::Transmit { power, .. } = decision {
                self.tally.power_mw += libm::exp10(power.value().to_num::<f64>() / 10.0);
            }
        }
        self.environment.step(&self.decisions);
        let worlds = self
            .observed
            .chunks_exact(vehicles)
            .zip(actions.chunks_exact(vehicles));
        for (world, (observed, actions)) in worlds.enumerate() {
            let mut groups = [(0.0_f32, 0.0_f32); SUB_CHANNELS];
            let first = rewards.len();
            for (vehicle, observation) in observed.iter().enumerate() {
                let age = self.environment.age(world, vehicle).slots();
                self.tally.age += f64::from(age);
                self.tally.received += f64::from(u8::from(self.environment.received(world, vehicle)));
                let periods = f32::from(age) / f32::from(observation.period().slots());
                let cost = periods.min(self.costs.most_periods);
                let (members, sum) = &mut groups[observation.home().index()];
                *members += 1.0;
                *sum += cost;
                rewards.push(cost);
            }
            for ((reward, observation), &action) in rewards[first..].iter_mut().zip(observed).zip(actions) {
                let sent = if action == Action::Silent as u8 {
                    0.0
                } else {
                    self.costs.transmission
                };
                let (members, sum) = groups[observation.home().index()];
                let (own, weight) = (*reward, 1.0 + self.costs.team * (members - 1.0));
                *reward = -(own + sent + self.costs.team * (sum - own)) / weight * self.costs.scale;
                weights.push(weight);
                self.tally.reward += f64::from(*reward);
            }
            self.tally.world_slots += 1.0;
            self.tally.count += observed.len() as f64;
        }
    }
}
