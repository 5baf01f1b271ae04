//! What the page shows: one world under the visitor's policy, and the same world under others to compare.

use crate::run::{HISTORY_SLOTS, Run};
use firmware::observation::Observation;
use firmware::ring::Open;
use firmware::table::Table;
use host_sim::age::ideal_age_ms;
use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::policy::{KINDS, Kind, actor, clock};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::stream::Purpose;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use serde::Deserialize;
use serde_json::{Value, json};

/// Slots before ages count, from the start and again after every change by hand: the command line's default.
const WARMUP_SLOTS: u32 = 500;

/// Slots of a session (chosen: eleven hours).
const MOST_SLOTS: u32 = 40_000_000;

/// Slots whose use of the sub-channels is kept for drawing (chosen).
const OCCUPANCY_SLOTS: usize = 256;

/// Bytes for one sub-channel in one slot: how many sent, how many of them were jammed, whom the base station received
/// ([`NOBODY`] if none), and 1 or 0 for: its place in the ring was nobody's, so that anybody might contend there.
const USE_BYTES: usize = 4;

/// No vehicle.
const NOBODY: u8 = u8::MAX;

/// Numbers for one vehicle: x and y in metres, its age in slots, the sub-channel that it sent on in the slot before (-1 if
/// none), 1 or 0 for: received in the slot before, jammed; its place in the ring as it knows it (-1 if none), and 1 or 0 for: called to
/// contend in the slot before.
const VEHICLE_NUMBERS: usize = 8;

/// Numbers for one run: mean age in ms, 99th percentile, successes a slot; not a number before the first slot that counts.
const SUMMARY_NUMBERS: usize = 3;

/// A world as the visitor wishes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Seed as the command line takes it, in decimal: JavaScript's numbers do not hold all of them.
    pub seed: String,
    /// Scenario settings, `KEY=VALUE` each.
    pub settings: Vec<String>,
    /// Name of the policy in charge.
    pub policy: String,
    /// Names of the policies to compare with.
    pub comparisons: Vec<String>,
}

/// A running page.
pub struct Session {
    scenario: &'static Scenario,
    table: &'static Table<'static>,
    /// The first is the visitor's, the others are for comparison.
    runs: Vec<Run>,
    names: Vec<&'static Kind>,
    /// By vehicle.
    jammed: Vec<bool>,
    /// Who was called to contend in the visitor's run in the slot before, by vehicle.
    called: Vec<bool>,
    /// Ages count from this slot on.
    count_from: u32,
    /// `[slot modulo OCCUPANCY_SLOTS][sub_channel][USE_BYTES]` of the visitor's run.
    occupancy: Vec<u8>,
    /// `[vehicle][VEHICLE_NUMBERS]`, as of the last look.
    vehicles: Vec<f32>,
    /// `[run][SUMMARY_NUMBERS]`, as of the last look.
    summaries: Vec<f64>,
}

