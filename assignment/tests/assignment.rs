//! Traffic assignment against hand-made answers, the paper's grid, and networks with best-known equilibria.

// Helpers and strategies are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use assignment::check::{self, evaluate};
use assignment::grid::{Axis, Direction, Grid};
use assignment::tntp::{read_network, read_trips};
use assignment::{
    Algorithm, CostWeights, Demand, Link, Network, NodeNumbering, Objective, Options, Solution, Text, assign,
    assign_observed, demand::Trip,
};
use proptest::prelude::*;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

const ALGORITHMS: [Algorithm; 4] = [
    Algorithm::FrankWolfe,
    Algorithm::ConjugateFrankWolfe,
    Algorithm::BiconjugateFrankWolfe,
    Algorithm::PathBased,
];

/// Sioux Falls' best-known Beckmann function, and our own system optimum.
const SIOUX_FALLS_OBJECTIVE: f64 = 4_231_335.287_107_44;
const SIOUX_FALLS_SYSTEM_OPTIMUM: f64 = 7_194_256.05;

fn options(algorithm: Algorithm, gap: f64) -> Options {
    Options {
        algorithm,
        gap,
        threads: 1,
        ..Options::default()
    }
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn read(folder: &Path, name: &str, weights: CostWeights) -> (Network, Demand) {
    let network = read_network(
        &Text::read(&folder.join(format!("{name}_net.tntp"))).unwrap(),
        weights,
    )
    .unwrap();
    let zones = network.numbering().zones;
    let demand = read_trips(
        &Text::read(&folder.join(format!("{name}_trips.tntp"))).unwrap(),
        zones,
    )
    .unwrap();
    (network, demand)
}

fn sioux_falls() -> (Network, Demand) {
    read(&fixture(""), "SiouxFalls", CostWeights::default())
}

fn braess() -> (Network, Demand) {
    read(&fixture(""), "Braess", CostWeights::default())
}

/// A network that is too large for the repository; none, and a word on the terminal, where it is not beside it.
fn large_network(name: &str, weights: CostWeights) -> Option<(Network, Demand)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/tntp");
    if folder.join(format!("{name}_net.tntp")).exists() {
        return Some(read(&folder, name, weights));
    }
    // Not eprintln!, which the test harness swallows.
    let notice = format!(
        "\nNOT TESTED: {name}, because {} has no such network\n",
        folder.display()
    );
    std::io::stderr().write_all(notice.as_bytes()).unwrap();
    None
}

fn link(init_node: u32, term_node: u32, free_flow_time: f64, b: f64, capacity: f64) -> Link {
    Link {
        init_node,
        term_node,
        capacity,
        length: 0.0,
        free_flow_time,
        b,
        power: 1.0,
        toll: 0.0,
    }
}

fn network(zones: u32, nodes: u32, first_thru_node: u32, links: Vec<Link>) -> Network {
    let numbering = NodeNumbering {
        zones,
        nodes,
        first_thru_node,
    };
    Network::new(numbering, links, CostWeights::default()).unwrap()
}

fn one_trip(zones: u32, origin: u32, destination: u32, volume: f64) -> Demand {
    let trip = Trip {
        origin,
        destination,
        volume,
    };
    Demand::new(zones, &[trip]).unwrap()
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "found {found}, expected {expected} within {tolerance}"
    );
}

// The paper's grid.

#[test]
fn every_row_of_the_grid_carries_12_16_12() {
    let grid = Grid::default();
    let (network, demand) = (grid.network().unwrap(), grid.demand().unwrap());
    assert_eq!((grid.roads(), demand.pairs()), (48, 240));
    // Gradient projection has to shift its way there; the link-based ones meet it at their first loading.
    for algorithm in ALGORITHMS {
        let tolerance = 1e-6;
        let solution = assign(&network, &demand, &options(algorithm, 1e-13)).unwrap();
        assert!(solution.converged, "{algorithm:?}: {}", solution.relative_gap);
        for (index, &flow) in solution.link_flows.iter().enumerate() {
            let expected = if grid.road(index).unwrap().block == 1 {
                16.0
            } else {
                12.0
            };
            assert_close(flow, expected, tolerance);
        }
        assert_close(solution.link_flows.iter().sum(), 640.0, 48.0 * tolerance);
    }
}

