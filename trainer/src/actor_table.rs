//! A trained actor as a weight table: calibrated on worlds of its own training, then the same quantiser and format as
//! everything else.

use crate::command::distil::provenance;
use crate::evaluate::{Setting, watch_inputs};
use crate::export::{Header, table_bytes};
use crate::laboratory::actors::Actors;
use crate::laboratory::forms::{ObservationForm, OutputForm};
use crate::quantise::quantise;
use crate::run_folder::RunIdentity;
use firmware::observation::INPUTS;
use host_sim::command::options::parse_table;
use host_sim::environment::Environment;
use host_sim::error::{Error, Result};
use host_sim::mobility::MobilitySource;
use host_sim::policy::power_plan;
use host_sim::scenario::Scenario;
use host_sim::stream::Purpose;
use rayon::prelude::*;

/// Worlds that activations are calibrated on, from the fewest to the most vehicles of the training, and their slots, which
/// begin with all ages at their largest (chosen: 16 worlds are about 50,000 inputs).
const WORLDS: u64 = 16;
const SLOTS: u32 = 150;

/// Index of the first of them, far from the worlds of episodes.
const FIRST_WORLD: u64 = 1 << 62;

/// What actors see and do in a scenario.
pub fn setting(scenario: &Scenario) -> Setting {
    Setting {
        required_sinr: scenario.radio.required_level(),
        power_plan: power_plan(scenario),
    }
}

/// Whether a table can hold such actors.
///
/// # Errors
/// Names the form that it cannot.
fn check_form(actors: &Actors) -> Result<()> {
    let form = actors.form;
    if form.observation != ObservationForm::Firmware || form.output != OutputForm::Actions {
        return Err(Error::input(
            "actor",
            format!("observation {:?} and output {:?}", form.observation, form.output),
            "observation Firmware and output Actions, which a table holds",
        ));
    }
    Ok(())
}

/// Tables of all networks: one, or one for each vehicle.
///
/// # Errors
/// If the form, a layer or a width is none that a table can hold.
pub fn actor_tables(identity: &RunIdentity, actors: &Actors) -> Result<Vec<Vec<u8>>> {
    check_form(actors)?;
    let scenario = &identity.configuration.scenario;
    let setting = setting(scenario);
    let watched: Vec<Vec<(usize, [i8; INPUTS])>> = (0..WORLDS)
        .into_par_iter()
        .map(|world| {
            let mut scenario = scenario.clone();
            let (least, most) = (actors.form.min_vehicles, actors.form.max_vehicles);
            scenario.cell.vehicles = least + ((u64::from(most - least) * world) / (WORLDS - 1)) as u32;
            let worlds = FIRST_WORLD + world..FIRST_WORLD + world + 1;
            let source = &MobilitySource::Grid;
            let mut environment =
                Environment::new(&scenario, source, identity.seed, Purpose::Training, worlds);
            let mut inputs = Vec::new();
            watch_inputs(&mut environment, actors, setting, SLOTS, |vehicle, input| {
                inputs.push((vehicle, input))
            });
            inputs
        })
        .collect();
    let header = Header {
        max_vehicles: u16::try_from(actors.form.max_vehicles).unwrap_or(u16::MAX),
        required_sinr: setting.required_sinr,
        power_plan: setting.power_plan,
        provenance: provenance(identity.seed),
    };
    let networks = actors.networks.iter().enumerate();
    let tables = networks.map(|(vehicle, network)| {
        let inputs: Vec<[i8; INPUTS]> = watched
            .iter()
            .flatten()
            .filter(|(seen, _)| actors.shared() || *seen == vehicle)
            .map(|(_, input)| *input)
            .collect();
        let quantised = quantise(network, &inputs)
            .map_err(|error| Error::input("quantisation", error, "a network that fits int8"))?;
        let bytes = table_bytes(&quantised, &header)
            .map_err(|error| Error::input("table", error, "a network that the kernel computes exactly"))?;
        // The firmware's own reader has the last word on what a table is.
        drop(parse_table(None, &bytes)?);
        Ok(bytes)
    });
    tables.collect()
}
