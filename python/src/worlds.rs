//! A batch of worlds that Python steps: the simulator's environments in parts, one part a task of the thread pool.

use crate::arrays::{Arrays, Part, Reward};
use crate::error::{check_range, exception, value_error};
use crate::evaluation::Evaluation;
use crate::scenario::{Scenario, Setting, names};
use clap::ValueEnum;
use firmware::decision::{Action, Decision, PowerPlan};
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::units::{Dbm, Level, SubChannel};
use host_sim::age::{AgeSummary, WorldAges};
use host_sim::command::options::thread_pool;
use host_sim::environment::{Decisions, Environment};
use host_sim::policy::{PolicyName, power_plan};
use host_sim::simulation::{Extent, Simulation};
use host_sim::stream::Purpose;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;
use self_cell::self_cell;

/// Worlds of a part: enough work for a task, few enough for all cores of a usual batch (chosen).
const PART_WORLDS: usize = 16;

/// Environments of a setting, one a part.
type Environments<'s> = Vec<Environment<'s>>;

self_cell!(
    struct Parts {
        owner: Setting,
        #[not_covariant]
        dependent: Environments,
    }
);

/// Many worlds of one scenario, slot by slot. `freshlane.BatchEnvironment` is its face.
#[pyclass(module = "freshlane._native")]
pub struct Worlds {
    parts: Parts,
    arrays: Arrays,
    /// `[world][vehicle]`.
    seen: Vec<Option<Observation>>,
    decisions: Vec<Decisions>,
    pool: rayon::ThreadPool,
    purpose: Purpose,
    seed: u64,
    /// The first world of the next reset.
    next_world: u64,
    elapsed: u32,
    /// Slots that a trace lasts.
    longest: u32,
    worlds: usize,
    vehicles: usize,
    required_sinr: Level,
    power_plan: PowerPlan,
    max_power_dbm: f64,
    reward: Reward,
    floats_of: Option<u32>,
    record: Option<Record>,
}

/// Ages of held-out worlds.
struct Record {
    extent: Extent,
    ages: Vec<WorldAges>,
}

#[pymethods]
impl Worlds {
    /// Training worlds of a seed, before their first slot.
    #[new]
    #[pyo3(signature = (scenario, mobility, worlds, seed, reward, threads))]
    fn new(
        py: Python<'_>,
        scenario: &Scenario,
        mobility: &str,
        worlds: u64,
        seed: u64,
        reward: &str,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let reward = Reward::from_str(reward, false)
            .map_err(|_| value_error("reward", format!("\"{reward}\""), names::<Reward>()))?;
        check_range("worlds", worlds, 1, 1_000_000)?;
        let setting = Setting::new(scenario, mobility)?;
        Self::build(
            py,
            setting,
            Purpose::Training,
            seed,
            worlds as usize,
            reward,
            threads,
        )
    }

    /// Held-out worlds whose ages are recorded.
    #[staticmethod]
    #[pyo3(signature = (scenario, mobility, worlds, slots, warmup, seed, threads))]
    #[allow(clippy::too_many_arguments, reason = "Python passes keywords")]
    fn held_out(
        py: Python<'_>,
        scenario: &Scenario,
        mobility: &str,
        worlds: u32,
        slots: u32,
        warmup: u32,
        seed: u64,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let extent = crate::evaluation::extent(worlds, slots, warmup, seed)?;
        let setting = Setting::new(scenario, mobility)?;
        let purpose = Purpose::Evaluation;
        let mut held_out = Self::build(py, setting, purpose, seed, worlds as usize, Reward::Own, threads)?;
        held_out.check_slots(extent.slots_per_world())?;
        let ages = (0..worlds).map(|_| WorldAges::new(warmup, held_out.vehicles));
        held_out.record = Some(Record {
            extent,
            ages: ages.collect(),
        });
        Ok(held_out)
    }

    /// Begins anew: with the first worlds of another seed, or with the worlds behind the last ones.
    #[pyo3(signature = (seed = None))]
    fn reset(&mut self, py: Python<'_>, seed: Option<u64>) {
        if let Some(seed) = seed {
            self.seed = seed;
            self.next_world = 0;
        }
        py.detach(|| self.begin());
    }

    /// Carries out actions, uint8 or int64 (worlds, vehicles), and begins the next slot.
    fn step(&mut self, py: Python<'_>, actions: ActionArray<'_>) -> PyResult<()> {
        match &actions {
            ActionArray::Bytes(array) => self.step_actions(py, array),
            ActionArray::Words(array) => self.step_actions(py, array),
        }
    }

