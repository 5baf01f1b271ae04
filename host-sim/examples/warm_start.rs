//! How much faster an assignment is that starts from the one before an incident: every link loses up to a tenth of its
//! capacity, at random, and the new equilibrium is found both from nothing and from where the old solve ended.
//!
//! ```console
//! $ cargo run --release -p host-sim --example warm_start -- NET.tntp TRIPS.tntp [TOLL_WEIGHT DISTANCE_WEIGHT]
//! ```
//!
//! Times are CPU seconds of one thread; cold and warm solves alternate, so that both meet the same machine.

use assignment::{Assigner, CostWeights, Network, Options, Solution, Text, tntp};
use host_sim::stream::{Purpose, Role, Stream, WorldKey};
use kit::error::{Error, Result};
use rustix::time::{ClockId, clock_gettime};
use std::path::Path;

/// Random cuts that are tried.
const CUTS: u64 = 24;

/// Solves of each kind per cut; the quickest one counts.
const REPEATS: usize = 5;

/// Largest share of its capacity that a link loses.
const LARGEST_CUT: f64 = 0.1;

/// Relative gap of all solves.
const GAP: f64 = 1e-6;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Err(error) = run(&arguments) {
        eprintln!("{error}");
        std::process::exit(2);
    }
}

fn run(arguments: &[String]) -> Result<()> {
    let (net, trips, weights) = match arguments {
        [net, trips] => (net, trips, CostWeights::default()),
        [net, trips, toll, distance] => {
            let weights = CostWeights {
                toll: number("TOLL_WEIGHT", toll)?,
                distance: number("DISTANCE_WEIGHT", distance)?,
            };
            (net, trips, weights)
        }
        _ => {
            let expected = "NET.tntp TRIPS.tntp [TOLL_WEIGHT DISTANCE_WEIGHT]";
            return Err(Error::input("arguments", arguments.len(), expected));
        }
    };
    let network = tntp::read_network(&Text::read(Path::new(net))?, weights)?;
    let demand = tntp::read_trips(&Text::read(Path::new(trips))?, network.numbering().zones)?;
    let options = Options {
        gap: GAP,
        threads: 1,
        ..Options::default()
    };
    let unsolved = Assigner::new(demand, options)?;
    let mut before = unsolved.clone();
    before.assign(&network)?;
    let (mut cold_times, mut warm_times, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for cut in 0..CUTS {
        let mut stream = cut_stream(cut);
        let left = || 1.0 - stream.uniform_between(0.0, LARGEST_CUT);
        let capacities: Vec<f64> = network
            .links()
            .iter()
            .zip(std::iter::repeat_with(left))
            .map(|(link, left)| link.capacity * left)
            .collect();
        let after = network.with_capacities(&capacities)?;
        let from_nothing = || timed(&unsolved, &after);
        let from_before = || timed(&before, &after);
        let ((mut cold_time, cold), (mut warm_time, warm)) = (from_nothing()?, from_before()?);
        for _ in 1..REPEATS {
            cold_time = cold_time.min(from_nothing()?.0);
            warm_time = warm_time.min(from_before()?.0);
        }
        println!(
            "cut {cut:2}: cold {cold_time:.4} s ({} iterations, gap {:.1e}), warm {warm_time:.4} s ({}, {:.1e}), {:.2} x",
            cold.iterations,
            cold.relative_gap,
            warm.iterations,
            warm.relative_gap,
            cold_time / warm_time,
        );
        cold_times.push(cold_time);
        warm_times.push(warm_time);
        ratios.push(cold_time / warm_time);
    }
    for (name, unit, values) in [
        ("cold", "s", &mut cold_times),
        ("warm", "s", &mut warm_times),
        ("cold over warm", "x", &mut ratios),
    ] {
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        let median = 0.5 * (values[middle - 1] + values[middle]);
        println!(
            "{name:<14} median {median:.4} {unit}, {:.4} to {:.4}",
            values[0],
            values[values.len() - 1]
        );
    }
    Ok(())
}

fn number(name: &str, text: &str) -> Result<f64> {
    let number = text.parse();
    number.map_err(|_| Error::input(name, format!("`{text}`"), "a number"))
}

fn cut_stream(cut: u64) -> Stream {
    let key = WorldKey {
        seed: 1,
        purpose: Purpose::Evaluation,
        world: cut,
    };
    key.stream(Role::Incidents, 0)
}

/// CPU seconds that a solve takes from where `start` ended, with its result.
fn timed(start: &Assigner, network: &Network) -> Result<(f64, Solution)> {
    let mut assigner = start.clone();
    let before = cpu_seconds();
    let solution = assigner.assign(network)?;
    Ok((cpu_seconds() - before, solution))
}

/// CPU time of this thread so far.
fn cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
