//! What a solve gives beside link flows, and what it can start from.

// Helpers are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use assignment::check::evaluate;
use assignment::path_flows::{carry_demand, format_paths, link_flows, read_paths};
use assignment::select_link::{links_between, select_links};
use assignment::skims::{format_skims, skims};
use assignment::tntp::{read_network, read_trips};
use assignment::{
    Algorithm, Assigner, CostWeights, Demand, Network, Objective, Options, PathFlows, Solution, Stop, Text,
    assign, assign_from, convergence, demand::Trip, uninterrupted,
};
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn read(name: &str) -> (Network, Demand) {
    // Braess' answers are for time alone.
    let weights = match name {
        "Braess" => CostWeights::default(),
        _ => CostWeights {
            toll: 0.02,
            distance: 0.04,
        },
    };
    let network = read_network(
        &Text::read(&fixture(&format!("{name}_net.tntp"))).unwrap(),
        weights,
    )
    .unwrap();
    let zones = network.numbering().zones;
    let demand = read_trips(
        &Text::read(&fixture(&format!("{name}_trips.tntp"))).unwrap(),
        zones,
    )
    .unwrap();
    (network, demand)
}

fn options(gap: f64) -> Options {
    Options {
        gap,
        threads: 1,
        ..Options::default()
    }
}

fn warm(network: &Network, demand: &Demand, gap: f64, start: &PathFlows) -> Solution {
    assign_from(network, demand, &options(gap), start, &mut uninterrupted).unwrap()
}

/// Every capacity less up to `largest_cut`, by a fixed sequence.
fn cut_capacities(network: &Network, largest_cut: f64) -> Network {
    let mut state = 99_u64;
    let mut cut = |capacity: f64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        capacity * (1.0 - largest_cut * ((state >> 33) as f64 / f64::from(1_u32 << 31)))
    };
    let capacities: Vec<f64> = network.links().iter().map(|link| cut(link.capacity)).collect();
    network.with_capacities(&capacities).unwrap()
}

#[test]
fn path_flows_make_up_the_link_flows_and_carry_the_demand() {
    let (network, demand) = read("SiouxFalls");
    let solution = assign(&network, &demand, &options(1e-10)).unwrap();
    assert!(carry_demand(&solution.path_flows, &demand, 1e-12));
    let summed = link_flows(&network, &solution.path_flows);
    for (summed, flow) in summed.iter().zip(&solution.link_flows) {
        assert!((summed - flow).abs() <= 1e-9 * flow.max(1.0));
    }
    // In use means cheapest: the gap is what the paths exceed the skims by.
    let skims = skims(&network, &solution.link_costs).unwrap();
    assert_eq!(skims.len(), 24 * 23);
    let mut excess = 0.0;
    for path in &solution.path_flows {
        path.check(&network, "path").unwrap();
        let skim = skims
            .iter()
            .find(|skim| (skim.origin, skim.destination) == (path.origin, path.destination));
        excess += path.volume * (path.cost(&solution.link_costs) - skim.unwrap().cost);
    }
    assert!(excess.abs() / solution.total_travel_time <= 1.1e-10);
    // The Frank-Wolfe family knows none.
    let bfw = Options {
        algorithm: Algorithm::BiconjugateFrankWolfe,
        ..options(1e-3)
    };
    assert!(assign(&network, &demand, &bfw).unwrap().path_flows.is_empty());
}

#[test]
fn skims_split_cost_into_its_parts() {
    let (network, demand) = read("SiouxFalls");
    let solution = assign(&network, &demand, &options(1e-6)).unwrap();
    let rows = skims(&network, &solution.link_costs).unwrap();
    for skim in &rows {
        let parts = skim.time + 0.02 * skim.toll + 0.04 * skim.length;
        assert!((parts - skim.cost).abs() <= 1e-12 * skim.cost);
    }
    let text = format_skims(&network, &rows);
    assert!(text.starts_with("origin,destination,cost,time,length,toll\n1,2,"));
    assert_eq!(text.lines().count(), 1 + 24 * 23);
    let failure = skims(&network, &[1.0]).unwrap_err().to_string();
    assert_eq!(failure, "link costs: found 1, expected 76, one per link");
}

