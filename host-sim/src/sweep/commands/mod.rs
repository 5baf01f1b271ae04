//! What a point may be: one `host-sim run`, `loop` or `assign`. A command says which keys it takes, how a point of it is
//! computed, and which numbers of its JSON object are kept.

mod assign;
mod closed_loop;
mod run;

use super::Settings;
use super::axis::{Kind, SEED};
use crate::policy;
use crate::report::chart::Scale;
use crate::scenario::ScenarioSource;
use kit::choice::Choice;
use kit::error::{Error, Result};
use serde_json::Value;

/// A command whose points a grid has.
#[derive(Debug)]
pub struct Command {
    /// What the command line calls it.
    pub name: &'static str,
    /// What a point of it is.
    pub meaning: &'static str,
    /// Whether it takes a scenario: a preset, a file, and any key in them but the number of vehicles.
    pub takes_scenario: bool,
    /// Its other keys, after the scenario's. The last changes fastest from point to point.
    pub keys: &'static [(&'static str, Kind)],
    /// The policies of a grid that names none; empty if a point has no policy.
    pub policies: &'static [&'static policy::Kind],
    /// Columns of how much was computed.
    pub counts: &'static [Column],
    /// Columns of what came out; a new one goes to the end.
    pub numbers: &'static [Column],
    /// What figures show.
    pub measures: &'static [Measure],
    /// How much stands behind a figure: text with names of [counts](Self::counts) in braces.
    pub extent: &'static str,
    /// Reads and checks a point.
    pub prepare: fn(&Settings<'_>) -> Result<Task>,
}

/// What is left to do for a point that was read and checked: to compute the command's JSON object, on the current rayon pool.
pub type Task = Box<dyn FnOnce() -> Result<Value> + Send>;

/// A number of a command's JSON object.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// What the merged table calls it.
    pub name: &'static str,
    /// Where it stands in the object, as a JSON pointer.
    pub place: &'static str,
}

const fn column(name: &'static str, place: &'static str) -> Column {
    Column { name, place }
}

/// A column that figures show.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// What titles call it.
    pub title: &'static str,
    /// What files call it.
    pub file: &'static str,
    /// What its axis is called.
    pub axis: &'static str,
    /// How its axis maps values to length.
    pub scale: Scale,
    /// No value is below, wherever an interval ends.
    pub least: f64,
    /// The column of its mean.
    pub mean: &'static str,
    /// The column of half the width of its 95 % interval, if it has one.
    pub ci95: Option<&'static str>,
}

/// All commands; the first is that of a grid that names none.
pub static COMMANDS: &[&Command] = &[&run::COMMAND, &closed_loop::COMMAND, &assign::COMMAND];

impl Choice for &'static Command {
    const ALL: &'static [Self] = COMMANDS;

    fn name(self) -> &'static str {
        self.name
    }

    fn meaning(self) -> &'static str {
        self.meaning
    }
}

impl Command {
    /// Every key that a grid of this command may have, in the order in which points count them.
    pub fn known_keys(&self) -> Result<Vec<(String, Kind)>> {
        let mut known = Vec::new();
        if self.takes_scenario {
            known.push(("preset".to_owned(), Kind::Text));
            known.push(("scenario".to_owned(), Kind::File(None)));
            known.extend(scenario_keys()?);
        }
        known.extend(self.keys.iter().map(|&(key, kind)| (key.to_owned(), kind)));
        Ok(known)
    }

    /// Whether points have seeds.
    pub fn takes_seeds(&self) -> bool {
        self.keys.iter().any(|(key, _)| *key == SEED)
    }

    /// Its columns.
    pub fn columns(&self) -> impl Iterator<Item = &'static Column> {
        self.counts.iter().chain(self.numbers)
    }

    /// Whose keys a grid may have.
    pub fn whose_keys(&self) -> String {
        let scenario = if self.takes_scenario {
            " or of the scenario"
        } else {
            ""
        };
        format!("{}{scenario}", self.name)
    }
}

/// The scenario's keys. How many vehicles there are is `run`'s own key; in the loop it turns out on the road.
fn scenario_keys() -> Result<Vec<(String, Kind)>> {
    let scenario = toml::Table::try_from(ScenarioSource::default().read()?)
        .map_err(|error| Error::input("preset", error, "a table of numbers"))?;
    let mut keys = Vec::new();
    for (section, table) in &scenario {
        for (name, value) in table.as_table().into_iter().flatten() {
            let key = format!("{section}.{name}");
            if key != "cell.vehicles" {
                let kind = match value {
                    toml::Value::Float(_) => Kind::Number,
                    toml::Value::Boolean(_) => Kind::Flag,
                    toml::Value::String(_) => Kind::Text,
                    _ => Kind::Integer,
                };
                keys.push((key, kind));
            }
        }
    }
    Ok(keys)
}

#[cfg(test)]
mod tests {
    use super::{COMMANDS, Kind};

    #[test]
    fn no_result_has_the_name_of_a_setting() {
        for command in COMMANDS {
            let results = command.counts.iter().chain(command.numbers);
            for result in results {
                // A number that was set, such as `worlds`, is what comes out.
                let taken = command
                    .keys
                    .iter()
                    .any(|(key, kind)| *key == result.name && !matches!(kind, Kind::Integer | Kind::Number));
                assert!(!taken, "{}: {}", command.name, result.name);
            }
        }
    }
}
