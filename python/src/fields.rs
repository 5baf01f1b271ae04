//! Results as dictionaries of their fields, for `pickle` and `copy`.

/// Gives a class of results `fields`, a dictionary of what these attributes hold, and `of_fields`, its inverse.
macro_rules! by_fields {
    ($class:ident: $($field:ident),* $(,)?) => {
        impl $class {
            fn fields<'py>(&self, py: pyo3::Python<'py>) -> pyo3::PyResult<pyo3::Bound<'py, pyo3::types::PyDict>> {
                use pyo3::types::PyDictMethods as _;
                let fields = pyo3::types::PyDict::new(py);
                $(fields.set_item(stringify!($field), &self.$field)?;)*
                Ok(fields)
            }

            fn of_fields(fields: &pyo3::Bound<'_, pyo3::types::PyDict>) -> pyo3::PyResult<Self> {
                use pyo3::types::PyAnyMethods as _;
                Ok(Self { $($field: fields.as_any().get_item(stringify!($field))?.extract()?,)* })
            }
        }
    };
}
pub(crate) use by_fields;