#[test]
fn the_grid_maps_streets_to_roads() {
    let grid = Grid::default();
    assert_eq!(grid.road_index(Axis::X, 0, 0, Direction::Forward), Some(0));
    assert_eq!(grid.road_index(Axis::X, 0, 0, Direction::Backward), Some(1));
    assert_eq!(grid.road_index(Axis::X, 3, 2, Direction::Backward), Some(23));
    assert_eq!(grid.road_index(Axis::Y, 0, 0, Direction::Forward), Some(24));
    assert_eq!(grid.road_index(Axis::Y, 3, 2, Direction::Backward), Some(47));
    assert_eq!(grid.road_index(Axis::Y, 4, 0, Direction::Forward), None);
    let huge = Grid {
        columns: u32::MAX,
        ..Grid::default()
    };
    assert_eq!(
        huge.network().unwrap_err().to_string(),
        "grid: columns: found 4294967295, expected 2 to 1000"
    );
}

// Known answers.

#[test]
fn braess_paradox() {
    let (network, demand) = braess();
    let equilibrium = assign(&network, &demand, &options(Algorithm::PathBased, 1e-13)).unwrap();
    for (flow, expected) in equilibrium.link_flows.iter().zip([4.0, 2.0, 2.0, 2.0, 4.0]) {
        assert_close(*flow, expected, 1e-7);
    }
    assert_close(equilibrium.total_travel_time, 6.0 * 92.0, 1e-6);
    // The best for all leaves the fifth road empty: 83 instead of 92 for everybody.
    for algorithm in ALGORITHMS {
        let optimum = Options {
            objective: Objective::SystemOptimum,
            ..options(algorithm, 1e-6)
        };
        let optimum = assign(&network, &demand, &optimum).unwrap();
        // Plain Frank-Wolfe stalls here at a gap of 6e-5.
        let tolerance = if algorithm == Algorithm::FrankWolfe {
            0.05
        } else {
            1e-6
        };
        assert_close(optimum.total_travel_time, 6.0 * 83.0, tolerance);
        assert_close(optimum.link_flows[3], 0.0, tolerance);
        assert_eq!(optimum.objective, optimum.total_travel_time);
    }
}

#[test]
fn sioux_falls_reaches_its_best_known_objective() {
    let (network, demand) = sioux_falls();
    assert_eq!((network.links().len(), demand.total()), (76, 360_600.0));
    for algorithm in ALGORITHMS {
        let solution = assign(&network, &demand, &options(algorithm, 1e-4)).unwrap();
        assert!(
            solution.converged && solution.relative_gap <= 1e-4,
            "{algorithm:?}"
        );
        assert_close(solution.objective / SIOUX_FALLS_OBJECTIVE, 1.0, 2e-4);
    }
    let solution = assign(&network, &demand, &options(Algorithm::PathBased, 1e-12)).unwrap();
    assert!(solution.converged);
    assert_close(solution.objective / SIOUX_FALLS_OBJECTIVE, 1.0, 5e-13);
    let optimum = Options {
        objective: Objective::SystemOptimum,
        ..options(Algorithm::PathBased, 1e-12)
    };
    let optimum = assign(&network, &demand, &optimum).unwrap();
    assert_close(optimum.total_travel_time, SIOUX_FALLS_SYSTEM_OPTIMUM, 0.005);
}

