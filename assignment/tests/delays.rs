//! Conical and time-dependent delays on a real network, and what a table says of roads.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use assignment::link_table::{Delay, LinkTable};
use assignment::report::ImportReport;
use assignment::{
    CostWeights, DelayFunction, Demand, Network, Objective, Options, Text, assign, check, tntp,
};
use std::path::Path;

fn fixture(name: &str) -> Text {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    Text::read(&fixtures.join(name)).unwrap()
}

fn sioux_falls() -> (Network, Demand) {
    let weights = CostWeights {
        toll: 0.0,
        distance: 0.1,
    };
    let network = tntp::read_network(&fixture("SiouxFalls_net.tntp"), weights).unwrap();
    let demand = tntp::read_trips(&fixture("SiouxFalls_trips.tntp"), network.numbering().zones).unwrap();
    (network, demand)
}

fn table(text: &str, network: &Network) -> assignment::Result<LinkTable> {
    LinkTable::read(
        &Text::new("links.csv", text),
        network,
        &[],
        &["car", "lorry"],
        &mut ImportReport::default(),
    )
}

/// Solves, and holds the solver's gap and objective against those that the judge finds by the printed formulas.
fn is_an_equilibrium(network: &Network, demand: &Demand, objective: Objective) {
    let options = Options {
        gap: 1e-11,
        objective,
        ..Options::default()
    };
    let solution = assign(network, demand, &options).unwrap();
    assert!(solution.converged, "{}", solution.relative_gap);
    let judged = check::evaluate(network, demand, objective, &solution.link_flows).unwrap();
    assert!(
        judged.conserves_demand && judged.relative_gap < 1e-10,
        "{judged:?}"
    );
    let objective = solution.objective / judged.objective - 1.0;
    assert!(objective.abs() < 1e-11, "{objective}");
    let total = solution.total_travel_time / judged.total_travel_time - 1.0;
    assert!(total.abs() < 1e-12, "{total}");
}

#[test]
fn every_delay_function_has_equilibria_that_the_judge_confirms() {
    let (network, demand) = sioux_falls();
    let nothing = LinkTable::default();
    for delay in ["conical", "conical=2.5", "akcelik=0.1", "akcelik=1.6"] {
        let roads = nothing
            .apply(network.clone(), delay.parse().unwrap(), 60.0)
            .unwrap();
        is_an_equilibrium(&roads, &demand, Objective::UserEquilibrium);
        is_an_equilibrium(&roads, &demand, Objective::SystemOptimum);
    }
    let alpha = nothing.apply(network, Delay::Conical(None), 60.0).unwrap();
    assert_eq!(alpha.delay_function(0), DelayFunction::Conical { alpha: 4.0 });
}

#[test]
fn a_table_has_the_last_word() {
    let (network, demand) = sioux_falls();
    let text = "from_node_id,to_node_id,preload,delay,toll_lorry,banned_lorry\n\
                1,2,500,,,\n10,16,,conical=6,2.5,\n3,1,,akcelik=0.4,,1\n";
    let read = table(text, &network).unwrap();
    let roads = read.apply(network.clone(), Delay::Bpr, 60.0).unwrap();
    let index = |from, to| {
        let links = roads.links().iter();
        let found = links
            .enumerate()
            .find(|(_, link)| (link.init_node, link.term_node) == (from, to));
        found.unwrap().0
    };
    assert_eq!(roads.preload(index(1, 2)), 500.0);
    let conical = DelayFunction::Conical { alpha: 6.0 };
    assert_eq!(roads.delay_function(index(10, 16)), conical);
    assert_eq!(roads.delay_function(index(1, 2)), DelayFunction::Bpr);
    // Preloads fill a road as others do, and one without capacity never fills.
    let mut links = roads.links().to_vec();
    links[5].capacity = 0.0;
    links[5].b = 0.0;
    let fuller = Network::new(roads.numbering(), links, roads.weights()).unwrap();
    let fuller = read.apply(fuller, Delay::Bpr, 60.0).unwrap();
    let ratios = fuller.volume_over_capacity(&[100.0; 76]);
    let first = index(1, 2);
    assert_eq!(ratios[first], 600.0 / roads.links()[first].capacity);
    assert_eq!(ratios[5], 0.0);
    let [car, lorry] = read.rules() else {
        panic!("{:?}", read.rules());
    };
    assert!(car.tolls.is_none() && car.banned_links.is_empty());
    assert_eq!(lorry.tolls.as_ref().unwrap()[index(10, 16)], 2.5);
    assert_eq!(lorry.banned_links, [index(3, 1) as u32]);
    is_an_equilibrium(&roads, &demand.scaled(0.3).unwrap(), Objective::UserEquilibrium);
    // Other capacities leave the functions alone.
    let capacities: Vec<f64> = roads.links().iter().map(|link| 2.0 * link.capacity).collect();
    let wider = roads.with_capacities(&capacities).unwrap();
    assert_eq!(wider.delay_function(index(10, 16)), conical);
}

