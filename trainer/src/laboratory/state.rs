//! What a learner remembers between two episodes: named tensors and counters.

use kit::error::{Error, Result};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;

/// Values of a tensor, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Weights, moments, observations.
    F32(Vec<f32>),
    /// Actions, flags.
    U8(Vec<u8>),
}

/// A shape and its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Lengths of the dimensions, the slowest first.
    pub shape: Vec<usize>,
    /// As many as the shape says.
    pub values: Values,
}

/// Everything a learner must remember. Tensors are taken out by [`State::take_f32`] and its like, which check shapes;
/// [`State::finish`] then refuses what nobody asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// By name.
    pub tensors: BTreeMap<String, Tensor>,
    /// Counters and positions of random streams. Integers of 64 bits survive; floats survive to the bit if finite.
    pub counters: serde_json::Value,
    /// What never changes once it is there, such as an episode of a replay: a checkpoint writes each once. By name, with the same name
    /// for the same thing in every state of a run.
    pub parts: BTreeMap<String, Part>,
}

/// Tensors of a state that never change once they are there, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part(pub BTreeMap<String, Tensor>);

impl Values {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::U8(values) => values.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    const fn type_name(&self) -> &'static str {
        match self {
            Self::F32(_) => "f32",
            Self::U8(_) => "u8",
        }
    }
}

impl From<Vec<f32>> for Values {
    fn from(values: Vec<f32>) -> Self {
        Self::F32(values)
    }
}

impl From<Vec<u8>> for Values {
    fn from(values: Vec<u8>) -> Self {
        Self::U8(values)
    }
}

impl State {
    /// A state without tensors.
    pub fn new(counters: serde_json::Value) -> Self {
        Self {
            tensors: BTreeMap::new(),
            counters,
            parts: BTreeMap::new(),
        }
    }

    /// Adds a tensor.
    ///
    /// # Panics
    /// If the number of values is not the shape's product, or the name is taken.
    pub fn put(&mut self, name: impl Into<String>, shape: &[usize], values: impl Into<Values>) {
        put(&mut self.tensors, name.into(), shape, values.into());
    }

    /// Takes a tensor of f32 out.
    ///
    /// # Errors
    /// If it is missing or has another type or shape.
    pub fn take_f32(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        take_f32(&mut self.tensors, name, shape)
    }

    /// Takes a tensor of u8 out.
    ///
    /// # Errors
    /// If it is missing or has another type or shape.
    pub fn take_u8(&mut self, name: &str, shape: &[usize]) -> Result<Vec<u8>> {
        take_u8(&mut self.tensors, name, shape)
    }

    /// Takes a part out.
    ///
    /// # Errors
    /// If it is missing.
    pub fn take_part(&mut self, name: &str) -> Result<Part> {
        let part = self.parts.remove(name);
        part.ok_or_else(|| Error::input(name, "no such part", "one of this name in this configuration"))
    }

    /// The counters as the learner's own type.
    ///
    /// # Errors
    /// If they are not of that type.
    pub fn counters<T: DeserializeOwned>(&self) -> Result<T> {
        serde_json::from_value(self.counters.clone())
            .map_err(|error| Error::input("counters", error, "those of this algorithm"))
    }

    /// Bytes of the tensors, without parts.
    pub fn tensors_bytes(&self) -> u64 {
        let bytes = |tensor: &Tensor| match &tensor.values {
            Values::F32(values) => 4 * values.len() as u64,
            Values::U8(values) => values.len() as u64,
        };
        self.tensors.values().map(bytes).sum()
    }

    /// Checks that every value is a number.
    ///
    /// # Errors
    /// Names the first tensor that holds another.
    pub fn check_finite(&self) -> Result<()> {
        check_finite(&self.tensors)?;
        for (name, part) in &self.parts {
            check_finite(&part.0).map_err(|error| error.within(name))?;
        }
        Ok(())
    }

    /// Refuses tensors and parts that nobody has taken.
    ///
    /// # Errors
    /// Names the first.
    pub fn finish(self) -> Result<()> {
        let unknown = |name: &String, what| {
            let expected = "none of this name in this configuration";
            Err(Error::input(name, what, expected))
        };
        match (self.tensors.first_key_value(), self.parts.first_key_value()) {
            (None, None) => Ok(()),
            (Some((name, _)), _) => unknown(name, "a tensor"),
            (None, Some((name, _))) => unknown(name, "a part"),
        }
    }
}