impl Session {
    /// The world before its first slot. What it borrows is never given back.
    ///
    /// # Errors
    /// [`Error::Input`] names what does not fit.
    pub fn open(request: &Request) -> Result<Self> {
        let seed = request.seed.trim().parse::<u64>().map_err(|_| {
            let expected = format!("a whole number from 0 to {}", u64::MAX);
            Error::input("seed", format!("\"{}\"", request.seed), expected)
        })?;
        let source = ScenarioSource {
            settings: request.settings.clone(),
            ..ScenarioSource::default()
        };
        let scenario: &Scenario = Box::leak(Box::new(source.read()?));
        let table = Table::parse(firmware::tables::DISTILLED)
            .map_err(|error| Error::input("built-in table", error, "a table"))?;
        let table: &Table<'_> = Box::leak(Box::new(table));
        let room = usize::from(table.max_vehicles()).min(usize::from(NOBODY));
        if scenario.cell.vehicles as usize > room {
            let expected = format!("at most {room} on this page");
            return Err(Error::input("cell.vehicles", scenario.cell.vehicles, expected));
        }
        let names = std::iter::once(&request.policy).chain(&request.comparisons);
        let names = names
            .map(|name| <&Kind>::of_name("policy", name))
            .collect::<Result<Vec<_>>>()?;
        for name in &names {
            name.check(scenario, room, table)?;
        }
        let run = |&name: &&'static Kind| {
            let (grid, purpose) = (&Grid, Purpose::Evaluation);
            let environment = Environment::with_room(scenario, grid, seed, purpose, 0..1, room);
            Run::new(environment, name, table, WARMUP_SLOTS)
        };
        let runs: Vec<Run> = names.iter().map(run).collect();
        let slot_bytes = scenario.radio.sub_channels as usize * USE_BYTES;
        Ok(Self {
            scenario,
            table,
            names,
            jammed: vec![false; room],
            called: vec![false; room],
            count_from: WARMUP_SLOTS,
            occupancy: vec![0; OCCUPANCY_SLOTS * slot_bytes],
            vehicles: Vec::new(),
            summaries: Vec::new(),
            runs,
        })
    }

    /// What the page needs to know once: scenario, policies that can serve it, and how the views are laid out.
    pub fn description(&self) -> Value {
        let rings = [&actor::KIND, &clock::KIND];
        let policies = KINDS.iter().map(|policy| {
            let refused = policy.check(self.scenario, self.jammed.len(), self.table).err();
            json!({
                "name": policy.name,
                "meaning": policy.meaning,
                "ring": rings.contains(policy),
                "refused": refused.map(|error| error.to_string()),
            })
        });
        let policies: Vec<Value> = policies.collect();
        json!({
            "scenario": self.scenario,
            "policies": policies,
            "runs": self.names.iter().map(|kind| kind.name).collect::<Vec<_>>(),
            "room": self.jammed.len(),
            "most_slots": MOST_SLOTS,
            "layout": {
                "vehicle_numbers": VEHICLE_NUMBERS,
                "summary_numbers": SUMMARY_NUMBERS,
                "history_slots": HISTORY_SLOTS,
                "occupancy_slots": OCCUPANCY_SLOTS,
                "use_bytes": USE_BYTES,
                "nobody": NOBODY,
            },
        })
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.runs[0].environment().elapsed()
    }

    /// The slot from which on ages count.
    pub fn count_from(&self) -> u32 {
        self.count_from
    }

    /// Vehicles in the cell.
    pub fn vehicle_count(&self) -> usize {
        self.runs[0].environment().present().len()
    }

    /// Mean age of an ideal schedule for the vehicles that are there.
    pub fn bound_age_ms(&self) -> f64 {
        ideal_age_ms(self.vehicle_count() as u32, self.scenario.radio.sub_channels)
    }

    /// Carries out so many slots in every run, or as many as are left.
    pub fn advance(&mut self, slots: u32) {
        for _ in 0..slots.min(MOST_SLOTS.saturating_sub(self.elapsed())) {
            let slot = self.elapsed();
            let open = Open(self.runs[0].environment().broadcasts(0).open()[0]);
            self.record_calls(open);
            self.runs.iter_mut().for_each(|run| run.step(&self.jammed));
            self.record_use(slot, open);
        }
    }

    /// Lets another policy decide in the visitor's run.
    ///
    /// # Errors
    /// [`Error::Input`] if there is none of this name, or if it cannot serve the scenario.
    pub fn set_policy(&mut self, name: &str) -> Result<()> {
        let policy = <&Kind>::of_name("policy", name)?;
        policy.check(self.scenario, self.jammed.len(), self.table)?;
        self.runs[0].set_policy(policy, self.table);
        self.names[0] = policy;
        self.count_anew();
        Ok(())
    }

    /// Jams a vehicle in every run, or lets it go. `false` if there is no such vehicle.
    pub fn jam(&mut self, vehicle: usize, jam: bool) -> bool {
        let present = self.runs[0].environment().present().contains(&vehicle);
        if present && self.jammed[vehicle] != jam {
            self.jammed[vehicle] = jam;
            self.count_anew();
        }
        present
    }

    /// A vehicle joins every run on the lane nearest to a place in metres. It is heard of at the next update of places.
    /// `false` if there is no room, or no such place.
    pub fn join(&mut self, x_m: f64, y_m: f64) -> bool {
        if !(x_m.is_finite() && y_m.is_finite()) {
            return false;
        }
        let mut joined = true;
        for run in &mut self.runs {
            joined &= run.join(x_m, y_m).is_some();
        }
        if joined {
            self.count_anew();
        }
        joined
    }

    /// The vehicles of the visitor's run.
    pub fn vehicles(&mut self) -> &[f32] {
        let (run, jammed, called) = (&self.runs[0], &self.jammed, &self.called);
        let (environment, decisions) = (run.environment(), run.decisions());
        self.vehicles.clear();
        for &(vehicle, place) in environment.places(0) {
            let sent_on = decisions.transmission(0, vehicle).map_or(-1.0, |(n, _)| n as f32);
            self.vehicles.extend([
                place.x_m as f32,
                place.y_m as f32,
                f32::from(environment.age(0, vehicle).slots()),
                sent_on,
                f32::from(u8::from(environment.received(0, vehicle))),
                f32::from(u8::from(jammed[vehicle])),
                known_place(environment, vehicle),
                f32::from(u8::from(called[vehicle])),
            ]);
        }
        &self.vehicles
    }

    /// Use of the sub-channels in the last slots of the visitor's run.
    pub fn occupancy(&self) -> &[u8] {
        &self.occupancy
    }

    /// Mean ages after the last slots of a run; empty if there is no such run.
    pub fn history_ms(&self, run: usize) -> &[f32] {
        self.runs.get(run).map_or(&[], Run::history_ms)
    }

    /// What was counted in every run.
    pub fn summaries(&mut self) -> &[f64] {
        self.summaries.clear();
        for run in &self.runs {
            let numbers = run.summary().map_or([f64::NAN; SUMMARY_NUMBERS], |summary| {
                [summary.mean_ms, summary.p99_ms, summary.success_per_slot]
            });
            self.summaries.extend(numbers);
        }
        &self.summaries
    }

    fn count_anew(&mut self) {
        self.count_from = self.elapsed() + WARMUP_SLOTS;
        let from = self.count_from;
        self.runs.iter_mut().for_each(|run| run.count_from(from));
    }

    /// Takes in whom the base station calls in the slot that begins; where nothing is open it calls nobody.
    fn record_calls(&mut self, open: Open) {
        self.called.fill(false);
        if open == Open::default() {
            return;
        }
        let environment = self.runs[0].environment();
        for &vehicle in environment.present() {
            self.called[vehicle] = environment.measurement(0, vehicle).is_some_and(|measurement| {
                let observation = Observation::new(&measurement, environment.identity(0, vehicle));
                observation.quantities().is_called()
            });
        }
    }

    fn record_use(&mut self, slot: u32, open: Open) {
        let (environment, decisions) = (self.runs[0].environment(), self.runs[0].decisions());
        let sub_channels = environment.sub_channels();
        let slot_bytes = sub_channels * USE_BYTES;
        let first = slot as usize % OCCUPANCY_SLOTS * slot_bytes;
        let uses = &mut self.occupancy[first..first + slot_bytes];
        for (sub_channel, bytes) in uses.chunks_exact_mut(USE_BYTES).enumerate() {
            bytes.copy_from_slice(&[0, 0, NOBODY, u8::from(open.contains(sub_channel))]);
        }
        for &vehicle in environment.present() {
            let Some((sub_channel, _)) = decisions.transmission(0, vehicle) else {
                continue;
            };
            let bytes = &mut uses[sub_channel * USE_BYTES..][..USE_BYTES];
            bytes[0] += 1;
            bytes[1] += u8::from(self.jammed[vehicle]);
            if environment.received(0, vehicle) {
                bytes[2] = vehicle as u8;
            }
        }
    }
}

/// A vehicle's place in the ring as it knows it, -1 if it has none.
fn known_place(environment: &Environment<'_>, vehicle: usize) -> f32 {
    let (places, _) = environment.senses(0, vehicle).places();
    // No place is the last of all codes.
    f32::from(places[0].cast_signed())
}
