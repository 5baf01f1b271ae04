//! Scenarios: the same presets, files and settings as on the command line.

use crate::error::{exception, value_error};
use crate::trace::Trace;
use host_sim::mobility::{Grid, MobilitySource};
use host_sim::scenario::{self, Preset, ScenarioSource, nearest_key};
use kit::choice::Choice as _;
use kit::keys::listed;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};
use std::path::PathBuf;

/// A checked scenario: who is in the cell, its radio, its streets.
///
/// A preset ("paper", "companion", "street" or "edge"), then a TOML file that may change some of its keys, then single settings such as
/// {"cell.vehicles": 40}. Keys, units and ranges are those of `host-sim explain`.
///
/// Raises ValueError for an unknown preset or key (the nearest key is named) and for a value out of range, OSError for a file
/// that cannot be read.
#[pyclass(frozen, eq, module = "freshlane")]
#[derive(Clone, PartialEq)]
pub struct Scenario {
    pub(crate) inner: scenario::Scenario,
}

#[pymethods]
impl Scenario {
    #[new]
    #[pyo3(signature = (preset = "paper", *, file = None, settings = None))]
    fn new(preset: &str, file: Option<PathBuf>, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let preset = Preset::of_name("preset", preset).map_err(exception)?;
        let mut lines = Vec::new();
        for (key, value) in settings.into_iter().flatten() {
            // As TOML has it, not Python.
            let value = match value.cast::<PyBool>() {
                Ok(flag) => flag.is_true().to_string(),
                Err(_) => value.str()?.to_string(),
            };
            lines.push(format!("{}={value}", key.extract::<String>()?));
        }
        let source = ScenarioSource {
            preset,
            file,
            settings: lines,
            ..ScenarioSource::default()
        };
        let inner = source.read().map_err(exception)?;
        Ok(Self { inner })
    }

    /// The value of a key such as "cell.vehicles".
    ///
    /// Raises KeyError for an unknown key and names the nearest one.
    fn __getitem__<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyAny>> {
        if listed(scenario::Scenario::KEYS)
            .iter()
            .all(|(name, _)| name != key)
        {
            let message = format!("{key}: found an unknown key, expected {}", nearest_key(key));
            return Err(PyKeyError::new_err(message));
        }
        key.split('.')
            .try_fold(self.to_dict(py)?, |values, part| values.get_item(part))
    }

    /// Every key's value: {section: {key: value}}.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.json()?,))
    }

    /// Every key's value as JSON, which `_of_json` reads back to the last bit.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((py.get_type::<Self>().getattr("_of_json")?, (self.json()?,)))
    }

    #[staticmethod]
    fn _of_json(text: &str) -> PyResult<Self> {
        let inner: scenario::Scenario = serde_json::from_str(text)
            .map_err(|error| value_error("scenario", error, "every key of a scenario"))?;
        inner.check().map_err(exception)?;
        Ok(Self { inner })
    }

    fn __repr__(&self) -> String {
        let scenario::Scenario { cell, radio, .. } = &self.inner;
        format!(
            "<Scenario: {} vehicles, {} sub-channels, {} dBm, C_min {} bit/s/Hz>",
            cell.vehicles, radio.sub_channels, radio.max_power_dbm, radio.min_spectral_efficiency
        )
    }
}

impl Scenario {
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.inner)
            .map_err(|error| value_error("scenario", error, "values that JSON can hold"))
    }
}

/// What worlds are made of: the cell, and what moves its vehicles.
pub struct Setting {
    pub scenario: scenario::Scenario,
    pub source: Box<dyn MobilitySource>,
}

impl Setting {
    /// A scenario with the vehicles of a trace, or of the urban grid.
    ///
    /// # Errors
    /// `ValueError` for a trace that never comes near the base station.
    pub fn new(scenario: &Scenario, trace: Option<&Trace>) -> PyResult<Self> {
        let scenario = scenario.inner.clone();
        let source: Box<dyn MobilitySource> = match trace {
            None => Box::new(Grid),
            Some(trace) => Box::new(trace.inner.clone()),
        };
        source.check(&scenario).map_err(exception)?;
        Ok(Self { scenario, source })
    }
}
