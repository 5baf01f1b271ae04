//! Many worlds of one scenario under one policy.

use crate::age::{AgeSummary, WorldAges, ideal_age_ms};
use crate::cell::Cell;
use crate::error::{Error, Result};
use crate::mobility::{Mobility, MobilitySource};
use crate::policy::{Policy, PolicyName};
use crate::scenario::Scenario;
use crate::stream::{Purpose, WorldKey};
use firmware::decision::Decision;
use firmware::table::Table;
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
    /// Runs every world on the current rayon pool, in an order that does not matter: the result is the same for any number
    /// of threads. `build` makes a world's policy; `at_end` looks at each world's cell after its last slot, and its
    /// values come in the order of worlds.
    ///
    /// # Errors
    /// [`Error::Input`] if the trace is too short, or no vehicle is present after warm-up.
    pub fn run<'p, B, E, T>(&self, build: B, at_end: E) -> Result<(AgeSummary, Vec<T>)>
    where
        B: Fn(&WorldKey) -> Box<dyn Policy + 'p> + Sync,
        E: Fn(&Cell<'_>) -> T + Sync,
        T: Send,
    {
        self.source.check_slots(self.extent.slots_per_world())?;
        let (ages, ends): (Vec<WorldAges>, Vec<T>) = (0..u64::from(self.extent.worlds))
            .into_par_iter()
            .map(|world| {
                let key = WorldKey {
                    seed: self.extent.seed,
                    purpose: Purpose::Evaluation,
                    world,
                };
                let mut policy = build(&key);
                let mobility = Mobility::new(self.source, self.scenario, &key);
                let mut cell = Cell::new(self.scenario, mobility, &key);
                let ages = run_world(&mut cell, policy.as_mut(), &self.extent, |_| ());
                (ages, at_end(&cell))
            })
            .unzip();
        let summary = AgeSummary::new(&ages);
        summary
            .map(|summary| (summary, ends))
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
        self.run(|key| policy.build(self.scenario, table, key), at_end)
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

/// Runs one world; `after_slot` looks at its cell after each slot.
pub fn run_world(
    cell: &mut Cell<'_>,
    policy: &mut dyn Policy,
    extent: &Extent,
    mut after_slot: impl FnMut(&Cell<'_>),
) -> WorldAges {
    let mut ages = WorldAges::new(extent.warmup, cell.vehicles());
    let mut decisions = vec![Decision::Silent; cell.vehicles()];
    for slot in 0..extent.slots_per_world() {
        decisions.fill(Decision::Silent);
        policy.decide(cell, &mut decisions);
        let successes = cell.step(&decisions).received.len();
        ages.record(
            slot,
            cell.present().iter().map(|&vehicle| (vehicle, cell.age(vehicle))),
            successes,
        );
        after_slot(cell);
    }
    ages
}
