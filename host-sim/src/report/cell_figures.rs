//! What goes on in the cell: who used the sub-channels, where information is old, and what the network does where.

use super::chart::{MapChart, OccupancyChart, OccupancyGroup, SlotUse};
use super::decision_map::decision_map;
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::policy::{Decider, Kind, actor};
use crate::simulation::{Simulation, run_slot};
use crate::stream::Purpose;
use firmware::table::Table;
use firmware::units::Age;
use kit::error::Result;
use kit::files::NamedText;

/// Slots of an occupancy figure, after warm-up (chosen: a square is then five pixels wide).
const SLOTS: u32 = 150;

/// Sub-channels up to which a figure has a row for each (chosen).
const MOST_SUB_CHANNELS: u32 = 12;

/// Worlds behind a map, and slots between two looks at the ages (chosen).
const MAP_WORLDS: u64 = 64;
const MAP_INTERVAL: u32 = 10;

/// Side of a map's squares (chosen: about the width of a street).
const SQUARE_M: f64 = 14.0;

/// Figures of the policies in the worlds of `simulation`: `occupancy.svg`, and on the urban grid `age_map.svg` of the first policy;
/// `decisions.svg` where the network is among them.
///
/// # Errors
/// If a figure cannot show its values.
pub fn files(
    simulation: &Simulation<'_>,
    policies: &[&'static Kind],
    table: &Table<'_>,
) -> Result<Vec<NamedText>> {
    let mut files = Vec::new();
    if simulation.scenario.radio.sub_channels <= MOST_SUB_CHANNELS {
        files.push((
            "occupancy.svg".to_owned(),
            occupancy(simulation, policies, table).to_svg()?,
        ));
    }
    if let Some(&policy) = policies.first()
        && simulation.source.is_grid()
    {
        files.push((
            "age_map.svg".to_owned(),
            age_map(simulation, policy, table).to_svg()?,
        ));
    }
    if policies.contains(&&actor::KIND)
        && let Some(map) = decision_map(simulation, table)
    {
        files.push(("decisions.svg".to_owned(), map.to_svg()?));
    }
    Ok(files)
}

/// Worlds of a simulation at their start with a policy for them.
pub(super) fn start<'s>(
    simulation: &Simulation<'s>,
    policy: &Kind,
    table: &'s Table<'s>,
    worlds: u64,
) -> (Environment<'s>, Decider<'s>, Decisions) {
    let Simulation {
        scenario,
        source,
        extent,
    } = *simulation;
    let environment = Environment::new(scenario, source, extent.seed, Purpose::Evaluation, 0..worlds);
    let decider = (policy.build)(&environment.setup(), table);
    let decisions = Decisions::new(environment.worlds(), environment.vehicles());
    (environment, decider, decisions)
}

fn occupancy(simulation: &Simulation<'_>, policies: &[&'static Kind], table: &Table<'_>) -> OccupancyChart {
    let extent = &simulation.extent;
    let slots = SLOTS.min(extent.slots);
    let groups = policies.iter().map(|&policy| {
        let (mut environment, mut decide, mut decisions) = start(simulation, policy, table, 1);
        let mut rows = vec![Vec::new(); environment.sub_channels()];
        for slot in 0..extent.warmup + slots {
            let senders = environment.present().to_vec();
            run_slot(&mut environment, &mut decide, &mut decisions);
            if slot < extent.warmup {
                continue;
            }
            let mut found = vec![(0, false); rows.len()];
            for vehicle in senders {
                if let Some((sub_channel, _)) = decisions.transmission(0, vehicle) {
                    let (transmissions, received) = &mut found[sub_channel];
                    *transmissions += 1;
                    *received |= environment.received(0, vehicle);
                }
            }
            for (row, (transmissions, received)) in rows.iter_mut().zip(found) {
                row.push(SlotUse::of(transmissions, received));
            }
        }
        OccupancyGroup {
            name: policy.name.to_owned(),
            rows,
        }
    });
    OccupancyChart {
        title: "Who used the sub-channels".to_owned(),
        note: format!("World 0, seed {}; a row a sub-channel.", extent.seed),
        first_slot: extent.warmup,
        groups: groups.collect(),
    }
}

fn age_map(simulation: &Simulation<'_>, policy: &Kind, table: &Table<'_>) -> MapChart {
    let Simulation { scenario, extent, .. } = simulation;
    let mobility = &scenario.mobility;
    let ground_m = (
        f64::from(mobility.blocks_x) * mobility.block_x_m,
        f64::from(mobility.blocks_y) * mobility.block_y_m,
    );
    let squares = |length_m: f64| libm::ceil(length_m / SQUARE_M).max(1.0) as usize;
    let (columns, rows) = (squares(ground_m.0), squares(ground_m.1));
    let mut sums = vec![vec![(0_u64, 0_u64); columns]; rows];
    let worlds = MAP_WORLDS.min(u64::from(extent.worlds));
    let (mut environment, mut decide, mut decisions) = start(simulation, policy, table, worlds);
    for slot in 0..extent.slots_per_world() {
        run_slot(&mut environment, &mut decide, &mut decisions);
        if slot < extent.warmup || !slot.is_multiple_of(MAP_INTERVAL) {
            continue;
        }
        for world in 0..environment.worlds() {
            for &(vehicle, place) in environment.places(world) {
                let index = |at_m: f64, length_m: f64, count: usize| {
                    ((at_m / length_m * count as f64) as usize).min(count - 1)
                };
                let row = index(place.y_m, ground_m.1, rows);
                let (sum, count) = &mut sums[row][index(place.x_m, ground_m.0, columns)];
                *sum += u64::from(environment.age(world, vehicle).slots());
                *count += 1;
            }
        }
    }
    let mean = |&(sum, count): &(u64, u64)| (count > 0).then(|| sum as f64 / count as f64);
    MapChart {
        title: format!("Where information is old: {}", policy.name),
        note: format!(
            "{worlds} worlds x {} slots after {}, every {MAP_INTERVAL}th; squares of {SQUARE_M} m where a vehicle drove.",
            extent.slots, extent.warmup
        ),
        quantity: "mean age (ms)".to_owned(),
        // The page's colours, so that every map of ages reads alike.
        range: (1.0, f64::from(Age::TIME_CONSTRAINT.slots())),
        ground_m,
        values: sums.iter().map(|row| row.iter().map(mean).collect()).collect(),
        mark: Some((
            scenario.cell.base_station_x_m,
            scenario.cell.base_station_y_m,
            "base station".to_owned(),
        )),
    }
}
