//! A trained actor as a weight table: calibrated on worlds of its own training, then the same quantiser and format as
//! everything else.

use crate::configuration::Configuration;
use crate::evaluate::watch_inputs;
use crate::export::{Header, table_bytes};
use crate::forms::at_code_one;
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::random;
use crate::mixture::Mixture;
use crate::network::Network;
use crate::provenance::provenance;
use crate::quantise::quantise;
use crate::run_folder::RunIdentity;
use firmware::form::{CONTINUOUS_ONE, OutputForm};
use firmware::network::{MAX_LAYERS, MAX_WIDTH};
use firmware::units::SubChannels;
use host_sim::stream::Role;
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};
use rayon::prelude::*;
use std::ops::Range;

/// Worlds of each cell that activations are calibrated on, from the fewest to the most vehicles of the training, and their slots,
/// which begin with all ages at their largest (chosen: 16 worlds are about 50,000 inputs).
const WORLDS: u64 = 16;
const SLOTS: u32 = 150;

/// Index of the first of them, far from the worlds of episodes.
const FIRST_WORLD: u64 = 1 << 62;

/// The network for a table: for inputs in its codes, whose unit is not every input's own, and without the score of a silence
/// that its form never chooses, which may be far from all others.
fn for_table(network: &Network, form: ActorForm) -> Network {
    let mut network = network.clone();
    let inputs = form.observation.inputs();
    for (place, weight) in network.layer_mut(0).0.iter_mut().enumerate() {
        *weight *= at_code_one(form.observation, place % inputs);
    }
    if form.output == OutputForm::SendingSubChannels {
        let (weights, biases) = network.last_mut();
        let inputs = weights.len() / biases.len();
        weights[..inputs].fill(0.0);
        biases[0] = 0.0;
    }
    network
}

/// Whether tables can hold networks of these widths.
///
/// # Errors
/// What a table has no room for.
pub fn check_widths(actors: &Actors) -> Result<()> {
    let widths = actors.networks[0].widths();
    let layers = widths.len() - 1;
    if layers > MAX_LAYERS {
        let expected = format!("at most {MAX_LAYERS}, which a table holds");
        return Err(Error::input("actor", format!("{layers} layers"), expected));
    }
    match widths.iter().find(|&&width| width > MAX_WIDTH) {
        Some(width) => {
            let expected = format!("at most {MAX_WIDTH}, which a table holds");
            Err(Error::input("actor", format!("a width of {width}"), expected))
        }
        None => Ok(()),
    }
}

/// The cells that activations are calibrated on: those of the training.
fn calibration(configuration: &Configuration, form: ActorForm) -> Mixture {
    match configuration.mixture.as_slice() {
        [] => Mixture::alone(&configuration.scenario, [form.min_vehicles, form.max_vehicles]),
        cells => Mixture::of(cells.to_vec()),
    }
}

/// Tables of these networks: the one that all vehicles share, or those of some vehicles.
///
/// # Errors
/// If a layer or a width is none that a table can hold.
pub fn actor_tables(
    identity: &RunIdentity,
    actors: &Actors,
    vehicles: Range<usize>,
) -> Result<Vec<WeightTable>> {
    check_widths(actors)?;
    let mixture = calibration(&identity.configuration, actors.form);
    let setting = mixture.setting();
    let cells = mixture.cells();
    let watched: Vec<Vec<(usize, Vec<i8>)>> = (0..WORLDS * cells.len() as u64)
        .into_par_iter()
        .map(|world| {
            let (cell, part) = (&cells[(world / WORLDS) as usize], world % WORLDS);
            let first = random::world(identity.seed, 0, 1, FIRST_WORLD + world);
            let mut scenario = cell.draw(&mut first.stream(Role::Policy, 0));
            let [least, most] = cell.vehicles;
            scenario.cell.vehicles = least + ((u64::from(most - least) * part) / (WORLDS - 1)) as u32;
            let worlds = first.world..first.world + 1;
            let mut environment = random::worlds(&scenario, identity.seed, worlds);
            let mut inputs = Vec::new();
            watch_inputs(&mut environment, actors, setting, SLOTS, |vehicle, input| {
                if actors.shared() || vehicles.contains(&vehicle) {
                    inputs.push((vehicle, input.to_vec()));
                }
            });
            inputs
        })
        .collect();
    let continuous = actors.form.output == OutputForm::SubChannelAndPower;
    let output_step = continuous.then_some(1.0 / f64::from(CONTINUOUS_ONE));
    let sub_channels = mixture.sub_channels() as usize;
    let header = Header {
        max_sub_channels: SubChannels::new(sub_channels).unwrap_or(SubChannels::ONE),
        observation_form: actors.form.observation,
        output_form: actors.form.output,
        max_vehicles: u16::try_from(actors.form.max_vehicles).unwrap_or(u16::MAX),
        required_sinr: setting.required_sinr,
        power_plan: setting.power_plan,
        provenance: provenance(identity.seed),
    };
    let table = |vehicle: usize| {
        let inputs: Vec<i8> = watched
            .iter()
            .flatten()
            .filter(|(seen, _)| actors.shared() || *seen == vehicle)
            .flat_map(|(_, input)| input.iter().copied())
            .collect();
        let network = for_table(&actors.networks[vehicle], actors.form);
        let place = if actors.shared() {
            "actor".to_owned()
        } else {
            format!("actor of vehicle {vehicle}")
        };
        let bytes = quantise(&network, &inputs, output_step)
            .and_then(|quantised| table_bytes(&quantised, &header))
            .map_err(|error| error.within(&place))?;
        WeightTable::new(place, bytes)
    };
    let tables: Vec<Result<WeightTable>> = vehicles.clone().into_par_iter().map(table).collect();
    tables.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::Preset;
    use crate::evaluate::compare;
    use host_sim::mobility::Grid;
    use host_sim::simulation::{Extent, Simulation};

    /// A table of each form decides as its float network does, on worlds that it was not calibrated on.
    #[test]
    fn actors_of_every_form_become_tables_that_decide_alike() {
        let forms = [
            ("paper", "sub-channel-and-power", true),
            ("paper", "actions", true),
            ("age-one-hot", "sub-channels", true),
            ("firmware", "sub-channels", false),
        ];
        for (observation, action, silence) in forms {
            let settings = [
                "scenario.cell.vehicles=3",
                "maddpg.actor_hidden=[300, 24]",
                "maddpg.local_critic_hidden=[8]",
                "maddpg.global_critic_hidden=[8]",
                &format!("maddpg.observation={observation:?}"),
                &format!("maddpg.action={action:?}"),
                &format!("maddpg.silence={silence}"),
            ];
            let identity = RunIdentity::new(1, Preset::Companion.with(&settings).unwrap());
            let mut learner = identity.configuration.learner(1).unwrap();
            let _metrics = learner.advance();
            let actors = learner.actors();
            let tables = actor_tables(&identity, &actors, 0..3).unwrap();
            let tables: Vec<_> = tables.iter().map(|table| table.parse().unwrap()).collect();
            assert_eq!(tables.len(), 3);
            assert_eq!(tables[0].observation_form(), actors.form.observation);
            assert_eq!(tables[0].output_form(), actors.form.output);
            let simulation = Simulation {
                scenario: &identity.configuration.scenario,
                source: &Grid,
                extent: Extent {
                    seed: 1,
                    worlds: 4,
                    slots: 300,
                    warmup: 20,
                },
            };
            let compared = compare(&simulation, &actors, &tables).unwrap();
            assert!(compared.agreement > 0.99, "{observation}, {action}: {compared:?}");
        }
    }
}
