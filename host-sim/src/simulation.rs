//! Many worlds of one scenario under one policy.

use crate::age::{AgeCounter, AgeSummary, WorldAges, ideal_age_ms};
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::lanes::LANES;
use crate::mobility::{MobilitySource, check_slots};
use crate::policy::{Decider, Kind, Setup};
use crate::scenario::Scenario;
use crate::stream::{Purpose, WorldKey};
use firmware::table::Table;
use kit::error::{Error, Result};
use rayon::prelude::*;

/// How much is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Seed of the run; any number is a fair evaluation seed ([`Purpose`]).
    pub seed: u64,
    /// Independent worlds.
    pub worlds: u32,
    /// Slots that count, after warm-up.
    pub slots: u32,
    /// Slots before.
    pub warmup: u32,
}

impl Extent {
    /// Slots of one world.
    pub fn slots_per_world(&self) -> u32 {
        self.warmup.saturating_add(self.slots)
    }
}

/// A set of worlds that any policy can be run on.
#[derive(Clone, Copy, Debug)]
pub struct Simulation<'s> {
    /// The cell.
    pub scenario: &'s Scenario,
    /// What moves its vehicles.
    pub source: &'s dyn MobilitySource,
    /// How much.
    pub extent: Extent,
}

impl Simulation<'_> {
    /// Runs every world on the current rayon pool, in batches and in an order that do not matter: the result is the same for
    /// any number of threads. `build` makes who decides in a batch; `at_end` looks at each world of a batch after its last
    /// slot, and its values come in the order of worlds.
    ///
    /// # Errors
    /// [`Error::Input`] if the trace is too short, or no vehicle is present after warm-up; what stops a source of places.
    pub fn run<'p, B, E, T>(&self, build: B, at_end: E) -> Result<(AgeSummary, Vec<T>)>
    where
        B: Fn(&Setup<'_>) -> Decider<'p> + Sync,
        E: Fn(&Environment<'_>, usize) -> T + Sync,
        T: Send,
    {
        check_slots(self.source, self.extent.slots_per_world())?;
        let worlds = u64::from(self.extent.worlds);
        // A row of worlds costs the same however full it is, so few worlds are spread over the threads.
        let batch = worlds
            .div_ceil(rayon::current_num_threads() as u64)
            .clamp(1, LANES as u64);
        let batches = (0..worlds.div_ceil(batch))
            .into_par_iter()
            .map(|index| {
                let worlds = index * batch..worlds.min((index + 1) * batch);
                let seed = self.extent.seed;
                let mut environment =
                    Environment::new(self.scenario, self.source, seed, Purpose::Evaluation, worlds);
                let mut decider = build(&environment.setup());
                let ages = run_worlds(&mut environment, &mut decider, &self.extent, |_| ())?;
                let ends = (0..environment.worlds()).map(|world| at_end(&environment, world));
                Ok((ages, ends.collect::<Vec<T>>()))
            })
            .collect::<Result<Vec<_>>>()?;
        let (ages, ends): (Vec<_>, Vec<_>) = batches.into_iter().unzip();
        let summary = AgeSummary::new(&ages.concat());
        summary
            .map(|summary| (summary, ends.into_iter().flatten().collect()))
            .ok_or_else(|| Error::input("slots", "no vehicle after warm-up", "at least one"))
    }

    /// [`Simulation::run`] with a kind of decider.
    ///
    /// # Errors
    /// As [`Simulation::run`], and what [`Kind::check`] refuses.
    pub fn run_policy<T: Send>(
        &self,
        policy: &Kind,
        table: &Table<'_>,
        at_end: impl Fn(&Environment<'_>, usize) -> T + Sync,
    ) -> Result<(AgeSummary, Vec<T>)> {
        policy.check(self.scenario, self.source.most_vehicles(self.scenario), table)?;
        self.run(|setup| (policy.build)(setup, table), at_end)
    }

    /// [`ideal_age_ms`], over the vehicle-slots after warm-up where the number of vehicles changes; `None` where it differs
    /// between worlds.
    pub fn bound_age_ms(&self) -> Option<f64> {
        let Self {
            scenario,
            source,
            extent,
        } = *self;
        let sub_channels = scenario.radio.sub_channels;
        if source.worlds_differ() {
            return None;
        }
        if source.duration_slots().is_none() {
            return Some(ideal_age_ms(source.vehicles(scenario) as u32, sub_channels));
        }
        let key = WorldKey {
            seed: extent.seed,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let (mut mobility, mut places) = (source.open(scenario, &key), Vec::new());
        let (mut sum, mut count) = (0.0, 0.0);
        let update = scenario.radio.slow_update_slots;
        for slot in (0..extent.slots_per_world()).step_by(update as usize) {
            if mobility.advance(slot, &mut places).is_err() {
                return None;
            }
            let vehicles = places.len() as u32;
            // The slots of this update that count.
            let end = slot.saturating_add(update).min(extent.slots_per_world());
            let vehicle_slots = f64::from(vehicles) * f64::from(end.saturating_sub(slot.max(extent.warmup)));
            if vehicle_slots > 0.0 {
                sum += vehicle_slots * ideal_age_ms(vehicles, sub_channels);
                count += vehicle_slots;
            }
        }
        (count > 0.0).then(|| sum / count)
    }
}

/// Runs a batch of worlds from their start; `after_slot` looks at them after each slot.
///
/// # Errors
/// [`Environment::failure`].
pub fn run_worlds(
    environment: &mut Environment<'_>,
    decider: &mut Decider<'_>,
    extent: &Extent,
    mut after_slot: impl FnMut(&Environment<'_>),
) -> Result<Vec<WorldAges>> {
    let (worlds, vehicles) = (environment.worlds(), environment.vehicles());
    let mut ages = AgeCounter::new(extent.warmup, worlds, vehicles);
    let mut decisions = Decisions::new(worlds, vehicles);
    for slot in 0..extent.slots_per_world() {
        run_slot(environment, decider, &mut decisions);
        ages.record(slot, environment);
        after_slot(environment);
    }
    if let Some(error) = environment.take_failure() {
        return Err(error);
    }
    let mut ages = ages.worlds();
    for (world, ages) in ages.iter_mut().enumerate() {
        ages.joiner_waits = environment.joiner_waits(world, extent.warmup);
    }
    Ok(ages)
}

/// Lets everybody decide once, and steps.
pub fn run_slot(environment: &mut Environment<'_>, decider: &mut Decider<'_>, decisions: &mut Decisions) {
    decisions.clear();
    environment.decide(decider, decisions);
    environment.step(decisions);
}
