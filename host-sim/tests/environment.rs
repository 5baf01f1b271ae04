//! The slot loop for many worlds: the same bytes in every batch and on every vector unit, the firmware's decisions, and no
//! allocation.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

#[path = "../../firmware/tests/table_builder.rs"]
mod table_builder;

use firmware::decision::Decision;
use firmware::table::Table;
use firmware::unit::{Event, Unit};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::lanes::{LANES, Vectors};
use host_sim::mobility::Grid;
use host_sim::policy::{Decider, KINDS, Kind, actor, aloha, central, random};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::run_slot;
use host_sim::stream::{Purpose, Role};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ops::Range;
use table_builder::Contents;

static SOURCE: Grid = Grid;

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

/// Everything that can be seen of some worlds after some slots, as bits.
fn seen(environment: &Environment<'_>, worlds: Range<usize>) -> Vec<u32> {
    let mut seen = Vec::new();
    for world in worlds {
        for &vehicle in environment.present() {
            seen.push(u32::from(environment.age(world, vehicle).slots()));
            seen.push(u32::from(environment.received(world, vehicle)));
            for n in 0..environment.sub_channels() {
                seen.push(environment.gain_db(world, vehicle, n).to_bits());
                seen.push(environment.interference_db(world, vehicle, n).to_bits());
            }
            if let Some(broadcast) = environment.broadcast(world, vehicle) {
                seen.push(u32::from(broadcast.period.slots()));
                seen.push(u32::from(broadcast.joiner_probability.code()));
            }
        }
    }
    seen
}

fn run<'s>(
    scenario: &'s Scenario,
    policy: &'static Kind,
    worlds: Range<u64>,
    vectors: Vectors,
) -> Environment<'s> {
    let table = table();
    let mut environment = Environment::new(scenario, &SOURCE, 7, Purpose::Evaluation, worlds);
    environment.set_vectors(vectors);
    let mut decider = (policy.build)(&environment.setup(), &table);
    let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
    for _ in 0..230 {
        run_slot(&mut environment, &mut decider, &mut decisions);
    }
    environment
}

#[test]
fn a_world_does_not_depend_on_its_batch() {
    let scenario = scenario(&[]);
    let many = LANES as u64 + 9;
    for &policy in KINDS {
        let batch = run(&scenario, policy, 0..many, Vectors::widest());
        let alone = run(&scenario, policy, many - 2..many, Vectors::widest());
        let expected = seen(&batch, many as usize - 2..many as usize);
        assert_eq!(seen(&alone, 0..2), expected, "{}", policy.name);
    }
}

#[test]
fn every_vector_unit_gives_the_same_bits() {
    for (settings, policies) in [
        (&[][..], KINDS),
        (
            &["cell.vehicles=37", "radio.sub_channels=11"],
            &[&central::KIND, &aloha::KIND, &random::KIND],
        ),
    ] {
        let scenario = scenario(settings);
        for &policy in policies {
            let worlds = 0..LANES as u64 + 1;
            let count = LANES + 1;
            let wide = run(&scenario, policy, worlds.clone(), Vectors::widest());
            let plain = run(&scenario, policy, worlds, Vectors::plain());
            assert_eq!(seen(&wide, 0..count), seen(&plain, 0..count), "{}", policy.name);
        }
    }
}

/// Observations and transmissions of a run in which every decision is the firmware's unit's. One table for all vehicles, or one
/// for each.
fn compare(vehicles: u32, slots: u32, tables: &[Table<'_>]) -> (u64, u64) {
    let scenario = scenario(&[&format!("cell.vehicles={vehicles}")]);
    let worlds = LANES as u64 + 8;
    let mut environment = Environment::new(&scenario, &SOURCE, 3, Purpose::Evaluation, 0..worlds);
    let mut actors = Decider::Policy(actor::build(&environment.setup(), tables));
    let mut noise = (random::KIND.build)(&environment.setup(), &tables[0]);
    let mut units: Vec<Vec<Unit<'_, _>>> = environment
        .keys()
        .iter()
        .map(|key| {
            let bytes = tables.iter().map(Table::bytes).cycle();
            let unit = |(vehicle, bytes)| Unit::new(bytes, key.stream(Role::BackOff, vehicle));
            (0..vehicles).zip(bytes).map(unit).collect()
        })
        .collect();
    let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
    let (mut observations, mut transmissions) = (0, 0);
    for slot in 0..slots {
        decisions.clear();
        environment.decide(&mut actors, &mut decisions);
        for (world, units) in units.iter_mut().enumerate() {
            for (vehicle, unit) in units.iter_mut().enumerate() {
                let measurement = environment.measurement(world, vehicle).unwrap();
                let expected = unit.slot(&Event::Measured(measurement)).unwrap().decision;
                let found = decisions.get(world, vehicle);
                assert_eq!(found, expected, "slot {slot} world {world} vehicle {vehicle}");
                transmissions += u64::from(expected != Decision::Silent);
                observations += 1;
            }
        }
        // Now and then nobody keeps to the turns, so that all ages, joiners and interferences occur.
        if slot % 100 >= 90 {
            environment.decide(&mut noise, &mut decisions);
        }
        environment.step(&decisions);
    }
    (observations, transmissions)
}

#[test]
fn the_actor_decides_as_the_firmware_s_units_on_a_million_observations() {
    let mut sum = 0;
    for (vehicles, slots) in [(20, 800), (60, 300)] {
        let (observations, transmissions) = compare(vehicles, slots, &[table()]);
        assert!(transmissions > 10_000, "{transmissions}");
        sum += observations;
    }
    assert!(sum >= 1_000_000, "{sum}");
}

#[test]
fn actors_of_every_form_decide_as_the_firmware_s_units() {
    let forms = (0..3).flat_map(|observation| (0..4).map(move |output| (observation, output)));
    let bytes: Vec<Vec<u8>> = forms
        .map(|(observation, output)| Contents::in_form(5, observation, output).bytes())
        .collect();
    let tables: Vec<Table<'_>> = bytes.iter().map(|bytes| Table::parse(bytes).unwrap()).collect();
    // Each vehicle with a table of its own, and some that all share.
    for tables in [&tables[..], &tables[1..2], &tables[11..]] {
        let (_, transmissions) = compare(tables.len().max(3) as u32, 100, tables);
        assert!(transmissions > 100, "{transmissions}");
    }
}

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting on each thread.
struct Counting;

// SAFETY: every call goes to the system's allocator as it came.
#[expect(unsafe_code, reason = "an allocator cannot be counted otherwise")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn no_slot_allocates() {
    let late = [
        "fading.follows_speed=true",
        "knowledge.gain_delay_slots=4",
        "knowledge.gain_error_db=2",
    ];
    for settings in [&[][..], &late] {
        let (scenario, table) = (scenario(settings), table());
        for &policy in KINDS {
            let mut environment = Environment::new(&scenario, &SOURCE, 1, Purpose::Evaluation, 0..40);
            let mut decider = (policy.build)(&environment.setup(), &table);
            let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
            for _ in 0..150 {
                run_slot(&mut environment, &mut decider, &mut decisions);
            }
            let before = ALLOCATIONS.get();
            for _ in 0..250 {
                run_slot(&mut environment, &mut decider, &mut decisions);
            }
            assert_eq!(ALLOCATIONS.get() - before, 0, "{} {settings:?}", policy.name);
        }
    }
}