    /// Carries out transmissions: sub-channels, int8 (worlds, vehicles), -1 for silence, and powers in dBm, float32.
    fn transmit(
        &mut self,
        py: Python<'_>,
        sub_channels: PyReadonlyArray2<'_, i8>,
        powers_dbm: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<()> {
        let sub_channels = self.values("sub_channels", &sub_channels)?;
        let powers_dbm = self.values("powers_dbm", &powers_dbm)?;
        self.check_slots(self.elapsed + 1)?;
        let vehicles = self.vehicles;
        let place = |name: &str, index: usize| format!("{name}[{}, {}]", index / vehicles, index % vehicles);
        let pairs = || sub_channels.iter().zip(powers_dbm).enumerate();
        for (index, (&sub_channel, &power_dbm)) in pairs() {
            if !(-1..=2).contains(&sub_channel) {
                return Err(value_error(
                    place("sub_channels", index),
                    sub_channel,
                    "-1 (silent) to 2",
                ));
            }
            let allowed = -100.0..=self.max_power_dbm;
            if sub_channel >= 0 && !allowed.contains(&f64::from(power_dbm)) {
                let expected = format!("-100 to {} dBm", self.max_power_dbm);
                return Err(value_error(place("powers_dbm", index), power_dbm, expected));
            }
        }
        let decision = |index: usize, _: Option<&Observation>| {
            match u8::try_from(sub_channels[index]).ok().and_then(SubChannel::new) {
                // Rounded down to the units' 1/256 dB, so that no limit is exceeded.
                Some(sub_channel) => Decision::Transmit {
                    sub_channel,
                    power: Dbm::from_bits((powers_dbm[index] * 256.0).floor() as i16),
                },
                None => Decision::Silent,
            }
        };
        py.detach(|| self.advance(decision));
        Ok(())
    }

    /// What the recorded slots say; only of held-out worlds, after all their slots.
    fn summary(&self, policy: String) -> PyResult<Evaluation> {
        let expected = "held-out worlds after all their slots";
        let found = || format!("slot {}", self.elapsed);
        let record = self
            .record
            .as_ref()
            .ok_or_else(|| value_error("summary", found(), expected))?;
        if self.elapsed != record.extent.slots_per_world() {
            return Err(value_error("summary", found(), expected));
        }
        let summary = AgeSummary::new(&record.ages)
            .ok_or_else(|| value_error("slots", "no vehicle after warm-up", "at least one"))?;
        let bound_age_ms = self.parts.with_dependent(|setting, _| {
            let simulation = Simulation {
                scenario: &setting.scenario,
                source: &setting.source,
                extent: record.extent,
            };
            simulation.bound_age_ms()
        });
        Ok(Evaluation::new(
            policy,
            record.extent,
            self.vehicles,
            bound_age_ms,
            summary,
        ))
    }

    /// Checks that a table serves these worlds.
    fn check_table(&self, table: &crate::table::Table) -> PyResult<()> {
        let table = table.parse()?;
        self.parts.with_dependent(|setting, _| {
            let most = setting.source.most_vehicles(&setting.scenario);
            PolicyName::Actor
                .check(&setting.scenario, most, &table)
                .map_err(exception)
        })
    }

    #[getter]
    fn worlds(&self) -> usize {
        self.worlds
    }

    #[getter]
    fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// Slots since the last reset.
    #[getter]
    fn elapsed(&self) -> u32 {
        self.elapsed
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    /// Index of the first of the present worlds.
    #[getter]
    fn first_world(&self) -> u64 {
        self.next_world - self.worlds as u64
    }

    #[getter]
    fn max_power_dbm(&self) -> f64 {
        self.max_power_dbm
    }

    #[getter]
    fn observations(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.observations.view(py)
    }

    #[getter]
    fn float_observations(&mut self, py: Python<'_>) -> Py<PyAny> {
        if self.floats_of != Some(self.elapsed) {
            py.detach(|| self.arrays.fill_float_observations());
            self.floats_of = Some(self.elapsed);
        }
        self.arrays.float_observations.view(py)
    }

    #[getter]
    fn ages(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.ages.view(py)
    }

    #[getter]
    fn received(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.received.view(py)
    }

    #[getter]
    fn rewards(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.rewards.view(py)
    }

    #[getter]
    fn gains_db(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.gains_db.view(py)
    }

    #[getter]
    fn interference_db(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.interference_db.view(py)
    }

    #[getter]
    fn home_sub_channels(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.home_sub_channels.view(py)
    }

    #[getter]
    fn periods(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.periods.view(py)
    }

    #[getter]
    fn joiner_probabilities(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.joiner_probabilities.view(py)
    }

    #[getter]
    fn present(&self, py: Python<'_>) -> Py<PyAny> {
        self.arrays.present.view(py)
    }
}

/// Actions as people have them: bytes, or the 64-bit integers that arg-max functions give.
#[derive(FromPyObject)]
pub enum ActionArray<'py> {
    /// uint8.
    Bytes(PyReadonlyArray2<'py, u8>),
    /// int64.
    Words(PyReadonlyArray2<'py, i64>),
}

impl Worlds {
    fn build(
        py: Python<'_>,
        setting: Setting,
        purpose: Purpose,
        seed: u64,
        worlds: usize,
        reward: Reward,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        let Setting { scenario, source } = &setting;
        let shipped = Table::parse(firmware::tables::DISTILLED);
        let shipped = shipped.map_err(|error| value_error("built-in table", error, "a table"))?;
        // As the clock, agents need the base station's groups.
        PolicyName::Clock
            .check(scenario, source.most_vehicles(scenario), &shipped)
            .map_err(exception)?;
        let vehicles = source.vehicles(scenario);
        let arrays = Arrays::zeros(py, worlds, vehicles)?;
        let longest = match source {
            host_sim::mobility::MobilitySource::Grid => u32::MAX,
            host_sim::mobility::MobilitySource::Trace(trace) => trace.duration_slots(),
        };
        let (required_sinr, power_plan) = (scenario.radio.required_level(), power_plan(scenario));
        let max_power_dbm = scenario.radio.max_power_dbm;
        let part_sizes = ranges(0, worlds).map(|range| range.end - range.start);
        let decisions = part_sizes
            .map(|part| Decisions::new(part as usize, vehicles))
            .collect();
        let parts = Parts::new(setting, |Setting { scenario, source }| {
            ranges(0, worlds)
                .map(|range| Environment::new(scenario, source, seed, purpose, range))
                .collect()
        });
        let mut batch = Self {
            parts,
            arrays,
            seen: vec![None; worlds * vehicles],
            decisions,
            pool: thread_pool(threads).map_err(exception)?,
            purpose,
            seed,
            next_world: 0,
            elapsed: 0,
            longest,
            worlds,
            vehicles,
            required_sinr,
            power_plan,
            max_power_dbm,
            reward,
            floats_of: None,
            record: None,
        };
        py.detach(|| batch.begin());
        Ok(batch)
    }

    /// The next worlds before their first slot.
    fn begin(&mut self) {
        let (seed, purpose, first) = (self.seed, self.purpose, self.next_world);
        let worlds = self.worlds;
        self.next_world += worlds as u64;
        self.elapsed = 0;
        let pool = &self.pool;
        self.parts
            .with_dependent_mut(|Setting { scenario, source }, environments| {
                let parts = environments.iter_mut().zip(ranges(first, worlds));
                pool.install(|| {
                    parts.par_bridge().for_each(|(environment, range)| {
                        *environment = Environment::new(scenario, source, seed, purpose, range);
                    });
                });
            });
        self.observe(|_, _| ());
    }

    /// Checks that the trace is long enough.
    fn check_slots(&self, slots: u32) -> PyResult<()> {
        if slots <= self.longest {
            return Ok(());
        }
        let expected = format!("at most {}, the length of the trace", self.longest);
        Err(value_error("slots", slots, expected))
    }

    fn step_actions<T>(&mut self, py: Python<'_>, actions: &PyReadonlyArray2<'_, T>) -> PyResult<()>
    where
        T: numpy::Element + Copy + Sync + std::fmt::Display,
        u8: TryFrom<T>,
    {
        let actions = self.values("actions", actions)?;
        self.check_slots(self.elapsed + 1)?;
        let known =
            |&action: &T| u8::try_from(action).is_ok_and(|action| usize::from(action) < Action::ALL.len());
        if let Some(index) = actions.iter().position(|action| !known(action)) {
            let place = format!("actions[{}, {}]", index / self.vehicles, index % self.vehicles);
            let expected = format!("0 to {}", Action::ALL.len() - 1);
            return Err(value_error(place, actions[index], expected));
        }
        let plan = self.power_plan;
        let decision = |index: usize, seen: Option<&Observation>| {
            let action = u8::try_from(actions[index])
                .map_or(Action::Silent, |action| Action::ALL[usize::from(action)]);
            seen.map_or(Decision::Silent, |observation| plan.decision(action, observation))
        };
        py.detach(|| self.advance(decision));
        Ok(())
    }

    /// The values of an array (worlds, vehicles).
    fn values<'a, T: numpy::Element>(
        &self,
        name: &str,
        array: &'a PyReadonlyArray2<'_, T>,
    ) -> PyResult<&'a [T]> {
        let (shape, expected) = (array.shape(), [self.worlds, self.vehicles]);
        if shape != expected {
            let text = |shape: &[usize]| format!("shape ({}, {})", shape[0], shape[1]);
            return Err(value_error(name, text(shape), text(&expected)));
        }
        let values = array.as_slice();
        values.map_err(|error| value_error(name, error, "an array in C order"))
    }

    /// Decides for every vehicle by its index `world * vehicles + vehicle`, carries it out, and looks at the next slot.
    fn advance(&mut self, decision: impl Fn(usize, Option<&Observation>) -> Decision + Sync) {
        let (vehicles, seen) = (self.vehicles, &self.seen);
        let decide = |part: usize, environment: &mut Environment<'_>, decisions: &mut Decisions| {
            for world in 0..environment.worlds() {
                let first = (part * PART_WORLDS + world) * vehicles;
                for &vehicle in environment.present() {
                    let index = first + vehicle;
                    decisions.set(world, vehicle, decision(index, seen[index].as_ref()));
                }
            }
            environment.step(decisions);
        };
        let (pool, decisions) = (&self.pool, &mut self.decisions);
        self.parts.with_dependent_mut(|_, environments| {
            pool.install(|| {
                environments
                    .par_iter_mut()
                    .zip(decisions)
                    .enumerate()
                    .for_each(|(part, (environment, decisions))| decide(part, environment, decisions));
            });
        });
        self.elapsed += 1;
        let slot = self.elapsed - 1;
        self.observe(|environment, ages| record_slot(slot, environment, ages));
    }

