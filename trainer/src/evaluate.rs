//! Trained actors as policies, in float and in int8, on the same held-out worlds.

use crate::laboratory::actors::Actors;
use crate::network::Batch;
use firmware::actor::Actor;
use firmware::decision::{Decision, PowerPlan};
use firmware::measurement::Measurement;
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::units::Level;
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::Policy;
use host_sim::stream::{Role, Stream};
use std::sync::atomic::{AtomicU64, Ordering};

/// Decisions on which the two forms agree: silence, or the same sub-channel with powers that are at most 1 dB apart.
#[derive(Debug, Default)]
pub struct Agreement {
    same: AtomicU64,
    all: AtomicU64,
}

/// How far apart powers of the same decision may be, in 1/256 dB (chosen).
const SAME_POWER: u16 = 1 << 8;

fn agree(a: Decision, b: Decision) -> bool {
    let parts = |decision| match decision {
        Decision::Silent => (None, 0),
        Decision::Transmit { sub_channel, power } => (Some(sub_channel), power.to_bits()),
    };
    let ((a, a_power), (b, b_power)) = (parts(a), parts(b));
    a == b && a_power.abs_diff(b_power) <= SAME_POWER
}

impl Agreement {
    /// Fraction of decisions, if there were any. Sums of whole numbers do not depend on the order of threads.
    pub fn fraction(&self) -> Option<f64> {
        let all = self.all.load(Ordering::Relaxed);
        (all > 0).then(|| self.same.load(Ordering::Relaxed) as f64 / all as f64)
    }
}

/// The scenario's part in what an actor sees and does.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Level at which a lone transmission succeeds.
    pub required_sinr: Level,
    /// How actions become power.
    pub power_plan: PowerPlan,
}

impl Setting {
    /// That of the scenario that a table was made for.
    pub fn of_table(table: &Table<'_>) -> Self {
        Self {
            required_sinr: table.required_sinr(),
            power_plan: *table.power_plan(),
        }
    }
}

/// The float networks decide.
pub struct FloatActors<'a> {
    actors: &'a Actors,
    setting: Setting,
    /// Of exploration, one a world; without them every decision is greedy.
    explore: Vec<Stream>,
    /// A vehicle's measurements with their worlds, and the inputs made of them, one after the other.
    measured: Vec<(usize, Measurement)>,
    inputs: Vec<f32>,
    batch: Batch,
    outputs: Vec<f32>,
    /// One table, or one for each vehicle, that is asked too.
    quantised: Vec<Actor<'a>>,
    agreement: &'a Agreement,
}

impl<'a> FloatActors<'a> {
    /// Greedy; at every decision the int8 form is asked too, if there is one, and counted into `agreement`.
    pub fn greedy(
        actors: &'a Actors,
        setting: Setting,
        tables: &[Table<'a>],
        agreement: &'a Agreement,
    ) -> Self {
        Self {
            actors,
            setting,
            explore: Vec::new(),
            measured: Vec::new(),
            inputs: Vec::new(),
            batch: Batch::default(),
            outputs: Vec::new(),
            quantised: tables.iter().cloned().map(Actor::new).collect(),
            agreement,
        }
    }

    /// As in training, with a stream of each world's own.
    pub fn exploring(
        actors: &'a Actors,
        setting: Setting,
        environment: &Environment<'_>,
        agreement: &'a Agreement,
    ) -> Self {
        Self {
            explore: environment
                .keys()
                .iter()
                .map(|key| key.stream(Role::Policy, u32::MAX))
                .collect(),
            ..Self::greedy(actors, setting, &[], agreement)
        }
    }
}

impl Policy for FloatActors<'_> {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        let Setting {
            required_sinr,
            power_plan,
        } = self.setting;
        let form = self.actors.form;
        let last = self.quantised.len().saturating_sub(1);
        let (mut same, mut all) = (0, 0);
        for &vehicle in environment.present() {
            let worlds = 0..environment.worlds();
            self.measured.clear();
            self.measured
                .extend(worlds.filter_map(|world| Some((world, environment.measurement(world, vehicle)?))));
            let (length, samples) = (form.observation.length(), self.measured.len());
            self.inputs.resize(samples * length, 0.0);
            for ((_, measurement), input) in self.measured.iter().zip(self.inputs.chunks_exact_mut(length)) {
                form.observation.write(measurement, required_sinr, input);
            }
            let network = self.actors.network(vehicle);
            let columns = network.forward_batch(&self.inputs, &mut self.batch);
            for (sample, (world, measurement)) in self.measured.iter().enumerate() {
                self.outputs.clear();
                self.outputs.extend(columns.iter().skip(sample).step_by(samples));
                let explore = self.explore.get_mut(*world);
                let decision = form
                    .output
                    .decide(&self.outputs, measurement, &power_plan, explore);
                decisions.set(*world, vehicle, decision);
                if let Some(quantised) = self.quantised.get_mut(vehicle.min(last)) {
                    let observation = Observation::new(measurement);
                    same += u64::from(agree(decision, quantised.decide(&observation)));
                    all += 1;
                }
            }
        }
        let _ = self.agreement.same.fetch_add(same, Ordering::Relaxed);
        let _ = self.agreement.all.fetch_add(all, Ordering::Relaxed);
    }
}

/// What the greedy networks see in the worlds of an environment, vehicle by vehicle in every slot, as a table's form encodes it:
/// for calibration.
pub fn watch_inputs(
    environment: &mut Environment<'_>,
    actors: &Actors,
    setting: Setting,
    slots: u32,
    mut seen: impl FnMut(usize, &[i8]),
) {
    let Setting {
        required_sinr,
        power_plan,
    } = setting;
    let form = actors.form;
    let mut input = vec![0.0; form.observation.length()];
    let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
    for _ in 0..slots {
        for &vehicle in environment.present() {
            for world in 0..environment.worlds() {
                let Some(measurement) = environment.measurement(world, vehicle) else {
                    continue;
                };
                form.observation.write(&measurement, required_sinr, &mut input);
                let outputs = actors.network(vehicle).forward(&input);
                let decision = form.output.decide(&outputs, &measurement, &power_plan, None);
                decisions.set(world, vehicle, decision);
                let observation = Observation::new(&measurement);
                let table_form = form.observation.in_table();
                table_form.encode(&observation, required_sinr, |input| seen(vehicle, input));
            }
        }
        environment.step(&decisions);
    }
}
