//! The float network beside its int8 table, on the same held-out worlds.

use crate::distil::{as_float, best_action};
use crate::network::Network;
use firmware::actor::Actor;
use firmware::observation::Observation;
use firmware::table::Table;
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::Policy;
use std::sync::atomic::{AtomicU64, Ordering};

/// Decisions on which the two forms agree.
#[derive(Debug, Default)]
pub struct Agreement {
    same: AtomicU64,
    all: AtomicU64,
}

impl Agreement {
    /// Fraction of decisions, if there were any. Sums of whole numbers do not depend on the order of threads.
    pub fn fraction(&self) -> Option<f64> {
        let all = self.all.load(Ordering::Relaxed);
        (all > 0).then(|| self.same.load(Ordering::Relaxed) as f64 / all as f64)
    }
}

/// The float network decides; at every decision the int8 form is asked too.
pub struct FloatActor<'a> {
    network: &'a Network,
    table: &'a Table<'a>,
    quantised: Actor<'a>,
    agreement: &'a Agreement,
}

impl<'a> FloatActor<'a> {
    /// Counts into `agreement`.
    pub fn new(network: &'a Network, table: &'a Table<'a>, agreement: &'a Agreement) -> Self {
        Self {
            network,
            table,
            quantised: Actor::new(table.clone()),
            agreement,
        }
    }
}

impl Policy for FloatActor<'_> {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        let (mut same, mut all) = (0, 0);
        for &vehicle in environment.present() {
            for world in 0..environment.worlds() {
                let Some(measurement) = environment.measurement(world, vehicle) else {
                    continue;
                };
                let observation = Observation::new(&measurement);
                let input = observation.encode(self.table.required_sinr());
                let action = best_action(&self.network.forward(&as_float(&input)));
                same += u64::from(action == self.quantised.act(&observation));
                all += 1;
                let decision = self.table.power_plan().decision(action, &observation);
                decisions.set(world, vehicle, decision);
            }
        }
        let _ = self.agreement.same.fetch_add(same, Ordering::Relaxed);
        let _ = self.agreement.all.fetch_add(all, Ordering::Relaxed);
    }
}
