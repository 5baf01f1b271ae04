//! A batch of worlds that Python steps: the simulator's environments in parts, one part a task of the thread pool.

use crate::arrays::{Arrays, Part};
use crate::error::{check_range, exception};
use crate::parts::Parts;
use crate::scenario::Setting;
use firmware::decision::{Action, PowerPlan};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::Observation;
use firmware::ring::MAX_PLACES;
use firmware::units::Dbm;
use host_sim::age::{AgeCounter, AgeSummary};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::lanes::LANES;
use host_sim::mobility::check_slots;
use host_sim::policy::power_plan;
use host_sim::policy::{self, Observer};
use host_sim::simulation::{Extent, Simulation};
use host_sim::stream::Purpose;
use host_sim::thread_pool;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::Arc;
use trainer::forms::check_sub_channels;
use trainer::game::reward::Reward;

/// Worlds of a part: one row, the least that the simulator does at once. So a part is one block.
const PART_WORLDS: usize = LANES;

/// Many worlds of one scenario, slot by slot, and the arrays that show them.
pub struct Worlds {
    parts: Parts,
    /// What Python sees.
    pub arrays: Arrays,
    /// One a part.
    decisions: Vec<Decisions>,
    /// Ages of recorded worlds, one a part.
    counters: Vec<AgeCounter>,
    /// None for one thread, which is the caller's.
    pool: Option<Arc<rayon::ThreadPool>>,
    /// The process whose threads the pool has.
    process: u32,
    observer: Observer,
    power_plan: PowerPlan,
    reward: Reward,
    purpose: Purpose,
    seed: u64,
    /// The first world after the present ones.
    next_world: u64,
    elapsed: u32,
    worlds: usize,
    vehicles: usize,
    /// Whether the floats, and the measurements, are the present slot's.
    floats_filled: bool,
    measurements_filled: bool,
    masks_filled: bool,
}

/// A part with its share of everything that a step writes.
struct Task<'a, 's> {
    /// Index of its first world in the batch.
    first: usize,
    environment: &'a mut Environment<'s>,
    decisions: &'a mut Decisions,
    counter: Option<&'a mut AgeCounter>,
    arrays: Part<'a>,
}

impl Worlds {
    /// The first worlds of a seed before their first slot; `threads` is one a core without a number.
    ///
    /// # Errors
    /// `ValueError` for more vehicles than a ring has places, for more sub-channels than units know, and for what does not fit the memory.
    pub fn new(
        py: Python<'_>,
        setting: Setting,
        purpose: Purpose,
        seed: u64,
        worlds: u32,
        reward: Reward,
        threads: Option<u16>,
    ) -> PyResult<Self> {
        check_range("worlds", worlds.into(), 1, 1_000_000)?;
        let worlds = worlds as usize;
        let Setting { scenario, source } = &setting;
        let (observation, output) = (ObservationForm::Ring, OutputForm::Actions);
        check_sub_channels("radio.sub_channels", scenario, observation, output).map_err(exception)?;
        check_range(
            "vehicles",
            source.most_vehicles(scenario) as u64,
            1,
            MAX_PLACES.into(),
        )?;
        let vehicles = source.vehicles(scenario);
        let sub_channels = scenario.radio.sub_channels as usize;
        let decisions = ranges(worlds).map(|part| Decisions::new(part.len(), vehicles));
        let own_pool = threads != Some(1);
        let mut batch = Self {
            arrays: Arrays::zeros(py, worlds, vehicles, sub_channels)?,
            decisions: decisions.collect(),
            counters: Vec::new(),
            pool: own_pool
                .then(|| thread_pool(threads))
                .transpose()
                .map_err(exception)?
                .map(Arc::new),
            process: std::process::id(),
            observer: Observer::new(scenario.radio.required_level()),
            power_plan: power_plan(scenario),
            reward,
            purpose,
            seed,
            next_world: worlds as u64,
            elapsed: 0,
            worlds,
            vehicles,
            floats_filled: false,
            measurements_filled: false,
            masks_filled: false,
            parts: Parts::new(setting, |Setting { scenario, source }| {
                let part = |range: std::ops::Range<usize>| {
                    let worlds = range.start as u64..range.end as u64;
                    Environment::new(scenario, source.as_ref(), seed, purpose, worlds)
                };
                ranges(worlds).map(part).collect()
            }),
        };
        py.detach(|| batch.run(|_, _| ()));
        Ok(batch)
    }

    /// Worlds in the same state, which go on by themselves, and arrays of their own.
    ///
    /// # Errors
    /// `ValueError` for what does not fit the memory.
    pub fn copy(&mut self, py: Python<'_>) -> PyResult<Self> {
        Ok(Self {
            parts: self.parts.copy().map_err(exception)?,
            arrays: self.arrays.copy(py)?,
            decisions: self.decisions.clone(),
            counters: self.counters.clone(),
            pool: self.pool.clone(),
            observer: self.observer.clone(),
            ..*self
        })
    }

