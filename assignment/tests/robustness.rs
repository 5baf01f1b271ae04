//! Networks that nobody has tuned anything for.

// Helpers are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use assignment::check::evaluate;
use assignment::grid::Grid;
use assignment::{
    CostWeights, Demand, Link, Network, NodeNumbering, Objective, Options, assign, assign_from, demand::Trip,
    uninterrupted,
};

/// A sequence of numbers in 0 to 1, the same everywhere.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1_u32 << 31)
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.next()
    }
}

/// A grid of streets with zones that hang on it by connectors of time 0, roads with odd powers, without congestion, and
/// without time; the zones may not be passed.
fn city(seed: u64, side: u32, load: f64) -> (Network, Demand) {
    const POWERS: [f64; 7] = [0.0, 0.5, 1.0, 2.3, 4.0, 5.2, 8.7];
    let mut sequence = Sequence(seed.wrapping_mul(7_919) + 17);
    for _ in 0..8 {
        sequence.next();
    }
    let streets = Grid {
        columns: side,
        rows: side,
        ..Grid::default()
    };
    let streets = streets.network().unwrap();
    let crossings = streets.numbering().nodes;
    let zones = crossings / 3;
    let mut links = Vec::new();
    for street in streets.links() {
        let kind = sequence.next();
        links.push(Link {
            init_node: zones + street.init_node,
            term_node: zones + street.term_node,
            capacity: sequence.between(200.0, 2_000.0),
            length: sequence.between(0.1, 3.0),
            free_flow_time: if kind < 0.05 {
                0.0
            } else {
                sequence.between(0.2, 5.0)
            },
            b: if kind > 0.85 {
                0.0
            } else {
                sequence.between(0.05, 1.0)
            },
            power: POWERS[(sequence.next() * POWERS.len() as f64) as usize],
            toll: if kind > 0.8 { sequence.next() } else { 0.0 },
        });
    }
    for zone in 1..=zones {
        let crossing = zones + 1 + (zone * 3 - 1) % crossings;
        for (init_node, term_node) in [(zone, crossing), (crossing, zone)] {
            links.push(Link {
                init_node,
                term_node,
                capacity: 0.0,
                length: 0.0,
                free_flow_time: 0.0,
                b: 0.15,
                power: 4.0,
                toll: 0.0,
            });
        }
    }
    let numbering = NodeNumbering {
        zones,
        nodes: zones + crossings,
        first_thru_node: zones + 1,
    };
    let weights = CostWeights {
        toll: 0.5,
        distance: 0.1,
    };
    let network = Network::new(numbering, links, weights).unwrap();
    let mut trips = Vec::new();
    for origin in 1..=zones {
        for destination in 1..=zones {
            if sequence.next() < 0.4 {
                let volume = load * sequence.next();
                trips.push(Trip {
                    origin,
                    destination,
                    volume,
                });
            }
        }
    }
    (network, Demand::new(zones, &trips).unwrap())
}

#[test]
fn unseen_networks_are_solved_to_1e_10() {
    for (seed, side, load, most) in [
        (1, 8, 60.0, [3, 4]),
        (2, 8, 120.0, [6, 6]),
        (3, 12, 20.0, [7, 7]),
        (4, 12, 40.0, [12, 15]),
        (5, 18, 8.0, [17, 29]),
    ] {
        let (network, demand) = city(seed, side, load);
        if side == 18 {
            assert!(network.links().len() > 1_000);
        }
        for (objective, most) in [Objective::UserEquilibrium, Objective::SystemOptimum]
            .into_iter()
            .zip(most)
        {
            let options = Options {
                objective,
                gap: 1e-10,
                ..Options::default()
            };
            let solution = assign(&network, &demand, &options).unwrap();
            let name = format!("seed {seed}, {objective:?}: {:e}", solution.relative_gap);
            assert!(solution.converged, "{name} after {}", solution.iterations);
            // Without one of the engine's steps the flows are right too, only later. Fewer are welcome.
            assert!(
                solution.iterations <= most,
                "{name} after {}",
                solution.iterations
            );
            let judged = evaluate(&network, &demand, objective, &solution.link_flows).unwrap();
            assert!(judged.conserves_demand, "{name}: {judged:?}");
            assert!(judged.relative_gap <= 1.1e-10 + 1e-13, "{name}: {judged:?}");
        }
    }
}

#[test]
fn a_warm_start_takes_few_iterations() {
    let (network, demand) = city(4, 12, 40.0);
    let options = Options {
        gap: 1e-8,
        ..Options::default()
    };
    let before = assign(&network, &demand, &options).unwrap();
    for (load, most) in [(40.0, 0), (41.0, 4), (60.0, 9)] {
        let (_, demand) = city(4, 12, load);
        let warm = assign_from(
            &network,
            &demand,
            &options,
            &before.path_flows,
            &mut uninterrupted,
        )
        .unwrap();
        let cold = assign(&network, &demand, &options).unwrap();
        assert!(warm.iterations < cold.iterations);
        assert!(
            warm.converged && warm.iterations <= most,
            "{load}: {} iterations",
            warm.iterations
        );
    }
}
