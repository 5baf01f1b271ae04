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
use host_sim::mobility::floating_car_data::Trace;
use host_sim::mobility::{Grid, MobilitySource};
use host_sim::policy::{Decider, KINDS, Kind, actor, aloha, central, clock, random};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::run_slot;
use host_sim::stream::Purpose;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ops::Range;
use std::path::Path;
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
                seen.push(u32::from(broadcast.ring.places()));
                seen.push(u32::from(broadcast.open.0));
                seen.push(broadcast.threshold);
                seen.push(u32::from(broadcast.salt));
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
    let many = LANES as u64 + 9;
    for settings in [&[][..], &edge(&["feedback.place_loss=0.5"])] {
        let scenario = scenario(settings);
        for &policy in KINDS {
            let batch = run(&scenario, policy, 0..many, Vectors::widest());
            let alone = run(&scenario, policy, many - 2..many, Vectors::widest());
            let expected = seen(&batch, many as usize - 2..many as usize);
            assert_eq!(seen(&alone, 0..2), expected, "{} {settings:?}", policy.name);
        }
    }
}

/// A cell with an edge, where places are open, and these settings.
fn edge<'s>(settings: &[&'s str]) -> Vec<&'s str> {
    [&["radio.carrier_ghz=5.9", "radio.max_power_dbm=23"], settings].concat()
}

#[test]
fn every_vector_unit_gives_the_same_bits() {
    for (settings, policies) in [
        (&[][..], KINDS),
        (
            &["cell.vehicles=37", "radio.sub_channels=11"],
            &[&central::KIND, &clock::KIND, &aloha::KIND, &random::KIND],
        ),
        (
            &[
                "cell.vehicles=37",
                "radio.sub_channels=8",
                "radio.max_power_dbm=15",
                "feedback.place_loss=0.3",
            ],
            &[&actor::KIND, &clock::KIND],
        ),
    ] {
        let scenario = scenario(settings);
        for &policy in policies {
            let worlds = 0..LANES as u64 + 1;
            let count = LANES + 1;
            let plain = run(&scenario, policy, worlds.clone(), Vectors::plain());
            for vectors in Vectors::all() {
                let found = run(&scenario, policy, worlds.clone(), vectors);
                let names = (policy.name, vectors.name());
                assert_eq!(seen(&found, 0..count), seen(&plain, 0..count), "{names:?}");
            }
        }
    }
}

/// More than a row.
const MANY: u64 = LANES as u64 + 8;

