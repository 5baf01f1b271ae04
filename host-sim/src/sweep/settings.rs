//! A point's values by key, as its command reads them.

use super::axis::{SEED, text};
use super::{Grid, Point};
use crate::mobility::live;
use crate::scenario::{Preset, ScenarioSource};
use assignment::CostWeights;
use kit::choice::Choice;
use kit::error::{Error, Result};
use std::path::PathBuf;
use toml::Value;

/// The settings of a point.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'g> {
    grid: &'g Grid,
    point: &'g Point,
}

impl<'g> Settings<'g> {
    /// Those of a grid's point.
    pub fn new(grid: &'g Grid, point: &'g Point) -> Self {
        Self { grid, point }
    }

    /// The value of a key, if the grid has it.
    fn value(&self, key: &str) -> Option<&'g Value> {
        let axis = self.grid.axes().iter().position(|axis| axis.key == key)?;
        Some(self.grid.value(self.point, axis))
    }

    /// A whole number.
    ///
    /// # Errors
    /// If it has more than 32 bits.
    pub fn whole(&self, key: &str) -> Result<Option<u32>> {
        let Some(value) = self.value(key) else {
            return Ok(None);
        };
        let number = value.as_integer().and_then(|number| u32::try_from(number).ok());
        let number = number.ok_or_else(|| Error::input(key, value, format!("0 to {}", u32::MAX)))?;
        Ok(Some(number))
    }

    /// A number.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.value(key)?.as_float()
    }

    /// A name.
    pub fn name(&self, key: &str) -> Option<String> {
        self.value(key).map(text)
    }

    /// One of the names of a choice.
    ///
    /// # Errors
    /// If there is none of this name.
    pub fn choice<C: Choice>(&self, key: &str) -> Result<Option<C>> {
        let value = self.value(key);
        value.map(|value| C::of_name(key, &text(value))).transpose()
    }

    /// A file or network, unless the value is the word for none.
    pub fn file(&self, key: &str) -> Option<PathBuf> {
        let mut axes = self.grid.axes().iter();
        let kind = axes.find(|axis| axis.key == key)?.kind;
        self.grid.file(kind, &text(self.value(key)?))
    }

    /// What moves the vehicles.
    pub fn mobility(&self, key: &str) -> Option<String> {
        let name = text(self.value(key)?);
        let file = self.file(key);
        Some(file.map_or(name.clone(), |path| live::name_of(&name, &path)))
    }

    /// The seed.
    pub fn seed(&self) -> u64 {
        let seed = self.value(SEED).and_then(Value::as_integer);
        seed.unwrap_or_default().cast_unsigned()
    }

    /// What toll and distance cost.
    pub fn weights(&self) -> CostWeights {
        CostWeights {
            toll: self.number("toll_weight").unwrap_or_default(),
            distance: self.number("distance_weight").unwrap_or_default(),
        }
    }

    /// The scenario: preset, file, and every key with a section.
    ///
    /// # Errors
    /// A preset that does not exist.
    pub fn scenario(&self) -> Result<ScenarioSource> {
        let mut source = ScenarioSource {
            preset: self.choice::<Preset>("preset")?.unwrap_or_default(),
            file: self.file("scenario"),
            ..ScenarioSource::default()
        };
        for (index, axis) in self.grid.axes().iter().enumerate() {
            if axis.key.contains('.') {
                source.set(&axis.key, self.grid.value(self.point, index).clone());
            }
        }
        Ok(source)
    }
}
