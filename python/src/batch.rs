//! The batch of worlds as a Python class: checks what comes in, hands out the views.

use crate::error::{check_range, exception, in_c_order, value_error};
use crate::evaluation::Evaluation;
use crate::scenario::{Scenario, Setting};
use crate::table::Table;
use crate::trace::Trace;
use crate::worlds::Worlds;
use firmware::decision::Action;
use host_sim::policy::actor;
use host_sim::simulation::Extent;
use host_sim::stream::Purpose;
use kit::choice::Choice as _;
use numpy::{Element, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::fmt::Display;
use trainer::game::reward::{Reward, RewardName};

/// Least power of a transmission in dBm (chosen: nobody hears it, and units can express it).
const LEAST_POWER_DBM: f64 = -100.0;

/// Worlds that Python steps. `freshlane.BatchEnvironment` is its face and checks types.
#[pyclass(module = "freshlane._native")]
pub struct Batch {
    worlds: Worlds,
    /// What held-out worlds are run for.
    extent: Option<Extent>,
}

/// Actions as people have them: bytes, or the 64-bit integers that arg-max functions give.
#[derive(FromPyObject)]
pub enum Actions<'py> {
    /// uint8.
    Bytes(PyReadonlyArray2<'py, u8>),
    /// int64.
    Words(PyReadonlyArray2<'py, i64>),
}

#[pymethods]
impl Batch {
    /// Training worlds of a seed, before their first slot.
    #[new]
    #[pyo3(signature = (scenario, trace, worlds, seed, reward, threads))]
    fn new(
        py: Python<'_>,
        scenario: &Scenario,
        trace: Option<&Trace>,
        worlds: u32,
        seed: u64,
        reward: &str,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let name = RewardName::of_name("reward", reward).map_err(exception)?;
        let reward = Reward::new(name, scenario.inner.cell.vehicles as usize);
        let setting = Setting::new(scenario, trace)?;
        let purpose = Purpose::Training;
        Ok(Self {
            worlds: Worlds::new(py, setting, purpose, seed, worlds, reward, threads)?,
            extent: None,
        })
    }

    /// Held-out worlds whose ages are recorded.
    #[staticmethod]
    #[pyo3(signature = (scenario, trace, worlds, slots, warmup, seed, threads))]
    #[allow(clippy::too_many_arguments, reason = "Python passes keywords")]
    fn held_out(
        py: Python<'_>,
        scenario: &Scenario,
        trace: Option<&Trace>,
        worlds: u32,
        slots: u32,
        warmup: u32,
        seed: u64,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let extent = crate::evaluation::extent(worlds, slots, warmup, seed)?;
        let reward = Reward::new(RewardName::Own, scenario.inner.cell.vehicles as usize);
        let setting = Setting::new(scenario, trace)?;
        let purpose = Purpose::Evaluation;
        let mut worlds = Worlds::new(py, setting, purpose, seed, worlds, reward, threads)?;
        worlds.check_slots(extent.slots_per_world())?;
        worlds.record(warmup);
        Ok(Self {
            worlds,
            extent: Some(extent),
        })
    }

    /// What the recorded slots say; of held-out worlds after all their slots.
    fn summary(&self, policy: String) -> PyResult<Evaluation> {
        let elapsed = self.worlds.elapsed();
        let extent = self.extent.filter(|extent| elapsed == extent.slots_per_world());
        let unfinished = || {
            value_error(
                "summary",
                format!("slot {elapsed}"),
                "held-out worlds after all their slots",
            )
        };
        let extent = extent.ok_or_else(unfinished)?;
        let nobody = || value_error("slots", "no vehicle after warm-up", "at least one");
        let summary = self.worlds.summary().ok_or_else(nobody)?;
        let bound_age_ms = self.worlds.bound_age_ms(extent);
        Ok(Evaluation::new(
            policy,
            extent,
            self.worlds.vehicles(),
            bound_age_ms,
            summary,
        ))
    }

    /// A batch in the same state, which goes on by itself, with arrays of its own.
    fn copy(&mut self, py: Python<'_>) -> PyResult<Self> {
        Ok(Self {
            worlds: self.worlds.copy(py)?,
            extent: self.extent,
        })
    }

    /// Begins anew: with the first worlds of another seed, or with the worlds behind the last ones.
    #[pyo3(signature = (seed = None))]
    fn reset(&mut self, py: Python<'_>, seed: Option<u64>) -> PyResult<()> {
        if self.extent.is_some() {
            return Err(value_error("reset", "held-out worlds", "training worlds"));
        }
        self.worlds.check_process()?;
        py.detach(|| self.worlds.reset(seed));
        Ok(())
    }

    /// Carries out actions, uint8 or int64 (worlds, vehicles), and begins the next slot.
    fn step(&mut self, py: Python<'_>, actions: Actions<'_>) -> PyResult<()> {
        let actions = match &actions {
            Actions::Bytes(array) => self.checked_actions(array)?,
            Actions::Words(array) => self.checked_actions(array)?,
        };
        self.worlds.check_process()?;
        self.worlds.check_slots(self.worlds.elapsed() + 1)?;
        py.detach(|| self.worlds.act(&actions));
        Ok(())
    }

    /// Carries out transmissions: sub-channels, int8 (worlds, vehicles), -1 for silence, and powers in dBm, float32.
    fn transmit(
        &mut self,
        py: Python<'_>,
        sub_channels: PyReadonlyArray2<'_, i8>,
        powers_dbm: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<()> {
        // Copied before they are checked: other threads may write them as soon as the interpreter lock is released.
        let sub_channels = self.values("sub_channels", &sub_channels)?.to_vec();
        let powers_dbm = self.values("powers_dbm", &powers_dbm)?.to_vec();
        self.worlds.check_process()?;
        self.worlds.check_slots(self.worlds.elapsed() + 1)?;
        let radio = &self.worlds.setting().scenario.radio;
        let (last, full_power_dbm) = (radio.sub_channels as i8 - 1, radio.max_power_dbm);
        for (index, (&sub_channel, &power_dbm)) in sub_channels.iter().zip(&powers_dbm).enumerate() {
            if !(-1..=last).contains(&sub_channel) {
                let expected = format!("-1 (silent) to {last}");
                return Err(value_error(
                    self.place("sub_channels", index),
                    sub_channel,
                    expected,
                ));
            }
            let allowed = LEAST_POWER_DBM..=full_power_dbm;
            if sub_channel >= 0 && !allowed.contains(&f64::from(power_dbm)) {
                let expected = format!("{LEAST_POWER_DBM} to {full_power_dbm} dBm");
                return Err(value_error(self.place("powers_dbm", index), power_dbm, expected));
            }
        }
        py.detach(|| self.worlds.transmit(&sub_channels, &powers_dbm));
        Ok(())
    }

    /// Checks that a table serves these worlds.
    fn check_table(&self, table: &Table) -> PyResult<()> {
        let Setting { scenario, source } = self.worlds.setting();
        let most = source.most_vehicles(scenario);
        actor::KIND
            .check(scenario, most, &table.parse()?)
            .map_err(exception)
    }

    #[getter]
    fn worlds(&self) -> usize {
        self.worlds.worlds()
    }

    #[getter]
    fn vehicles(&self) -> usize {
        self.worlds.vehicles()
    }

    #[getter]
    fn sub_channels(&self) -> u32 {
        self.worlds.setting().scenario.radio.sub_channels
    }

    #[getter]
    fn gains_hold(&self) -> bool {
        self.worlds.gains_hold()
    }

    /// Slots since the last reset.
    #[getter]
    fn elapsed(&self) -> u32 {
        self.worlds.elapsed()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.worlds.seed()
    }

    /// Index of the first of the present worlds.
    #[getter]
    fn first_world(&self) -> u64 {
        self.worlds.first_world()
    }

    #[getter]
    fn observations(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.observations.view(py)
    }

    #[getter]
    fn float_observations(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_float_observations());
        self.worlds.arrays.float_observations.view(py)
    }

    #[getter]
    fn ages(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.ages.view(py)
    }

    #[getter]
    fn received(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.received.view(py)
    }

    #[getter]
    fn replaced(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.replaced.view(py)
    }

    #[getter]
    fn action_masks(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_masks());
        self.worlds.arrays.masks.view(py)
    }

    /// Where a world's vehicles are: float64 (vehicles, 2), metres, NaN for an absent one.
    fn positions_m<'py>(&self, py: Python<'py>, world: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        check_range("world", world as u64, 0, self.worlds.worlds() as u64 - 1)?;
        let rows = self.worlds.positions_m(world);
        Ok(PyArray2::from_vec2(
            py,
            &rows.iter().map(|row| row.to_vec()).collect::<Vec<_>>(),
        )?)
    }

    #[getter]
    fn rewards(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.rewards.view(py)
    }

    #[getter]
    fn present(&self, py: Python<'_>) -> Py<PyAny> {
        self.worlds.arrays.present.view(py)
    }

    #[getter]
    fn gains_db(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.gains_db.view(py)
    }

    #[getter]
    fn interference_db(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.interference_db.view(py)
    }

    #[getter]
    fn places(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.places.view(py)
    }

    #[getter]
    fn assigned(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.assigned.view(py)
    }

    #[getter]
    fn weights(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.weights.view(py)
    }

    #[getter]
    fn awaits(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.awaits.view(py)
    }

    #[getter]
    fn ring_places(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.ring_places.view(py)
    }

    #[getter]
    fn open_sub_channels(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.open_sub_channels.view(py)
    }

    #[getter]
    fn thresholds(&mut self, py: Python<'_>) -> Py<PyAny> {
        py.detach(|| self.worlds.fill_measurements());
        self.worlds.arrays.thresholds.view(py)
    }
}

