//! The native half of the Python package `freshlane`: environments, held-out evaluation, export and assignment.
//!
//! `freshlane/` holds the Python half, which checks types, speaks Gymnasium and PettingZoo, and documents what people use.
//! Everything is computed by `host-sim`, `trainer` and `firmware`; nothing of them is repeated here.

mod arrays;
mod assignment;
mod batch;
mod error;
mod evaluation;
mod export;
mod fields;
mod parts;
mod scenario;
mod shared_array;
mod speed;
mod table;
mod trace;
mod worlds;

#[pyo3::pymodule]
mod _native {
    /// Actions of a vehicle.
    #[pymodule_export]
    const ACTIONS: usize = firmware::decision::ACTIONS;
    /// Length of an encoded observation.
    #[pymodule_export]
    const INPUTS: usize = firmware::observation::INPUTS;
    /// The product's version.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::assignment::{Assignment, assign_arrays};
    #[pymodule_export]
    use crate::batch::Batch;
    #[pymodule_export]
    use crate::evaluation::{Evaluation, evaluate_policy, policies};
    #[pymodule_export]
    use crate::export::FloatNetwork;
    #[pymodule_export]
    use crate::scenario::Scenario;
    #[pymodule_export]
    use crate::speed::native_loop;
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::trace::{Trace, TraceReader};
}