    /// Checks that the worker threads are there: a fork does not copy them, and waiting for them would never end.
    ///
    /// # Errors
    /// `RuntimeError` in a process that was forked off after the worlds were made.
    pub fn check_process(&self) -> PyResult<()> {
        let here = std::process::id();
        if self.pool.is_none() || here == self.process {
            return Ok(());
        }
        Err(PyRuntimeError::new_err(format!(
            "environment: found process {here}, a fork of process {}, which has the environment's threads, expected that one: make the \
             environment in the process that uses it, start processes with \"spawn\", or set threads=1",
            self.process
        )))
    }

    /// Records ages from the next slot on; those of the first `warmup` slots count for the cold start only.
    pub fn record(&mut self, warmup: u32) {
        let counter = |part: std::ops::Range<usize>| AgeCounter::new(warmup, part.len(), self.vehicles);
        self.counters = ranges(self.worlds).map(counter).collect();
    }

    /// The recorded ages; `None` if no vehicle was present after warm-up.
    pub fn summary(&self) -> Option<AgeSummary> {
        let ages: Vec<_> = self.counters.iter().flat_map(AgeCounter::worlds).collect();
        AgeSummary::new(&ages)
    }

    /// [`Simulation::bound_age_ms`] of these worlds.
    pub fn bound_age_ms(&self, extent: Extent) -> f64 {
        let Setting { scenario, source } = self.setting();
        let simulation = Simulation {
            scenario,
            source: source.as_ref(),
            extent,
        };
        simulation.bound_age_ms().unwrap_or(f64::NAN)
    }

    /// What the worlds are made of.
    pub fn setting(&self) -> &Setting {
        self.parts.setting()
    }

    /// How many worlds.
    pub fn worlds(&self) -> usize {
        self.worlds
    }

    /// How many vehicles ever appear.
    pub fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// Whether gains as they were measured still say that a transmission will be received, as the base station broadcasts.
    pub fn gains_hold(&self) -> bool {
        let first = self.parts.environments().first();
        first.is_some_and(|environment| environment.broadcasts(0).gains_hold())
    }

    /// Slots since the worlds began.
    pub fn elapsed(&self) -> u32 {
        self.elapsed
    }

    /// The seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Index of the first of the present worlds.
    pub fn first_world(&self) -> u64 {
        self.next_world - self.worlds as u64
    }

    /// Goes on with the first worlds of another seed, or with those behind the present ones.
    pub fn reset(&mut self, seed: Option<u64>) {
        if let Some(seed) = seed {
            self.seed = seed;
            self.next_world = 0;
        }
        self.begin();
    }

    fn begin(&mut self) {
        let (seed, purpose, next) = (self.seed, self.purpose, self.next_world);
        let worlds = self.worlds;
        self.next_world += worlds as u64;
        self.elapsed = 0;
        self.run(|_, task| {
            let last = (task.first + PART_WORLDS).min(worlds) as u64;
            let range = next + task.first as u64..next + last;
            task.environment.reset(seed, purpose, range);
        });
    }

    /// Checks that a trace is long enough for so many slots.
    ///
    /// # Errors
    /// `ValueError` if it is shorter.
    pub fn check_slots(&self, slots: u32) -> PyResult<()> {
        check_slots(self.setting().source.as_ref(), slots).map_err(exception)
    }

    /// Carries out every vehicle's action, `[world][vehicle]`, and begins the next slot.
    pub fn act(&mut self, actions: &[Action]) {
        let (vehicles, plan, observer) = (self.vehicles, self.power_plan, self.observer.clone());
        self.advance(|task| {
            let Task {
                first,
                environment,
                decisions,
                ..
            } = task;
            let worlds = environment.worlds();
            let of = |world: usize, vehicle: usize| actions[(*first + world) * vehicles + vehicle];
            if worlds == 1 || environment.scenario().feedback.measurement_loss > 0.0 {
                // A row of which one lane counts is more work than one unit, and units that measured nothing stay silent.
                for &vehicle in environment.present() {
                    for world in 0..worlds {
                        if let Some(measurement) = environment.measurement(world, vehicle) {
                            let observation =
                                Observation::new(&measurement, environment.identity(world, vehicle));
                            decisions.set(world, vehicle, plan.decision(of(world, vehicle), &observation));
                        }
                    }
                }
                return;
            }
            let mut observer = observer.clone();
            observer.hear(&environment.broadcasts(0));
            let mut chosen = [Action::Silent as i32; LANES];
            for &vehicle in environment.present() {
                for (world, chosen) in chosen[..worlds].iter_mut().enumerate() {
                    *chosen = of(world, vehicle) as i32;
                }
                let senses = environment.senses(0, vehicle);
                policy::carry_out(&observer, &plan, &senses, &chosen, &mut decisions.of(0, vehicle));
            }
        });
    }

