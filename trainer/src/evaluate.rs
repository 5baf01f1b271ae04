//! Trained actors as policies, in float and in int8, on the same held-out worlds.

use crate::forms;
use crate::laboratory::actors::Actors;
use crate::network::perceptron::{Pass, Rows};
use firmware::actor::Actor;
use firmware::decision::{Decision, PowerPlan};
use firmware::lots::Identity;
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::units::Level;
use host_sim::age::AgeSummary;
use host_sim::decisions::{Decisions, VehicleDecisions};
use host_sim::environment::Environment;
use host_sim::lanes::LANES;
use host_sim::policy::{Decider, Policy, Setup, actor, power_plan};
use host_sim::scenario::Scenario;
use host_sim::senses::Senses;
use host_sim::simulation::Simulation;
use host_sim::stream::Stream;
use kit::error::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering};

/// Decisions on which the two forms agree: silence, or the same sub-channel with powers that are at most 1 dB apart.
#[derive(Debug, Default)]
pub struct Agreement {
    same: AtomicU64,
    all: AtomicU64,
}

/// How far apart powers of the same decision may be, in 1/256 dB (chosen).
const SAME_POWER: u16 = 1 << 8;

fn agree(a: Decision, b: Decision) -> bool {
    let parts = |decision| match decision {
        Decision::Silent => (None, 0),
        Decision::Transmit { sub_channel, power } => (Some(sub_channel), power.to_bits()),
    };
    let ((a, a_power), (b, b_power)) = (parts(a), parts(b));
    a == b && a_power.abs_diff(b_power) <= SAME_POWER
}

impl Agreement {
    /// Fraction of decisions, if there were any. Sums of whole numbers do not depend on the order of threads.
    pub fn fraction(&self) -> Option<f64> {
        let all = self.all.load(Ordering::Relaxed);
        (all > 0).then(|| self.same.load(Ordering::Relaxed) as f64 / all as f64)
    }
}

/// The scenario's part in what an actor sees and does.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Level at which a lone transmission succeeds.
    pub required_sinr: Level,
    /// How actions become power.
    pub power_plan: PowerPlan,
}

impl Setting {
    /// What actors see and do in a scenario.
    pub fn of_scenario(scenario: &Scenario) -> Self {
        Self {
            required_sinr: scenario.radio.required_level(),
            power_plan: power_plan(scenario),
        }
    }

    /// That of the scenario that a table was made for.
    pub fn of_table(table: &Table<'_>) -> Self {
        Self {
            required_sinr: table.required_sinr(),
            power_plan: *table.power_plan(),
        }
    }
}

/// Number of the exploring actors' random streams: far from those of policies' kinds.
const EXPLORATION_STREAM: u32 = u32::MAX;

/// The float networks decide.
pub struct FloatActors<'a> {
    actors: &'a Actors,
    setting: Setting,
    /// Of exploration, one a world; without them every decision is greedy.
    explore: Vec<Stream>,
    /// What a vehicle sees in its worlds, and the inputs made of it, one after the other.
    observed: Vec<(usize, Observation)>,
    inputs: Vec<f32>,
    pass: Pass,
    outputs: Vec<f32>,
    /// One table, or one for each vehicle, that is asked too.
    quantised: Vec<Actor<'a>>,
    agreement: &'a Agreement,
}

