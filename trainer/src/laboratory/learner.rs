//! What a learning algorithm looks like from outside.

use super::actors::Actors;
use super::state::State;
use kit::error::Result;
use std::borrow::Cow;

/// A learning algorithm at work.
///
/// An episode is a whole unit of work that begins with fresh worlds, so that between two episodes no simulator has a
/// state. Every number that an episode needs follows from the configuration, the seed, the episode's index and
/// [`Learner::state`]; never from time, memory addresses or the number of threads.
pub trait Learner {
    /// Episodes of the whole run.
    fn length(&self) -> u64;

    /// Episodes done.
    fn done(&self) -> u64;

    /// Runs one episode on the current rayon pool. Every episode gives metrics of the same names in the same order.
    fn advance(&mut self) -> Metrics;

    /// Everything that later episodes depend on: weights, targets, optimiser moments, replay, counters, positions of random
    /// streams.
    fn state(&self) -> State;

    /// Bytes that the parts of its states take at most.
    fn parts_bytes(&self) -> u64 {
        0
    }

    /// Goes back to a state.
    ///
    /// # Errors
    /// The tensor or counter that is missing, has another shape or is one too many. The learner is not to be used then.
    fn restore(&mut self, state: State) -> Result<()>;

    /// The actors as they stand.
    fn actors(&self) -> Actors;
}

/// Names of metrics that reports look for; an algorithm adds its own (losses, entropy, learning rates).
pub mod name {
    /// Mean global reward of a slot.
    pub const REWARD: &str = "mean_reward";
    /// Mean age of vehicles over slots, in ms, with exploration.
    pub const AGE: &str = "mean_age_ms";
    /// Updates received by the base station in a slot.
    pub const SUCCESSES: &str = "success_per_slot";
    /// Mean transmit power of a vehicle over slots, silence included, in mW.
    pub const POWER: &str = "mean_power_mw";
    /// World-slots simulated so far.
    pub const SLOTS: &str = "slots";
    /// Optimiser steps so far.
    pub const UPDATES: &str = "updates";

    /// A metric of one cell of a mixture: TensorBoard shows names up to the slash together.
    pub fn of_cell(metric: &str, cell: &str) -> String {
        format!("{metric}/{cell}")
    }
}

/// Named numbers of one episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics(Vec<(Cow<'static, str>, f64)>);

impl Metrics {
    /// Appends a number. NaN says that the episode has none, such as the loss of a network that is not yet trained.
    #[must_use]
    pub fn with(mut self, name: impl Into<Cow<'static, str>>, value: f64) -> Self {
        self.0.push((name.into(), value));
        self
    }

    /// Names and numbers in their order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_ref(), *value))
    }

    /// The number of this name, if the episode has one.
    pub fn get(&self, name: &str) -> Option<f64> {
        let found = self.iter().find(|(known, _)| *known == name)?;
        (!found.1.is_nan()).then_some(found.1)
    }
}