    /// Carries out transmissions, `[world][vehicle]`, and begins the next slot. A negative sub-channel is silence.
    pub fn transmit(&mut self, sub_channels: &[i8], powers_dbm: &[f32]) {
        let vehicles = self.vehicles;
        self.advance(|task| {
            for &vehicle in task.environment.present() {
                for world in 0..task.environment.worlds() {
                    let index = (task.first + world) * vehicles + vehicle;
                    if let Ok(sub_channel) = usize::try_from(sub_channels[index]) {
                        // Rounded down to the units' 1/256 dB, so that no limit is exceeded.
                        let power = Dbm::from_bits((powers_dbm[index] * 256.0).floor() as i16);
                        task.decisions.transmit(world, vehicle, sub_channel, power);
                    }
                }
            }
        });
    }

    /// Lets `decide` decide for every present vehicle of every part, carries the decisions out, and looks at the next slot.
    fn advance(&mut self, decide: impl Fn(&mut Task<'_, '_>) + Sync) {
        let slot = self.elapsed;
        self.elapsed += 1;
        self.run(|_, task| {
            task.decisions.clear();
            decide(task);
            task.environment.step(task.decisions);
            if let Some(counter) = &mut task.counter {
                counter.record(slot, task.environment);
            }
        });
    }

    /// Does `work` on every part, then fills its arrays.
    fn run(&mut self, work: impl for<'s> Fn(&'s Setting, &mut Task<'_, 's>) + Sync) {
        self.floats_filled = false;
        self.measurements_filled = false;
        self.masks_filled = false;
        let (arrays, decisions, pool) = (&mut self.arrays, &mut self.decisions, &self.pool);
        let (observer, reward, worlds) = (&self.observer, &self.reward, self.worlds);
        let counters = self.counters.iter_mut().map(Some);
        let counters = counters.chain(std::iter::repeat_with(|| None));
        self.parts.with(|setting, environments| {
            let shares = environments.iter_mut().zip(decisions).zip(counters);
            let shares = shares.zip(arrays.parts(PART_WORLDS)).zip(ranges(worlds));
            let tasks = shares.map(|((((environment, decisions), counter), arrays), range)| Task {
                first: range.start,
                environment,
                decisions,
                counter,
                arrays,
            });
            match pool {
                Some(pool) => {
                    let tasks: Vec<_> = tasks.collect();
                    let tasks = tasks.into_par_iter();
                    pool.install(|| tasks.for_each(|task| complete(setting, task, &work, observer, reward)));
                }
                None => tasks.for_each(|task| complete(setting, task, &work, observer, reward)),
            }
            if let Some(first) = environments.first() {
                arrays.mark_present(first.present());
            }
        });
    }

    /// Brings the float observations up to the present slot.
    pub fn fill_float_observations(&mut self) {
        if !std::mem::replace(&mut self.floats_filled, true) {
            self.arrays.fill_float_observations();
        }
    }

    /// Brings levels and broadcasts up to the present slot.
    pub fn fill_measurements(&mut self) {
        if std::mem::replace(&mut self.measurements_filled, true) {
            return;
        }
        for (part, environment) in self.parts.environments().iter().enumerate() {
            self.arrays.fill_measurements(part * PART_WORLDS, environment);
        }
    }

    /// Brings the masks of actions up to the present slot.
    pub fn fill_masks(&mut self) {
        if std::mem::replace(&mut self.masks_filled, true) {
            return;
        }
        for (part, environment) in self.parts.environments().iter().enumerate() {
            self.arrays
                .fill_masks(part * PART_WORLDS, environment, &self.power_plan);
        }
    }

    /// Where a world's vehicles are, in metres: (x, y) by vehicle, NaN for an absent one.
    pub fn positions_m(&self, world: usize) -> Vec<[f64; 2]> {
        let mut positions = vec![[f64::NAN; 2]; self.vehicles];
        let environment = &self.parts.environments()[world / PART_WORLDS];
        for &(vehicle, place) in environment.places(world % PART_WORLDS) {
            positions[vehicle] = [place.x_m, place.y_m];
        }
        positions
    }
}

/// Does `work` on a part and fills its arrays.
fn complete<'s>(
    setting: &'s Setting,
    mut task: Task<'_, 's>,
    work: &impl Fn(&'s Setting, &mut Task<'_, 's>),
    observer: &Observer,
    reward: &Reward,
) {
    work(setting, &mut task);
    task.arrays.fill(task.environment, observer, reward);
}

/// The worlds of each part.
fn ranges(worlds: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    let starts = (0..worlds).step_by(PART_WORLDS);
    starts.map(move |start| start..(start + PART_WORLDS).min(worlds))
}