impl<'a> FloatActors<'a> {
    /// Greedy; at every decision the int8 form is asked too, if there is one, and counted into `agreement`.
    pub fn greedy(
        actors: &'a Actors,
        setting: Setting,
        tables: &[Table<'a>],
        agreement: &'a Agreement,
    ) -> Self {
        Self {
            actors,
            setting,
            explore: Vec::new(),
            observed: Vec::new(),
            inputs: Vec::new(),
            pass: Pass::default(),
            outputs: Vec::new(),
            quantised: tables.iter().cloned().map(Actor::new).collect(),
            agreement,
        }
    }

    /// As in training, with a stream of each world's own.
    pub fn exploring(
        actors: &'a Actors,
        setting: Setting,
        setup: &Setup<'_>,
        agreement: &'a Agreement,
    ) -> Self {
        Self {
            explore: setup.streams(EXPLORATION_STREAM).collect(),
            ..Self::greedy(actors, setting, &[], agreement)
        }
    }
}

impl Policy for FloatActors<'_> {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let Setting {
            required_sinr,
            power_plan,
        } = self.setting;
        let (form, vehicle) = (self.actors.form, senses.vehicle());
        let last = self.quantised.len().saturating_sub(1);
        let (mut same, mut all) = (0, 0);
        let observe = |lane: usize| {
            let identity = Identity(senses.identities()[lane]);
            Some((lane, Observation::new(&senses.measurement(lane)?, identity)))
        };
        self.observed.clear();
        self.observed.extend((0..senses.worlds()).filter_map(observe));
        let (length, samples) = (form.observation.inputs(), self.observed.len());
        self.inputs.resize(samples * length, 0.0);
        for ((_, observation), input) in self.observed.iter().zip(self.inputs.chunks_exact_mut(length)) {
            forms::observe(form.observation, observation, required_sinr, input);
        }
        let network = self.actors.network(vehicle);
        let columns = network.forward_batch(Rows::all(&self.inputs, length), &mut self.pass);
        for (sample, (lane, observation)) in self.observed.iter().enumerate() {
            self.outputs.clear();
            self.outputs.extend(columns.iter().skip(sample).step_by(samples));
            let explore = self.explore.get_mut(senses.block() * LANES + lane);
            let decision = forms::decide(
                form.output,
                &self.outputs,
                form.noise,
                observation,
                &power_plan,
                explore,
            );
            decisions.set(*lane, decision);
            if let Some(quantised) = self.quantised.get_mut(vehicle.min(last)) {
                same += u64::from(agree(decision, quantised.decide(observation)));
                all += 1;
            }
        }
        let _ = self.agreement.same.fetch_add(same, Ordering::Relaxed);
        let _ = self.agreement.all.fetch_add(all, Ordering::Relaxed);
    }
}

/// What the greedy networks see in the worlds of an environment, vehicle by vehicle in every slot, as a table's form encodes it:
/// for calibration.
pub fn watch_inputs(
    environment: &mut Environment<'_>,
    actors: &Actors,
    setting: Setting,
    slots: u32,
    mut seen: impl FnMut(usize, &[i8]),
) {
    let Setting {
        required_sinr,
        power_plan,
    } = setting;
    let form = actors.form;
    let mut input = vec![0.0; form.observation.inputs()];
    let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
    for _ in 0..slots {
        for &vehicle in environment.present() {
            for world in 0..environment.worlds() {
                let Some(measurement) = environment.measurement(world, vehicle) else {
                    continue;
                };
                let observation = Observation::new(&measurement, environment.identity(world, vehicle));
                forms::observe(form.observation, &observation, required_sinr, &mut input);
                let outputs = actors.network(vehicle).forward(&input);
                let decision =
                    forms::decide(form.output, &outputs, form.noise, &observation, &power_plan, None);
                decisions.set(world, vehicle, decision);
                form.observation
                    .encode(&observation, required_sinr, |input| seen(vehicle, input));
            }
        }
        environment.step(&decisions);
    }
}

/// Float and int8 on the same worlds.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// Fraction of decisions that agree, along the float network's trajectories.
    pub agreement: f64,
    /// Mean age with the table.
    pub quantised_age_ms: f64,
    /// Mean age with the float network.
    pub float_age_ms: f64,
}

/// Compares actors with their tables, on the current rayon pool.
///
/// # Errors
/// If the tables do not serve the scenario.
pub fn compare(simulation: &Simulation<'_>, actors: &Actors, tables: &[Table<'_>]) -> Result<Comparison> {
    let setting = tables
        .first()
        .map_or_else(|| Setting::of_scenario(simulation.scenario), Setting::of_table);
    let float = float(simulation, actors, setting, tables, || ())?;
    Ok(Comparison {
        agreement: float.1.unwrap_or(1.0),
        quantised_age_ms: quantised(simulation, tables, || ())?.mean_ms,
        float_age_ms: float.0.mean_ms,
    })
}

