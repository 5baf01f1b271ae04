//! A distilled network as a weight table: from a seed to bytes.

use super::{MAX_SUB_CHANNELS, Recipe, Round, SERVED_VEHICLES, distil};
use crate::export::{Header, table_bytes};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::quantise::quantise;
use firmware::form::{ObservationForm, OutputForm};
use firmware::table::Provenance;
use firmware::units::SubChannels;
use host_sim::policy::power_plan;
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::weight_table::WeightTable;
use kit::error::Result;

/// A table and the network behind it.
pub struct DistilledTable {
    /// The float network.
    pub actors: Actors,
    /// Mean cross entropy of the last round.
    pub loss: f32,
    /// The table.
    pub table: WeightTable,
}

/// The scenario that the shipped table is distilled in: the paper's.
///
/// # Errors
/// Never for the built-in preset.
pub fn shipped_scenario() -> Result<Scenario> {
    ScenarioSource::default().read()
}

/// Distils and quantises.
///
/// # Errors
/// If the network cannot be quantised.
pub fn distil_table(
    scenario: &Scenario,
    recipe: &Recipe,
    provenance: Provenance,
    progress: impl FnMut(Round),
) -> Result<DistilledTable> {
    let distilled = distil(scenario, recipe, progress);
    let form = ActorForm {
        observation: ObservationForm::Ring,
        output: OutputForm::Actions,
        noise: 0.0,
        min_vehicles: recipe.min_vehicles,
        max_vehicles: SERVED_VEHICLES,
    };
    let header = Header {
        observation_form: form.observation,
        output_form: form.output,
        max_vehicles: SERVED_VEHICLES as u16,
        max_sub_channels: SubChannels::new(MAX_SUB_CHANNELS as usize).unwrap_or(SubChannels::ONE),
        required_sinr: scenario.radio.required_level(),
        power_plan: power_plan(scenario),
        provenance,
    };
    let bytes = quantise(&distilled.network, distilled.inputs.as_flattened(), None)
        .and_then(|quantised| table_bytes(&quantised, &header))
        .map_err(|error| error.within("distilled network"))?;
    Ok(DistilledTable {
        actors: Actors {
            form,
            networks: vec![distilled.network],
        },
        loss: distilled.loss,
        // The firmware's own reader has the last word on what a table is.
        table: WeightTable::new("distilled table", bytes)?,
    })
}
