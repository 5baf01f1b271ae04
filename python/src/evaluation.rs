//! The held-out protocol: the same worlds, and the same numbers, as the command line's.

use crate::error::{check_range, exception};
use crate::fields::by_fields;
use crate::scenario::{Scenario, Setting};
use crate::table::Table;
use crate::trace::Trace;
use host_sim::age::AgeSummary;
use host_sim::experiment::{SLOTS, WARMUP, WORLDS};
use host_sim::policy::{KINDS, Kind};
use host_sim::simulation::{Extent, Simulation};
use host_sim::thread_pool;
use kit::choice::Choice as _;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Ages of a policy on held-out worlds. One slot is 1 ms.
#[pyclass(frozen, get_all, module = "freshlane")]
pub struct Evaluation {
    /// The policy's name.
    policy: String,
    /// How many vehicles ever appear in a world.
    vehicles: usize,
    /// Independent worlds.
    worlds: u32,
    /// Slots that count.
    slots: u32,
    /// Slots before them.
    warmup: u32,
    /// Seed of the worlds.
    seed: u64,
    /// Mean age of an ideal schedule on a channel that never fades.
    bound_age_ms: f64,
    /// Mean over worlds of the mean over vehicles and slots.
    mean_age_ms: f64,
    /// Half the width of its 95 % interval over worlds (Student's t); None for a single world.
    mean_age_ci95_ms: Option<f64>,
    /// Mean over all vehicle-slots of ages that may exceed 100 slots.
    uncapped_mean_age_ms: f64,
    /// Median over worlds of their means.
    median_world_age_ms: f64,
    /// 99th percentile over all vehicle-slots.
    p99_age_ms: f64,
    /// Mean over vehicles and the first 100 slots.
    first100_age_ms: f64,
    /// Successful transmissions a slot.
    success_per_slot: f64,
    /// Mean of the ages that receptions ended, each just before; None without one.
    peak_age_ms: Option<f64>,
    /// Fraction of vehicle-slots with information older than 10 ms.
    age_above_10_ms: f64,
    /// Older than 20 ms.
    age_above_20_ms: f64,
    /// Older than 50 ms.
    age_above_50_ms: f64,
    /// Mean age that one vehicle in 20 exceeds, over all worlds.
    worst_vehicles_ms: f64,
    /// The same of ages that may exceed 100 slots.
    uncapped_worst_vehicles_ms: f64,
    /// Transmissions a vehicle and slot, received or not.
    transmissions_per_vehicle_slot: f64,
    /// Energy that they radiate, a vehicle and slot.
    energy_mj_per_vehicle_slot: f64,
    /// Fraction of vehicle-slots at each age: float64 (101,), index 0 unused.
    distribution: Py<PyArray1<f64>>,
    /// Mean age after each of the first 300 slots, in ms: float64.
    start_ms: Py<PyArray1<f64>>,
}

impl Evaluation {
    /// A summary with what it is of.
    pub fn new(policy: String, extent: Extent, vehicles: usize, bound_age_ms: f64, ages: AgeSummary) -> Self {
        let Extent {
            seed,
            worlds,
            slots,
            warmup,
        } = extent;
        let (distribution, start_ms) = Python::attach(|py| {
            let array = |values: &[f64]| PyArray1::from_slice(py, values).unbind();
            (array(&ages.distribution), array(&ages.start_ms))
        });
        Self {
            policy,
            vehicles,
            worlds,
            slots,
            warmup,
            seed,
            bound_age_ms,
            mean_age_ms: ages.mean_ms,
            mean_age_ci95_ms: ages.ci95_ms,
            uncapped_mean_age_ms: ages.uncapped_mean_ms,
            median_world_age_ms: ages.median_world_ms,
            p99_age_ms: ages.p99_ms,
            first100_age_ms: ages.first100_ms,
            success_per_slot: ages.success_per_slot,
            peak_age_ms: ages.peak_ms,
            age_above_10_ms: ages.share_above(10),
            age_above_20_ms: ages.share_above(20),
            age_above_50_ms: ages.share_above(50),
            worst_vehicles_ms: ages.worst_vehicles_ms,
            uncapped_worst_vehicles_ms: ages.uncapped_worst_vehicles_ms,
            transmissions_per_vehicle_slot: ages.transmissions_per_vehicle_slot,
            energy_mj_per_vehicle_slot: ages.energy_mj_per_vehicle_slot,
            distribution,
            start_ms,
        }
    }
}

