//! The native loop that the Python one is measured against.

use crate::scenario::{Scenario, Setting};
use firmware::decision::{Action, PowerPlan};
use firmware::observation::{INPUTS, Observation};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::lanes::{LANES, Row};
use host_sim::policy::actor::Encoder;
use host_sim::policy::{Policy, power_plan};
use host_sim::simulation::run_slot;
use host_sim::stream::Purpose;
use pyo3::prelude::*;

/// Steps training worlds on the calling thread without Python: in every slot everybody's observation is encoded, and every
/// fifth vehicle sends at full power. Returns the sum of all ages at the end, for comparison.
#[pyfunction]
pub fn native_loop(py: Python<'_>, scenario: &Scenario, worlds: u64, slots: u32, seed: u64) -> PyResult<u64> {
    let setting = Setting::new(scenario, "grid")?;
    Ok(py.detach(|| run(&setting, worlds, slots, seed)))
}

fn run(setting: &Setting, worlds: u64, slots: u32, seed: u64) -> u64 {
    let Setting { scenario, source } = setting;
    // As the simulator itself does it: one row of worlds after the other.
    let batches = (0..worlds).step_by(LANES).map(|first| {
        let batch = first..worlds.min(first + LANES as u64);
        let mut environment = Environment::new(scenario, source, seed, Purpose::Training, batch);
        let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
        let mut policy = EveryFifth {
            encoder: Encoder::new(scenario.radio.required_level()),
            power_plan: power_plan(scenario),
            inputs: [[0; LANES]; INPUTS],
        };
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
    encoder: Encoder,
    power_plan: PowerPlan,
    inputs: [Row<i32>; INPUTS],
}

impl Policy for EveryFifth {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        for block in 0..environment.ages().blocks() {
            self.encoder.hear(environment.base_station(), block);
            for &vehicle in environment.present() {
                let Self { encoder, inputs, .. } = self;
                environment.vectors().run(
                    #[inline(always)]
                    || encoder.encode(&encoder.view(environment, block, vehicle), inputs),
                );
                let _ = std::hint::black_box(&self.inputs);
            }
        }
        for &vehicle in environment.present() {
            for world in (0..environment.worlds()).filter(|world| (world + vehicle).is_multiple_of(5)) {
                if let Some(measurement) = environment.measurement(world, vehicle) {
                    let observation = Observation::new(&measurement);
                    let decision = self.power_plan.decision(Action::FullPower, &observation);
                    decisions.set(world, vehicle, decision);
                }
            }
        }
    }
}
