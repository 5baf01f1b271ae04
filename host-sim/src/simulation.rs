//! Many worlds of one scenario under one policy.

use crate::age::{AgeSummary, WorldAges};
use crate::cell::Cell;
use crate::error::{Error, Result};
use crate::mobility::Mobility;
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

/// Runs every world of an extent on the current rayon pool, in an order that does not matter: the result is the same for
/// any number of threads. `build` makes a world's policy, `finished` is called after each world.
///
/// # Errors
/// [`Error::Input`] if no vehicle is present after warm-up.
pub fn simulate<'p, B>(
    scenario: &Scenario,
    extent: &Extent,
    build: B,
    finished: impl Fn() + Sync,
) -> Result<AgeSummary>
where
    B: Fn(&WorldKey) -> Box<dyn Policy + 'p> + Sync,
{
    let worlds: Vec<WorldAges> = (0..u64::from(extent.worlds))
        .into_par_iter()
        .map(|world| {
            let key = WorldKey {
                seed: extent.seed,
                purpose: Purpose::Evaluation,
                world,
            };
            let mut policy = build(&key);
            let mut cell = Cell::new(scenario, Mobility::new(scenario, &key), &key);
            let ages = run(&mut cell, policy.as_mut(), extent);
            finished();
            ages
        })
        .collect();
    AgeSummary::new(&worlds).ok_or_else(|| Error::input("slots", "no vehicle after warm-up", "at least one"))
}

/// Runs one world.
fn run(cell: &mut Cell<'_>, policy: &mut dyn Policy, extent: &Extent) -> WorldAges {
    let mut ages = WorldAges::new(extent.warmup, cell.vehicles());
    let mut decisions = vec![Decision::Silent; cell.vehicles()];
    for slot in 0..extent.warmup + extent.slots {
        decisions.fill(Decision::Silent);
        policy.decide(cell, &mut decisions);
        let successes = cell.step(&decisions).received.len();
        ages.record(
            slot,
            cell.present().iter().map(|&vehicle| (vehicle, cell.age(vehicle))),
            successes,
        );
    }
    ages
}

/// [`simulate`] with one of the named policies.
///
/// # Errors
/// As [`simulate`], and what [`PolicyName::check`] refuses.
pub fn simulate_policy(
    scenario: &Scenario,
    extent: &Extent,
    policy: PolicyName,
    table: &Table<'_>,
    finished: impl Fn() + Sync,
) -> Result<AgeSummary> {
    policy.check(scenario, scenario.cell.vehicles as usize, table)?;
    simulate(
        scenario,
        extent,
        |key| policy.build(scenario, table, key),
        finished,
    )
}