#[test]
fn select_link_finds_whose_trips_use_a_road() {
    let (network, demand) = read("Braess");
    let solution = assign(&network, &demand, &options(1e-12)).unwrap();
    // Two each of the six vehicles take the three routes; the first road serves two of these.
    let links = links_between(&network, "links", "1", "3").unwrap();
    let selected = select_links(&solution.path_flows, &links);
    assert_eq!(selected.len(), 1);
    assert_eq!((selected[0].origin, selected[0].destination), (1, 2));
    assert!((selected[0].volume - 4.0).abs() < 1e-6 && (selected[0].share - 4.0 / 6.0).abs() < 1e-6);
    let failure = links_between(&network, "--select-link", "2", "1").unwrap_err();
    assert_eq!(
        failure.to_string(),
        "--select-link: found 2,1, expected two nodes that a link joins"
    );
    // On a larger network the pairs' volumes make up the link's flow.
    let (network, demand) = read("SiouxFalls");
    let solution = assign(&network, &demand, &options(1e-10)).unwrap();
    for link in [0, 30, 75_u32] {
        let selected = select_links(&solution.path_flows, &[link]);
        let sum: f64 = selected.iter().map(|pair| pair.volume).sum();
        assert!((sum / solution.link_flows[link as usize] - 1.0).abs() < 1e-12);
        assert!(
            selected
                .iter()
                .all(|pair| pair.share > 0.0 && pair.share < 1.0 + 1e-12)
        );
    }
}