    /// Fills the arrays; `after` takes in a part's ages where they are recorded.
    fn observe(&mut self, after: impl Fn(&Environment<'_>, &mut [WorldAges]) + Sync) {
        let (vehicles, required_sinr, reward) = (self.vehicles, self.required_sinr, self.reward);
        self.floats_of = None;
        let (arrays, seen, pool) = (&mut self.arrays, &mut self.seen, &self.pool);
        let mut no_ages = Vec::new();
        let ages = self
            .record
            .as_mut()
            .map_or(&mut no_ages, |record| &mut record.ages);
        self.parts.with_dependent(|_, environments| {
            if let Some(first) = environments.first() {
                arrays.mark_present(first.present());
            }
            let mut ages = ages.chunks_mut(PART_WORLDS);
            let ages: Vec<&mut [WorldAges]> = environments
                .iter()
                .map(|_| ages.next().unwrap_or_default())
                .collect();
            let parts: Vec<(Part<'_>, &mut [WorldAges])> =
                arrays.parts(PART_WORLDS).into_iter().zip(ages).collect();
            pool.install(|| {
                environments
                    .par_iter()
                    .zip(parts)
                    .zip(seen.par_chunks_mut(PART_WORLDS * vehicles))
                    .for_each(|((environment, (mut part, ages)), seen)| {
                        part.fill(environment, required_sinr, reward, seen);
                        after(environment, ages);
                    });
            });
        });
    }
}

/// Takes in the ages after a slot; the same order and numbers as in [`host_sim::simulation::run_world`].
fn record_slot(slot: u32, environment: &Environment<'_>, ages: &mut [WorldAges]) {
    for (world, ages) in ages.iter_mut().enumerate() {
        let present = environment.present().iter();
        let successes = (0..environment.vehicles()).filter(|&vehicle| environment.received(world, vehicle));
        ages.record(
            slot,
            present.map(|&vehicle| (vehicle, environment.age(world, vehicle))),
            successes.count(),
        );
    }
}

/// The worlds of each part.
fn ranges(first: u64, worlds: usize) -> impl Iterator<Item = std::ops::Range<u64>> + Send {
    let end = first + worlds as u64;
    (first..end)
        .step_by(PART_WORLDS)
        .map(move |start| start..(start + PART_WORLDS as u64).min(end))
}
