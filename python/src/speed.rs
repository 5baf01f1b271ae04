//! The native loop that the Python one is measured against.

use crate::scenario::{Scenario, Setting};
use firmware::decision::{Action, Decision};
use firmware::observation::{INPUTS, Observation};
use host_sim::environment::{Decisions, Environment};
use host_sim::policy::power_plan;
use host_sim::stream::Purpose;
use pyo3::prelude::*;

/// Steps training worlds on the calling thread without Python: measures, encodes and decides for every vehicle in every slot,
/// everybody with the action that its index gives. Returns the sum of all ages, so that nothing can be left out.
#[pyfunction]
pub fn native_loop(py: Python<'_>, scenario: &Scenario, worlds: u64, slots: u32, seed: u64) -> PyResult<u64> {
    let setting = Setting::new(scenario, "grid")?;
    Ok(py.detach(|| run(&setting, worlds, slots, seed)))
}

fn run(setting: &Setting, worlds: u64, slots: u32, seed: u64) -> u64 {
    let Setting { scenario, source } = setting;
    let (required, plan) = (scenario.radio.required_level(), power_plan(scenario));
    let mut environment = Environment::new(scenario, source, seed, Purpose::Training, 0..worlds);
    let vehicles = environment.vehicles();
    let mut decisions = Decisions::new(environment.worlds(), vehicles);
    let mut inputs = vec![[0_i8; INPUTS]; environment.worlds() * vehicles];
    let mut ages = 0;
    for _ in 0..slots {
        for world in 0..environment.worlds() {
            for vehicle in 0..vehicles {
                let observation = environment
                    .measurement(world, vehicle)
                    .map(|measured| Observation::new(&measured));
                let decision = observation.map_or(Decision::Silent, |observation| {
                    inputs[world * vehicles + vehicle] = observation.encode(required);
                    plan.decision(action(world, vehicle), &observation)
                });
                decisions.set(world, vehicle, decision);
                ages += u64::from(environment.age(world, vehicle).slots());
            }
        }
        environment.step(std::hint::black_box(&decisions));
        let _ = std::hint::black_box(&inputs);
    }
    ages
}

/// Every fifth vehicle sends at full power.
fn action(world: usize, vehicle: usize) -> Action {
    if (world + vehicle).is_multiple_of(5) {
        Action::FullPower
    } else {
        Action::Silent
    }
}