#[test]
fn path_files_are_read_as_they_were_written() {
    let (network, demand) = read("SiouxFalls");
    let solution = assign(&network, &demand, &options(1e-8)).unwrap();
    let text = format_paths(&network, &solution.path_flows, &solution.link_costs);
    assert_eq!(
        read_paths(&Text::new("paths", &text), &network).unwrap(),
        solution.path_flows
    );
    let header = "origin,destination,volume,cost,links";
    for (row, message) in [
        (
            "1,2,5,1",
            "paths:2: found 4 columns, expected 5: origin,destination,volume,cost,links",
        ),
        (
            "1,99,5,1,1",
            "paths:2: destination: found `99`, expected a zone of the network",
        ),
        ("1,2,x,1,1", "paths:2: volume: found `x`, expected a number"),
        (
            "1,2,NaN,1,1",
            "paths:2: volume: found NaN, expected a finite number, not negative",
        ),
        (
            "1,2,5,1,0",
            "paths:2: links: found `0`, expected numbers of links, from 1",
        ),
        (
            "1,2,5,1,77",
            "paths:2: links: found 77, expected a link from 1 to 76",
        ),
        (
            "1,2,5,1,2 1",
            "paths:2: links: found link 1, which leaves node 1, expected a link that goes on from node 3, if it may be passed",
        ),
        (
            "1,2,5,1,2",
            "paths:2: links: found an end at node 3, expected the destination 2",
        ),
        (
            "1,2,5,1,",
            "paths:2: links: found an end at node 1, expected the destination 2",
        ),
    ] {
        let failure = read_paths(&Text::new("paths", &format!("{header}\n{row}\n")), &network).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
    let failure = read_paths(&Text::new("paths", "x\n"), &network).unwrap_err();
    assert_eq!(
        failure.to_string(),
        format!("paths:1: found `x`, expected `{header}`")
    );
}

#[test]
fn a_warm_start_gets_to_the_same_flows_in_fewer_iterations() {
    let (network, demand) = read("SiouxFalls");
    let before = assign(&network, &demand, &options(1e-6)).unwrap();
    let changed = cut_capacities(&network, 0.1);
    for gap in [1e-6, 1e-11] {
        let cold = assign(&changed, &demand, &options(gap)).unwrap();
        let again = warm(&changed, &demand, gap, &before.path_flows);
        assert!(again.converged);
        assert!(again.iterations < cold.iterations);
        assert!((again.objective / cold.objective - 1.0).abs() <= 2.0 * gap + 1e-14);
        let judged = evaluate(&changed, &demand, Objective::UserEquilibrium, &again.link_flows).unwrap();
        assert!(judged.conserves_demand && judged.relative_gap <= 1.01 * gap);
    }
    // From its own answer, there is nothing left to do.
    assert_eq!(warm(&network, &demand, 1e-6, &before.path_flows).iterations, 0);
}

#[test]
fn a_warm_start_follows_the_demand() {
    let (network, demand) = read("SiouxFalls");
    let before = assign(&network, &demand, &options(1e-8)).unwrap();
    // A third of the pairs gone, the others up by a half, and one that is new.
    let trips: Vec<Trip> = demand.trips().collect();
    let kept = trips.iter().enumerate().filter(|(index, _)| index % 3 > 0);
    let mut changed: Vec<Trip> = kept
        .map(|(_, trip)| Trip {
            volume: 1.5 * trip.volume,
            ..*trip
        })
        .collect();
    changed.push(trips[0]);
    let changed = Demand::new(24, &changed).unwrap();
    let cold = assign(&network, &changed, &options(1e-11)).unwrap();
    let again = warm(&network, &changed, 1e-11, &before.path_flows);
    assert!(again.converged && carry_demand(&again.path_flows, &changed, 1e-12));
    assert!((again.objective / cold.objective - 1.0).abs() < 1e-12);
    // Paths of another network are refused.
    let (braess, one_pair) = read("Braess");
    let failure = assign_from(
        &braess,
        &one_pair,
        &options(1e-6),
        &before.path_flows,
        &mut uninterrupted,
    );
    let message = failure.unwrap_err().to_string();
    assert!(message.starts_with("start: path 1: "), "{message}");
    let bfw = Options {
        algorithm: Algorithm::BiconjugateFrankWolfe,
        ..options(1e-3)
    };
    let failure = assign_from(&network, &demand, &bfw, &before.path_flows, &mut uninterrupted).unwrap_err();
    assert!(
        failure
            .to_string()
            .starts_with("algorithm for a warm start: found Frank-Wolfe")
    );
}

#[test]
fn a_warm_start_has_the_same_bytes_at_any_number_of_threads() {
    let (network, demand) = read("SiouxFalls");
    let before = assign(&network, &demand, &options(1e-4)).unwrap();
    let changed = cut_capacities(&network, 0.3);
    let solve = |threads| {
        let options = Options {
            threads,
            ..options(1e-9)
        };
        let solution = assign_from(
            &changed,
            &demand,
            &options,
            &before.path_flows,
            &mut uninterrupted,
        )
        .unwrap();
        let bits: Vec<u64> = solution.link_flows.iter().map(|flow| flow.to_bits()).collect();
        (bits, solution.path_flows)
    };
    let one = solve(1);
    assert!(one == solve(2) && one == solve(3));
}

#[test]
fn a_solve_says_why_it_ended() {
    let (network, demand) = read("SiouxFalls");
    assert_eq!(
        assign(&network, &demand, &options(1e-4)).unwrap().stopped,
        Stop::Gap
    );
    let short = Options {
        max_iterations: 2,
        ..options(1e-9)
    };
    assert_eq!(
        assign(&network, &demand, &short).unwrap().stopped,
        Stop::Iterations
    );
    let (braess, one_pair) = read("Braess");
    for (network, demand) in [(&network, &demand), (&braess, &one_pair)] {
        let best = assign(network, demand, &options(0.0)).unwrap();
        assert!(best.iterations < 1_000);
        assert!(best.stopped == Stop::Stagnation || best.relative_gap == 0.0);
        assert!(best.relative_gap <= 1e-13);
    }
}

#[test]
fn the_convergence_file_has_a_row_per_record() {
    let (network, demand) = read("SiouxFalls");
    let solution = assign(&network, &demand, &options(1e-6)).unwrap();
    let text = convergence::format_convergence(&solution.convergence);
    assert!(text.starts_with("iteration,relative_gap,objective,seconds\n0,"));
    assert_eq!(text.lines().count(), solution.iterations + 2);
}

#[test]
fn the_frank_wolfe_family_stops_where_it_gets_nowhere() {
    let (network, demand) = read("SiouxFalls");
    for algorithm in [
        Algorithm::FrankWolfe,
        Algorithm::ConjugateFrankWolfe,
        Algorithm::BiconjugateFrankWolfe,
    ] {
        let options = Options {
            algorithm,
            ..options(0.0)
        };
        let solution = assign(&network, &demand, &options).unwrap();
        assert_eq!(solution.stopped, Stop::Stagnation, "{algorithm:?}");
        assert!(
            solution.relative_gap < 1e-4,
            "{algorithm:?}: {}",
            solution.relative_gap
        );
    }
}

#[test]
fn an_assigner_plans_again_from_where_it_ended() {
    let (network, demand) = read("SiouxFalls");
    let cut = cut_capacities(&network, 0.1);
    let mut assigner = Assigner::new(demand.clone(), options(1e-11)).unwrap();
    let cold = assigner.assign(&network).unwrap();
    assert_eq!(
        cold.link_flows,
        assign(&network, &demand, &options(1e-11)).unwrap().link_flows
    );
    assert!(carry_demand(&assigner.path_flows(), &demand, 1e-12));
    let warm = assigner.assign(&cut).unwrap();
    let fresh = assign(&cut, &demand, &options(1e-11)).unwrap();
    assert!(warm.converged && warm.iterations < fresh.iterations);
    assert!((warm.objective - fresh.objective).abs() <= 1e-10 * fresh.objective);
    let judged = evaluate(&cut, &demand, Objective::UserEquilibrium, &warm.link_flows).unwrap();
    assert!((judged.relative_gap - warm.relative_gap).abs() < 1e-12 && judged.conserves_demand);
    // Back on the old roads, and then on others.
    let back = assigner.assign(&network).unwrap();
    assert!((back.objective - cold.objective).abs() <= 1e-10 * cold.objective);
    let (braess, _) = read("Braess");
    assert!(assigner.assign(&braess).is_err());
}
