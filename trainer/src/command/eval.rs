//! `trainer eval`: a table, or all forms of a run's actors, on held-out worlds.

use crate::actor_table::{actor_tables, setting};
use crate::evaluate::{Agreement, FloatActors, Setting};
use crate::laboratory::actors::Actors;
use crate::run_folder::{RunFolder, RunIdentity};
use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::command::options::{parse_table, progress_bar, table_bytes, thread_pool};
use host_sim::command::run::{PreparedRun, RunOptions};
use host_sim::environment::Environment;
use host_sim::error::{Error, Result};
use host_sim::policy::{Policy, PolicyName, actor};
use host_sim::report::{PolicyResult, ages};
use host_sim::say;
use host_sim::scenario::Preset;
use host_sim::simulation::Simulation;
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Options of `eval`.
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("policy", |policy| policy.help("Policy to run beside a run's actors (repeatable) [default: central with --run, else all]")))]
pub struct EvalArguments {
    /// Folder of a training run: evaluates its actors in int8 (actor), in float (float), and exploring as in training
    /// (exploring); in the scenario of the run unless --set changes it; beside the central scheduler unless --policy is given
    #[arg(long, value_name = "DIR", conflicts_with = "table")]
    pub run: Option<PathBuf>,
    /// Worlds, policies and output.
    #[command(flatten)]
    pub options: RunOptions,
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
        .map_or_else(|| setting(simulation.scenario), Setting::of_table);
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
        PolicyName::Actor.check(simulation.scenario, vehicles, table)?;
    }
    if tables.len() > 1 {
        check_vehicles(simulation, tables.len())?;
    }
    let build = |environment: &Environment<'_>| -> Box<dyn Policy + '_> { actor::build(environment, tables) };
    Ok(simulation.run(build, |_| ended())?.0)
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
    let build = |_: &Environment<'_>| -> Box<dyn Policy + '_> {
        Box::new(FloatActors::greedy(actors, setting, tables, &agreement))
    };
    let (ages, _) = simulation.run(build, |_| ended())?;
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
    let build = |environment: &Environment<'_>| -> Box<dyn Policy + '_> {
        Box::new(FloatActors::exploring(actors, setting, environment, &agreement))
    };
    Ok(simulation.run(build, |_| ended())?.0)
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

/// A run's actors with all that their evaluation needs.
pub struct TrainedActors {
    /// The float networks.
    pub actors: Actors,
    /// What they see and do.
    pub setting: Setting,
    /// One table, or one for each vehicle; none where the form or a layer is none for tables.
    pub tables: Vec<Vec<u8>>,
    /// Why there is none.
    pub obstacle: Option<Error>,
    /// What the run was told, if `train` made it.
    pub identity: Option<RunIdentity>,
}

