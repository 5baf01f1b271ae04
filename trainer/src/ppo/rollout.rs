//! Playing the cell with the present actor, and what is remembered of it.

use super::Recipe;
use super::advantage::advantages;
use super::central::{CENTRAL_INPUTS, GroupCounts};
use super::loss::{log_probability, softmax};
use crate::distil::{as_float, start_ages};
use crate::network::Network;
use firmware::decision::{ACTIONS, Action, PowerPlan};
use firmware::observation::{INPUTS, Observation};
use firmware::units::{Level, SUB_CHANNELS};
use host_sim::environment::{Decisions, Environment};
use host_sim::stream::Stream;

/// Decisions that were taken, in a fixed order; one row each.
#[derive(Clone, Debug, Default)]
pub struct Experience {
    /// What the actor saw: rows of equal width.
    pub inputs: Vec<f32>,
    /// What the critic saw: rows of equal width.
    pub views: Vec<f32>,
    /// What was done.
    pub actions: Vec<u8>,
    /// Log probabilities of that.
    pub log_probabilities: Vec<f32>,
    /// How much better than the critic expected it went.
    pub advantages: Vec<f32>,
    /// What the critic should have expected.
    pub targets: Vec<f32>,
    /// What happened, for people.
    pub tally: Tally,
}

/// Sums over vehicle-slots.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Vehicle-slots.
    pub count: f64,
    /// Of ages after the slot.
    pub age: f64,
    /// Of rewards.
    pub reward: f64,
    /// Of transmissions.
    pub sent: f64,
    /// Of successful ones.
    pub received: f64,
}

impl Tally {
    /// Adds another.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.age += other.age;
        self.reward += other.reward;
        self.sent += other.sent;
        self.received += other.received;
    }
}

impl Experience {
    /// Joins batches in their order.
    pub fn join(batches: Vec<Self>) -> Self {
        let mut all = Self::default();
        for batch in batches {
            all.inputs.extend(batch.inputs);
            all.views.extend(batch.views);
            all.actions.extend(batch.actions);
            all.log_probabilities.extend(batch.log_probabilities);
            all.advantages.extend(batch.advantages);
            all.targets.extend(batch.targets);
            all.tally.merge(&batch.tally);
        }
        all
    }
}

/// What a vehicle's reward is made of.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    group: usize,
    periods: f32,
}

/// Worlds with the same number of vehicles, and the randomness of their decisions.
pub struct Batch<'s> {
    environment: Environment<'s>,
    stream: Stream,
    required: Level,
    plan: PowerPlan,
    decisions: Decisions,
}

impl<'s> Batch<'s> {
    /// Starts fresh worlds at random ages.
    pub fn new(mut environment: Environment<'s>, plan: PowerPlan, mut stream: Stream) -> Self {
        for world in 0..environment.worlds() {
            let homes: Vec<Option<usize>> = (0..environment.vehicles())
                .map(|vehicle| environment.broadcast(world, vehicle))
                .map(|broadcast| broadcast.map(|broadcast| broadcast.home.index()))
                .collect();
            start_ages(&homes, &mut stream, |vehicle, age| {
                environment.set_age(world, vehicle, age);
            });
        }
        Self {
            required: environment.scenario().radio.required_level(),
            decisions: Decisions::new(environment.worlds(), environment.vehicles()),
            environment,
            stream,
            plan,
        }
    }

