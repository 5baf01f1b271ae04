//! The closed loop on a loaded network: where its nodes lie, how vehicles drive on it, what staleness costs there.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use assignment::coordinates::{LengthUnit, NodePlaces};
use assignment::tntp::{read_network, read_places, read_trips};
use assignment::{CostWeights, Demand, Link, Network, NodeNumbering, Text};
use firmware::table::Table;
use host_sim::closed_loop::{LoopSummary, closed_loop};
use host_sim::mobility::{MobilitySource as _, Road, StreetMap};
use host_sim::policy::{Kind, actor, always};
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::{Extent, Simulation};
use host_sim::stream::{Purpose, WorldKey};
use host_sim::thread_pool;
use host_sim::traffic::planning_options;
use std::path::Path;
use std::process::Command;

fn scenario() -> Scenario {
    ScenarioSource::default().read().unwrap()
}

fn sioux_falls() -> (Network, Demand) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assignment/tests/fixtures");
    let network = read_network(
        &Text::read(&folder.join("SiouxFalls_net.tntp")).unwrap(),
        CostWeights::default(),
    )
    .unwrap();
    let zones = network.numbering().zones;
    let demand = read_trips(&Text::read(&folder.join("SiouxFalls_trips.tntp")).unwrap(), zones).unwrap();
    (network, demand)
}

/// Nodes in rows of five, 7 apart.
fn in_rows(network: &Network, unit: LengthUnit) -> NodePlaces {
    let nodes = 0..network.numbering().nodes;
    NodePlaces {
        places: nodes
            .map(|node| (7.0 * f64::from(node % 5), 7.0 * f64::from(node / 5)))
            .collect(),
        unit,
    }
}

fn sioux_falls_map() -> StreetMap {
    let (network, demand) = sioux_falls();
    let places = in_rows(&network, LengthUnit::Unknown);
    StreetMap::new(
        network,
        demand,
        &places,
        &scenario(),
        (None, 36.0),
        &planning_options(),
    )
    .unwrap()
}

#[test]
fn tntp_nodes_are_read_and_bad_ones_named_by_line() {
    let links = [(1, 2), (2, 1)].map(|(init_node, term_node)| Link {
        init_node,
        term_node,
        capacity: 1.0,
        length: 1.0,
        free_flow_time: 1.0,
        b: 0.15,
        power: 4.0,
        toll: 0.0,
    });
    let numbering = NodeNumbering {
        zones: 2,
        nodes: 2,
        first_thru_node: 1,
    };
    let network = Network::new(numbering, links.to_vec(), CostWeights::default()).unwrap();
    let read = |text: &str| read_places(&Text::new("nodes", text), &network);
    let places = read("Node\tX\tY\t;\n2\t-3.5\t4\t;\n~ a comment\n\n1 0 1e3;\n").unwrap();
    assert_eq!(places.places, [(0.0, 1000.0), (-3.5, 4.0)]);
    for (text, message) in [
        (
            "node X Y ;\n1 0 ;\n",
            "nodes:2: found 2 columns, expected 3: node X Y",
        ),
        (
            "node X Y ;\n3 0 0 ;\n",
            "nodes:2: node: found `3`, expected a node of the network",
        ),
        (
            "node X Y ;\n1 0 0 ;\n1 0 0 ;\n",
            "nodes:3: node: found `1` again, expected each node once",
        ),
        (
            "node X Y ;\n1 0 inf ;\n",
            "nodes:2: Y: found `inf`, expected a finite number",
        ),
        (
            "node X Y ;\n1 0 0 ;\n",
            "nodes: found no coordinates of node 2, expected coordinates of every node",
        ),
    ] {
        assert_eq!(read(text).unwrap_err().to_string(), message);
    }
}

#[test]
fn vehicles_drive_from_link_to_link_at_their_speed() {
    let scenario = scenario();
    let map = sioux_falls_map();
    // 28 x 28 units in 750 m x 1299 m.
    let metres = 750.0 / 28.0;
    assert!((map.scale().metres_per_unit - metres).abs() < 1e-12);
    let key = WorldKey {
        seed: 1,
        purpose: Purpose::Evaluation,
        world: 0,
    };
    let place_of = |node: u32| {
        let (column, row) = (f64::from((node - 1) % 5), f64::from((node - 1) / 5));
        (7.0 * metres * column, 649.5 + metres * (7.0 * row - 14.0))
    };
    let mut mobility = map.open(&scenario, &key);
    let mut places = Vec::new();
    let mut previous: Vec<Option<(u32, f64, f64)>> = vec![None; map.vehicles(&scenario)];
    let (mut kept, mut changed) = (0, 0);
    for update in 0..3000 {
        mobility.advance(update * 100, &mut places).unwrap();
        for &(vehicle, place) in &places {
            let Some(Road::Link(link)) = mobility.road(vehicle) else {
                panic!("a vehicle on a street");
            };
            let ends = &map.network().links()[link as usize];
            let (from, to) = (place_of(ends.init_node), place_of(ends.term_node));
            let part = |x: (f64, f64)| f64::hypot(place.x_m - x.0, place.y_m - x.1);
            let length = f64::hypot(to.0 - from.0, to.1 - from.1);
            assert!((part(from) + part(to) - length).abs() < 1e-6, "off its street");
            if let Some((last_link, x_m, y_m)) = previous[vehicle] {
                assert!((1.0..=1.4 + 1e-9).contains(&place.moved_m));
                let straight = f64::hypot(place.x_m - x_m, place.y_m - y_m);
                if last_link == link {
                    assert!((straight - place.moved_m).abs() < 1e-6);
                    kept += 1;
                } else {
                    // The next link of the trip, or of the next trip, which starts where this one ended.
                    let last = &map.network().links()[last_link as usize];
                    assert_eq!(last.term_node, ends.init_node);
                    changed += 1;
                }
            }
            previous[vehicle] = Some((link, place.x_m, place.y_m));
        }
    }
    assert!(kept > 50_000 && changed > 100, "{kept} {changed}");
}

