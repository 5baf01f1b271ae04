//! One key of a grid with its values.

use crate::scenario::ScenarioSource;
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
    /// Files, relative to the grid's folder.
    File,
}

/// Keys of a grid before the scenario's own: options of `host-sim run`.
const BEFORE: [(&str, Kind); 2] = [("preset", Kind::Text), ("scenario", Kind::File)];

/// Keys after them. The last changes fastest from point to point.
const AFTER: [(&str, Kind); 8] = [
    ("mobility", Kind::File),
    ("table", Kind::File),
    ("worlds", Kind::Integer),
    ("slots", Kind::Integer),
    ("warmup", Kind::Integer),
    (VEHICLES, Kind::Integer),
    (POLICY, Kind::Text),
    (SEED, Kind::Integer),
];

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

/// All keys that a grid may have, in the order in which points count them.
pub fn known() -> Result<Vec<(String, Kind)>> {
    let scenario = Table::try_from(ScenarioSource::default().read()?)
        .map_err(|error| Error::input("preset", error, "a table of numbers"))?;
    let owned = |(key, kind): (&str, Kind)| (key.to_owned(), kind);
    let mut keys: Vec<_> = BEFORE.map(owned).into();
    for (section, table) in &scenario {
        for (name, value) in table.as_table().into_iter().flatten() {
            let key = format!("{section}.{name}");
            if key != "cell.vehicles" {
                let kind = match value {
                    Value::Float(_) => Kind::Number,
                    Value::Boolean(_) => Kind::Flag,
                    Value::String(_) => Kind::Text,
                    _ => Kind::Integer,
                };
                keys.push((key, kind));
            }
        }
    }
    keys.extend(AFTER.map(owned));
    Ok(keys)
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
                Kind::Text | Kind::File => "text",
            };
            let value = match (kind, value) {
                (Kind::Number, Value::Integer(value)) => Value::Float(value as f64),
                (Kind::Number, value @ Value::Float(_))
                | (Kind::Flag, value @ Value::Boolean(_))
                | (Kind::Text | Kind::File, value @ Value::String(_)) => value,
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