/// Observations and transmissions of a run in which every decision is the firmware's unit's. One table for all vehicles, or one
/// for each.
fn compare(settings: &[&str], worlds: u64, slots: u32, tables: &[Table<'_>]) -> (u64, u64) {
    let scenario = scenario(settings);
    let mut environment = Environment::new(&scenario, &SOURCE, 3, Purpose::Evaluation, 0..worlds);
    let mut actors = Decider::Policy(actor::build(&environment.setup(), tables));
    let mut noise = (random::KIND.build)(&environment.setup(), &tables[0]);
    let vehicles = environment.vehicles();
    let mut units: Vec<Vec<Unit<'_>>> = (0..environment.worlds())
        .map(|world| {
            let bytes = tables.iter().map(Table::bytes).cycle();
            let unit = |(vehicle, bytes)| Unit::new(bytes, environment.identity(world, vehicle));
            (0..vehicles).zip(bytes).map(unit).collect()
        })
        .collect();
    let mut decisions = Decisions::new(environment.worlds(), vehicles);
    let (mut observations, mut transmissions) = (0, 0);
    for slot in 0..slots {
        decisions.clear();
        environment.decide(&mut actors, &mut decisions);
        for (world, units) in units.iter_mut().enumerate() {
            for (vehicle, unit) in units.iter_mut().enumerate() {
                let measurement = environment.measurement(world, vehicle).unwrap();
                let expected = unit.slot(&Event::Measured(measurement)).unwrap().decision;
                let found = decisions.get(world, vehicle);
                assert_eq!(
                    found, expected,
                    "{settings:?}, slot {slot}, world {world}, vehicle {vehicle}"
                );
                transmissions += u64::from(expected != Decision::Silent);
                observations += 1;
            }
        }
        // Now and then nobody keeps to the turns, so that all ages, priorities and interferences occur.
        if slot % 100 >= 90 {
            environment.decide(&mut noise, &mut decisions);
        }
        environment.step(&decisions);
    }
    (observations, transmissions)
}

#[test]
fn the_actor_decides_as_the_firmware_s_units_on_a_million_observations() {
    let street: Vec<String> = preset("street");
    let street: Vec<&str> = street.iter().map(String::as_str).collect();
    let churn = ["cell.replacement_probability=1e-3", "feedback.place_loss=0.3"];
    let mut sum = 0;
    for (settings, slots, least) in [
        (vec![], 400, 40_000),
        (vec!["cell.vehicles=60"], 200, 20_000),
        (street.clone(), 300, 20_000),
        ([&street[..], &churn].concat(), 300, 20_000),
        (edge(&[]), 300, 20_000),
        (edge(&churn), 200, 10_000),
        (vec!["feedback.place_loss=1"], 200, 10_000),
        (vec!["radio.sub_channels=1"], 200, 5_000),
        (edge(&["radio.sub_channels=8", "cell.vehicles=50"]), 120, 20_000),
    ] {
        let (observations, transmissions) = compare(&settings, MANY, slots, &[table()]);
        assert!(transmissions > least, "{settings:?}: {transmissions}");
        sum += observations;
    }
    assert!(sum >= 1_000_000, "{sum}");
    // A single world, whose vehicles share rows.
    let settings = [&street[..], &churn, &["cell.vehicles=70"]].concat();
    let (_, transmissions) = compare(&settings, 1, 500, &[table()]);
    assert!(transmissions > 500, "{transmissions}");
}

/// The settings of a preset, as `--set` takes them.
fn preset(name: &str) -> Vec<String> {
    let path = format!("{}/presets/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let mut section = "";
    let mut settings = Vec::new();
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        if let Some(name) = line.strip_prefix('[') {
            section = name.trim_end_matches(']');
        } else if let Some((key, value)) = line.split_once(" = ") {
            settings.push(format!("{section}.{key}={value}"));
        }
    }
    assert!(!settings.is_empty());
    settings
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
        let vehicles = format!("cell.vehicles={}", tables.len().max(3));
        for more in [&[][..], &["feedback.place_loss=0.5", "radio.max_power_dbm=15"]] {
            let settings = [&[vehicles.as_str()], more].concat();
            for (worlds, least) in [(MANY, 100), (1, 2)] {
                let (_, transmissions) = compare(&settings, worlds, 100, tables);
                assert!(transmissions > least, "{settings:?}: {transmissions}");
            }
        }
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
    let hard = edge(&[
        "feedback.place_loss=0.3",
        "feedback.broadcast_loss=0.1",
        "feedback.acknowledgement_delay_slots=4",
        "broadcast.call_delay_slots=2",
    ]);
    for settings in [&[][..], &late, &hard] {
        let (scenario, table) = (scenario(settings), table());
        for &policy in KINDS {
            let mut environment = Environment::new(&scenario, &SOURCE, 1, Purpose::Evaluation, 0..40);
            let mut decider = (policy.build)(&environment.setup(), &table);
            let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
            // Long enough that plans have changed, too.
            for _ in 0..350 {
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

/// Worlds of the grid and of a trace, with everything that has a state of its own, begin anew in the memory of others as if it were new.
#[test]
fn a_reset_makes_new_worlds_in_the_memory_of_the_old() {
    let trace =
        Trace::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/fcd-gap.xml")).unwrap();
    let hard = edge(&[
        "broadcast.call_delay_slots=2",
        "cell.replacement_probability=1e-2",
        "fading.follows_speed=true",
        "feedback.acknowledgement_delay_slots=2",
        "feedback.acknowledgement_loss=0.1",
        "feedback.broadcast_loss=0.1",
        "feedback.measurement_loss=0.1",
        "feedback.place_loss=0.3",
        "knowledge.gain_delay_slots=2",
        "knowledge.gain_error_db=2",
        "mobility.signal_cycle_s=30",
        "neighbours.noise_rise_db=10",
        "reception.block_error_width_db=1",
    ]);
    let near = ["cell.base_station_x_m=0", "cell.base_station_y_m=0"];
    // With how many allocations at most.
    for (settings, source, most) in [
        (&[][..], &SOURCE as &dyn MobilitySource, 0),
        (&["fading.sub_channel_correlation=0.5"], &SOURCE, 0),
        (&near, &trace, 0),
        (&hard, &SOURCE, 3),
    ] {
        let (scenario, table) = (scenario(settings), table());
        let go_on = |environment: &mut Environment<'_>| {
            let mut decider = (clock::KIND.build)(&environment.setup(), &table);
            let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
            for _ in 0..350 {
                run_slot(environment, &mut decider, &mut decisions);
            }
        };
        let mut environment = Environment::new(&scenario, source, 7, Purpose::Training, 0..40);
        go_on(&mut environment);
        let before = ALLOCATIONS.get();
        environment.reset(8, Purpose::Evaluation, 3..43);
        let allocations = ALLOCATIONS.get() - before;
        assert!(allocations <= most, "{settings:?}: {allocations}");
        let mut new = Environment::new(&scenario, source, 8, Purpose::Evaluation, 3..43);
        for _ in 0..2 {
            assert_eq!(seen(&environment, 0..40), seen(&new, 0..40), "{settings:?}");
            go_on(&mut environment);
            go_on(&mut new);
        }
    }
}

/// Worlds of the grid and of a trace, with everything that has a state of its own, go on alike from a copy, and apart where decisions differ.
#[test]
fn a_copy_goes_on_from_the_same_state() {
    let trace =
        Trace::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/fcd-gap.xml")).unwrap();
    let hard = [
        "cell.replacement_probability=1e-2",
        "knowledge.gain_delay_slots=2",
        "feedback.acknowledgement_delay_slots=2",
        "feedback.measurement_loss=0.1",
        "feedback.broadcast_loss=0.1",
        "fading.follows_speed=true",
    ];
    for (settings, source) in [
        (&hard[..], &SOURCE as &dyn MobilitySource),
        (&["cell.base_station_x_m=0", "cell.base_station_y_m=0"], &trace),
    ] {
        let scenario = scenario(settings);
        let mut environment = Environment::new(&scenario, source, 7, Purpose::Training, 0..3);
        let vehicles = environment.vehicles();
        let silence = Decisions::new(3, vehicles);
        let mut loud = silence.clone();
        for vehicle in 0..vehicles {
            (0..3).for_each(|world| loud.transmit(world, vehicle, vehicle % 3, scenario.radio.max_power()));
        }
        (0..120).for_each(|_| environment.step(&loud));
        let mut copy = environment.copy().unwrap();
        let mut apart = environment.copy().unwrap();
        for _ in 0..120 {
            environment.step(&loud);
            copy.step(&loud);
            apart.step(&silence);
            assert_eq!(seen(&environment, 0..3), seen(&copy, 0..3));
            assert_eq!(environment.replacements(), copy.replacements());
        }
        assert_ne!(seen(&environment, 0..3), seen(&apart, 0..3));
    }
}

#[test]
fn who_is_replaced_leaves_with_its_own_age() {
    let scenario = scenario(&["cell.vehicles=6", "cell.replacement_probability=0.05"]);
    let mut environment = Environment::new(&scenario, &SOURCE, 7, Purpose::Training, 0..3);
    let mut decisions = Decisions::new(3, 6);
    let (mut replaced, mut heard) = (0, 0);
    for slot in 0..400 {
        decisions.clear();
        (0..3).for_each(|world| decisions.transmit(world, slot % 6, 0, scenario.radio.max_power()));
        let before: Vec<_> = (0..18).map(|row| environment.age(row / 6, row % 6)).collect();
        environment.step(&decisions);
        for (row, before) in before.iter().enumerate() {
            let (world, vehicle) = (row / 6, row % 6);
            let received = environment.received(world, vehicle);
            let after = if received { 1 } else { before.slots() + 1 };
            match environment.replacement(world, vehicle) {
                None => assert_eq!(environment.age(world, vehicle).slots(), after),
                Some(left) => {
                    assert_eq!((left.world, left.vehicle), (world, vehicle));
                    assert_eq!(left.last_age.slots(), after);
                    assert_eq!(environment.age(world, vehicle).slots(), 100);
                    replaced += 1;
                    heard += u32::from(received);
                }
            }
        }
    }
    // 360 expected.
    assert!(
        (280..440).contains(&replaced) && heard > 10,
        "{replaced}, {heard}"
    );
}
