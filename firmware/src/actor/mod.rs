//! The frozen actor: dense int8 layers over a weight table, evaluated in integers only.

mod dense;

pub(crate) use dense::MAX_BIAS;
pub use dense::{DenseLayer, MAX_WIDTH};

use crate::decision::{ACTIONS, Action, Decision};
use crate::observation::{INPUTS, Observation};
use crate::table::Table;

/// Runs a table's network. Owns the activations of one inference, so that no slot allocates or clears anything.
#[derive(Clone, Debug)]
pub struct Actor<'t> {
    table: Table<'t>,
    activations: [i16; MAX_WIDTH],
    next_activations: [i16; MAX_WIDTH],
}

impl<'t> Actor<'t> {
    /// An actor over a parsed table.
    pub const fn new(table: Table<'t>) -> Self {
        Self {
            table,
            activations: [0; MAX_WIDTH],
            next_activations: [0; MAX_WIDTH],
        }
    }

    /// The table it runs.
    pub const fn table(&self) -> &Table<'t> {
        &self.table
    }

    /// The network's outputs for an encoded observation, in the table's common output scale.
    pub fn infer(&mut self, input: &[i8; INPUTS]) -> [i32; ACTIONS] {
        let (mut now, mut next) = (&mut self.activations, &mut self.next_activations);
        for (activation, &value) in now.iter_mut().zip(input) {
            *activation = i16::from(value);
        }
        for layer in self.table.hidden_layers() {
            layer.hidden(now, next);
            core::mem::swap(&mut now, &mut next);
        }
        let mut outputs = [0; ACTIONS];
        self.table.output_layer().outputs(now, &mut outputs);
        outputs
    }

    /// What to do in this slot.
    pub fn act(&mut self, observation: &Observation) -> Action {
        Action::from_outputs(&self.infer(&observation.encode(self.table.required_sinr())))
    }

    /// The slot's sub-channel and power.
    pub fn decide(&mut self, observation: &Observation) -> Decision {
        let action = self.act(observation);
        self.table.power_plan().decision(action, observation)
    }
}
