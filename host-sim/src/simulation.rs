//! Many worlds of one scenario under one policy.

use crate::age::{AgeCounter, AgeSummary, WorldAges, ideal_age_ms};
use crate::cell::Cell;
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::lanes::LANES;
use crate::mobility::MobilitySource;
use crate::policy::{Policy, PolicyName};
use crate::scenario::Scenario;
use crate::stream::Purpose;
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
    pub source: &'s MobilitySource,
    /// How much.
    pub extent: Extent,
}

impl Simulation<'_> {
    /// Runs every world on the current rayon pool, in batches and in an order that do not matter: the result is the same for
    /// any number of threads. `build` makes the policy of a batch; `at_end` looks at each world's cell after its last slot,
    /// and its values come in the order of worlds.
    ///
    /// # Errors
    /// [`Error::Input`] if the trace is too short, or no vehicle is present after warm-up.
    pub fn run<'p, B, E, T>(&self, build: B, at_end: E) -> Result<(AgeSummary, Vec<T>)>
    where
        B: Fn(&Environment<'_>) -> Box<dyn Policy + 'p> + Sync,
        E: Fn(&Cell<'_>) -> T + Sync,
        T: Send,
    {
        self.source.check_slots(self.extent.slots_per_world())?;
        let worlds = u64::from(self.extent.worlds);
        // A row of worlds costs the same however full it is, so few worlds are spread over the threads.
        let batch = worlds
            .div_ceil(rayon::current_num_threads() as u64)
            .clamp(1, LANES as u64);
        let batches: Vec<(Vec<WorldAges>, Vec<T>)> = (0..worlds.div_ceil(batch))
            .into_par_iter()
            .map(|index| {
                let worlds = index * batch..worlds.min((index + 1) * batch);
                let seed = self.extent.seed;
                let mut environment =
                    Environment::new(self.scenario, self.source, seed, Purpose::Evaluation, worlds);
                let mut policy = build(&environment);
                let ages = run_worlds(&mut environment, policy.as_mut(), &self.extent, |_| ());
                let ends = (0..environment.worlds()).map(|world| at_end(&environment.cell(world)));
                (ages, ends.collect())
            })
            .collect();
        let (ages, ends): (Vec<_>, Vec<_>) = batches.into_iter().unzip();
        let summary = AgeSummary::new(&ages.concat());
        summary
            .map(|summary| (summary, ends.into_iter().flatten().collect()))
            .ok_or_else(|| Error::input("slots", "no vehicle after warm-up", "at least one"))
    }

    /// [`Simulation::run`] with one of the named policies.
    ///
    /// # Errors
    /// As [`Simulation::run`], and what [`PolicyName::check`] refuses.
    pub fn run_policy<T: Send>(
        &self,
        policy: PolicyName,
        table: &Table<'_>,
        at_end: impl Fn(&Cell<'_>) -> T + Sync,
    ) -> Result<(AgeSummary, Vec<T>)> {
        policy.check(self.scenario, self.source.most_vehicles(self.scenario), table)?;
        self.run(|environment| policy.build(environment, table), at_end)
    }

    /// [`ideal_age_ms`], over the vehicle-slots after warm-up where the number of vehicles changes.
    pub fn bound_age_ms(&self) -> f64 {
        let sub_channels = self.scenario.radio.sub_channels;
        match self.source {
            MobilitySource::Grid | MobilitySource::Streets(_) => {
                ideal_age_ms(self.scenario.cell.vehicles, sub_channels)
            }
            MobilitySource::Trace(trace) => {
                let (mut sum, mut count) = (0.0, 0.0);
                let mut cursor = trace.cursor();
                let update = self.scenario.radio.slow_update_slots;
                for slot in (0..self.extent.slots_per_world()).step_by(update as usize) {
                    let vehicles = cursor.advance_to(slot).count() as u32;
                    // The slots of this update that count.
                    let end = slot.saturating_add(update).min(self.extent.slots_per_world());
                    let vehicle_slots =
                        f64::from(vehicles) * f64::from(end.saturating_sub(slot.max(self.extent.warmup)));
                    if vehicle_slots > 0.0 {
                        sum += vehicle_slots * ideal_age_ms(vehicles, sub_channels);
                        count += vehicle_slots;
                    }
                }
                if count > 0.0 { sum / count } else { f64::NAN }
            }
        }
    }
}

/// Runs a batch of worlds from their start; `after_slot` looks at them after each slot.
pub fn run_worlds(
    environment: &mut Environment<'_>,
    policy: &mut dyn Policy,
    extent: &Extent,
    mut after_slot: impl FnMut(&Environment<'_>),
) -> Vec<WorldAges> {
    let (worlds, vehicles) = (environment.worlds(), environment.vehicles());
    let mut ages = AgeCounter::new(extent.warmup, worlds, vehicles);
    let mut decisions = Decisions::new(worlds, vehicles);
    for slot in 0..extent.slots_per_world() {
        run_slot(environment, policy, &mut decisions);
        ages.record(
            environment.vectors(),
            slot,
            environment.present(),
            environment.ages(),
            environment.successes(),
        );
        after_slot(environment);
    }
    let mut ages = ages.worlds();
    for (world, ages) in ages.iter_mut().enumerate() {
        ages.joiner_waits = environment.joiner_waits(world, extent.warmup);
    }
    ages
}

/// Lets everybody decide once, and steps.
pub fn run_slot(environment: &mut Environment<'_>, policy: &mut dyn Policy, decisions: &mut Decisions) {
    decisions.clear();
    policy.decide(environment, decisions);
    environment.step(decisions);
}
