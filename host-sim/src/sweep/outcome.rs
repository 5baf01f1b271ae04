//! What is kept of a point: nothing that depends on the machine or on how long it took.

use super::commands::Command;
use kit::error::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Number, Value};
use std::collections::BTreeMap;

/// Changes whenever the same input gives other results, so that old ones are not mixed with new ones.
pub const VERSION: u32 = 9;

/// A point's result: by the name of its command's columns a number, or nothing where there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Outcome(BTreeMap<String, Option<Number>>);

impl Outcome {
    /// The columns of a command's JSON object.
    ///
    /// # Errors
    /// If something else than a number stands at a column's place.
    pub fn of(command: &Command, object: &Value) -> Result<Self> {
        let columns = command.columns().map(|column| {
            let number = match object.pointer(column.place) {
                None | Some(Value::Null) => None,
                Some(Value::Number(number)) => Some(number.clone()),
                Some(other) => return Err(Error::input(column.place, other, "a number")),
            };
            Ok((column.name.to_owned(), number))
        });
        Ok(Self(columns.collect::<Result<_>>()?))
    }

    /// Whether it has all columns of a command, and no others.
    pub fn fits(&self, command: &Command) -> bool {
        let known = command.columns().all(|column| self.0.contains_key(column.name));
        known && command.columns().count() == self.0.len()
    }

    /// The count of this name.
    pub fn count(&self, name: &str) -> Option<u64> {
        self.0.get(name)?.as_ref()?.as_u64()
    }

    /// The number of this name.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.as_ref()?.as_f64()
    }
}
