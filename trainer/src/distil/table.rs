//! A distilled network as a weight table: from a seed to bytes.

use super::{Recipe, Round, SERVED_VEHICLES, VEHICLES, distil};
use crate::export::{Header, table_bytes};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::mixture::Mixture;
use crate::quantise::quantise;
use firmware::form::{ObservationForm, OutputForm};
use firmware::table::Provenance;
use firmware::units::SubChannels;
use host_sim::scenario::ScenarioSource;
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

/// The mixture that the shipped table is distilled in: the paper's scenario, varied.
///
/// # Errors
/// Never for the built-in preset.
pub fn shipped_mixture() -> Result<Mixture> {
    Ok(Mixture::varied(&ScenarioSource::default().read()?, VEHICLES))
}

/// Distils and quantises.
///
/// # Errors
/// If the network cannot be quantised.
pub fn distil_table(
    mixture: &Mixture,
    recipe: &Recipe,
    provenance: Provenance,
    progress: impl FnMut(Round),
) -> Result<DistilledTable> {
    let distilled = distil(mixture, recipe, progress);
    let form = ActorForm {
        observation: ObservationForm::Ring,
        output: OutputForm::Actions,
        noise: 0.0,
        min_vehicles: mixture.vehicles()[0],
        max_vehicles: SERVED_VEHICLES,
    };
    let (setting, sub_channels) = (mixture.setting(), mixture.sub_channels() as usize);
    let header = Header {
        observation_form: form.observation,
        output_form: form.output,
        max_vehicles: SERVED_VEHICLES as u16,
        max_sub_channels: SubChannels::new(sub_channels).unwrap_or(SubChannels::ONE),
        required_sinr: setting.required_sinr,
        power_plan: setting.power_plan,
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
