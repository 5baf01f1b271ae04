//! A policy of one's own in the cell, and how old it lets information get.
//!
//! Every vehicle whose age has reached a frame of the ring sends where its gain is largest at full power, but only in one of two
//! slots, drawn by chance: vehicles then meet less often. It runs on the same worlds as two of the simulator's policies.
//!
//! ```console
//! $ cargo run --release -p host-sim --example own_policy
//! ```

use firmware::decision::Decision;
use firmware::table::Table;
use firmware::units::SubChannel;
use host_sim::decisions::VehicleDecisions;
use host_sim::lanes::LaneStream;
use host_sim::mobility::Grid;
use host_sim::policy::{Decider, Kind, Needs, Policy, actor, aloha};
use host_sim::scenario::ScenarioSource;
use host_sim::senses::Senses;
use host_sim::simulation::{Extent, Simulation};
use kit::error::{Error, Result};

/// What the command line would know of the policy; `docs/develop.md` says how to give it a place there.
static KIND: Kind = Kind {
    name: "half",
    meaning: "Whoever's age has reached a frame sends in one of two slots.",
    // Its random streams are its own: no other policy has this number.
    stream: 100,
    needs: Needs::Ring,
    build: |setup, _table| {
        Decider::Policy(Box::new(Half {
            streams: setup.row_streams(KIND.stream),
        }))
    },
};

struct Half {
    /// One for each row of worlds that are simulated side by side.
    streams: Vec<LaneStream>,
}

impl Policy for Half {
    /// One vehicle, from what it alone senses, in a row of worlds.
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let drawn = *self.streams[senses.block()].next_row();
        for (world, word) in drawn.into_iter().enumerate().take(senses.worlds()) {
            // The measurement that a unit's modem hands over; none for a vehicle that is away.
            let Some(measurement) = senses.measurement(world) else {
                continue;
            };
            let broadcast = measurement.broadcast();
            // In 1/256 slots.
            let due = i32::from(measurement.age().slots()) << 8 >= broadcast.ring.frame();
            let best = measurement.gain().iter().zip(0..).max();
            let best = best.and_then(|(_, index)| SubChannel::new(index));
            if let Some(sub_channel) = best
                && due
                && word < u32::MAX / 2
            {
                let power = broadcast.max_power;
                decisions.set(world, Decision::Transmit { sub_channel, power });
            }
        }
    }
}

fn main() -> Result<()> {
    let scenario = ScenarioSource {
        settings: vec!["cell.vehicles=12".to_owned()],
        ..ScenarioSource::default()
    };
    let scenario = scenario.read()?;
    let table = Table::parse(firmware::tables::DISTILLED)
        .map_err(|error| Error::input("built-in table", error, "a table"))?;
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent: Extent {
            seed: 1,
            worlds: 32,
            slots: 1_000,
            warmup: 200,
        },
    };
    println!("12 vehicles, 3 sub-channels, 32 worlds x 1000 slots after 200, seed 1");
    for kind in [&KIND, &aloha::KIND, &actor::KIND] {
        let (ages, _) = simulation.run_policy(kind, &table, |_, _| ())?;
        let interval = ages.ci95_ms.unwrap_or(f64::NAN);
        println!(
            "{:8} {:6.2} +- {interval:.2} ms mean age",
            kind.name, ages.mean_ms
        );
    }
    println!(
        "bound    {:6.2} ms",
        simulation.bound_age_ms().unwrap_or(f64::NAN)
    );
    Ok(())
}