#[test]
fn large_networks_reach_their_best_known_objectives() {
    let weights = CostWeights {
        toll: 0.02,
        distance: 0.04,
    };
    for (name, weights, objective, digit) in [
        ("Anaheim", CostWeights::default(), 1_286_032.171_096, 1e-6),
        ("ChicagoSketch", weights, 17_313_018.738_747_7, 1e-6),
    ] {
        let Some((network, demand)) = large_network(name, weights) else {
            continue;
        };
        let options = Options {
            threads: 0,
            ..options(Algorithm::PathBased, 1e-12)
        };
        let solution = assign(&network, &demand, &options).unwrap();
        assert!(solution.converged, "{name}: {}", solution.relative_gap);
        assert_close(solution.objective, objective, digit);
        let judged = evaluate(
            &network,
            &demand,
            Objective::UserEquilibrium,
            &solution.link_flows,
        )
        .unwrap();
        assert!(judged.conserves_demand, "{name}: {judged:?}");
        assert!(judged.relative_gap <= 2e-12, "{name}: {judged:?}");
    }
}

#[test]
fn links_without_congestion_share_or_take_all() {
    // B = 0, a free-flow time of 0, and a capacity of 0 where it does not matter: 1 to 2 costs 3 on either, 4 on the last.
    let links = vec![
        link(1, 2, 3.0, 0.0, 0.0),
        link(1, 3, 0.0, 0.15, 0.0),
        link(3, 2, 3.0, 0.0, 10.0),
        link(1, 2, 4.0, 0.0, 1.0),
    ];
    let (network, demand) = (network(2, 3, 1, links), one_trip(2, 1, 2, 5.0));
    for algorithm in ALGORITHMS {
        let solution = assign(&network, &demand, &options(algorithm, 1e-12)).unwrap();
        assert!(solution.converged);
        assert_eq!(solution.total_travel_time, 15.0);
        assert_eq!(solution.link_flows[0] + solution.link_flows[2], 5.0);
        assert_eq!(solution.link_flows[3], 0.0);
    }
}

#[test]
fn a_constant_link_caps_the_cost_of_a_congestible_one() {
    // 10 + x against a constant 15: five vehicles take the first road, the others the second.
    let links = vec![link(1, 2, 10.0, 0.1, 1.0), link(1, 2, 15.0, 0.0, 1.0)];
    let (network, demand) = (network(2, 2, 1, links), one_trip(2, 1, 2, 20.0));
    for algorithm in ALGORITHMS {
        let solution = assign(&network, &demand, &options(algorithm, 1e-9)).unwrap();
        assert_close(solution.link_flows[0], 5.0, 1e-4);
        assert_close(solution.link_flows[1], 15.0, 1e-4);
    }
}

#[test]
fn unusual_powers_converge() {
    for power in [0.0, 0.5, 1.0, 2.5, 16.8, 60.0] {
        let mut links = vec![link(1, 2, 10.0, 0.15, 4.0), link(1, 2, 11.0, 0.15, 5.0)];
        for link in &mut links {
            link.power = power;
        }
        let (network, demand) = (network(2, 2, 1, links), one_trip(2, 1, 2, 12.0));
        let solution = assign(&network, &demand, &options(Algorithm::PathBased, 1e-12)).unwrap();
        assert!(solution.converged, "power {power}: {}", solution.relative_gap);
        assert_close(solution.link_flows.iter().sum(), 12.0, 1e-12);
    }
}

