//! Global critics: the value of what all vehicles see and do together.

use super::view::View;
use crate::network::perceptron::Pass;
use host_sim::stream::Stream;

/// One value for each sub-channel, or one for the cell, of joint observations and actions, `[sample][vehicle][action length]`.
pub trait Critic: Send + Sync {
    /// How many values it gives for a sample; their mean is the value of the cell.
    fn heads(&self) -> usize;

    /// Random parameters.
    fn initial(&self, stream: &mut Stream) -> Vec<f32>;

    /// Values of actions as `[sample][head]`.
    fn forward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32>;

    /// Runs slopes along the values of the last forward run back, to the parameters' gradient or else to the inputs.
    fn backward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        slopes: &[f32],
        pass: &mut CriticPass,
        gradient: Option<&mut [f32]>,
    );

    /// Slopes along the actions after a backward run to the inputs.
    fn along_actions(&self, view: &View<'_>, pass: &CriticPass) -> Vec<f32>;

    /// The cell's value if one vehicle had taken another action, for each vehicle and action: `[sample][vehicle][action]`. What
    /// is the same for all actions of a vehicle may be left out.
    fn alternatives(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32>;

    /// Slopes of the cell's value along every action.
    fn action_slopes(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        let _values = self.forward(parameters, view, actions, pass);
        let slopes = vec![1.0 / self.heads() as f32; view.samples() * self.heads()];
        self.backward(parameters, view, &slopes, pass, None);
        self.along_actions(view, pass)
    }
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
    /// Which sum each column of `describe` belongs to.
    pub heads: Vec<u32>,
}
