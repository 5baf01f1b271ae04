//! Recorded mobility: SUMO floating-car data, whose XML Python's own parser reads.

use crate::error::{exception, value_error};
use host_sim::mobility::floating_car_data::{self, TraceBuilder};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::collections::HashMap;

/// The recorded movement of many vehicles, from SUMO's floating-car data.
#[pyclass(frozen, module = "freshlane")]
pub struct Trace {
    pub(crate) inner: floating_car_data::Trace,
}

#[pymethods]
impl Trace {
    /// Every vehicle's name, in the order in which arrays count them.
    #[getter]
    fn vehicles(&self) -> Vec<String> {
        self.inner.vehicle_ids().to_vec()
    }

    /// Slots of 1 ms from the first time step to the last.
    #[getter]
    fn slots(&self) -> u32 {
        self.inner.duration_slots()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = serde_json::to_vec(&self.inner)
            .map_err(|error| value_error("trace", error, "one that memory holds"))?;
        Ok((
            py.get_type::<Self>().getattr("_of_bytes")?,
            (PyBytes::new(py, &bytes),),
        ))
    }

    #[staticmethod]
    fn _of_bytes(data: &[u8]) -> PyResult<Self> {
        let inner = serde_json::from_slice(data)
            .map_err(|error| value_error("data", error, "a trace of this version"))?;
        Ok(Self { inner })
    }

    fn __repr__(&self) -> String {
        let (vehicles, slots) = (self.inner.vehicle_ids().len(), self.inner.duration_slots());
        format!("<Trace: {vehicles} vehicles, {slots} slots>")
    }
}

/// What the simulator makes of the elements of a file, told one after the other, each with its line from 1.
#[pyclass(module = "freshlane._native")]
pub struct TraceReader {
    /// Taken when the file ends.
    builder: Option<TraceBuilder>,
}

#[pymethods]
impl TraceReader {
    #[new]
    fn new(name: &str) -> Self {
        let builder = Some(TraceBuilder::new(name));
        Self { builder }
    }

    /// An element begins.
    fn open(&mut self, line: usize, tag: &str, attributes: HashMap<String, String>) -> PyResult<()> {
        let attribute = |name: &str| Ok(attributes.get(name).cloned());
        self.builder()?.open(line, tag, &attribute).map_err(exception)
    }

    /// The innermost element ends.
    fn close(&mut self) -> PyResult<()> {
        self.builder()?.close();
        Ok(())
    }

    /// Text between elements.
    fn text(&mut self, line: usize, text: &str) -> PyResult<()> {
        self.builder()?.text(line, text).map_err(exception)
    }

    /// The trace, at the end of the file.
    fn finish(&mut self, line: usize) -> PyResult<Trace> {
        let builder = self.builder.take().ok_or_else(finished)?;
        let inner = builder.finish(line).map_err(exception)?;
        Ok(Trace { inner })
    }
}

impl TraceReader {
    fn builder(&mut self) -> PyResult<&mut TraceBuilder> {
        self.builder.as_mut().ok_or_else(finished)
    }
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("the trace is finished")
}
