//! What a run begins with where it does not begin from nothing: the actors of another run, and its critics.

use crate::actor_file;
use crate::laboratory::checkpoint;
use crate::laboratory::state::State;
use crate::network::Network;
use crate::run_folder::RunFolder;
use firmware::form::{ObservationForm, OutputForm};
use kit::error::{Error, Result};
use std::path::Path;

/// What a learner's actors are like.
#[derive(Clone, Copy, Debug)]
pub struct Expected<'a> {
    /// What users call the key that names the folder.
    pub key: &'a str,
    /// What they see, and what they do.
    pub form: (ObservationForm, OutputForm),
    /// Their widths.
    pub widths: &'a [usize],
    /// How many there are.
    pub count: usize,
}

/// The actors in the folder of a run, such as `trainer distil` leaves; one that all vehicles share begins each of several.
///
/// # Errors
/// The file, and what is not as the learner needs it.
pub fn actors(folder: &Path, expected: Expected<'_>) -> Result<Vec<Network>> {
    let path = RunFolder::new(folder).actors();
    if !path.exists() {
        let found = format!("{}, which does not exist", path.display());
        let expected_folder = "the folder of a run, such as `trainer distil` leaves";
        return Err(Error::input(expected.key, found, expected_folder));
    }
    let actors = actor_file::read(&path)?;
    let place = || format!("{}: {}", expected.key, path.display());
    let form = (actors.form.observation, actors.form.output);
    if form != expected.form {
        let text = |(observation, output): (ObservationForm, OutputForm)| {
            format!("observation {observation:?} and action {output:?}")
        };
        return Err(Error::input(place(), text(form), text(expected.form)));
    }
    let (found, count) = (actors.networks[0].widths(), actors.networks.len());
    if found != expected.widths || (count != expected.count && count != 1) {
        let found = format!("{count} of widths {found:?}");
        let expected = format!("{} of widths {:?}", expected.count, expected.widths);
        return Err(Error::input(place(), found, expected));
    }
    Ok((0..expected.count)
        .map(|vehicle| actors.network(vehicle).clone())
        .collect())
}

/// The state of the last checkpoint in the folder of a run, for what a learner takes of it; no parts.
///
/// # Errors
/// What is wrong with the checkpoint.
pub fn state(folder: &Path, key: &str) -> Result<State> {
    let path = RunFolder::new(folder).checkpoint();
    if !path.exists() {
        let found = format!("{}, which does not exist", path.display());
        return Err(Error::input(key, found, "the folder of a run of `trainer train`"));
    }
    let bytes = std::fs::read(&path).map_err(|source| Error::file(&path, source))?;
    checkpoint::of_any_run(&format!("{key}: {}", path.display()), &bytes)
}
