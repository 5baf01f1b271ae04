//! The learning laboratory: what every learning algorithm shares.
//!
//! An algorithm is a [`Learner`](learner::Learner): it runs episode after episode, can be saved and restored between any two
//! of them, and gives [`Actors`](actors::Actors), which evaluation, export, ONNX and safetensors understand. What it is
//! told is a [`Configuration`](crate::configuration::Configuration); its random numbers come from [`random`], whose worlds no
//! evaluation ever meets.

pub mod actors;
pub mod checkpoint;
pub mod learner;
#[cfg(feature = "program")]
pub mod metrics_log;
pub mod random;
pub mod state;
#[cfg(feature = "program")]
pub mod tensorboard;
