//! What may come between a cell and those who look at it: an imperfection of sensing, places from outside, one more policy.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::decision::Decision;
use firmware::table::Table;
use firmware::unit::{Event, Unit};
use firmware::units::{Level, SlotIndex, SubChannel};
use host_sim::age::{AgeCounter, AgeSummary};
use host_sim::decisions::{Decisions, VehicleDecisions};
use host_sim::environment::Environment;
use host_sim::lanes::{LANES, Rows};
use host_sim::mobility::{Grid, Mobility, MobilitySource, Place};
use host_sim::policy::{Decider, KINDS, Kind, Needs, Policy, actor};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::senses::{Readings, Senses, Sensing};
use host_sim::simulation::{Extent, Simulation, run_slot};
use host_sim::stream::{Purpose, WorldKey};
use kit::error::{Error, Result};
use std::sync::atomic::{AtomicUsize, Ordering};

fn scenario(settings: &[&str]) -> Scenario {
    let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
    ScenarioSource {
        settings,
        ..ScenarioSource::default()
    }
    .read()
    .unwrap()
}

fn table() -> Table<'static> {
    Table::parse(firmware::tables::DISTILLED).unwrap()
}

/// Gains of the slot before, 3 dB too low.
#[derive(Clone, Default)]
struct LateAndLow {
    before: Option<Rows<f32>>,
    now: Option<Rows<f32>>,
}

impl Sensing for LateAndLow {
    fn begin_slot(&mut self, _slot: SlotIndex, truth: &Readings<'_>) {
        let mut low = truth.gains_db.clone();
        low.as_flat_mut().iter_mut().for_each(|gain_db| *gain_db -= 3.0);
        self.before = self.now.replace(low);
    }

    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t> {
        let gains_db = self.before.as_ref().or(self.now.as_ref());
        Readings {
            gains_db: gains_db.unwrap_or(truth.gains_db),
            ..truth
        }
    }

    fn copy(&self) -> Box<dyn Sensing> {
        Box::new(self.clone())
    }
}

/// The same imperfection for rows of worlds, for units one by one, and for whoever asks for a measurement.
#[test]
fn an_imperfection_reaches_everybody_who_senses() {
    let scenario = scenario(&["cell.vehicles=12"]);
    let tables = [table()];
    let mut environment = Environment::new(&scenario, &Grid, 5, Purpose::Evaluation, 0..3);
    environment.set_sensing(Box::new(LateAndLow::default()));
    let mut actors = Decider::Policy(actor::build(&environment.setup(), &tables));
    let unit = |world, vehicle| Unit::new(tables[0].bytes(), environment.identity(world, vehicle));
    let mut units: Vec<Vec<Unit<'_>>> = (0..3)
        .map(|world| (0..12).map(|vehicle| unit(world, vehicle)).collect())
        .collect();
    let mut decisions = Decisions::new(3, 12);
    let mut true_gains: Vec<f32> = Vec::new();
    for slot in 0..200 {
        let mut now = Vec::new();
        decisions.clear();
        environment.decide(&mut actors, &mut decisions);
        for (world, units) in units.iter_mut().enumerate() {
            for (vehicle, unit) in units.iter_mut().enumerate() {
                let measurement = environment.measurement(world, vehicle).unwrap();
                let expected = unit.slot(&Event::Measured(measurement)).unwrap().decision;
                assert_eq!(decisions.get(world, vehicle), expected, "slot {slot}");
                let sensed = environment.senses(0, vehicle).gain(1)[world];
                assert_eq!(i32::from(measurement.gain()[1].to_bits()), sensed);
                if let Some(&before_db) = true_gains.get(world * 12 + vehicle) {
                    assert!((f64::from(sensed) / 256.0 - f64::from(before_db - 3.0)).abs() <= 1.0 / 256.0);
                }
                now.push(environment.gain_db(world, vehicle, 1));
            }
        }
        true_gains = now;
        environment.step(&decisions);
    }
}

/// An outside program's script: who is where in which world, and who was told which way.
#[derive(Debug)]
struct Script {
    routes_told: AtomicUsize,
    fails_at: Option<u32>,
}

/// The most vehicles in a world.
const ROOM: usize = 7;

impl MobilitySource for Script {
    fn open<'s>(&'s self, _scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        Box::new(ScriptedWorld {
            script: self,
            world: key.world,
            routes: vec![Vec::new(); ROOM],
        })
    }

    fn describe(&self, _scenario: &Scenario) -> String {
        "a script".to_owned()
    }

    fn vehicles(&self, _scenario: &Scenario) -> usize {
        ROOM
    }

    fn worlds_differ(&self) -> bool {
        true
    }
}

struct ScriptedWorld<'s> {
    script: &'s Script,
    world: u64,
    routes: Vec<Vec<u32>>,
}

impl ScriptedWorld<'_> {
    /// Every world has its own vehicles: each comes and goes with a period that depends on both.
    fn is_there(&self, vehicle: usize, slots: u32) -> bool {
        let period = 200 + 100 * ((self.world + vehicle as u64) % 4);
        vehicle == 0 || !(u64::from(slots) / period + self.world + vehicle as u64).is_multiple_of(3)
    }
}

