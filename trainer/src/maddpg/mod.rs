//! The paper's modified MADDPG and its family.
//!
//! [`learner`] is the algorithm, `update` its arithmetic; [`options`] what may be changed about it; [`arena`] where it plays. Networks run
//! on the own kernels of [`crate::product`], [`perceptron`] and [`optimiser`], because they give the same bits on every machine and
//! with any number of threads, and use AVX-512 where it is; every gradient is checked against finite differences. With the feature
//! `burn` the paper's form also runs on burn's automatic differentiation: module `burn`.

pub mod actions;
pub mod arena;
#[cfg(feature = "burn")]
mod burn;
#[cfg(all(test, feature = "burn"))]
mod burn_tests;
pub mod choice;
pub mod critic;
pub mod flat_critic;
#[cfg(test)]
mod gradient_tests;
pub mod group;
mod laboratory;
pub mod learner;
pub mod optimiser;
pub mod options;
pub mod perceptron;
pub mod pool;
pub mod replay;
pub mod set_critic;
mod update;
