//! The paper's modified MADDPG and its family.
//!
//! [`learner`] is the algorithm in any game, `update` its arithmetic, [`options`] what may be changed about it; [`in_cell`] lets it
//! learn in the simulator's cell. Networks run on the own kernels of [`crate::network`], because they give the same bits on every
//! machine and with any number of threads, and use AVX-512 where it is; every gradient is checked against finite differences. With
//! the feature `burn` the paper's form also runs on burn's automatic differentiation: module `burn`.

#[cfg(feature = "burn")]
mod burn;
#[cfg(all(test, feature = "burn"))]
mod burn_tests;
pub mod critic;
pub mod flat_critic;
#[cfg(test)]
mod gradient_tests;
pub mod group;
pub mod in_cell;
pub mod learner;
pub mod options;
pub mod replay;
pub mod set_critic;
mod update;
pub mod view;