impl TrainedActors {
    /// Reads a run folder, on the current rayon pool.
    ///
    /// # Errors
    /// The file that is missing or does not fit.
    pub fn read(folder: &RunFolder) -> Result<Self> {
        let (actors, identity) = (folder.read_actors()?, folder.read_identity()?);
        let (setting, tables) = match &identity {
            // Each vehicle's own table, or one of a run that is still going on, is made when it is asked for.
            Some(identity) if !folder.table().exists() => {
                let tables = actor_tables(identity, &actors, 0..actors.networks.len());
                (setting(&identity.configuration.scenario), tables)
            }
            _ => {
                let bytes = own_table(folder, &actors, identity.as_ref())?;
                let setting = Setting::of_table(&parse_table(Some(&folder.table()), &bytes)?);
                (setting, Ok(vec![bytes]))
            }
        };
        let (tables, obstacle) = match tables {
            Ok(tables) => (tables, None),
            Err(error) => (Vec::new(), Some(error)),
        };
        Ok(Self {
            actors,
            setting,
            tables,
            obstacle,
            identity,
        })
    }
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit.
pub fn run(arguments: &EvalArguments) -> Result<()> {
    let mut options = arguments.options.clone();
    options.check_typed()?;
    let pool = thread_pool(options.threads)?;
    let Some(folder) = &arguments.run else {
        let prepared = options.prepare()?;
        let results = pool.install(|| prepared.results(options.json))?;
        report(&prepared, &results, None, None, options.json);
        return Ok(());
    };
    let trained = pool.install(|| TrainedActors::read(&RunFolder::new(folder)))?;
    if let Some(identity) = &trained.identity {
        options = in_scenario_of(identity, options)?;
    }
    let asked = std::mem::replace(&mut options.policy, vec![PolicyName::Central]);
    let mut prepared = options.prepare()?;
    check_radio(&prepared, trained.setting)?;
    if !asked.is_empty() {
        prepared.policies = asked;
        // The actor is the run's own, which comes anyway.
        prepared.policies.retain(|policy| *policy != PolicyName::Actor);
        prepared.policies.sort();
        prepared.policies.dedup();
    }
    let (mut results, agreement) = pool.install(|| trained_results(&prepared, &trained, options.json))?;
    results.extend(pool.install(|| prepared.results(options.json))?);
    let obstacle = trained.obstacle.as_ref();
    report(&prepared, &results, agreement, obstacle, options.json);
    Ok(())
}

/// The options with the run's scenario below the user's settings.
fn in_scenario_of(identity: &RunIdentity, mut options: RunOptions) -> Result<RunOptions> {
    let scenario = &mut options.scenario;
    if let Some(file) = &scenario.scenario {
        return Err(Error::input(
            "--scenario",
            file.display(),
            "none with --run, whose scenario is taken; --set changes it",
        ));
    }
    if scenario.preset != Preset::default() {
        let found = format!("{:?}", scenario.preset);
        return Err(Error::input(
            "--preset",
            found,
            "none with --run, whose scenario is taken; --set changes it",
        ));
    }
    let table = toml::Table::try_from(&identity.configuration.scenario)
        .map_err(|error| Error::input("scenario", error, "one that TOML can hold"))?;
    let mut settings = Vec::new();
    for (section, keys) in &table {
        for (key, value) in keys.as_table().into_iter().flatten() {
            settings.push(format!("{section}.{key}={value}"));
        }
    }
    settings.append(&mut scenario.set);
    scenario.set = settings;
    Ok(options)
}

/// Measured gains are relative to full power, and the joiner levels to the required SINR: actors live in the scenario that
/// they were made for.
fn check_radio(prepared: &PreparedRun, known: Setting) -> Result<()> {
    let radio = &prepared.scenario.radio;
    let asked = setting(&prepared.scenario);
    if asked.power_plan.max_power != known.power_plan.max_power {
        let expected = format!("{} dBm as in training", known.power_plan.max_power.value());
        return Err(Error::input("radio.max_power_dbm", radio.max_power_dbm, expected));
    }
    if asked.required_sinr != known.required_sinr {
        let expected = format!(
            "a required SINR of {:.3} dB as in training",
            known.required_sinr.to_num::<f64>()
        );
        return Err(Error::input(
            "radio.min_spectral_efficiency",
            radio.min_spectral_efficiency,
            expected,
        ));
    }
    Ok(())
}

/// All forms of the actors, and how far the int8 form decides like the float form.
fn trained_results(
    prepared: &PreparedRun,
    trained: &TrainedActors,
    hide_progress: bool,
) -> Result<(Vec<PolicyResult>, Option<f64>)> {
    let simulation = prepared.simulation();
    let tables: Result<Vec<Table<'_>>> = trained
        .tables
        .iter()
        .map(|bytes| parse_table(None, bytes))
        .collect();
    let (tables, actors, setting) = (tables?, &trained.actors, trained.setting);
    let extent = prepared.extent;
    let slots = f64::from(extent.worlds) * f64::from(extent.slots_per_world());
    let result = |name, ages: AgeSummary, start: Instant| PolicyResult {
        name,
        ages,
        traffic: None,
        slots_per_second: slots / start.elapsed().as_secs_f64(),
    };
    let forms = 2 + u64::from(!tables.is_empty());
    let template = "{msg:14} {bar:40} {pos}/{len} worlds, {elapsed}, {eta} left";
    let progress = progress_bar(forms * u64::from(extent.worlds), template, hide_progress);
    progress.enable_steady_tick(Duration::from_secs(1));
    let ended = || progress.inc(1);
    let mut results = Vec::new();
    if !tables.is_empty() {
        progress.set_message("actor");
        let start = Instant::now();
        results.push(result("actor", quantised(&simulation, &tables, ended)?, start));
    }
    progress.set_message("float");
    let start = Instant::now();
    let (ages, agreement) = float(&simulation, actors, setting, &tables, ended)?;
    results.push(result("float", ages, start));
    progress.set_message("exploring");
    let start = Instant::now();
    let ages = exploring(&simulation, actors, setting, ended)?;
    results.push(result("exploring", ages, start));
    progress.finish_and_clear();
    Ok((results, agreement))
}

fn report(
    prepared: &PreparedRun,
    results: &[PolicyResult],
    agreement: Option<f64>,
    obstacle: Option<&Error>,
    json: bool,
) {
    let mut object = prepared.to_json(results);
    let mean = |name: &str| {
        results
            .iter()
            .find(|result| result.name == name)
            .map(|result| result.ages.mean_ms)
    };
    let lost = mean("actor")
        .zip(mean("float"))
        .map(|(actor, float)| actor - float);
    if !json {
        let bound = prepared.simulation().bound_age_ms();
        say!("{}", ages::table(results, &prepared.description(), bound));
    }
    if let Some(float) = mean("float") {
        object["float_mean_age_ms"] = json!(float);
        object["age_lost_ms"] = json!(lost);
        object["agreement"] = json!(agreement);
        object["no_table_because"] = json!(obstacle.map(Error::to_string));
        if !json {
            match (lost.zip(agreement), obstacle) {
                (Some((lost, agreement)), _) => say!(
                    "Actor: int8 as deployed. Float: greedy too; int8 loses {lost:.3} ms, and {:.3} % of decisions agree.",
                    100.0 * agreement
                ),
                (None, Some(obstacle)) => say!("No int8 form: {obstacle}. Float: greedy."),
                (None, None) => say!("Float: greedy."),
            }
            say!("Exploring: as in training, drawn or with noise.");
        }
    }
    if json {
        say!("{object}");
    }
}

/// The table that a run left.
fn own_table(folder: &RunFolder, actors: &Actors, identity: Option<&RunIdentity>) -> Result<Vec<u8>> {
    let bytes = table_bytes(Some(&folder.table()))?;
    check_belongs(
        folder,
        actors,
        identity,
        &parse_table(Some(&folder.table()), &bytes)?,
    )?;
    Ok(bytes)
}

/// The table of one of a run's networks: what the run left, or made anew.
///
/// # Errors
/// If there is none, or if it is of something else.
pub fn table_of(folder: &RunFolder, actors: &Actors, vehicle: usize) -> Result<Vec<u8>> {
    let identity = folder.read_identity()?;
    match &identity {
        Some(identity) if !folder.table().exists() => {
            Ok(actor_tables(identity, actors, vehicle..vehicle + 1)?.swap_remove(0))
        }
        _ => own_table(folder, actors, identity.as_ref()),
    }
}

/// Checks that a table can be of these networks, as far as its header tells.
fn check_belongs(
    folder: &RunFolder,
    actors: &Actors,
    identity: Option<&RunIdentity>,
    table: &Table<'_>,
) -> Result<()> {
    let description = |widths: Vec<usize>, observation, outputs, seed, vehicles| {
        format!("widths {widths:?}, {observation:?}, {outputs:?}, seed {seed}, {vehicles} vehicles at most")
    };
    let (form, seed) = (actors.form, table.provenance().seed);
    let expected = description(
        actors.networks[0].widths(),
        form.observation.in_table(),
        form.output.in_table(),
        identity.map_or(seed, |identity| identity.seed),
        form.max_vehicles,
    );
    let found = description(
        table.network().widths().collect(),
        table.observation_form(),
        table.output_form(),
        seed,
        table.max_vehicles().into(),
    );
    if found == expected && actors.shared() {
        return Ok(());
    }
    let expected = if actors.shared() {
        format!("{expected} as the networks beside it")
    } else {
        "none: each vehicle has its own network".to_owned()
    };
    Err(Error::input(folder.table().display(), found, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::configuration::Preset;
    use host_sim::mobility::MobilitySource;
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
            source: &MobilitySource::Grid,
            extent: Extent {
                seed: 1,
                worlds: 3,
                slots: 200,
                warmup: 20,
            },
        };
        let setting = setting(simulation.scenario);
        let bytes = actor_tables(&identity, &shared, 0..1).unwrap().remove(0);
        let table = parse_table(None, &bytes).unwrap();
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
