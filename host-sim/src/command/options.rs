//! Options that sub-commands share.

use crate::scenario::{Preset, Scenario, ScenarioSource};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use firmware::table::Table;
use indicatif::{ProgressBar, ProgressStyle};
use kit::choice::Choice;
use kit::error::{Error, Result};
use kit::layers::sets;
use std::path::{Path, PathBuf};

/// Which scenario.
#[derive(Clone, Debug, clap::Args)]
pub struct ScenarioArguments {
    /// TOML file whose keys replace the preset's
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Scenario to start from
    #[arg(long, value_parser = choice::<Preset>(), default_value = Preset::default().name())]
    pub preset: Preset,
    /// Replace one key, such as radio.max_power_dbm=23 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl ScenarioArguments {
    /// The scenario, with further settings laid over it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(&self, settings: impl IntoIterator<Item = String>) -> Result<Scenario> {
        let settings = self.set.iter().cloned().chain(settings).collect();
        ScenarioSource {
            preset: self.preset,
            file: self.scenario.clone(),
            settings,
        }
        .read()
    }

    /// Refuses `--set` of a key for which another option is given.
    ///
    /// # Errors
    /// [`Error::Input`] names both.
    pub fn check_not_set(&self, option: &str, key: &str) -> Result<()> {
        match self.set.iter().find(|setting| sets(setting, key)) {
            None => Ok(()),
            Some(setting) => {
                let found = format!("--set {setting} beside it");
                Err(Error::input(option, found, "one of the two"))
            }
        }
    }
}

/// Reads one of the names of a choice; help lists them with their meanings.
pub fn choice<C: Choice + Send + Sync>() -> impl TypedValueParser<Value = C> {
    let values = C::ALL
        .iter()
        .map(|choice| PossibleValue::new(choice.name()).help(choice.meaning()));
    PossibleValuesParser::new(values).try_map(|name| C::of_name("value", &name))
}

/// A thread pool of this size; one thread a core without it.
///
/// # Errors
/// If the system gives no threads.
pub fn thread_pool(threads: Option<u16>) -> Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, usize::from))
        .build();
    pool.map_err(|error| Error::input("--threads", error, "threads that the system can start"))
}

/// Bytes of a table file, or of the table built into the firmware.
///
/// # Errors
/// If the file cannot be read.
pub fn table_bytes(path: Option<&Path>) -> Result<Vec<u8>> {
    match path {
        None => Ok(firmware::tables::DISTILLED.to_vec()),
        Some(path) => std::fs::read(path).map_err(|source| Error::file(path, source)),
    }
}

/// Checks table bytes.
///
/// # Errors
/// Names the file and the field that does not fit.
pub fn parse_table<'t>(path: Option<&Path>, bytes: &'t [u8]) -> Result<Table<'t>> {
    let place = path.map_or("built-in table".to_owned(), |path| path.display().to_string());
    Table::parse(bytes).map_err(|error| Error::of_text(place, &error.to_string()))
}

/// A progress bar on stderr, unless output is for scripts.
pub fn progress_bar(steps: u64, template: &str, hidden: bool) -> ProgressBar {
    if hidden {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(template);
    ProgressBar::new(steps).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
