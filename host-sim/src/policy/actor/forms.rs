//! Actors of any form: the network for a row of worlds at a time, between the library's own encoder and decoder.

use super::network::LaneNetwork;
use super::table_index;
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, Row};
use crate::policy::Policy;
use crate::senses::Senses;
use firmware::form::MAX_INPUTS;
use firmware::lots::Identity;
use firmware::observation::Observation;
use firmware::table::Table;

/// One table for all vehicles, or one for each.
pub struct FormActors<'t> {
    tables: &'t [Table<'t>],
    networks: Vec<LaneNetwork>,
    /// `[input][world]`.
    inputs: [Row<i32>; MAX_INPUTS],
}

impl<'t> FormActors<'t> {
    /// Actors that run these tables.
    pub fn new(tables: &'t [Table<'t>]) -> Self {
        Self {
            tables,
            networks: tables.iter().map(LaneNetwork::new).collect(),
            inputs: [[0; LANES]; MAX_INPUTS],
        }
    }
}

impl Policy for FormActors<'_> {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let (vectors, vehicle) = (senses.vectors(), senses.vehicle());
        let table = &self.tables[table_index(self.tables, vehicle)];
        let network = &mut self.networks[table_index(self.tables, vehicle)];
        let (observation_form, output_form) = (table.observation_form(), table.output_form());
        let mut observations = [None; LANES];
        for lane in 0..senses.worlds() {
            let Some(measurement) = senses.measurement(lane) else {
                continue;
            };
            let observation = Observation::new(&measurement, Identity(senses.identities()[lane]));
            observation_form.encode(&observation, table.required_sinr(), |codes| {
                for (row, &code) in self.inputs.iter_mut().zip(codes) {
                    row[lane] = i32::from(code);
                }
            });
            observations[lane] = Some(observation);
        }
        let inputs = &self.inputs[..observation_form.inputs()];
        let outputs = vectors.run(
            #[inline(always)]
            || network.infer(vectors, inputs),
        );
        for (lane, observation) in observations.iter().enumerate() {
            if let Some(observation) = observation {
                let outputs = outputs.map(|row| row[lane]);
                decisions.set(lane, output_form.decision(&outputs, observation, table.power_plan()));
            }
        }
    }
}