#[test]
fn a_true_scale_is_kept_and_nodes_on_one_spot_are_refused() {
    let (network, demand) = sioux_falls();
    let map = |places: &NodePlaces, scale| {
        let (network, demand) = (network.clone(), demand.clone());
        StreetMap::new(network, demand, places, &scenario(), scale, &planning_options())
    };
    let in_metres = in_rows(&network, LengthUnit::Metre);
    assert_eq!(map(&in_metres, (None, 1.0)).unwrap().scale().metres_per_unit, 1.0);
    assert_eq!(
        map(&in_metres, (Some(20.0), 1.0))
            .unwrap()
            .scale()
            .metres_per_unit,
        20.0
    );
    let mut one_spot = in_rows(&network, LengthUnit::Unknown);
    one_spot.places.fill((3.0, 4.0));
    assert_eq!(
        map(&one_spot, (None, 1.0)).unwrap_err().to_string(),
        "metres per unit of coordinates: found inf, expected a positive number, and nodes that do not all lie on one spot"
    );
    assert_eq!(
        map(&one_spot, (Some(1.0), 1.0)).unwrap_err().to_string(),
        "trips: found none of any length, expected trips between nodes that lie apart"
    );
}

fn run(source: &StreetMap, policies: &[&'static Kind], threads: u16) -> LoopSummary {
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    let scenario = scenario();
    let simulation = Simulation {
        scenario: &scenario,
        source,
        extent: Extent {
            seed: 5,
            worlds: 4,
            slots: 200,
            warmup: 200,
        },
    };
    let pool = thread_pool(Some(threads)).unwrap();
    pool.install(|| closed_loop(&simulation, policies, &table, || ()).unwrap())
}

#[test]
fn staler_knowledge_of_a_loaded_network_costs_more() {
    let source = sioux_falls_map();
    let policies = [&actor::KIND, &always::KIND];
    let summary = run(&source, &policies, 2);
    let [actor, always, full] = &summary.results[..] else {
        panic!("{} results", summary.results.len())
    };
    assert_eq!((full.policy, full.mean.regret_s_per_trip), (None, 0.0));
    assert!(actor.mean.capacity_error_veh_per_h < always.mean.capacity_error_veh_per_h);
    assert!(actor.mean.road_age_ms < always.mean.road_age_ms);
    assert!(actor.mean.regret_s_per_trip > 0.0);
    // Sioux Falls at full capacity takes 7,480,225 / 360,600 units of 36 s a trip; incidents make it longer.
    assert!(full.mean.trip_time_s > 36.0 * 20.7, "{}", full.mean.trip_time_s);
    assert_eq!(
        format!("{summary:?}"),
        format!("{:?}", run(&source, &policies, 1))
    );
}

#[test]
fn the_command_reads_a_sumo_network_and_its_junctions() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let edge = |from: &str, to: &str| {
        format!(
            "<edge id=\"{from}{to}\" from=\"{from}\" to=\"{to}\"><lane id=\"{from}{to}_0\" speed=\"14\" length=\"300\"/></edge>"
        )
    };
    let edges: String = ["AB", "BA", "BC", "CB", "AC", "CA"]
        .map(|ends| edge(&ends[..1], &ends[1..]))
        .concat();
    let junction = |id: &str, x: f64, y: f64| format!("<junction id=\"{id}\" x=\"{x}\" y=\"{y}\"/>");
    let junctions = [
        junction("A", 0.0, 0.0),
        junction("B", 300.0, 0.0),
        junction("C", 0.0, 300.0),
    ]
    .concat();
    let trips =
        "<routes><trip id=\"0\" from=\"AB\" to=\"BC\"/><trip id=\"1\" from=\"CA\" to=\"AB\"/></routes>";
    let trips = file("trips.xml", trips);
    let net = file("net.xml", &format!("<net>{edges}{junctions}</net>"));
    let run = |net: &Path| {
        Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args([
                "loop", "--json", "--worlds", "2", "--slots", "100", "--policy", "clock",
            ])
            .args([
                "--net".as_ref(),
                net.as_os_str(),
                "--trips".as_ref(),
                trips.as_os_str(),
            ])
            .output()
            .unwrap()
    };
    let output = run(&net);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["scale"]["metres_per_unit"], 1.0);
    assert_eq!(object["scale"]["seconds_per_unit"], 1.0);
    // Both trips take two streets of 300 m at 14 m/s, or the third street alone.
    let time = object["policies"][0]["mean_travel_time_s"].as_f64().unwrap();
    assert!((21.4..43.0).contains(&time), "{time}");
    let without = file("without.xml", &format!("<net>{edges}</net>"));
    let output = run(&without);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("found no coordinates of node A"), "{message}");
    let output = run(&folder.path().join("nothing.xml"));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("nothing.xml: No such file"), "{message}");
}
