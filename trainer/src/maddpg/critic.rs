//! Global critics: the value of what all vehicles see and do together.

use super::view::View;
use crate::network::perceptron::Pass;
use host_sim::stream::Stream;

/// What a critic is asked about.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// The critic's own.
    pub parameters: &'a [f32],
    /// What the vehicles see.
    pub view: View<'a>,
    /// What they do, `[sample][vehicle][action length]`.
    pub actions: &'a [f32],
}

impl<'a> Question<'a> {
    /// With these parameters, of what vehicles see and do.
    pub fn new(parameters: &'a [f32], view: View<'a>, actions: &'a [f32]) -> Self {
        Self {
            parameters,
            view,
            actions,
        }
    }
}

/// The value of a cell, of joint observations and actions.
pub trait Critic: Send + Sync {
    /// Random parameters.
    fn initial(&self, stream: &mut Stream) -> Vec<f32>;

    /// Values of actions as `[sample]`.
    fn forward(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32>;

    /// Writes the parameters' gradient from slopes along the values of the last forward run.
    fn backward(&self, asked: &Question<'_>, slopes: &[f32], pass: &mut CriticPass, gradient: &mut [f32]);

    /// What the cell's value gains by other actions, as `[sample][vehicle][action length]`: where actions are choices, the value if
    /// one vehicle had taken each, up to what is the same for all of them; otherwise its slope along each of their values.
    fn gains(&self, asked: &Question<'_>, pass: &mut CriticPass) -> Vec<f32>;
}

/// A batch on its way through a critic, which uses what it needs of it.
#[derive(Clone, Debug, Default)]
pub struct CriticPass {
    /// Through what comes before a sum.
    pub describe: Pass,
    /// Through what gives the values.
    pub judge: Pass,
    /// The same for alternatives.
    pub alternatives: Pass,
    /// And their values.
    pub alternative_judge: Pass,
}
