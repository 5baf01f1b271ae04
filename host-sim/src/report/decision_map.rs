//! What the network does where: its decisions over gain and age, beside the clock's in the same place.

use super::answers::counted;
use super::cell_figures::start;
use super::chart::{ShareMaps, Side, Squares};
use crate::policy::{actor, power_plan};
use crate::simulation::{Simulation, run_slot};
use firmware::clock;
use firmware::decision::Decision;
use firmware::observation::Observation;
use firmware::table::Table;
use firmware::units::Level;

/// Worlds and slots that are looked at, at most (chosen: a quarter of a million decisions of twenty vehicles).
const WORLDS: u64 = 32;
const SLOTS: u32 = 400;

/// Decisions from which on a square has a colour (chosen).
const LEAST_SEEN: u64 = 10;

/// Squares along the sides of a panel (chosen), and what they range over: dB above the level that carries a report, and frames of age.
const COLUMNS: usize = 20;
const ROWS: usize = 16;
const MARGINS_DB: (f64, f64) = (-15.0, 35.0);
const FRAMES: (f64, f64) = (0.0, 4.0);

/// Why a vehicle might send, the first that holds, with the gain that it would send with.
const SITUATIONS: [(&str, Situation); 4] = [
    ("own place comes round", |seen, _| {
        let known = seen.quantities();
        (known.own_turn() & !known.turn_lost()).then_some(known.sight.own_gain)
    }),
    ("called to an open place", |seen, required| {
        let known = seen.quantities();
        let is_called = known.is_called() & (known.sight.best >= 0);
        let is_better_a_guest = known.is_guest(required) & (known.sight.best_gain < required);
        (is_called & !is_better_a_guest).then_some(known.sight.best_gain)
    }),
    ("may be a guest", |seen, required| {
        let known = seen.quantities();
        known.is_guest(required).then_some(known.sight.guest_gain)
    }),
    ("anything else", |seen, _| {
        let sight = &seen.quantities().sight;
        Some(sight.own_gain.max(sight.best_gain).max(sight.guest_gain))
    }),
];

/// The gain, in 1/256 dB, of one in a situation; `None` for others. The second argument is the required SINR in the same unit.
type Situation = fn(&Observation, i32) -> Option<i32>;

/// Decisions of a square: all of them, and those that send.
#[derive(Clone, Copy, Debug, Default)]
struct Square {
    seen: u64,
    sent: u64,
}

/// By situation.
type Panels = [[[Square; COLUMNS]; ROWS]; SITUATIONS.len()];

/// The figure of a table in the worlds of `simulation`; `None` if nothing was seen often enough.
pub fn decision_map(simulation: &Simulation<'_>, table: &Table<'_>) -> Option<ShareMaps> {
    let extent = &simulation.extent;
    let (worlds, slots) = (WORLDS.min(u64::from(extent.worlds)), SLOTS.min(extent.slots));
    let required: Level = simulation.scenario.radio.required_level();
    let plan = power_plan(simulation.scenario);
    let (mut environment, mut decide, mut decisions) = start(simulation, &actor::KIND, table, worlds);
    let [mut by_actor, mut by_clock]: [Panels; 2] = Default::default();
    let (mut seen, mut differ) = (0_u64, 0_u64);
    let mut observed = Vec::new();
    for slot in 0..extent.warmup + slots {
        observed.clear();
        if slot >= extent.warmup {
            for world in 0..environment.worlds() {
                for &vehicle in environment.present() {
                    if let Some(measurement) = environment.measurement(world, vehicle) {
                        let identity = environment.identity(world, vehicle);
                        observed.push((world, vehicle, Observation::new(&measurement, identity)));
                    }
                }
            }
        }
        run_slot(&mut environment, &mut decide, &mut decisions);
        for (world, vehicle, observation) in &observed {
            let by_network = decisions.get(*world, *vehicle);
            let by_rule = plan.decision(clock::act(observation, required), observation);
            count(&mut by_actor, observation, required, by_network);
            count(&mut by_clock, observation, required, by_rule);
            seen += 1;
            differ += u64::from(by_network != by_rule);
        }
    }
    let rows = [("actor", &by_actor), ("clock", &by_clock)];
    let rows = rows.map(|(name, panels)| (name.to_owned(), panels.iter().map(shares).collect()));
    let figure = ShareMaps {
        title: "What the network does where".to_owned(),
        note: format!(
            "Decisions of the actor that had a measurement in {} x {slots} slots after {}, seed {}, and what the clock would have done in \
             its place: in sub-channel or power {differ} of {seen} differ. Blank where it came fewer than {LEAST_SEEN} times; what lies \
             beyond is in the squares at the rim. A frame is a round of the ring.",
            counted(environment.worlds(), "world"),
            extent.warmup,
            extent.seed,
        ),
        quantity: "share that sends (1)".to_owned(),
        horizontal: Side {
            label: "gain above what carries a report (dB)".to_owned(),
            range: MARGINS_DB,
        },
        vertical: Side {
            label: "age (frames)".to_owned(),
            range: FRAMES,
        },
        columns: SITUATIONS.iter().map(|&(name, _)| name.to_owned()).collect(),
        rows: rows.into(),
    };
    let is_seen =
        |(_, panels): &(String, Vec<Squares>)| panels.iter().flatten().flatten().any(Option::is_some);
    figure.rows.iter().any(is_seen).then_some(figure)
}