/// Ages with the firmware's units and these tables: one for all, or one for each vehicle. `ended` is called after each world.
///
/// # Errors
/// If they do not serve the scenario.
pub fn quantised(
    simulation: &Simulation<'_>,
    tables: &[Table<'_>],
    ended: impl Fn() + Sync,
) -> Result<AgeSummary> {
    let vehicles = simulation.source.most_vehicles(simulation.scenario);
    for table in tables {
        actor::KIND.check(simulation.scenario, vehicles, table)?;
    }
    if tables.len() > 1 {
        check_vehicles(simulation, tables.len())?;
    }
    let build = |setup: &Setup<'_>| Decider::Policy(actor::build(setup, tables));
    Ok(simulation.run(build, |_, _| ended())?.0)
}

/// Ages with the greedy float networks, and the fraction of decisions that the tables share, if there are any.
///
/// # Errors
/// If there are more vehicles than networks of their own.
pub fn float(
    simulation: &Simulation<'_>,
    actors: &Actors,
    setting: Setting,
    tables: &[Table<'_>],
    ended: impl Fn() + Sync,
) -> Result<(AgeSummary, Option<f64>)> {
    check_actors(simulation, actors)?;
    let agreement = Agreement::default();
    let build = |_: &Setup<'_>| -> Decider<'_> {
        Decider::Policy(Box::new(FloatActors::greedy(actors, setting, tables, &agreement)))
    };
    let (ages, _) = simulation.run(build, |_, _| ended())?;
    Ok((ages, agreement.fraction()))
}

/// Ages with the float networks exploring as in training.
///
/// # Errors
/// As [`float`].
pub fn exploring(
    simulation: &Simulation<'_>,
    actors: &Actors,
    setting: Setting,
    ended: impl Fn() + Sync,
) -> Result<AgeSummary> {
    check_actors(simulation, actors)?;
    let agreement = Agreement::default();
    let build = |setup: &Setup<'_>| -> Decider<'_> {
        Decider::Policy(Box::new(FloatActors::exploring(
            actors, setting, setup, &agreement,
        )))
    };
    Ok(simulation.run(build, |_, _| ended())?.0)
}

fn check_actors(simulation: &Simulation<'_>, actors: &Actors) -> Result<()> {
    if actors.shared() {
        return Ok(());
    }
    check_vehicles(simulation, actors.networks.len())
}

/// Vehicles with an actor each can be fewer than in training, but not more.
fn check_vehicles(simulation: &Simulation<'_>, actors: usize) -> Result<()> {
    let vehicles = simulation.source.vehicles(simulation.scenario);
    if vehicles <= actors {
        return Ok(());
    }
    let expected = format!("at most {actors}, each with an actor of its own");
    Err(Error::input("vehicles", vehicles, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actor_table::actor_tables;
    use crate::configuration::Preset;
    use crate::run_folder::RunIdentity;
    use host_sim::mobility::Grid;
    use host_sim::simulation::Extent;

    /// Three vehicles with a copy each of one actor decide as three that share it, in every form.
    #[test]
    fn own_actors_that_are_equal_are_one_shared_actor() {
        let configuration = Preset::Evolution.with(&["scenario.cell.vehicles=3"]);
        let identity = RunIdentity::new(1, configuration.unwrap());
        let mut learner = identity.configuration.learner(1).unwrap();
        let _metrics = learner.advance();
        let shared = learner.actors();
        let own = Actors {
            networks: vec![shared.networks[0].clone(); 3],
            ..shared.clone()
        };
        let simulation = Simulation {
            scenario: &identity.configuration.scenario,
            source: &Grid,
            extent: Extent {
                seed: 1,
                worlds: 3,
                slots: 200,
                warmup: 20,
            },
        };
        let setting = Setting::of_scenario(simulation.scenario);
        let table = actor_tables(&identity, &shared, 0..1).unwrap().remove(0);
        let table = table.parse().unwrap();
        let tables = vec![table.clone(); 3];
        let ages = [
            quantised(&simulation, &[table], || ()).unwrap(),
            quantised(&simulation, &tables, || ()).unwrap(),
        ];
        assert_eq!(ages[0].mean_ms, ages[1].mean_ms);
        let (alone, _) = float(&simulation, &shared, setting, &[], || ()).unwrap();
        let (each, agreement) = float(&simulation, &own, setting, &tables, || ()).unwrap();
        assert_eq!(alone.mean_ms, each.mean_ms);
        assert!(agreement.unwrap() > 0.9);
        let ages =
            [&shared, &own].map(|actors| exploring(&simulation, actors, setting, || ()).unwrap().mean_ms);
        assert_eq!(ages[0], ages[1]);
        assert_ne!(ages[0], alone.mean_ms);
        // Each own table is calibrated on what its vehicle sees.
        assert_eq!(actor_tables(&identity, &own, 0..3).unwrap().len(), 3);

        let fewer = Actors {
            networks: own.networks[..2].to_vec(),
            ..own
        };
        let message = float(&simulation, &fewer, setting, &[], || ())
            .unwrap_err()
            .to_string();
        assert_eq!(
            message,
            "vehicles: found 3, expected at most 2, each with an actor of its own"
        );
    }
}
