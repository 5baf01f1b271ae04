//! Errors as Python exceptions: `ValueError` for input that makes no sense, `OSError` for files.

use host_sim::error::Error;
use pyo3::PyErr;
use pyo3::exceptions::{PyOSError, PyValueError};

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
