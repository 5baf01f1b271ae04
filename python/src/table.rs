//! Firmware tables: the shipped one, or one from a file; what they decide.

use crate::error::{exception, in_c_order, value_error};
use firmware::actor::Actor;
use firmware::decision::{ACTIONS, Action};
use firmware::form::{ObservationForm, OutputForm};
use firmware::network::MAX_OUTPUTS;
use firmware::observation::INPUTS;
use host_sim::weight_table::WeightTable;
use kit::files::write_whole;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// A frozen int8 network with its header, as a unit runs it.
#[pyclass(frozen, eq, module = "freshlane")]
#[derive(Clone)]
pub struct Table {
    inner: WeightTable,
}

impl PartialEq for Table {
    /// The same bytes, wherever they were read.
    fn eq(&self, other: &Self) -> bool {
        self.inner.bytes() == other.inner.bytes()
    }
}

impl Table {
    /// Checks the bytes and keeps them; errors call them by the name.
    ///
    /// # Errors
    /// `ValueError` with the field that does not fit.
    pub fn new(name: &str, bytes: Vec<u8>) -> PyResult<Self> {
        let inner = WeightTable::new(name, bytes).map_err(exception)?;
        Ok(Self { inner })
    }

    /// The table in place.
    ///
    /// # Errors
    /// None, since it was checked.
    pub fn parse(&self) -> PyResult<firmware::table::Table<'_>> {
        self.inner.parse().map_err(exception)
    }
}

#[pymethods]
impl Table {
    /// The table that the firmware's image carries.
    #[staticmethod]
    fn shipped() -> PyResult<Self> {
        let inner = WeightTable::read_or_built_in(None).map_err(exception)?;
        Ok(Self { inner })
    }

    /// The table in a file.
    ///
    /// Raises OSError for a file that cannot be read, ValueError with the field for one that is no table of this firmware.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        let inner = WeightTable::read(&path).map_err(exception)?;
        Ok(Self { inner })
    }

    /// The table in these bytes.
    ///
    /// Raises ValueError with the field for bytes that are no table of this firmware.
    #[staticmethod]
    fn from_bytes(data: Vec<u8>) -> PyResult<Self> {
        Self::new("data", data)
    }

    /// Writes the table to a file, whole or not at all.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        write_whole(&path, self.inner.bytes()).map_err(exception)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((
            py.get_type::<Self>().getattr("from_bytes")?,
            (self.__bytes__(py),),
        ))
    }

    /// The table's bytes.
    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, self.inner.bytes())
    }

    /// Inputs, then each layer's outputs.
    #[getter]
    fn widths(&self) -> PyResult<Vec<usize>> {
        let table = self.parse()?;
        Ok(table.network().widths().collect())
    }

    /// The most vehicles in a cell that it serves.
    #[getter]
    fn max_vehicles(&self) -> PyResult<u16> {
        Ok(self.parse()?.max_vehicles())
    }

    /// The most sub-channels of a cell that it serves.
    #[getter]
    fn max_sub_channels(&self) -> PyResult<usize> {
        Ok(self.parse()?.max_sub_channels().count())
    }

    /// Level in dB over noise at which a lone transmission succeeds.
    #[getter]
    fn required_sinr_db(&self) -> PyResult<f64> {
        Ok(self.parse()?.required_sinr().to_num())
    }

    /// The seed that it was trained with.
    #[getter]
    fn seed(&self) -> PyResult<u64> {
        Ok(self.parse()?.provenance().seed)
    }

    /// The network's outputs for encoded observations.
    ///
    /// observations: int8 (..., 22), in C order. Returns int32 (..., 7) in the table's common output scale.
    ///
    /// Raises TypeError for another type, ValueError for another shape or order, or a table whose network sees something else.
    fn outputs<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArrayDyn<'py, i8>,
    ) -> PyResult<Bound<'py, PyArrayDyn<i32>>> {
        let rows = input_rows(&observations)?;
        let outputs = self.infer_rows(py, rows, |outputs| outputs)?;
        let shape = [leading(&observations), &[ACTIONS]].concat();
        PyArray1::from_vec(py, outputs.into_flattened()).reshape(shape)
    }

    /// What units that run this table do.
    ///
    /// observations: int8 (..., 22), in C order. Returns uint8 (...): actions 0 to 6, the first of equal outputs.
    ///
    /// Raises TypeError for another type, ValueError for another shape or order, or a table whose network sees something else.
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArrayDyn<'py, i8>,
    ) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let rows = input_rows(&observations)?;
        let actions = self.infer_rows(py, rows, |outputs| Action::from_outputs(&outputs) as u8)?;
        PyArray1::from_vec(py, actions).reshape(leading(&observations))
    }

    fn __repr__(&self) -> PyResult<String> {
        let widths: Vec<String> = self.widths()?.iter().map(usize::to_string).collect();
        let (widths, vehicles) = (widths.join("-"), self.max_vehicles()?);
        Ok(format!(
            "<Table: {widths}, {} bytes, up to {vehicles} vehicles, seed {}>",
            self.inner.bytes().len(),
            self.seed()?
        ))
    }
}

impl Table {
    /// Runs the network on every row, without Python meanwhile.
    fn infer_rows<T: Send>(
        &self,
        py: Python<'_>,
        rows: &[[i8; INPUTS]],
        result: impl Fn([i32; ACTIONS]) -> T + Send + Sync,
    ) -> PyResult<Vec<T>> {
        let table = self.parse()?;
        let forms = (table.observation_form(), table.output_form());
        let common = (ObservationForm::Ring, OutputForm::Actions);
        if forms != common {
            let (found, expected) = (
                format!("{forms:?}"),
                format!("{common:?}, which observations here have"),
            );
            return Err(value_error("table", found, expected));
        }
        let mut actor = Actor::new(table);
        // Copied: other threads may write the caller's rows as soon as the interpreter lock is released.
        let rows = rows.to_vec();
        let scores = |outputs: [i32; MAX_OUTPUTS]| std::array::from_fn(|action| outputs[action]);
        Ok(py.detach(|| rows.iter().map(|row| result(scores(actor.infer(row)))).collect()))
    }
}

/// Rows of encoded observations, int8 (..., 22).
///
/// # Errors
/// `ValueError` for rows of another length, or ones that do not lie one behind the other.
pub fn input_rows<'a>(observations: &'a PyReadonlyArrayDyn<'_, i8>) -> PyResult<&'a [[i8; INPUTS]]> {
    let shape = observations.shape();
    if shape.last() != Some(&INPUTS) {
        return Err(value_error(
            "observations",
            format!("shape {shape:?}"),
            format!("(..., {INPUTS})"),
        ));
    }
    let (rows, _) = in_c_order("observations", observations)?.as_chunks();
    Ok(rows)
}

/// The dimensions before the inputs.
fn leading<'a>(observations: &'a PyReadonlyArrayDyn<'_, i8>) -> &'a [usize] {
    observations
        .shape()
        .split_last()
        .map_or(&[], |(_, leading)| leading)
}
