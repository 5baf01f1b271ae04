//! One world under one policy.

use firmware::decision::Decision;
use firmware::table::Table;
use firmware::units::Age;
use host_sim::age::{AgeCounter, AgeSummary};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::{Decider, Kind};

/// Slots whose mean ages are kept for drawing (chosen: the width of a wide screen in pixels).
pub const HISTORY_SLOTS: usize = 4096;

/// A world, who decides in it, and what came of it.
pub struct Run {
    environment: Environment<'static>,
    decider: Decider<'static>,
    decisions: Decisions,
    counter: AgeCounter,
    /// Mean over vehicles of ages, each at most 100 slots, after each of the last slots: a slot's place is its index modulo [`HISTORY_SLOTS`].
    history_ms: Vec<f32>,
}

impl Run {
    /// A world before its first slot; slots before `warmup` do not count.
    pub fn new(
        environment: Environment<'static>,
        policy: &'static Kind,
        table: &'static Table<'static>,
        warmup: u32,
    ) -> Self {
        let (worlds, vehicles) = (environment.worlds(), environment.vehicles());
        Self {
            decider: (policy.build)(&environment.setup(), table),
            decisions: Decisions::new(worlds, vehicles),
            counter: AgeCounter::new(warmup, worlds, vehicles),
            history_ms: vec![f32::NAN; HISTORY_SLOTS],
            environment,
        }
    }

    /// The world.
    pub fn environment(&self) -> &Environment<'static> {
        &self.environment
    }

    /// What everybody decided in the slot before, the jammed too.
    pub fn decisions(&self) -> &Decisions {
        &self.decisions
    }

    /// The means of the last slots.
    pub fn history_ms(&self) -> &[f32] {
        &self.history_ms
    }

    /// Lets another policy decide from now on. It begins without a past, as if every unit were switched on now.
    pub fn set_policy(&mut self, policy: &'static Kind, table: &'static Table<'static>) {
        self.decider = (policy.build)(&self.environment.setup(), table);
    }

    /// Begins to count anew, from a later slot on.
    pub fn count_from(&mut self, slot: u32) {
        self.counter = AgeCounter::new(slot, self.environment.worlds(), self.environment.vehicles());
    }

    /// A vehicle joins on the lane nearest to a place; its index, or `None` if there is no room.
    pub fn join(&mut self, x_m: f64, y_m: f64) -> Option<usize> {
        self.environment.join(x_m, y_m)
    }

    /// One slot. What a jammed vehicle sends is cut off at its antenna: it reaches nobody, and disturbs nobody.
    pub fn step(&mut self, jammed: &[bool]) {
        let slot = self.environment.elapsed();
        self.decisions.clear();
        self.environment.decide(&mut self.decider, &mut self.decisions);
        if jammed.contains(&true) {
            let mut heard = self.decisions.clone();
            for &vehicle in self
                .environment
                .present()
                .iter()
                .filter(|&&vehicle| jammed[vehicle])
            {
                heard.set(0, vehicle, Decision::Silent);
            }
            self.environment.step(&heard);
        } else {
            self.environment.step(&self.decisions);
        }
        let environment = &self.environment;
        self.counter.record(slot, environment);
        let ages = environment
            .present()
            .iter()
            .map(|&vehicle| environment.age(0, vehicle).min(Age::TIME_CONSTRAINT));
        let sum: u32 = ages.map(|age: Age| u32::from(age.slots())).sum();
        self.history_ms[slot as usize % HISTORY_SLOTS] = sum as f32 / environment.present().len() as f32;
    }

    /// What was counted so far; `None` before the first slot that counts.
    pub fn summary(&self) -> Option<AgeSummary> {
        AgeSummary::new(&self.counter.worlds())
    }
}