#[test]
fn zones_before_the_first_thru_node_are_not_crossed() {
    // 1 to 2 through zone 3 is short, through node 4 long.
    let links = vec![
        link(1, 3, 1.0, 0.0, 1.0),
        link(3, 2, 1.0, 0.0, 1.0),
        link(1, 4, 9.0, 0.0, 1.0),
        link(4, 2, 9.0, 0.0, 1.0),
    ];
    let demand = one_trip(3, 1, 2, 7.0);
    for algorithm in ALGORITHMS {
        let crossed = assign(
            &network(3, 4, 1, links.clone()),
            &demand,
            &options(algorithm, 1e-9),
        );
        assert_eq!(crossed.unwrap().link_flows, [7.0, 7.0, 0.0, 0.0]);
        let closed = network(3, 4, 4, links.clone());
        let around = assign(&closed, &demand, &options(algorithm, 1e-9)).unwrap();
        assert_eq!(around.link_flows, [0.0, 0.0, 7.0, 7.0]);
        // The judge sees who crosses a zone.
        let crossing = [7.0, 7.0, 0.0, 0.0];
        let judged = evaluate(&closed, &demand, Objective::UserEquilibrium, &crossing).unwrap();
        assert_eq!(
            (
                judged.conserves_demand,
                judged.largest_imbalance,
                judged.worst_node
            ),
            (false, 7.0, 3)
        );
    }
    // A zone is still where trips start and end.
    let closed = network(3, 4, 4, links);
    let ends = assign(
        &closed,
        &one_trip(3, 1, 3, 1.0),
        &options(Algorithm::PathBased, 1e-9),
    );
    assert_eq!(ends.unwrap().link_flows, [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn tolls_and_distance_join_the_cost() {
    let mut links = vec![link(1, 2, 10.0, 0.0, 1.0), link(1, 2, 12.0, 0.0, 1.0)];
    links[0].toll = 100.0;
    links[1].length = 3.0;
    let numbering = NodeNumbering {
        zones: 2,
        nodes: 2,
        first_thru_node: 1,
    };
    let demand = one_trip(2, 1, 2, 4.0);
    for (toll, distance, first, cost) in [
        (0.0, 0.0, 4.0, 10.0),
        (0.05, 0.0, 0.0, 12.0),
        (0.05, 2.0, 4.0, 15.0),
    ] {
        let network = Network::new(numbering, links.clone(), CostWeights { toll, distance }).unwrap();
        let solution = assign(&network, &demand, &options(Algorithm::PathBased, 1e-9)).unwrap();
        assert_eq!(solution.link_flows[0], first);
        assert_eq!(solution.total_travel_time, 4.0 * cost);
    }
}

// Trust.

/// Everything of a solution but the clock.
fn bytes(solution: &Solution) -> Vec<u64> {
    let records = solution.convergence.iter();
    let records = records.flat_map(|record| [record.relative_gap, record.objective]);
    let flows = solution.link_flows.iter().chain(&solution.link_costs).copied();
    flows.chain(records).map(f64::to_bits).collect()
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let mut problems = vec![sioux_falls()];
    problems.extend(large_network("Anaheim", CostWeights::default()));
    for (network, demand) in &problems {
        for algorithm in ALGORITHMS {
            let solve = |threads| {
                let options = Options {
                    threads,
                    max_iterations: 12,
                    ..options(algorithm, 0.0)
                };
                bytes(&assign(network, demand, &options).unwrap())
            };
            let one = solve(1);
            for threads in [2, 3] {
                assert!(one == solve(threads), "{algorithm:?} on {threads} threads");
            }
        }
    }
}

#[test]
fn the_judge_agrees_with_the_solver_and_sees_tampering() {
    let (network, demand) = sioux_falls();
    for objective in [Objective::UserEquilibrium, Objective::SystemOptimum] {
        let options = Options {
            objective,
            ..options(Algorithm::BiconjugateFrankWolfe, 1e-4)
        };
        let solution = assign(&network, &demand, &options).unwrap();
        let text = check::format_flows(&network, &solution.link_flows, &solution.link_costs);
        let mut link_flows = check::read_flows(&Text::new("flows.csv", &text), &network).unwrap();
        assert_eq!(link_flows, solution.link_flows);
        let judged = evaluate(&network, &demand, objective, &link_flows).unwrap();
        assert_close(judged.relative_gap / solution.relative_gap, 1.0, 1e-9);
        assert_close(judged.objective / solution.objective, 1.0, 1e-13);
        assert_close(judged.total_travel_time / solution.total_travel_time, 1.0, 1e-13);
        assert!(judged.conserves_demand);
        link_flows[9] += 1.0;
        let judged = evaluate(&network, &demand, objective, &link_flows).unwrap();
        assert_close(judged.largest_imbalance, 1.0, 1e-9);
        assert!(!judged.conserves_demand && !judged.is_short);
    }
}

/// As many trips back as forth: whatever share of them is missing, every node is balanced.
#[test]
fn flows_that_are_short_of_a_balanced_demand_do_not_carry_it() {
    let road = |init_node, term_node| link(init_node, term_node, 5.0, 1.0, 4.0);
    let network = network(2, 2, 1, vec![road(1, 2), road(2, 1)]);
    let trip = |origin, destination| Trip {
        origin,
        destination,
        volume: 8.0,
    };
    let demand = Demand::new(2, &[trip(1, 2), trip(2, 1)]).unwrap();
    for (share, carried) in [(0.0, false), (0.5, false), (0.99, false), (1.0, true)] {
        let judged = evaluate(&network, &demand, Objective::UserEquilibrium, &[8.0 * share; 2]).unwrap();
        assert_eq!(judged.largest_imbalance, 0.0);
        assert_eq!(
            (judged.conserves_demand, judged.is_short),
            (carried, !carried),
            "{share}"
        );
    }
}

#[test]
fn the_record_starts_with_all_or_nothing_and_ends_with_the_result() {
    let (network, demand) = sioux_falls();
    for algorithm in ALGORITHMS {
        let options = Options {
            max_iterations: 3,
            ..options(algorithm, 1e-12)
        };
        let mut observed = Vec::new();
        let solution = assign_observed(&network, &demand, &options, &mut |record| {
            observed.push(*record);
            ControlFlow::Continue(())
        })
        .unwrap();
        assert_eq!(observed, solution.convergence);
        assert_eq!((solution.iterations, observed.len()), (3, 4));
        assert!(!solution.converged);
        assert_eq!(solution.relative_gap, observed[3].relative_gap);
        assert_eq!(solution.objective, observed[3].objective);
        let none = Options {
            max_iterations: 0,
            ..options
        };
        assert_eq!(assign(&network, &demand, &none).unwrap().iterations, 0);
    }
    let nobody = Demand::new(24, &[]).unwrap();
    for algorithm in ALGORITHMS {
        let empty = assign(&network, &nobody, &options(algorithm, 0.0)).unwrap();
        assert!(empty.converged && empty.link_flows.iter().all(|&flow| flow == 0.0));
    }
}

#[test]
fn a_gap_that_no_computer_reaches_ends_all_the_same() {
    let (network, demand) = sioux_falls();
    let solution = assign(&network, &demand, &options(Algorithm::PathBased, 0.0)).unwrap();
    assert!(solution.relative_gap < 1e-13, "{}", solution.relative_gap);
    assert!(solution.iterations < 1000);
}

// Bad input: one line each, that says where and what.

const NETWORK: &str = "<NUMBER OF ZONES> 2
<NUMBER OF NODES> 3
<FIRST THRU NODE> 1
<NUMBER OF LINKS> 2
<END OF METADATA>
~ init term capacity length time b power speed toll type ;
\t1\t3\t10\t1\t5\t0.15\t4\t0\t0\t1\t;
\t3\t2\t10\t1\t5\t0.15\t4\t0\t0\t1\t;
";

const TRIPS: &str = "<NUMBER OF ZONES> 2
<TOTAL OD FLOW> 9.0
<END OF METADATA>
Origin 1
 1 : 2.0; 2 : 7.0;
";

#[test]
fn bad_networks_are_named_by_line() {
    assert!(read_network(&Text::new("net", NETWORK), CostWeights::default()).is_ok());
    // A number in a small file is no reason for much memory.
    let start = NETWORK.find("<NUMBER OF NODES>").unwrap();
    let line = NETWORK[start..].lines().next().unwrap();
    let claims = NETWORK.replace(line, "<NUMBER OF NODES> 9000000");
    let failure = read_network(&Text::new("net", &claims), CostWeights::default()).unwrap_err();
    let expected = format!(
        "net: <NUMBER OF NODES>: found 9000000, expected fewer: the file has {} bytes",
        claims.len()
    );
    assert_eq!(failure.to_string(), expected);
    for (from, to, message) in [
        (
            "\t1\t3\t10\t1",
            "\t1\t3\t10",
            "net:7: found 9 columns, expected 10: init_node term_node capacity length free_flow_time b power speed toll link_type",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\tten",
            "net:8: capacity: found `ten`, expected a number",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2.5\t10",
            "net:8: term_node: found `2.5`, expected a node number",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\tinf",
            "net:8: capacity: found inf, expected a finite number, not negative",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\tNaN",
            "net:8: capacity: found NaN, expected a finite number, not negative",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\t-10",
            "net:8: capacity: found -10, expected a finite number, not negative",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\t0",
            "net:8: capacity: found 0, expected a positive number where b, power and free_flow_time are positive",
        ),
        (
            "\t3\t2\t10",
            "\t3\t2\t1e-100",
            "net:8: found a cost that overflows, expected attributes of a usual size",
        ),
        (
            "\t3\t2\t10",
            "\t4\t2\t10",
            "net:8: init_node: found 4, expected a node from 1 to 3",
        ),
        (
            "\t3\t2\t10",
            "\t3\t0\t10",
            "net:8: term_node: found 0, expected a node from 1 to 3",
        ),
        (
            "LINKS> 2",
            "LINKS> 3",
            "net: found 2 links, expected 3, as <NUMBER OF LINKS> states",
        ),
        (
            "<NUMBER OF NODES> 3\n",
            "",
            "net: found no <NUMBER OF NODES>, expected it among the metadata",
        ),
        (
            "NODES> 3",
            "NODES> three",
            "net:2: <NUMBER OF NODES>: found `three`, expected a number",
        ),
        (
            "NODES> 3",
            "NODES> 4000000000",
            "net: NUMBER OF NODES: found 4000000000, expected 1 to 10000000",
        ),
        (
            "ZONES> 2",
            "ZONES> 4",
            "net: NUMBER OF ZONES: found 4, expected at most the 3 nodes",
        ),
        (
            "THRU NODE> 1",
            "THRU NODE> 5",
            "net: FIRST THRU NODE: found 5, expected 1 to 4",
        ),
        (
            "<FIRST THRU NODE> 1",
            "<NUMBER OF NODES> 3",
            "net:3: found a second <NUMBER OF NODES>, expected each key once",
        ),
        (
            "<END OF METADATA>\n~",
            "~",
            "net:6: found `1\t3\t10\t1\t5\t0.15\t4\t0\t0\t1\t;`, expected `<KEY> value` up to <END OF METADATA>",
        ),
        (
            NETWORK,
            "",
            "net: found the end of the file, expected <END OF METADATA> after the metadata",
        ),
    ] {
        let text = NETWORK.replacen(from, to, 1);
        let found = read_network(&Text::new("net", &text), CostWeights::default()).unwrap_err();
        assert_eq!(found.to_string(), message);
    }
}

#[test]
fn bad_trips_are_named_by_line() {
    let demand = read_trips(&Text::new("trips", TRIPS), 2).unwrap();
    assert_eq!(
        (demand.total(), demand.intrazonal(), demand.pairs()),
        (7.0, 2.0, 1)
    );
    for (from, to, message) in [
        (
            "2 : 7.0",
            "2 : seven",
            "trips:5: volume: found `seven`, expected a number",
        ),
        (
            "2 : 7.0",
            "2 : -7.0",
            "trips:5: volume: found -7, expected a finite number, not negative",
        ),
        (
            "2 : 7.0",
            "2 : inf",
            "trips:5: volume: found inf, expected a finite number, not negative",
        ),
        (
            "2 : 7.0",
            "3 : 7.0",
            "trips:5: destination: found 3, expected a zone from 1 to 2",
        ),
        (
            "2 : 7.0",
            "2 7.0",
            "trips:5: found `2 7.0`, expected `destination : volume`",
        ),
        (
            "2 : 7.0",
            "2 : 7.1",
            "trips: found trips that add up to 9.1, expected 9, as <TOTAL OD FLOW> states",
        ),
        (
            "Origin 1",
            "Origin 9",
            "trips:4: origin: found 9, expected a zone from 1 to 2",
        ),
        (
            "Origin 1",
            "Origin",
            "trips:4: origin: found ``, expected a zone number",
        ),
        (
            "Origin 1\n",
            "",
            "trips:4: found 1 : 2.0, expected an `Origin` line before any trips",
        ),
        (
            "ZONES> 2",
            "ZONES> 3",
            "trips: <NUMBER OF ZONES>: found 3, expected 2, as the network has",
        ),
        (
            "<TOTAL OD FLOW> 9.0\n",
            "",
            "trips: found no <TOTAL OD FLOW>, expected it among the metadata",
        ),
        (
            "FLOW> 9.0",
            "FLOW> 0e300",
            "trips: found trips that add up to 9, expected 0, as <TOTAL OD FLOW> states",
        ),
        (
            "FLOW> 9.0",
            "FLOW> NaN",
            "trips:2: <TOTAL OD FLOW>: found NaN, expected a finite number, not negative",
        ),
    ] {
        let found = read_trips(&Text::new("trips", &TRIPS.replacen(from, to, 1)), 2).unwrap_err();
        assert_eq!(found.to_string(), message);
    }
}

#[test]
fn bad_flow_files_are_named_by_line() {
    let network = read_network(&Text::new("net", NETWORK), CostWeights::default()).unwrap();
    let flows = "init_node,term_node,volume,cost\n1,3,7,5\n3,2,7,5\n";
    assert_eq!(
        check::read_flows(&Text::new("flows", flows), &network).unwrap(),
        [7.0, 7.0]
    );
    for (from, to, message) in [
        (
            "volume,cost",
            "volume",
            "flows:1: found `init_node,term_node,volume`, expected `init_node,term_node,volume,cost`",
        ),
        (
            "1,3,7,5",
            "1,3,7",
            "flows:2: found 3 columns, expected 4: init_node,term_node,volume,cost",
        ),
        (
            "1,3,7,5",
            "1,3,-7,5",
            "flows:2: volume: found `-7`, expected a finite number, not negative",
        ),
        (
            "1,3,7,5",
            "1,3,7,NaN",
            "flows:2: cost: found `NaN`, expected a finite number, not negative",
        ),
        (
            "1,3,7,5",
            "3,1,7,5",
            "flows:2: found link 3 to 1, expected 1 to 3, the network's next",
        ),
        ("3,2,7,5\n", "", "flows: found 1 rows, expected 2, one per link"),
        (
            "3,2,7,5\n",
            "3,2,7,5\n3,2,7,5\n",
            "flows:4: found one more row, expected 2 rows, one per link",
        ),
    ] {
        let found =
            check::read_flows(&Text::new("flows", &flows.replacen(from, to, 1)), &network).unwrap_err();
        assert_eq!(found.to_string(), message);
    }
}

#[test]
fn a_pair_without_a_path_is_named() {
    let network = network(3, 3, 1, vec![link(1, 2, 1.0, 0.0, 1.0)]);
    let demand = one_trip(3, 2, 3, 1.0);
    let message = "trips from 2 to 3: found no path in the network, expected a path wherever there is demand";
    for algorithm in ALGORITHMS {
        let failure = assign(&network, &demand, &options(algorithm, 1e-6)).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
    let failure = evaluate(&network, &demand, Objective::UserEquilibrium, &[0.0]).unwrap_err();
    assert_eq!(failure.to_string(), message);
    // Without demand between them, all is well.
    assert!(assign(&network, &one_trip(3, 1, 2, 1.0), &Options::default()).is_ok());
}

#[test]
fn problems_that_make_no_sense_are_refused() {
    let (network, demand) = braess();
    for gap in [-1e-6, f64::NAN, f64::INFINITY] {
        let failure = assign(&network, &demand, &options(Algorithm::PathBased, gap)).unwrap_err();
        let expected = format!("relative gap: found {gap}, expected a finite number, not negative");
        assert_eq!(failure.to_string(), expected);
    }
    let failure = assign(&network, &one_trip(3, 1, 2, 1.0), &Options::default()).unwrap_err();
    assert_eq!(
        failure.to_string(),
        "demand: found 3 zones, expected the network's 2 zones"
    );
    let failure = assign(&network, &one_trip(2, 1, 2, 1e200), &Options::default()).unwrap_err();
    assert!(
        failure
            .to_string()
            .starts_with("link 1 (1 to 3): found a cost that overflows at 1")
    );
    // Each road's total time is a number, and their sum is none.
    let failure = assign(&network, &one_trip(2, 1, 2, 3e153), &Options::default()).unwrap_err();
    let failure = failure.to_string();
    assert!(
        failure.starts_with("link 5 (4 to 2): found a cost that overflows at 3"),
        "{failure}"
    );
    let failure = network.with_capacities(&[1.0, 1.0, 0.0, 1.0, 1.0]).unwrap_err();
    assert_eq!(
        failure.to_string(),
        "link 3: capacity: found 0, expected a positive number"
    );
    let failure = evaluate(&network, &demand, Objective::UserEquilibrium, &[1.0]).unwrap_err();
    assert_eq!(failure.to_string(), "flows: found 1, expected 5, one per link");
}

// Any network.

/// A grid with roads of every kind and a few trips.
fn any_problem() -> impl Strategy<Value = (Network, Demand)> {
    let any_link = (1.0..100.0, 1.0..50.0, 0.0..1.0, 0..5_usize);
    let any_trip = (1..=12_u32, 1..=12_u32, 0.0..30.0);
    (
        proptest::collection::vec(any_link, 34),
        proptest::collection::vec(any_trip, 1..20),
    )
        .prop_map(|(attributes, trips)| {
            let grid = Grid {
                columns: 4,
                rows: 3,
                ..Grid::default()
            };
            let grid = grid.network().unwrap();
            let links = grid.links().iter().zip(attributes);
            let links = links.map(|(link, (free_flow_time, capacity, b, power))| Link {
                free_flow_time,
                capacity,
                b: if b < 0.2 { 0.0 } else { b },
                power: [1.0, 2.0, 4.0, 4.0, 5.5][power],
                ..link.clone()
            });
            let network = Network::new(grid.numbering(), links.collect(), CostWeights::default()).unwrap();
            let trips = trips.into_iter().map(|(origin, destination, volume)| Trip {
                origin,
                destination,
                volume,
            });
            (network, Demand::new(12, &trips.collect::<Vec<_>>()).unwrap())
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// The objective is convex: no flows beat the best by more than their own gap times total cost.
    #[test]
    fn any_solution_conserves_flow_and_algorithms_agree((network, demand) in any_problem(), optimum: bool) {
        let objective = if optimum { Objective::SystemOptimum } else { Objective::UserEquilibrium };
        let solve = |algorithm, gap| {
            let options = Options { objective, max_iterations: 2000, ..options(algorithm, gap) };
            assign(&network, &demand, &options).unwrap()
        };
        let best = solve(Algorithm::PathBased, 1e-11);
        prop_assert!(best.converged, "path: {}", best.relative_gap);
        for algorithm in ALGORITHMS {
            let solution = solve(algorithm, 1e-5);
            let judged = evaluate(&network, &demand, objective, &solution.link_flows).unwrap();
            prop_assert!(judged.largest_imbalance <= 1e-9 * (1.0 + demand.total()), "{algorithm:?}: {judged:?}");
            prop_assert!((judged.relative_gap - solution.relative_gap).abs() <= 1e-12, "{algorithm:?}: {judged:?}");
            prop_assert!(judged.relative_gap <= 1e-2, "{algorithm:?}: {judged:?}");
            let excess = solution.objective - best.objective;
            // At marginal costs the total is larger than at travel costs; 7 = the largest power + 1, rounded up.
            let bound = (solution.relative_gap + best.relative_gap + 1e-13) * 7.0 * solution.total_travel_time;
            prop_assert!(excess.abs() <= bound, "{algorithm:?}: {excess} above the best, allowed {bound}");
        }
    }
}
