//! Global critics: the value of what all vehicles see and do together.
//!
//! Both forms give one value for each sub-channel or one for the cell, and answer three questions: what is this worth, which
//! way should every action change (for continuous and straight-through actors), and what would each other action of each
//! vehicle have been worth (for the all-action gradient).

use super::actions::ActionSet;
use super::flat_critic::{FlatCritic, FlatPass};
use super::set_critic::{SetCritic, SetPass};

/// A batch of joint observations.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Vehicles that a sample has room for.
    pub vehicles: usize,
    /// `[sample][vehicle][width]`.
    pub observations: &'a [f32],
    /// Values that a vehicle has in `observations`.
    pub width: usize,
    /// How many of them, from the first on, the vehicle itself observes.
    pub observed: usize,
    /// `[sample][vehicle]`: index of the vehicle's home sub-channel.
    pub homes: &'a [u8],
    /// `[sample]`: vehicles from this one on are absent.
    pub present: &'a [u8],
}

impl View<'_> {
    /// Samples.
    pub fn samples(&self) -> usize {
        self.present.len()
    }

    /// Whether a vehicle takes part in a sample.
    pub fn takes_part(&self, sample: usize, vehicle: usize) -> bool {
        vehicle < usize::from(self.present[sample])
    }

    /// What is known of a vehicle in a sample.
    pub fn row(&self, sample: usize, vehicle: usize) -> &[f32] {
        &self.observations[(sample * self.vehicles + vehicle) * self.width..][..self.width]
    }
}

/// A global critic.
#[derive(Clone, Debug)]
pub enum Critic {
    /// The paper's: one perceptron on all observations and actions side by side.
    Flat(FlatCritic),
    /// A sum over the vehicles of each sub-channel, whose order cannot matter, and a perceptron on each sum.
    Set(SetCritic),
}

/// A batch on its way through a critic.
#[derive(Clone, Debug, Default)]
pub struct CriticPass {
    flat: FlatPass,
    set: SetPass,
}

impl Critic {
    /// How many values it gives for a sample; their mean is the value of the cell.
    pub fn heads(&self) -> usize {
        match self {
            Self::Flat(_) => 1,
            Self::Set(_) => super::set_critic::HEADS,
        }
    }

    /// Random parameters.
    pub fn initial(&self, stream: &mut host_sim::stream::Stream) -> Vec<f32> {
        match self {
            Self::Flat(critic) => critic.network.initial(stream),
            Self::Set(critic) => critic.initial(stream),
        }
    }

    /// Values of `actions`, `[sample][vehicle][action length]`, as `[sample][head]`.
    pub fn forward(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        match self {
            Self::Flat(critic) => critic.forward(parameters, view, actions, &mut pass.flat),
            Self::Set(critic) => critic.forward(parameters, view, actions, &mut pass.set),
        }
    }

    /// Gradient of a loss with these slopes along the values of the last forward run.
    pub fn gradient(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        slopes: &[f32],
        pass: &mut CriticPass,
        gradient: &mut [f32],
    ) {
        match self {
            Self::Flat(critic) => critic.backward(parameters, slopes, &mut pass.flat, Some(gradient)),
            Self::Set(critic) => critic.backward(parameters, view, slopes, &mut pass.set, Some(gradient)),
        }
    }

    /// Slopes of the cell's value along every action, `[sample][vehicle][action length]`.
    pub fn action_slopes(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        let _values = self.forward(parameters, view, actions, pass);
        let slopes = vec![1.0 / self.heads() as f32; view.samples() * self.heads()];
        match self {
            Self::Flat(critic) => {
                critic.backward(parameters, &slopes, &mut pass.flat, None);
                critic.action_slopes(view, &pass.flat)
            }
            Self::Set(critic) => {
                critic.backward(parameters, view, &slopes, &mut pass.set, None);
                critic.action_slopes(view, &pass.set)
            }
        }
    }

    /// The cell's value if one vehicle had taken another action, for each vehicle and action: `[sample][vehicle][action]`. What
    /// is the same for all actions of a vehicle may be left out.
    pub fn alternatives(
        &self,
        parameters: &[f32],
        view: &View<'_>,
        actions: &[f32],
        set: ActionSet,
        pass: &mut CriticPass,
    ) -> Vec<f32> {
        match self {
            Self::Flat(critic) => critic.alternatives(parameters, view, actions, set, &mut pass.flat),
            Self::Set(critic) => critic.alternatives(parameters, view, actions, &mut pass.set),
        }
    }
}
