//! The frozen actor: a weight table's network between the forms that its header names.

use crate::decision::Decision;
use crate::network::{MAX_OUTPUTS, Scratch};
use crate::observation::Observation;
use crate::table::Table;

/// Runs a table's network. Owns the activations of one inference, so that no slot allocates or clears anything.
#[derive(Clone, Debug)]
pub struct Actor<'t> {
    table: Table<'t>,
    scratch: Scratch,
}

impl<'t> Actor<'t> {
    /// An actor over a parsed table.
    pub const fn new(table: Table<'t>) -> Self {
        Self {
            table,
            scratch: Scratch::new(),
        }
    }

    /// The table it runs.
    pub const fn table(&self) -> &Table<'t> {
        &self.table
    }

    /// The network's outputs for an encoded observation ([`Network::infer`](crate::network::Network::infer)).
    pub fn infer(&mut self, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        self.table.network().infer(&mut self.scratch, input)
    }

    /// The slot's sub-channel and power.
    pub fn decide(&mut self, observation: &Observation) -> Decision {
        decide(&self.table, &mut self.scratch, observation)
    }
}

/// The sub-channel and power that a table's network decides on, with these activations to work in.
pub(crate) fn decide(table: &Table<'_>, scratch: &mut Scratch, observation: &Observation) -> Decision {
    let infer = |input: &[i8]| table.network().infer(scratch, input);
    let form = table.observation_form();
    let outputs = form.encode(observation, table.required_sinr(), infer);
    let form = table.output_form();
    form.decision(&outputs, observation, table.power_plan())
}