    /// Plays on for some slots and judges every decision.
    pub fn play(&mut self, actor: &Network, critic: &Network, recipe: &Recipe) -> Experience {
        let agents = self.environment.worlds() * self.environment.vehicles();
        let decided = recipe.slots as usize * agents;
        let mut experience = Experience {
            inputs: Vec::with_capacity(decided * INPUTS),
            views: Vec::with_capacity((decided + agents) * CENTRAL_INPUTS),
            ..Experience::default()
        };
        let (mut rewards, mut weights) = (Vec::with_capacity(decided), Vec::with_capacity(decided));
        let mut activations = actor.activations();
        let mut probabilities = [0.0; ACTIONS];
        for _ in 0..recipe.slots {
            let observed = self.observe(&mut experience.views);
            for (index, (observation, encoded)) in observed.iter().enumerate() {
                softmax(actor.forward_into(encoded, &mut activations), &mut probabilities);
                let action = draw(&probabilities, self.stream.uniform());
                let (world, vehicle) = (index / self.environment.vehicles(), index % self.environment.vehicles());
                let decision = self.plan.decision(Action::ALL[action], observation);
                self.decisions.set(world, vehicle, decision);
                experience.inputs.extend(encoded);
                experience.actions.push(action as u8);
                experience.log_probabilities.push(log_probability(probabilities[action]));
                experience.tally.sent += f64::from(u8::from(action != Action::Silent as usize));
            }
            self.environment.step(&self.decisions);
            self.reward(&observed, recipe, &mut rewards, &mut weights, &mut experience.tally);
        }
        // The state after the last reward is valued, and then forgotten.
        let _ = self.observe(&mut experience.views);
        let mut activations = critic.activations();
        let values: Vec<f32> = experience
            .views
            .chunks_exact(CENTRAL_INPUTS)
            .map(|view| critic.forward_into(view, &mut activations)[0])
            .collect();
        experience.views.truncate(decided * CENTRAL_INPUTS);
        let advantages = advantages(&rewards, &values, agents, recipe.discount, recipe.trace);
        experience.targets = values.iter().zip(&advantages).map(|(value, advantage)| value + advantage).collect();
        experience.advantages = advantages.iter().zip(&weights).map(|(advantage, weight)| advantage * weight).collect();
        experience
    }

    /// What every vehicle of every world observes, `[world][vehicle]`; the critic's views are appended.
    fn observe(&self, views: &mut Vec<f32>) -> Vec<(Observation, [f32; INPUTS])> {
        let mut observed = Vec::with_capacity(self.environment.worlds() * self.environment.vehicles());
        for world in 0..self.environment.worlds() {
            let first = observed.len();
            // The recipe's check leaves no group without a broadcast.
            let measured = (0..self.environment.vehicles())
                .filter_map(|vehicle| self.environment.measurement(world, vehicle));
            observed.extend(measured.map(|measurement| {
                let observation = Observation::new(&measurement);
                (observation, as_float(&observation.encode(self.required)))
            }));
            let counts = GroupCounts::new(observed[first..].iter().map(|(observation, _)| observation));
            for (observation, encoded) in &observed[first..] {
                counts.append_view(observation, encoded, views);
            }
        }
        observed
    }

    /// Appends every vehicle's reward for the slot that has passed: less its own cost and its group's, weighted; and what
    /// the weights sum up to.
    fn reward(
        &self,
        observed: &[(Observation, [f32; INPUTS])],
        recipe: &Recipe,
        rewards: &mut Vec<f32>,
        weights: &mut Vec<f32>,
        tally: &mut Tally,
    ) {
        let vehicles = self.environment.vehicles();
        for (world, observed) in observed.chunks_exact(vehicles).enumerate() {
            let mut groups = [(0.0_f32, 0.0_f32); SUB_CHANNELS];
            let costs: Vec<Cost> = observed
                .iter()
                .enumerate()
                .map(|(vehicle, (observation, _))| {
                    let age = self.environment.age(world, vehicle).slots();
                    tally.age += f64::from(age);
                    tally.received += f64::from(u8::from(age == 1));
                    let periods = f32::from(age) / f32::from(observation.period().slots());
                    let cost = Cost {
                        group: observation.home().index(),
                        periods: periods.min(recipe.most_periods),
                    };
                    groups[cost.group].0 += 1.0;
                    groups[cost.group].1 += cost.periods;
                    cost
                })
                .collect();
            for cost in costs {
                let (members, sum) = groups[cost.group];
                let weight = 1.0 + recipe.team * (members - 1.0);
                // Scaled so that a value is a mean cost.
                let reward = -(cost.periods + recipe.team * (sum - cost.periods)) / weight * (1.0 - recipe.discount);
                rewards.push(reward);
                weights.push(weight);
                tally.reward += f64::from(reward);
                tally.count += 1.0;
            }
        }
    }
}

/// The action whose interval of the cumulated probabilities holds `uniform`.
fn draw(probabilities: &[f32; ACTIONS], uniform: f32) -> usize {
    let mut left = uniform;
    for (action, &probability) in probabilities.iter().enumerate() {
        left -= probability;
        if left < 0.0 {
            return action;
        }
    }
    // Rounding left a little: the likeliest action has room for it.
    (1..ACTIONS).fold(0, |best, action| if probabilities[action] > probabilities[best] { action } else { best })
}
