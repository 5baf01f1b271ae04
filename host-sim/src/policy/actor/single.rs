//! The actor in a single world: the network for a row of vehicles at a time, between the library's own encoder and decoder.

use super::network::LaneNetwork;
use crate::decisions::{Decisions, VehicleDecisions};
use crate::lanes::{LANES, Row, Vectors};
use crate::policy::Policy;
use crate::senses::Senses;
use firmware::form::MAX_INPUTS;
use firmware::lots::Identity;
use firmware::observation::Observation;
use firmware::table::Table;

/// One table for all vehicles of one world. A row of which one lane counts would cost what 32 worlds do, so here the lanes are vehicles.
pub struct SingleWorld<'t> {
    table: &'t Table<'t>,
    network: LaneNetwork,
    /// Of the slot's vehicles, in rows of [`LANES`]. `[row][input][vehicle]`.
    inputs: Vec<[Row<i32>; MAX_INPUTS]>,
    /// Who decides in the slot, and what it sees.
    seen: Vec<(usize, Observation)>,
}

impl<'t> SingleWorld<'t> {
    /// Actors that run this table, for up to so many vehicles.
    pub fn new(table: &'t Table<'t>, vehicles: usize) -> Self {
        Self {
            table,
            network: LaneNetwork::new(table),
            inputs: vec![[[0; LANES]; MAX_INPUTS]; vehicles.div_ceil(LANES)],
            seen: Vec::with_capacity(vehicles),
        }
    }
}

impl Policy for SingleWorld<'_> {
    fn decide(&mut self, senses: &Senses<'_>, _decisions: &mut VehicleDecisions<'_>) {
        let Some(measurement) = senses.measurement(0) else {
            return;
        };
        let observation = Observation::new(&measurement, Identity(senses.identities()[0]));
        let index = self.seen.len();
        let (row, lane) = (&mut self.inputs[index / LANES], index % LANES);
        let (form, required) = (self.table.observation_form(), self.table.required_sinr());
        form.encode(&observation, required, |codes| {
            for (row, &code) in row.iter_mut().zip(codes) {
                row[lane] = i32::from(code);
            }
        });
        self.seen.push((senses.vehicle(), observation));
    }

    fn conclude(&mut self, vectors: Vectors, decisions: &mut Decisions) {
        let (count, form) = (self.table.observation_form().inputs(), self.table.output_form());
        for (inputs, seen) in self.inputs.iter().zip(self.seen.chunks(LANES)) {
            let outputs = vectors.run(
                #[inline(always)]
                || self.network.infer(vectors, &inputs[..count]),
            );
            for (lane, (vehicle, observation)) in seen.iter().enumerate() {
                let outputs = outputs.map(|row| row[lane]);
                let decision = form.decision(&outputs, observation, self.table.power_plan());
                decisions.set(0, *vehicle, decision);
            }
        }
        self.seen.clear();
    }
}
