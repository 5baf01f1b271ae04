//! Trained actors as policies, in float and in int8, on the same held-out worlds.

use crate::distil::{as_float, best_action};
use crate::laboratory::actors::Actors;
use crate::laboratory::forms::{ObservationForm, OutputForm};
use firmware::actor::Actor;
use firmware::decision::{Decision, PowerPlan};
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::unit::{Event, Unit};
use firmware::units::Level;
use host_sim::cell::Cell;
use host_sim::policy::Policy;
use host_sim::stream::{Role, Stream, WorldKey};
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
    /// Of exploration; without it every decision is greedy.
    explore: Option<Stream>,
    inputs: Vec<f32>,
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
            explore: None,
            inputs: vec![0.0; actors.form.observation.length()],
            quantised: tables.iter().cloned().map(Actor::new).collect(),
            agreement,
        }
    }

    /// As in training, with a stream of the world's own.
    pub fn exploring(actors: &'a Actors, setting: Setting, key: &WorldKey, agreement: &'a Agreement) -> Self {
        Self {
            explore: Some(key.stream(Role::Policy, u32::MAX)),
            ..Self::greedy(actors, setting, &[], agreement)
        }
    }
}

impl Policy for FloatActors<'_> {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        let Setting {
            required_sinr,
            power_plan,
        } = self.setting;
        let form = self.actors.form;
        let (mut same, mut all) = (0, 0);
        for &vehicle in cell.present() {
            let Some(measurement) = cell.measurement(vehicle) else {
                continue;
            };
            form.observation
                .write(&measurement, required_sinr, &mut self.inputs);
            let outputs = self.actors.network(vehicle).forward(&self.inputs);
            let explore = self.explore.as_mut();
            decisions[vehicle] = form.output.decide(&outputs, &measurement, &power_plan, explore);
            let last = self.quantised.len().saturating_sub(1);
            if let Some(quantised) = self.quantised.get_mut(vehicle.min(last)) {
                let observation = Observation::new(&measurement);
                same += u64::from(best_action(&outputs) == quantised.act(&observation));
                all += 1;
            }
        }
        let _ = self.agreement.same.fetch_add(same, Ordering::Relaxed);
        let _ = self.agreement.all.fetch_add(all, Ordering::Relaxed);
    }
}

/// The firmware's units, each vehicle with a table of its own.
pub struct OwnTables<'a> {
    tables: &'a [Table<'a>],
    key: WorldKey,
    units: Vec<Unit<'a, Stream>>,
}

impl<'a> OwnTables<'a> {
    /// As many tables as there will be vehicles.
    pub fn new(tables: &'a [Table<'a>], key: WorldKey) -> Self {
        Self {
            tables,
            key,
            units: Vec::new(),
        }
    }
}

impl Policy for OwnTables<'_> {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        let (tables, key) = (self.tables, &self.key);
        if self.units.is_empty() {
            let back_off = |vehicle| key.stream(Role::BackOff, vehicle);
            self.units = (0..)
                .zip(tables)
                .map(|(vehicle, table)| Unit::new(table.bytes(), back_off(vehicle)))
                .collect();
        }
        for &vehicle in cell.present() {
            let event = cell
                .measurement(vehicle)
                .map_or(Event::Missed(cell.slot()), Event::Measured);
            if let Some(report) = self.units[vehicle].slot(&event) {
                decisions[vehicle] = report.decision;
            }
        }
    }
}

/// What the greedy networks see in a world, vehicle by vehicle in every slot, as the firmware encodes it: for calibration.
///
/// # Panics
/// If the actors are not of the firmware's form.
pub fn watch_inputs(
    cell: &mut Cell<'_>,
    actors: &Actors,
    setting: Setting,
    slots: u32,
    mut seen: impl FnMut(usize, [i8; firmware::observation::INPUTS]),
) {
    assert_eq!(
        (actors.form.observation, actors.form.output),
        (ObservationForm::Firmware, OutputForm::Actions)
    );
    let mut decisions = vec![Decision::Silent; cell.vehicles()];
    for _ in 0..slots {
        for &vehicle in cell.present() {
            let Some(measurement) = cell.measurement(vehicle) else {
                continue;
            };
            let observation = Observation::new(&measurement);
            let input = observation.encode(setting.required_sinr);
            let action = best_action(&actors.network(vehicle).forward(&as_float(&input)));
            decisions[vehicle] = setting.power_plan.decision(action, &observation);
            seen(vehicle, input);
        }
        let _outcome = cell.step(&decisions);
    }
}
