//! Several classes on the same roads, and roads with vehicles that no demand accounts for.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use assignment::{
    Algorithm, ClassSolution, CostWeights, Demand, Link, Network, NodeNumbering, Options, PathFlows, Text,
    Trip, VehicleClass, assign, assign_classes, check, tntp, uninterrupted,
};
use std::path::Path;

fn fixture(name: &str) -> Text {
    Text::read(
        &Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/fixtures")
            .join(name),
    )
    .unwrap()
}

fn sioux_falls() -> (Network, Demand) {
    let network = tntp::read_network(&fixture("SiouxFalls_net.tntp"), CostWeights::default()).unwrap();
    let demand = tntp::read_trips(&fixture("SiouxFalls_trips.tntp"), network.numbering().zones).unwrap();
    (network, demand)
}

fn options(gap: f64) -> Options {
    Options {
        gap,
        ..Options::default()
    }
}

fn solve(network: &Network, classes: &[VehicleClass], gap: f64) -> ClassSolution {
    assign_classes(network, classes, &options(gap), &[], &mut uninterrupted).unwrap()
}

/// Cars, vans and lorries in Sioux Falls, each with tolls of its own; lorries may not use three streets.
fn three_classes(network: &Network, demand: &Demand) -> Vec<VehicleClass> {
    let tolls = |every: usize, toll: f64| {
        let links = 0..network.links().len();
        Some(
            links
                .map(|link| if link % every == 0 { toll } else { 0.0 })
                .collect(),
        )
    };
    let class = |name: &str, share, passenger_car_equivalent, toll, tolls, banned_links| VehicleClass {
        name: name.to_owned(),
        demand: demand.scaled(share).unwrap(),
        passenger_car_equivalent,
        weights: CostWeights { toll, distance: 0.1 },
        tolls,
        banned_links,
    };
    vec![
        class("car", 0.7, 1.0, 2.0, tolls(5, 1.5), vec![]),
        class("van", 0.15, 1.5, 0.7, tolls(3, 4.0), vec![]),
        class("lorry", 0.05, 3.0, 0.3, tolls(4, 10.0), vec![0, 4, 40]),
    ]
}

/// Cost of the cheapest way from `origin` to every node, by Bellman and Ford.
fn cheapest(network: &Network, costs: &[f64], origin: u32) -> Vec<f64> {
    let mut labels = vec![f64::INFINITY; network.numbering().nodes as usize];
    labels[origin as usize - 1] = 0.0;
    for _ in 1..labels.len() {
        for (link, cost) in network.links().iter().zip(costs) {
            let through = labels[link.init_node as usize - 1] + cost;
            let label = &mut labels[link.term_node as usize - 1];
            *label = label.min(through);
        }
    }
    labels
}

#[test]
fn no_vehicle_of_any_class_gains_by_changing_route() {
    let (network, demand) = sioux_falls();
    let classes = three_classes(&network, &demand);
    let solution = solve(&network, &classes, 1e-13);
    assert!(
        solution.total.relative_gap < 1e-12,
        "{}",
        solution.total.relative_gap
    );
    // All flows together, in passenger cars, and what they make of travel times by the printed formula.
    let mut cars = vec![0.0; network.links().len()];
    for (class, flows) in classes.iter().zip(&solution.classes) {
        let mut own = vec![0.0; cars.len()];
        for path in &flows.path_flows {
            path.check(&network, "path").unwrap();
            assert!(path.links.iter().all(|link| !class.banned_links.contains(link)));
            for &link in &path.links {
                own[link as usize] += path.volume;
            }
        }
        for ((total, own), flow) in cars.iter_mut().zip(own).zip(&flows.link_flows) {
            assert!((own - flow).abs() <= 1e-9 * flow.max(1.0));
            *total += class.passenger_car_equivalent * own;
        }
    }
    let times = network.links().iter().zip(&cars).map(|(link, flow)| {
        link.free_flow_time * (1.0 + link.b * libm::pow(flow / link.capacity, link.power))
    });
    let times: Vec<f64> = times.collect();
    for (class, flows) in classes.iter().zip(&solution.classes) {
        let tolls = class.tolls.as_ref().unwrap();
        let links = network.links().iter().enumerate();
        let costs: Vec<f64> = links
            .map(|(index, link)| {
                if class.banned_links.contains(&(index as u32)) {
                    return f64::INFINITY;
                }
                times[index] + class.weights.toll * tolls[index] + class.weights.distance * link.length
            })
            .collect();
        let labels: Vec<_> = (1..=24)
            .map(|origin| cheapest(&network, &costs, origin))
            .collect();
        let (mut spent, mut least, mut carried) = (0.0, 0.0, 0.0);
        for path in &flows.path_flows {
            let cost = path.cost(&costs);
            let cheapest = labels[path.origin as usize - 1][path.destination as usize - 1];
            assert!(
                cost - cheapest <= 1e-10 * cheapest,
                "{}: {cost} {cheapest}",
                class.name
            );
            spent += path.volume * cost;
            least += path.volume * cheapest;
            carried += path.volume;
        }
        assert!(
            (spent - least) / spent <= 1e-10,
            "{}: {}",
            class.name,
            (spent - least) / spent
        );
        assert!((carried - class.demand.total()).abs() <= 1e-9 * carried);
    }
}