fn count(panels: &mut Panels, observation: &Observation, required: Level, decision: Decision) {
    let required = i32::from(required.to_bits());
    let mut situations = SITUATIONS.iter().enumerate();
    let found = situations.find_map(|(index, (_, gain))| Some((index, gain(observation, required)?)));
    let Some((situation, gain)) = found else { return };
    let known = observation.quantities();
    let margin_db = f64::from(gain.saturating_sub(required)) / 256.0;
    let frames = f64::from(known.age * known.sub_channels) / f64::from(known.places);
    let square = |value: f64, (least, most): (f64, f64), count: usize| {
        let share = (value - least) / (most - least) * count as f64;
        (share.max(0.0) as usize).min(count - 1)
    };
    let found = &mut panels[situation][square(frames, FRAMES, ROWS)][square(margin_db, MARGINS_DB, COLUMNS)];
    found.seen += 1;
    found.sent += u64::from(decision != Decision::Silent);
}

fn shares(panel: &[[Square; COLUMNS]; ROWS]) -> Squares {
    let share =
        |square: &Square| (square.seen >= LEAST_SEEN).then(|| square.sent as f64 / square.seen as f64);
    panel.iter().map(|row| row.iter().map(share).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mobility::Grid;
    use crate::scenario::ScenarioSource;
    use crate::simulation::Extent;

    /// The shipped network where guests are called, too: it decides as the clock, and both as the rules say.
    #[test]
    fn the_shipped_network_does_what_the_rules_say() {
        let settings = ["radio.max_power_dbm=10", "cell.vehicles=30"];
        let scenario = ScenarioSource {
            settings: settings.map(str::to_owned).into(),
            ..ScenarioSource::default()
        };
        let simulation = Simulation {
            scenario: &scenario.read().unwrap(),
            source: &Grid,
            extent: Extent {
                seed: 1,
                worlds: 8,
                slots: 400,
                warmup: 100,
            },
        };
        let table = Table::parse(firmware::tables::DISTILLED).unwrap();
        let map = decision_map(&simulation, &table).unwrap();
        assert_eq!(map.rows[0].0, "actor");
        // Squares above what carries a report.
        let first = COLUMNS * 3 / 10;
        for (_, panels) in &map.rows {
            let reaching = |panel: &Squares| -> Vec<f64> {
                let squares = panel.iter().flat_map(|row| &row[first..]);
                squares.flatten().copied().collect()
            };
            let [own, called, guest, else_where] = [0, 1, 2, 3].map(|situation| reaching(&panels[situation]));
            for sends in [own, called, guest] {
                assert!(sends.len() > 5, "{}", sends.len());
                assert!(sends.iter().all(|&share| share > 0.9), "{sends:?}");
            }
            assert!(else_where.len() > 50);
            assert!(else_where.iter().all(|&share| share < 0.1), "{else_where:?}");
        }
        assert!(map.to_svg().unwrap().contains("own place comes"));
    }
}
