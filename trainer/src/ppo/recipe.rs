//! How to learn.

use super::cell::Costs;
use super::optimiser::Rates;
use firmware::network::{MAX_LAYERS, MAX_WIDTH};
use host_sim::scenario::Scenario;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The learner's parameters; `presets/ppo.toml` says what they mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the preset documents every key")]
pub struct Recipe {
    pub first_actor: PathBuf,
    pub first_actor_sharpness: f32,
    pub critic_first_episodes: u64,
    pub hidden: Vec<usize>,
    pub critic_hidden: Vec<usize>,
    pub episodes: u64,
    pub batches: u32,
    pub worlds: u32,
    pub updates: u32,
    pub slots: u32,
    pub epochs: u32,
    pub minibatch: usize,
    pub min_vehicles: u32,
    pub max_vehicles: u32,
    pub discount: f32,
    pub trace: f32,
    pub team: f32,
    pub most_periods: f32,
    pub transmission: f32,
    pub clip: f32,
    pub gradient_limit: f32,
    pub learning_rate: [f32; 2],
    pub critic_learning_rate: [f32; 2],
    pub entropy: [f32; 2],
    pub first_scores: [f32; 3],
}

impl Recipe {
    /// Checks ranges, and options against each other.
    ///
    /// # Errors
    /// The first key that is out of its range, or does not go with another.
    pub fn check(&self, _scenario: &Scenario) -> Result<()> {
        for (key, value, most) in [
            ("episodes", self.episodes, 1_000_000),
            ("batches", self.batches.into(), 10_000),
            ("worlds", self.worlds.into(), 10_000),
            ("updates", self.updates.into(), 10_000),
            ("slots", self.slots.into(), 10_000),
            ("epochs", self.epochs.into(), 1000),
            ("minibatch", self.minibatch as u64, 1 << 24),
            ("min_vehicles", self.min_vehicles.into(), 300),
            ("max_vehicles", self.max_vehicles.into(), 300),
        ] {
            if !(1..=most).contains(&value) {
                return Err(Error::input(format!("ppo.{key}"), value, format!("1 to {most}")));
            }
        }
        if self.min_vehicles > self.max_vehicles {
            let expected = format!("at most ppo.max_vehicles, which is {}", self.max_vehicles);
            return Err(Error::input("ppo.min_vehicles", self.min_vehicles, expected));
        }
        if self.critic_first_episodes >= self.episodes {
            let expected = format!("less than ppo.episodes, which is {}", self.episodes);
            return Err(Error::input(
                "ppo.critic_first_episodes",
                self.critic_first_episodes,
                expected,
            ));
        }
        for (key, widths) in [("hidden", &self.hidden), ("critic_hidden", &self.critic_hidden)] {
            let fits =
                widths.len() < MAX_LAYERS && widths.iter().all(|width| (1..=MAX_WIDTH).contains(width));
            if !fits {
                let expected = format!("at most {} widths from 1 to {MAX_WIDTH}", MAX_LAYERS - 1);
                return Err(Error::input(
                    format!("ppo.{key}"),
                    format!("{widths:?}"),
                    expected,
                ));
            }
        }
        self.check_first_actor()?;
        let [first_rate, last_rate] = self.learning_rate;
        let [first_critic_rate, last_critic_rate] = self.critic_learning_rate;
        let [first_entropy, last_entropy] = self.entropy;
        for (key, value, least, most) in [
            ("discount", self.discount, 0.0, 0.999_99),
            ("trace", self.trace, 0.0, 1.0),
            ("team", self.team, 0.0, 1.0),
            ("most_periods", self.most_periods, 1.0, 100.0),
            ("transmission", self.transmission, 0.0, 100.0),
            ("clip", self.clip, 1e-3, 1.0),
            ("gradient_limit", self.gradient_limit, 1e-6, 1e6),
            ("learning_rate", first_rate, 1e-9, 1.0),
            ("learning_rate", last_rate, 1e-9, 1.0),
            ("critic_learning_rate", first_critic_rate, 1e-9, 1.0),
            ("critic_learning_rate", last_critic_rate, 1e-9, 1.0),
            ("entropy", first_entropy, 1e-12, 1e3),
            ("entropy", last_entropy, 1e-12, 1e3),
            ("first_actor_sharpness", self.first_actor_sharpness, 1e-3, 1e3),
        ] {
            // Also refuses NaN.
            if !(least..=most).contains(&value) {
                return Err(Error::input(
                    format!("ppo.{key}"),
                    value,
                    format!("{least} to {most}"),
                ));
            }
        }
        if !self.first_scores.iter().all(|score| score.abs() <= 100.0) {
            let found = format!("{:?}", self.first_scores);
            return Err(Error::input(
                "ppo.first_scores",
                found,
                "numbers from -100 to 100",
            ));
        }
        Ok(())
    }

    /// Checks that what belongs to a first actor comes with one.
    fn check_first_actor(&self) -> Result<()> {
        let needs = if self.first_actor_sharpness != 1.0 {
            format!(
                "ppo.first_actor_sharpness, which is {}",
                self.first_actor_sharpness
            )
        } else if self.critic_first_episodes > 0 {
            format!(
                "ppo.critic_first_episodes, which is {}",
                self.critic_first_episodes
            )
        } else {
            return Ok(());
        };
        if self.first_actor.as_os_str().is_empty() {
            let expected = format!("the folder of a run, for {needs}");
            return Err(Error::input("ppo.first_actor", "none", expected));
        }
        Ok(())
    }

    /// How far to step when this part of the run is done.
    pub(super) fn rates(&self, progress: f64) -> Rates {
        let linear = |[first, last]: [f32; 2]| first + (last - first) * progress as f32;
        let [first, last] = self.entropy;
        let learns = progress * self.episodes as f64 >= self.critic_first_episodes as f64;
        Rates {
            actor: if learns { linear(self.learning_rate) } else { 0.0 },
            critic: linear(self.critic_learning_rate),
            entropy: first * libm::pow(f64::from(last / first), progress) as f32,
        }
    }

    pub(super) const fn costs(&self) -> Costs {
        Costs {
            team: self.team,
            most_periods: self.most_periods,
            transmission: self.transmission,
            scale: 1.0 - self.discount,
        }
    }
}