#[test]
fn a_table_that_says_nonsense_is_refused_by_line_and_column() {
    let (network, _) = sioux_falls();
    for (text, message) in [
        ("from,to,preload\n1,2,-1\n", "links.csv:2: preload: found `-1`"),
        (
            "from,to,preload\n1,9,5\n",
            "links.csv:2: found 1 to 9, no road of the network",
        ),
        (
            "from,to,preload\n1,2,5\n1,2,5\n",
            "links.csv:3: found 1 to 2, again",
        ),
        ("from,to,delay\n1,2,conic\n", "links.csv:2: delay: found `conic`"),
        (
            "from,to,delay\n1,2,akcelik\n",
            "links.csv:2: delay: found `akcelik`",
        ),
        (
            "from,to,banned_lorry\n1,2,yes\n",
            "links.csv:2: banned_lorry: found `yes`, expected 0 or 1",
        ),
        (
            "from,to,toll_van\n1,2,3\n",
            "links.csv:1: found column `toll_van`",
        ),
        ("preload\n5\n", "links.csv:1: found no column `link_id`"),
    ] {
        let failure = table(text, &network).unwrap_err().to_string();
        assert!(failure.starts_with(message), "{failure}");
    }
    // Of two roads between the same nodes, nodes alone name none.
    let mut links = network.links().to_vec();
    links[75] = links[0].clone();
    let parallel = Network::new(network.numbering(), links, CostWeights::default()).unwrap();
    let failure = table("from,to,preload\n1,2,5\n", &parallel)
        .unwrap_err()
        .to_string();
    assert!(
        failure.starts_with("links.csv:2: found 1 to 2, one of several"),
        "{failure}"
    );
    let by_name = table("link_id,preload\n76,5\n", &parallel).unwrap();
    assert_eq!(
        by_name.apply(parallel, Delay::Bpr, 60.0).unwrap().preload(75),
        5.0
    );
    let flat = table("from,to,delay\n1,2,conical=1\n", &network).unwrap();
    let failure = flat.apply(network, Delay::Bpr, 60.0).unwrap_err().to_string();
    assert!(
        failure.starts_with("link 1: alpha of the conical function: found 1"),
        "{failure}"
    );
}

#[test]
fn a_bend_too_sharp_for_its_digits_is_refused() {
    let (network, _) = sioux_falls();
    let link = &network.links()[0];
    let akcelik = |delay_parameter| {
        let function = DelayFunction::Akcelik {
            delay_parameter,
            period: 60.0,
        };
        link.volume_delay(function, CostWeights::default(), "link 1")
    };
    let most = 1e4 / 8.0 * link.capacity;
    let delay = akcelik(most).unwrap();
    assert!((delay.cost(0.0) / link.free_flow_time - 1.0).abs() < 1e-3);
    let message = akcelik(4_294_967_295.0).unwrap_err().to_string();
    let expected = format!(
        "link 1: Akcelik's J: found 4294967295, expected at most {most}, with a capacity of {}",
        link.capacity
    );
    assert_eq!(message, expected);
}