impl Mobility for ScriptedWorld<'_> {
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        if self.script.fails_at.is_some_and(|last| slots >= last) {
            return Err(Error::input("script", "its end", "more vehicles"));
        }
        let there = (0..ROOM).filter(|&vehicle| self.is_there(vehicle, slots));
        let place = |vehicle: usize| Place {
            x_m: 100.0 * vehicle as f64 + 10.0 * self.routes[vehicle].len() as f64,
            y_m: 300.0 + 50.0 * self.world as f64,
            moved_m: 1.0,
            speed_m_per_s: 10.0,
        };
        let found = there.map(|vehicle| (vehicle, place(vehicle))).collect();
        *places = found;
        Ok(())
    }

    fn take_route(&mut self, vehicle: usize, links: &[u32]) -> Result<()> {
        if links.is_empty() {
            return Err(Error::input("route", "no link", "at least one"));
        }
        self.routes[vehicle] = links.to_vec();
        self.script.routes_told.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

fn script(fails_at: Option<u32>) -> Script {
    Script {
        routes_told: AtomicUsize::new(0),
        fails_at,
    }
}

/// Everything that is counted and can be seen of some worlds after 900 slots under a policy.
fn scripted(kind: &Kind, worlds: std::ops::Range<u64>) -> Vec<String> {
    let (scenario, table, script) = (scenario(&[]), table(), script(None));
    let mut environment = Environment::new(&scenario, &script, 9, Purpose::Evaluation, worlds);
    let mut decider = (kind.build)(&environment.setup(), &table);
    let mut decisions = Decisions::new(environment.worlds(), ROOM);
    let mut ages = AgeCounter::new(300, environment.worlds(), ROOM);
    for slot in 0..900 {
        run_slot(&mut environment, &mut decider, &mut decisions);
        ages.record(slot, &environment);
    }
    let counted = ages.worlds().into_iter().enumerate();
    counted
        .map(|(world, ages)| {
            let seen = (0..ROOM).filter(|&vehicle| environment.presence().contains(world, vehicle));
            let seen = seen.map(|vehicle| {
                (
                    vehicle,
                    environment.age(world, vehicle),
                    environment.gain_db(world, vehicle, 0).to_bits(),
                    environment.broadcast(world, vehicle),
                )
            });
            format!("{ages:?} {:?}", seen.collect::<Vec<_>>())
        })
        .collect()
}

#[test]
fn worlds_may_have_different_vehicles_and_stay_independent_of_their_batch() {
    let many = LANES as u64 + 3;
    for kind in KINDS {
        let batch = scripted(kind, 0..many);
        for world in [0, 5, many - 1] {
            let alone = scripted(kind, world..world + 2);
            assert_eq!(alone[0], batch[world as usize], "{} world {world}", kind.name);
        }
    }
}

#[test]
fn nobody_who_is_absent_is_heard_counted_or_asked() {
    let (scenario, script) = (scenario(&[]), script(None));
    let mut environment = Environment::new(&scenario, &script, 9, Purpose::Evaluation, 0..40);
    let mut decisions = Decisions::new(40, ROOM);
    let full_power = scenario.radio.max_power();
    let mut absent = 0;
    for slot in 0..900_u32 {
        let place = |world: usize, vehicle: usize| {
            let places = environment.places(world);
            places.binary_search_by_key(&vehicle, |&(known, _)| known).is_ok()
        };
        decisions.clear();
        for world in 0..40 {
            let here = (0..ROOM).filter(|&vehicle| place(world, vehicle)).count();
            let frame = environment
                .broadcasts(world / LANES)
                .frame(world % LANES)
                .unwrap();
            assert!(usize::from(frame.places()) >= here.max(3));
            let ring = environment.broadcasts(world / LANES).ring(world % LANES).unwrap();
            assert!(ring.places() >= 3);
            assert_eq!(environment.presence().count(world), here);
            assert_eq!(
                environment.broadcasts(world / LANES).vehicles(world % LANES),
                here
            );
            for vehicle in 0..ROOM {
                assert_eq!(
                    environment.measurement(world, vehicle).is_some(),
                    place(world, vehicle)
                );
                // Even if somebody lets the absent shout.
                if vehicle == slot as usize % ROOM {
                    decisions.transmit(world, vehicle, 0, full_power);
                }
            }
        }
        let sender = slot as usize % ROOM;
        let here: Vec<bool> = (0..40).map(|world| place(world, sender)).collect();
        let before = |world| {
            let older = u32::from(environment.age(world, sender).slots()) + 1;
            (environment.presence().count(world), older)
        };
        let before: Vec<(usize, u32)> = (0..40).map(before).collect();
        environment.step(&decisions);
        for (world, here) in here.into_iter().enumerate() {
            let (activity, (present, peak)) = (environment.activity(), before[world]);
            let received = u32::from(environment.successes().get(world, 0));
            assert_eq!(usize::from(activity.vehicles().get(world, 0)), present);
            assert_eq!(activity.transmissions().get(world, 0), u16::from(here));
            let energy_mj = activity.energy_mj().get(world, 0);
            assert_eq!(energy_mj, f32::from(u8::from(here)), "1 W for 1 ms");
            assert_eq!(activity.peak_ages().get(world, 0), received * peak);
            if !here {
                assert!(!environment.received(world, slot as usize % ROOM));
                absent += 1;
            }
        }
    }
    assert!(absent > 5_000, "{absent}");
}

#[test]
fn a_source_is_told_routes_and_says_why_it_ends() {
    let (scenario, table) = (scenario(&[]), table());
    let script = script(Some(700));
    let mut environment = Environment::new(&scenario, &script, 1, Purpose::Evaluation, 0..2);
    let before = environment.places(1)[0].1;
    environment.tell_route(1, 0, &[4, 2]).unwrap();
    let refused = environment.tell_route(1, 0, &[]).unwrap_err();
    assert_eq!(refused.to_string(), "route: found no link, expected at least one");
    let silent = Decisions::new(2, ROOM);
    (0..100).for_each(|_| environment.step(&silent));
    assert_eq!(environment.places(1)[0].1.x_m, before.x_m + 20.0);
    assert_eq!(script.routes_told.load(Ordering::Relaxed), 1);
    // The grid's vehicles choose their ways alone.
    let mut grid = Environment::new(&scenario, &Grid, 1, Purpose::Evaluation, 0..1);
    assert!(grid.tell_route(0, 3, &[1]).is_err());
    let simulation = Simulation {
        scenario: &scenario,
        source: &script,
        extent: Extent {
            seed: 1,
            worlds: 3,
            slots: 800,
            warmup: 0,
        },
    };
    let failure = simulation
        .run_policy(&actor::KIND, &table, |_, _| ())
        .unwrap_err();
    assert_eq!(
        failure.to_string(),
        "script: found its end, expected more vehicles"
    );
}

/// A policy that nobody knows yet: everybody sends at random in one of ten slots, at full power where its gain is largest.
struct Tenth {
    required: Level,
    streams: Vec<host_sim::lanes::LaneStream>,
}

static TENTH: Kind = Kind {
    name: "tenth",
    meaning: "Everybody sends in one of ten slots.",
    stream: 1_000,
    needs: Needs::Ring,
    build: |setup, _| {
        Decider::Policy(Box::new(Tenth {
            required: setup.scenario.radio.required_level(),
            streams: setup.row_streams(TENTH.stream),
        }))
    },
};

impl Policy for Tenth {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let words = *self.streams[senses.block()].next_row();
        for (lane, word) in words.into_iter().enumerate().take(senses.worlds()) {
            if let Some(measurement) = senses.measurement(lane)
                && word < u32::MAX / 10
            {
                let gains = measurement.gain().iter().zip(0..);
                let (gain, best) = gains.max().unwrap();
                if let Some(sub_channel) = SubChannel::new(best).filter(|_| *gain >= self.required) {
                    let power = measurement.broadcast().max_power;
                    decisions.set(lane, Decision::Transmit { sub_channel, power });
                }
            }
        }
    }
}

