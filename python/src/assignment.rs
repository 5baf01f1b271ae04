//! The traffic assignment engine as a function from arrays.

use crate::error::{exception, value_error};
use crate::fields::by_fields;
use assignment::demand::Trip;
use assignment::{
    Algorithm, CostWeights, Demand, Link, Network, NodeNumbering, Objective, Options, Stop, assign,
};
use kit::choice::Choice as _;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::HashMap;

/// Link flows and how good they are.
#[pyclass(frozen, get_all, module = "freshlane")]
pub struct Assignment {
    /// Vehicles per unit of time on each link: float64 (links,).
    flows: Py<PyArray1<f64>>,
    /// Generalised travel cost that a vehicle meets on each link, in units of free_flow_time: float64 (links,).
    costs: Py<PyArray1<f64>>,
    /// (TSTT - SPTT) / TSTT, never negative; with marginal costs under the system optimum.
    relative_gap: f64,
    /// What was minimised: the Beckmann function or the total travel cost.
    objective: f64,
    /// Sum over links of flow times cost.
    total_travel_time: f64,
    /// Iterations after the initial loading.
    iterations: usize,
    /// Whether the gap asked for was reached.
    converged: bool,
    /// Why it ended: "gap", "iterations" or "stagnation".
    stopped: String,
}

by_fields! { Assignment:
    flows, costs, relative_gap, objective, total_travel_time, iterations, converged, stopped,
}

#[pymethods]
impl Assignment {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        Ok((py.get_type::<Self>().getattr("_of_fields")?, (self.fields(py)?,)))
    }

    #[staticmethod]
    fn _of_fields(fields: &Bound<'_, PyDict>) -> PyResult<Self> {
        Self::of_fields(fields)
    }

    fn __repr__(&self) -> String {
        format!(
            "<Assignment: relative gap {:.3e} after {} iterations, total travel time {}>",
            self.relative_gap, self.iterations, self.total_travel_time
        )
    }
}

/// Columns of the links by their names, all of one length.
type Columns<'py> = HashMap<String, PyReadonlyArray1<'py, f64>>;

/// Assigns trips, float64 (zones, zones), to links. `freshlane.assign` is its face and checks types.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python passes keywords")]
pub fn assign_arrays(
    py: Python<'_>,
    init_node: PyReadonlyArray1<'_, u32>,
    term_node: PyReadonlyArray1<'_, u32>,
    columns: Columns<'_>,
    trips: PyReadonlyArray2<'_, f64>,
    algorithm: &str,
    objective: &str,
    gap: f64,
    max_iterations: usize,
    first_thru_node: u32,
    toll_weight: f64,
    distance_weight: f64,
    threads: usize,
) -> PyResult<Assignment> {
    let algorithm = Algorithm::of_name("algorithm", algorithm).map_err(exception)?;
    let objective = Objective::of_name("objective", objective).map_err(exception)?;
    let links = links(&init_node, &term_node, &columns)?;
    let &[zones, destinations] = trips.shape() else {
        return Err(value_error("trips", "another shape", "(zones, zones)"));
    };
    if zones != destinations {
        let found = format!("shape ({zones}, {destinations})");
        return Err(value_error("trips", found, "a square matrix, (zones, zones)"));
    }
    let most = links.iter().map(|link| link.init_node.max(link.term_node)).max();
    let numbering = NodeNumbering {
        zones: zones as u32,
        nodes: most.unwrap_or(0).max(zones as u32),
        first_thru_node,
    };
    let weights = CostWeights {
        toll: toll_weight,
        distance: distance_weight,
    };
    let network = Network::new(numbering, links, weights).map_err(exception)?;
    let pairs = trips.as_array();
    let pairs = pairs.indexed_iter().filter(|&(_, &volume)| volume != 0.0);
    let trips: Vec<Trip> = pairs
        .map(|((origin, destination), &volume)| Trip {
            origin: origin as u32 + 1,
            destination: destination as u32 + 1,
            volume,
        })
        .collect();
    let demand = Demand::new(numbering.zones, &trips).map_err(exception)?;
    let options = Options {
        algorithm,
        objective,
        gap,
        max_iterations,
        threads,
    };
    let solution = py
        .detach(|| assign(&network, &demand, &options))
        .map_err(exception)?;
    Ok(Assignment {
        flows: PyArray1::from_vec(py, solution.link_flows).unbind(),
        costs: PyArray1::from_vec(py, solution.link_costs).unbind(),
        relative_gap: solution.relative_gap,
        objective: solution.objective,
        total_travel_time: solution.total_travel_time,
        iterations: solution.iterations,
        converged: solution.converged,
        stopped: match solution.stopped {
            Stop::Gap => "gap",
            Stop::Iterations => "iterations",
            Stop::Stagnation => "stagnation",
            Stop::Time => "time",
            Stop::Interrupted => "signal",
        }
        .to_owned(),
    })
}

fn links(
    init_node: &PyReadonlyArray1<'_, u32>,
    term_node: &PyReadonlyArray1<'_, u32>,
    columns: &Columns<'_>,
) -> PyResult<Vec<Link>> {
    let (init_node, term_node) = (init_node.as_array(), term_node.as_array());
    let count = init_node.len();
    let value = |name: &str, link: usize| {
        let column = columns.get(name);
        column
            .and_then(|column| column.as_array().get(link).copied())
            .unwrap_or(0.0)
    };
    let lengths = columns
        .iter()
        .map(|(name, column)| (name.as_str(), column.shape()[0]));
    for (name, length) in lengths.chain([("term_node", term_node.len())]) {
        if length != count {
            return Err(value_error(
                name,
                format!("length {length}"),
                format!("{count}, one a link"),
            ));
        }
    }
    let link = |index: usize| Link {
        init_node: init_node[index],
        term_node: term_node[index],
        capacity: value("capacity", index),
        length: value("length", index),
        free_flow_time: value("free_flow_time", index),
        b: value("b", index),
        power: value("power", index),
        toll: value("toll", index),
    };
    Ok((0..count).map(link).collect())
}