#[test]
fn one_class_is_an_assignment_and_its_paths_are_a_start() {
    let weights = CostWeights {
        toll: 0.02,
        distance: 0.04,
    };
    let (_, demand) = sioux_falls();
    let network = tntp::read_network(&fixture("SiouxFalls_net.tntp"), weights).unwrap();
    let alone = assign(&network, &demand, &options(1e-12)).unwrap();
    let class = VehicleClass {
        name: "all".to_owned(),
        demand: demand.scaled(0.5).unwrap(),
        passenger_car_equivalent: 2.0,
        weights,
        tolls: None,
        banned_links: vec![],
    };
    let classes = [class];
    let solution = solve(&network, &classes, 1e-12);
    let relative = solution.total.objective / alone.objective - 1.0;
    assert!(relative.abs() < 1e-12, "{relative}");
    let start: [&PathFlows; 1] = [&solution.classes[0].path_flows];
    let again = assign_classes(&network, &classes, &options(1e-10), &start, &mut uninterrupted).unwrap();
    assert_eq!(again.total.iterations, 0);
}

#[test]
fn classes_have_the_same_bytes_at_any_number_of_threads() {
    let (network, demand) = sioux_falls();
    let classes = three_classes(&network, &demand);
    let with = |threads| {
        let options = Options {
            threads,
            ..options(1e-8)
        };
        let solution = assign_classes(&network, &classes, &options, &[], &mut uninterrupted).unwrap();
        solution.classes
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn bad_classes_are_named() {
    let (network, demand) = sioux_falls();
    let refused = |spoil: &dyn Fn(&mut VehicleClass), algorithm, expected: &str| {
        let mut classes = three_classes(&network, &demand);
        spoil(&mut classes[1]);
        let options = Options {
            algorithm,
            ..options(1e-4)
        };
        let failure = assign_classes(&network, &classes, &options, &[], &mut uninterrupted).unwrap_err();
        assert!(failure.to_string().contains(expected), "{failure}");
    };
    let none = Demand::new(24, &[]).unwrap();
    let path = Algorithm::PathBased;
    refused(
        &|class| class.demand = none.clone(),
        path,
        "class van: demand: found no trips",
    );
    refused(
        &|class| class.passenger_car_equivalent = 0.0,
        path,
        "class van: passenger_car_equivalent",
    );
    refused(
        &|class| class.tolls = Some(vec![1.0]),
        path,
        "class van: tolls: found 1, expected 76",
    );
    refused(
        &|class| class.banned_links = vec![76],
        path,
        "class van: banned links",
    );
    // Zone 1 has two streets.
    refused(
        &|class| class.banned_links = vec![0, 1],
        path,
        "class van: trips from 1 to 2",
    );
    refused(&|_| {}, Algorithm::FrankWolfe, "path-based");
}

/// Two roads from 1 to 2, alike.
fn two_roads(preload: f64) -> Network {
    let link = |free_flow_time| Link {
        init_node: 1,
        term_node: 2,
        capacity: 10.0,
        length: 1.0,
        free_flow_time,
        b: 1.0,
        power: 1.0,
        toll: 0.0,
    };
    let numbering = NodeNumbering {
        zones: 2,
        nodes: 2,
        first_thru_node: 1,
    };
    let network = Network::new(numbering, vec![link(10.0), link(10.0)], CostWeights::default()).unwrap();
    network.with_preloads(vec![preload, 0.0]).unwrap()
}

#[test]
fn preloads_push_others_away() {
    let trip = Trip {
        origin: 1,
        destination: 2,
        volume: 8.0,
    };
    let demand = Demand::new(2, &[trip]).unwrap();
    // Four buses on the first road: six of the eight cars take the second.
    for algorithm in [Algorithm::PathBased, Algorithm::BiconjugateFrankWolfe] {
        let options = Options {
            algorithm,
            ..options(1e-12)
        };
        let network = two_roads(4.0);
        let solution = assign(&network, &demand, &options).unwrap();
        for (flow, expected) in solution.link_flows.iter().zip([2.0, 6.0]) {
            assert!(
                (flow - expected).abs() < 1e-9,
                "{algorithm:?} {:?}",
                solution.link_flows
            );
        }
        assert!(solution.link_costs.iter().all(|cost| (cost - 16.0).abs() < 1e-9));
        // Of what the second car on the first road meets, the buses' own part is left out.
        assert!((solution.objective - (20.0 + 18.0 - 8.0 + 60.0 + 18.0)).abs() < 1e-8);
        let judged = check::evaluate(&network, &demand, options.objective, &solution.link_flows).unwrap();
        assert!(judged.relative_gap < 1e-9 && (judged.objective / solution.objective - 1.0).abs() < 1e-12);
    }
    // Ten leave the road to them.
    let solution = assign(&two_roads(10.0), &demand, &options(1e-12)).unwrap();
    assert_eq!(solution.link_flows, [0.0, 8.0]);
    let failure = two_roads(0.0).with_preloads(vec![-1.0, 0.0]).unwrap_err();
    assert!(failure.to_string().starts_with("link 1: preload"), "{failure}");
}