by_fields! { Evaluation:
    policy, vehicles, worlds, slots, warmup, seed, bound_age_ms, mean_age_ms, mean_age_ci95_ms, uncapped_mean_age_ms,
    median_world_age_ms, p99_age_ms, first100_age_ms, success_per_slot, peak_age_ms, age_above_10_ms, age_above_20_ms,
    age_above_50_ms, worst_vehicles_ms, uncapped_worst_vehicles_ms, transmissions_per_vehicle_slot,
    energy_mj_per_vehicle_slot, distribution, start_ms,
}

#[pymethods]
impl Evaluation {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        Ok((py.get_type::<Self>().getattr("_of_fields")?, (self.fields(py)?,)))
    }

    #[staticmethod]
    fn _of_fields(fields: &Bound<'_, PyDict>) -> PyResult<Self> {
        Self::of_fields(fields)
    }

    fn __repr__(&self) -> String {
        let interval = self
            .mean_age_ci95_ms
            .map_or(String::new(), |half| format!(" +- {half:.3}"));
        format!(
            "<Evaluation: {} {:.3}{interval} ms, {} vehicles, {} worlds x {} slots after {}, seed {}>",
            self.policy, self.mean_age_ms, self.vehicles, self.worlds, self.slots, self.warmup, self.seed
        )
    }
}

/// How much is simulated, within the command line's limits.
///
/// # Errors
/// `ValueError` with the number out of range.
pub fn extent(worlds: u32, slots: u32, warmup: u32, seed: u64) -> PyResult<Extent> {
    for (name, value, range) in [
        ("worlds", worlds, WORLDS),
        ("slots", slots, SLOTS),
        ("warmup", warmup, WARMUP),
    ] {
        check_range(name, value.into(), (*range.start()).into(), (*range.end()).into())?;
    }
    Ok(Extent {
        seed,
        worlds,
        slots,
        warmup,
    })
}

/// Names of the simulator's own policies, each with what it does, in the order of its reports.
#[pyfunction]
pub fn policies() -> Vec<(&'static str, &'static str)> {
    KINDS.iter().map(|kind| (kind.name, kind.meaning)).collect()
}

/// Runs one of the simulator's own policies; "actor" takes the table.
#[pyfunction]
#[pyo3(signature = (policy, table, scenario, trace, worlds, slots, warmup, seed, threads))]
#[allow(clippy::too_many_arguments, reason = "Python passes keywords")]
pub fn evaluate_policy(
    py: Python<'_>,
    policy: &str,
    table: &Table,
    scenario: &Scenario,
    trace: Option<&Trace>,
    worlds: u32,
    slots: u32,
    warmup: u32,
    seed: u64,
    threads: Option<u16>,
) -> PyResult<Evaluation> {
    let kind = <&'static Kind>::of_name("policy", policy).map_err(exception)?;
    let extent = extent(worlds, slots, warmup, seed)?;
    let setting = Setting::new(scenario, trace)?;
    let table = table.parse()?;
    let pool = thread_pool(threads).map_err(exception)?;
    let simulation = Simulation {
        scenario: &setting.scenario,
        source: setting.source.as_ref(),
        extent,
    };
    let run = || simulation.run_policy(kind, &table, |_, _| ());
    let (ages, _) = py.detach(|| pool.install(run)).map_err(exception)?;
    let vehicles = setting.source.vehicles(&setting.scenario);
    Ok(Evaluation::new(
        kind.name.to_owned(),
        extent,
        vehicles,
        simulation.bound_age_ms().unwrap_or(f64::NAN),
        ages,
    ))
}