impl Batch {
    /// Actions that exist, `[world][vehicle]`.
    fn checked_actions<T>(&self, actions: &PyReadonlyArray2<'_, T>) -> PyResult<Vec<Action>>
    where
        T: Element + Copy + Display,
        usize: TryFrom<T>,
    {
        let actions = self.values("actions", actions)?;
        let known = |(index, &number): (usize, &T)| {
            let action = usize::try_from(number)
                .ok()
                .and_then(|number| Action::ALL.get(number));
            let expected = || format!("0 to {}", Action::ALL.len() - 1);
            action
                .copied()
                .ok_or_else(|| value_error(self.place("actions", index), number, expected()))
        };
        actions.iter().enumerate().map(known).collect()
    }

    /// The values of an array (worlds, vehicles).
    fn values<'a, T: Element>(&self, name: &str, array: &'a PyReadonlyArray2<'_, T>) -> PyResult<&'a [T]> {
        let (shape, expected) = (array.shape(), [self.worlds.worlds(), self.worlds.vehicles()]);
        if shape != expected {
            let text = |shape: &[usize]| format!("shape ({}, {})", shape[0], shape[1]);
            return Err(value_error(name, text(shape), text(&expected)));
        }
        in_c_order(name, array)
    }

    /// An element's name in errors.
    fn place(&self, name: &str, index: usize) -> String {
        let vehicles = self.worlds.vehicles();
        format!("{name}[{}, {}]", index / vehicles, index % vehicles)
    }
}
