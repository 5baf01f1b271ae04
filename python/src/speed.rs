//! The native loop that the Python one is measured against.

use crate::scenario::{Scenario, Setting};
use firmware::decision::{Action, PowerPlan};
use firmware::lots::Identity;
use firmware::observation::{INPUTS, Observation};
use host_sim::decisions::{Decisions, VehicleDecisions};
use host_sim::environment::Environment;
use host_sim::lanes::{LANES, Row};
use host_sim::policy::Observer;
use host_sim::policy::{Decider, Policy, power_plan};
use host_sim::senses::{Broadcasts, Senses};
use host_sim::simulation::run_slot;
use host_sim::stream::Purpose;
use pyo3::prelude::*;

/// Steps training worlds on the calling thread without Python: in every slot everybody's observation is encoded, and every
/// fifth vehicle sends at full power. Returns the sum of all ages at the end, for comparison.
#[pyfunction]
pub fn native_loop(py: Python<'_>, scenario: &Scenario, worlds: u64, slots: u32, seed: u64) -> PyResult<u64> {
    let setting = Setting::new(scenario, None)?;
    Ok(py.detach(|| run(&setting, worlds, slots, seed)))
}

fn run(setting: &Setting, worlds: u64, slots: u32, seed: u64) -> u64 {
    let Setting { scenario, source } = setting;
    // As the simulator itself does it: one row of worlds after the other.
    let batches = (0..worlds).step_by(LANES).map(|first| {
        let batch = first..worlds.min(first + LANES as u64);
        let mut environment = Environment::new(scenario, source.as_ref(), seed, Purpose::Training, batch);
        let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
        let mut policy = Decider::Policy(Box::new(EveryFifth {
            observer: Observer::new(scenario.radio.required_level()),
            power_plan: power_plan(scenario),
            inputs: [[0; LANES]; INPUTS],
        }));
        (0..slots).for_each(|_| run_slot(&mut environment, &mut policy, &mut decisions));
        let (worlds, vehicles) = (environment.worlds(), environment.vehicles());
        let everybody = (0..worlds).flat_map(|world| (0..vehicles).map(move |vehicle| (world, vehicle)));
        let ages = everybody.map(|(world, vehicle)| u64::from(environment.age(world, vehicle).slots()));
        ages.sum::<u64>()
    });
    batches.sum()
}

/// Encodes every observation and lets every fifth vehicle send.
struct EveryFifth {
    observer: Observer,
    power_plan: PowerPlan,
    inputs: [Row<i32>; INPUTS],
}

impl Policy for EveryFifth {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        self.observer.hear(broadcasts);
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let Self { observer, inputs, .. } = self;
        senses.vectors().run(
            #[inline(always)]
            || observer.encode(&observer.view(senses), inputs),
        );
        let _ = std::hint::black_box(&self.inputs);
        let first = senses.block() * LANES + senses.vehicle();
        for lane in (0..senses.worlds()).filter(|lane| (first + lane).is_multiple_of(5)) {
            if let Some(measurement) = senses.measurement(lane) {
                let observation = Observation::new(&measurement, Identity(senses.identities()[lane]));
                decisions.set(lane, self.power_plan.decision(Action::FullPower, &observation));
            }
        }
    }
}