impl Part {
    /// Adds a tensor.
    ///
    /// # Panics
    /// If the number of values is not the shape's product, or the name is taken.
    pub fn put(&mut self, name: &str, shape: &[usize], values: impl Into<Values>) {
        put(&mut self.0, name.to_owned(), shape, values.into());
    }

    /// Takes a tensor of f32 out.
    ///
    /// # Errors
    /// If it is missing or has another type or shape.
    pub fn take_f32(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        take_f32(&mut self.0, name, shape)
    }

    /// Takes a tensor of u8 out.
    ///
    /// # Errors
    /// If it is missing or has another type or shape.
    pub fn take_u8(&mut self, name: &str, shape: &[usize]) -> Result<Vec<u8>> {
        take_u8(&mut self.0, name, shape)
    }
}

fn put(tensors: &mut BTreeMap<String, Tensor>, name: String, shape: &[usize], values: Values) {
    assert_eq!(
        shape.iter().product::<usize>(),
        values.len(),
        "values of tensor {name}"
    );
    let tensor = Tensor {
        shape: shape.to_vec(),
        values,
    };
    let before = tensors.insert(name.clone(), tensor);
    assert!(before.is_none(), "tensor {name} twice");
}

fn take_f32(tensors: &mut BTreeMap<String, Tensor>, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
    take(tensors, name, shape, "f32", |values| match values {
        Values::F32(values) => Some(values),
        _ => None,
    })
}

fn take_u8(tensors: &mut BTreeMap<String, Tensor>, name: &str, shape: &[usize]) -> Result<Vec<u8>> {
    take(tensors, name, shape, "u8", |values| match values {
        Values::U8(values) => Some(values),
        _ => None,
    })
}

fn take<T>(
    tensors: &mut BTreeMap<String, Tensor>,
    name: &str,
    shape: &[usize],
    expected_type: &str,
    values: impl FnOnce(Values) -> Option<Vec<T>>,
) -> Result<Vec<T>> {
    let expected = format!("{expected_type} of shape {shape:?}");
    let Some(tensor) = tensors.remove(name) else {
        return Err(Error::input(name, "no such tensor", expected));
    };
    let found = format!("{} of shape {:?}", tensor.values.type_name(), tensor.shape);
    if tensor.shape == shape
        && let Some(values) = values(tensor.values)
    {
        return Ok(values);
    }
    Err(Error::input(name, found, expected))
}

fn check_finite(tensors: &BTreeMap<String, Tensor>) -> Result<()> {
    for (name, tensor) in tensors {
        if let Values::F32(values) = &tensor.values
            && let Some(found) = values.iter().find(|value| !value.is_finite())
        {
            return Err(Error::input(name, found, "finite numbers"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn tensors_come_out_as_they_went_in_and_others_are_refused() {
        let mut state = State::new(json!({ "episode": u64::MAX }));
        state.put("weights", &[2, 1], vec![1.5_f32, -0.0]);
        state.put("actions", &[3], vec![1_u8, 2, 3]);
        let message = |state: &State, name: &str, shape: &[usize]| {
            state.clone().take_f32(name, shape).unwrap_err().to_string()
        };
        assert_eq!(
            message(&state, "weights", &[1, 2]),
            "weights: found f32 of shape [2, 1], expected f32 of shape [1, 2]"
        );
        assert_eq!(
            message(&state, "actions", &[3]),
            "actions: found u8 of shape [3], expected f32 of shape [3]"
        );
        assert_eq!(
            message(&state, "moments", &[]),
            "moments: found no such tensor, expected f32 of shape []"
        );
        assert_eq!(state.take_f32("weights", &[2, 1]).unwrap(), [1.5, -0.0]);
        assert_eq!(state.counters["episode"], u64::MAX);
        assert_eq!(
            state.clone().finish().unwrap_err().to_string(),
            "actions: found a tensor, expected none of this name in this configuration"
        );
        assert_eq!(state.take_u8("actions", &[3]).unwrap(), [1, 2, 3]);
        state.finish().unwrap();
    }
}
