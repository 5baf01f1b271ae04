//! A run's actors and tables, as they are evaluated and exported: what the run left, or made anew.

use crate::actor_table::actor_tables;
use crate::evaluate::Setting;
use crate::laboratory::actors::Actors;
use crate::run_folder::{RunFolder, RunIdentity};
use firmware::table::Table;
use host_sim::weight_table::WeightTable;
use kit::error::{Error, Result};

/// A run's actors with all that their evaluation needs.
pub struct TrainedActors {
    /// The float networks.
    pub actors: Actors,
    /// What they see and do.
    pub setting: Setting,
    /// One table, or one for each vehicle; none where the form or a layer is none for tables.
    pub tables: Vec<WeightTable>,
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
                (identity.configuration.cells().setting(), tables)
            }
            _ => {
                let table = own_table(folder, &actors, identity.as_ref())?;
                let setting = Setting::of_table(&table.parse()?);
                (setting, Ok(vec![table]))
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

/// The table that a run left.
fn own_table(folder: &RunFolder, actors: &Actors, identity: Option<&RunIdentity>) -> Result<WeightTable> {
    let table = WeightTable::read(&folder.table())?;
    check_belongs(folder, actors, identity, &table.parse()?)?;
    Ok(table)
}

/// The table of one of a run's networks: what the run left, or made anew.
///
/// # Errors
/// If there is none, or if it is of something else.
pub fn table_of(folder: &RunFolder, actors: &Actors, vehicle: usize) -> Result<WeightTable> {
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
    let description = |widths: &[usize], observation, outputs, seed, vehicles| {
        format!("widths {widths:?}, {observation:?}, {outputs:?}, seed {seed}, {vehicles} vehicles at most")
    };
    let (form, seed) = (actors.form, table.provenance().seed);
    let expected = description(
        actors.networks[0].widths(),
        form.observation,
        form.output,
        identity.map_or(seed, |identity| identity.seed),
        form.max_vehicles,
    );
    let found = description(
        &table.network().widths().collect::<Vec<_>>(),
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
