//! Learning from the cell alone, on policy: proximal policy optimisation (Schulman et al. 2017) of one actor that all
//! vehicles share, with a critic that sees the whole cell (Yu et al., "The surprising effectiveness of PPO in cooperative
//! multi-agent games", NeurIPS 2022).
//!
//! Nothing is imitated. The actor's input is the firmware's encoding, which already says when the vehicle's place comes round and
//! whether it is called; what to do with it is learned. Every sum has a fixed order, so that a seed gives the same network to
//! the last bit on any machine and any number of threads.

pub mod advantage;
pub mod central;
pub mod learner;
pub mod loss;
mod recipe;
pub mod rollout;
pub mod rules;
#[cfg(test)]
mod tests;
pub mod update;

pub use learner::PpoLearner;
pub use recipe::{CriticView, Recipe};
