//! One key of a grid with its values.

use kit::error::{Error, Result};
use toml::{Table, Value};

/// Most points of a grid (chosen: a file each, and a table that any tool still opens).
pub const MOST_POINTS: usize = 100_000;

/// What a key's values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers from 0.
    Integer,
    /// Numbers.
    Number,
    /// True or false.
    Flag,
    /// Names.
    Text,
    /// Files, relative to the grid's folder; perhaps with a word for none.
    File(Option<&'static str>),
    /// What moves vehicles: [`GRID`], or a trace or SUMO configuration relative to the grid's folder.
    Mobility,
    /// Road networks, files or folders relative to the grid's folder, with a word for none.
    Network(&'static str),
}

/// Written for the table that is built into the firmware, in a list of tables.
pub const BUILT_IN_TABLE: &str = "built-in";

/// Written for the urban grid, in a list of networks or traces.
pub const GRID: &str = "grid";

/// The key of the number of vehicles, which is the scenario's `cell.vehicles` by a shorter name.
pub const VEHICLES: &str = "vehicles";

/// The key of the policy.
pub const POLICY: &str = "policy";

/// The key of the seed.
pub const SEED: &str = "seed";

/// A key with its values, each once.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// `policy`, `radio.max_power_dbm` and so on.
    pub key: String,
    /// The type of its values.
    pub kind: Kind,
    /// At least one, all of one type: [`Value::Integer`], [`Value::Float`], [`Value::Boolean`] or [`Value::String`].
    pub values: Vec<Value>,
}

impl Axis {
    /// An axis from what stands in the file: a value, a list, or `{ from = 1, to = 8 }` with both ends.
    ///
    /// # Errors
    /// `place` names the key; no value, one that comes twice or has another type.
    pub fn new(place: &str, key: &str, kind: Kind, found: Value) -> Result<Self> {
        let listed = match found {
            Value::Array(values) => values,
            Value::Table(range) => integers(place, &range)?,
            value => vec![value],
        };
        if listed.is_empty() {
            return Err(Error::input(place, "no value", "at least one"));
        }
        let mut values: Vec<Value> = Vec::new();
        for value in listed {
            let expected = match kind {
                Kind::Integer => "whole numbers from 0",
                Kind::Number => "numbers",
                Kind::Flag => "true or false",
                Kind::Text | Kind::File(_) | Kind::Mobility | Kind::Network(_) => "text",
            };
            let value = match (kind, value) {
                (Kind::Number, Value::Integer(value)) => Value::Float(value as f64),
                (Kind::Number, value @ Value::Float(_))
                | (Kind::Flag, value @ Value::Boolean(_))
                | (
                    Kind::Text | Kind::File(_) | Kind::Mobility | Kind::Network(_),
                    value @ Value::String(_),
                ) => value,
                (Kind::Integer, Value::Integer(value)) if value >= 0 => Value::Integer(value),
                (_, value) => return Err(Error::input(place, value, expected)),
            };
            values.push(value);
        }
        let mut sorted: Vec<String> = values.iter().map(text).collect();
        sorted.sort_unstable();
        if let Some(twice) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Error::input(
                place,
                format!("{} twice", twice[0]),
                "every value once",
            ));
        }
        Ok(Self {
            key: key.to_owned(),
            kind,
            values,
        })
    }
}

/// The integers of a range, both ends among them.
fn integers(place: &str, range: &Table) -> Result<Vec<Value>> {
    let expected = "{ from = 1, to = 8 } and perhaps step = 1, whole numbers from 0";
    let number = |key: &str| range.get(key).and_then(Value::as_integer);
    let known = |key: &String| ["from", "to", "step"].contains(&key.as_str());
    let step = if range.contains_key("step") {
        number("step")
    } else {
        Some(1)
    };
    match (number("from"), number("to"), step) {
        (Some(from), Some(to), Some(step)) if from >= 0 && step > 0 && range.keys().all(known) => {
            let values = (to.saturating_sub(from)) / step;
            if values >= MOST_POINTS as i64 {
                return Err(Error::input(
                    place,
                    Value::Table(range.clone()),
                    "a shorter range",
                ));
            }
            Ok((from..=to).step_by(step as usize).map(Value::Integer).collect())
        }
        _ => Err(Error::input(place, Value::Table(range.clone()), expected)),
    }
}

/// A value as the command line takes it.
pub fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Float(number) => number.to_string(),
        other => other.to_string(),
    }
}
