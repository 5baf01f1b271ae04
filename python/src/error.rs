//! Errors as Python exceptions: `ValueError` for input that makes no sense, `OSError` for files.

use kit::error::Error;
use numpy::ndarray::Dimension;
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods as _};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::{PyErr, PyResult};

/// A simulator's error. A setting is called that, not by the command line's option.
pub fn exception(error: Error) -> PyErr {
    if let Error::File { path, source } = &error {
        // Python picks the subclass, such as FileNotFoundError, from the number.
        let number = source.raw_os_error().unwrap_or(0);
        return PyOSError::new_err((number, source.to_string(), path.clone()));
    }
    let message = error.to_string();
    PyValueError::new_err(match message.strip_prefix("--set") {
        Some(rest) => format!("settings{rest}"),
        None => message,
    })
}

/// A `ValueError` in the product's form: where, what was found, what was expected.
pub fn value_error(place: impl ToString, found: impl ToString, expected: impl ToString) -> PyErr {
    exception(Error::input(place, found, expected))
}

/// An array's values, the last index fastest.
///
/// # Errors
/// `ValueError` for an array in another order. `as_slice` alone takes Fortran's too, and would mix up the values.
pub fn in_c_order<'a, T: Element, D: Dimension>(
    name: &str,
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [T]> {
    let values = array.as_slice().ok().filter(|_| array.is_c_contiguous());
    values.ok_or_else(|| {
        let expected = "C order, as numpy.ascontiguousarray gives it";
        value_error(name, "an array in another order", expected)
    })
}

/// Checks that a number lies in its range.
///
/// # Errors
/// `ValueError` with name, number and range.
pub fn check_range(name: &str, value: u64, least: u64, most: u64) -> Result<(), PyErr> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(value_error(name, value, format!("{least} to {most}")))
    }
}