/// Nobody's bytes depend on which other policies there are: stream numbers are the policies' own.
#[test]
fn a_policy_from_elsewhere_moves_no_other() {
    let (scenario, table) = (scenario(&[]), table());
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent: Extent {
            seed: 3,
            worlds: 8,
            slots: 200,
            warmup: 50,
        },
    };
    let ages = |kind: &Kind| -> AgeSummary { simulation.run_policy(kind, &table, |_, _| ()).unwrap().0 };
    let alone: Vec<AgeSummary> = KINDS.iter().map(|kind| ages(kind)).collect();
    let mut kinds = KINDS.to_vec();
    kinds.insert(3, &TENTH);
    let mut with_another: Vec<AgeSummary> = kinds.iter().map(|kind| ages(kind)).collect();
    let tenth = with_another.remove(3);
    assert_eq!(with_another, alone);
    assert!(tenth.mean_ms > 5.0 && tenth.mean_ms < 60.0, "{}", tenth.mean_ms);
    // The numbers that stored results rest on.
    let numbers: Vec<(&str, u32)> = KINDS.iter().map(|kind| (kind.name, kind.stream)).collect();
    for known in [
        ("actor", 0),
        ("central", 1),
        ("clock", 2),
        ("age-threshold", 3),
        ("aloha", 4),
        ("random", 5),
        ("always", 6),
        ("assigned", 7),
        ("grants", 8),
        ("max-weight", 9),
        ("sps", 10),
    ] {
        assert!(numbers.contains(&known), "{known:?}");
    }
    let mut streams: Vec<u32> = KINDS.iter().map(|kind| kind.stream).collect();
    streams.sort_unstable();
    streams.dedup();
    assert_eq!(streams.len(), KINDS.len());
}
