//! GMNS and SUMO files, good and bad.

// Helpers are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use assignment::sumo::{LaneModel, SumoNetwork};
use assignment::tntp::{read_network, read_trips};
use assignment::{CostWeights, Network, Options, Text, assign, check, gmns, sumo};
use std::io::Write as _;
use std::path::Path;

const NODES: &str = "\
node_id,name,zone_id,node_type,x_coord
a,\"Mill, the\",,,1
c7,,10,centroid,2
b,,20,,3
";

const LINKS: &str = "\
link_id,from_node_id,to_node_id,directed,geometry,length,free_speed,capacity,lanes,toll
1,c7,a,false,\"LINESTRING (0 0, 1 1)\",2,60,900,2,0
2,a,b,1,,3,30,800,,1.5
";

const DEMAND: &str = "o_zone_id,d_zone_id,volume\n10,20,100\n20,20,7\n";

fn gmns_network(nodes: &str, links: &str) -> kit::error::Result<Network> {
    gmns::read_network(
        &Text::new("node.csv", nodes),
        &Text::new("link.csv", links),
        CostWeights::default(),
    )
}

#[test]
fn gmns_is_read_with_its_own_names() {
    let network = gmns_network(NODES, LINKS).unwrap();
    let numbering = network.numbering();
    // The centroid comes first, then the other zone, then the rest.
    assert_eq!(
        (numbering.zones, numbering.nodes, numbering.first_thru_node),
        (2, 3, 2)
    );
    let names: Vec<_> = (1..=3).map(|number| network.node_name(number)).collect();
    assert_eq!(names, ["c7", "b", "a"]);
    let links = network.links();
    assert_eq!(links.len(), 3);
    assert_eq!((links[0].init_node, links[0].term_node), (1, 3));
    assert_eq!((links[1].init_node, links[1].term_node), (3, 1));
    assert_eq!((links[2].init_node, links[2].term_node), (3, 2));
    assert_eq!((links[0].free_flow_time, links[0].capacity), (2.0, 1800.0));
    assert_eq!(
        (links[2].free_flow_time, links[2].capacity, links[2].toll),
        (6.0, 800.0, 1.5)
    );
    assert_eq!((links[2].b, links[2].power), (0.15, 4.0));
    let demand = gmns::read_demand(&Text::new("demand.csv", DEMAND), &network).unwrap();
    assert_eq!((demand.total(), demand.intrazonal()), (100.0, 7.0));
    let solution = assign(&network, &demand, &Options::default()).unwrap();
    assert_eq!(solution.link_flows, [100.0, 0.0, 100.0]);
    let text = check::format_flows(&network, &solution.link_flows, &solution.link_costs);
    assert!(text.contains("\nc7,a,100,") && text.contains("\na,b,100,"));
    assert_eq!(
        check::read_flows(&Text::new("flows", &text), &network).unwrap(),
        solution.link_flows
    );
}

#[test]
fn a_network_survives_the_way_through_gmns() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let weights = CostWeights::default();
    let network = read_network(&Text::read(&folder.join("SiouxFalls_net.tntp")).unwrap(), weights).unwrap();
    let demand = read_trips(&Text::read(&folder.join("SiouxFalls_trips.tntp")).unwrap(), 24).unwrap();
    let files = gmns::format_network(&network, &gmns::Extras::default());
    let again = gmns_network(&files[0].1, &files[1].1).unwrap();
    assert_eq!(again.links(), network.links());
    assert_eq!(again.numbering(), network.numbering());
    let trips = gmns::read_demand(&Text::new("d", &gmns::format_demand(&network, &demand)), &again).unwrap();
    assert!(trips.trips().eq(demand.trips()));
}

#[test]
fn bad_gmns_is_named_by_line_and_column() {
    for (from, to, message) in [
        (
            "a,\"Mill",
            "c7,\"Mill",
            "node.csv:3: node_id: found `c7`, expected each node once",
        ),
        (
            "c7,,10",
            "c7,,",
            "node.csv:3: found `c7`, a centroid without a zone_id, expected a zone_id",
        ),
        (
            "b,,20,,3",
            "b,,20",
            "node.csv:4: found 3 columns, expected as many columns as the first line has",
        ),
        (
            "node_id,",
            "id,",
            "node.csv:1: found no column `node_id`, expected it in the first line",
        ),
        (
            "x_coord",
            "name",
            "node.csv:1: found a second column `name`, expected each column once",
        ),
    ] {
        let failure = gmns_network(&NODES.replacen(from, to, 1), LINKS).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
    for (from, to, message) in [
        (
            "2,a,b",
            "2,a,x",
            "link.csv:3: to_node_id: found `x`, expected a node of node.csv",
        ),
        (
            "3,30",
            "3,fast",
            "link.csv:3: free_speed: found `fast`, expected a finite number, not negative",
        ),
        (
            "3,30",
            "3,0",
            "link.csv:3: free_speed: found `0`, expected a positive number",
        ),
        (
            "800",
            "-800",
            "link.csv:3: capacity: found `-800`, expected a finite number, not negative",
        ),
        (
            "false",
            "no",
            "link.csv:2: directed: found `no`, expected true or false",
        ),
        (
            "800",
            "0",
            "link.csv:3: capacity: found 0, expected a positive number where b, power and free_flow_time are positive",
        ),
        (
            "free_speed",
            "speed",
            "link.csv:1: found no column `free_speed`, expected it in the first line",
        ),
    ] {
        let failure = gmns_network(NODES, &LINKS.replacen(from, to, 1)).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
    let network = gmns_network(NODES, LINKS).unwrap();
    for (from, to, message) in [
        (
            "10,20",
            "10,30",
            "demand.csv:2: d_zone_id: found `30`, expected a zone of the network",
        ),
        (
            "100",
            "nan",
            "demand.csv:2: volume: found `nan`, expected a finite number, not negative",
        ),
    ] {
        let failure =
            gmns::read_demand(&Text::new("demand.csv", &DEMAND.replacen(from, to, 1)), &network).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
}

const NET: &str = r#"<?xml version="1.0"?>
<net version="1.20">
    <edge id=":B_0" function="internal">
        <lane id=":B_0_0" index="0" speed="8" length="9"/>
    </edge>
    <edge id="AB" from="A" to="B">
        <lane id="AB_0" index="0" speed="10" length="100" allow="pedestrian"/>
        <lane id="AB_1" index="1" speed="10" length="100"/>
        <lane id="AB_2" index="2" speed="10" length="100" disallow="tram"/>
    </edge>
    <edge id="BC" from="B" to="C" priority="-1">
        <lane id="BC_0" index="0" speed="20" length="300"/>
    </edge>
    <edge id="rail" from="C" to="A">
        <lane id="rail_0" index="0" speed="20" length="300" allow="rail"/>
    </edge>
</net>
"#;

const ROUTES: &str = r#"<routes>
    <vType id="car"/>
    <route id="long" edges="AB BC"/>
    <vehicle id="1" depart="0" route="long"/>
    <vehicle id="2" depart="1">
        <route edges="BC"/>
    </vehicle>
    <trip id="3" depart="2" from="AB" to="AB"/>
    <trip id="4" depart="3" fromJunction="A" toJunction="C"/>
</routes>
"#;

fn sumo_network(text: &str) -> kit::error::Result<SumoNetwork> {
    sumo::read_network(
        &Text::new("net", text),
        &LaneModel::default(),
        CostWeights::default(),
    )
}

#[test]
fn sumo_is_read_with_its_own_names() {
    let sumo = sumo_network(NET).unwrap();
    let links = sumo.network.links();
    assert_eq!(links.len(), 2);
    assert_eq!(
        (links[0].capacity, links[0].free_flow_time, links[0].length),
        (3600.0, 10.0, 100.0)
    );
    assert_eq!((links[1].capacity, links[1].free_flow_time), (1800.0, 15.0));
    assert_eq!(sumo.network.node_name(3), "C");
    let demand = sumo.read_trips(&Text::new("routes", ROUTES)).unwrap();
    let trips: Vec<_> = demand
        .trips()
        .map(|trip| (trip.origin, trip.destination, trip.volume))
        .collect();
    assert_eq!(trips, [(1, 2, 1.0), (1, 3, 2.0), (2, 3, 1.0)]);
}

#[test]
fn bad_sumo_files_are_named_by_line() {
    for (from, to, message) in [
        (
            "speed=\"20\"",
            "speed=\"x\"",
            "net:12: found speed=\"x\", expected a positive number",
        ),
        (
            "id=\"BC\" ",
            "id=\"AB\" ",
            "net:11: found a second edge `AB`, expected each edge once",
        ),
        (
            " to=\"C\"",
            "",
            "net:11: found <edge> without 'to', expected an attribute 'to'",
        ),
        ("<net ", "<nets ", "net:2: found <nets>, expected one <net>"),
        ("</net>", "", "net:18: found the end of the file, expected </net>"),
    ] {
        let failure = sumo_network(&NET.replacen(from, to, 1)).unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
    let failure = sumo_network("<net>\n</nett>").unwrap_err().to_string();
    assert!(failure.starts_with("net:2: found broken XML ("), "{failure}");
    let failure = sumo_network("<net/>").unwrap_err().to_string();
    assert_eq!(
        failure,
        "net: found no edge, expected <edge> with a lane for cars"
    );
    let sumo = sumo_network(NET).unwrap();
    for (from, to, message) in [
        (
            "edges=\"BC\"",
            "edges=\"BC rail\"",
            "routes:6: found edge `rail`, expected an edge of the network that cars may use",
        ),
        (
            "route=\"long\"",
            "route=\"short\"",
            "routes:4: found route=\"short\", expected a <route> that came before",
        ),
        (
            "        <route edges=\"BC\"/>\n",
            "\n",
            "routes:5: found <vehicle> without a route, expected a <route> within it, or its name",
        ),
        (
            "fromJunction=\"A\"",
            "fromJunction=\"Z\"",
            "routes:9: found fromJunction=\"Z\", expected a junction of the network",
        ),
        (
            "<trip id=\"3\"",
            "<flow id=\"3\"",
            "routes:8: found <flow> without a number of vehicles, expected number, vehsPerHour, period or probability",
        ),
    ] {
        let failure = sumo
            .read_trips(&Text::new("routes", &ROUTES.replacen(from, to, 1)))
            .unwrap_err();
        assert_eq!(failure.to_string(), message);
    }
}

#[test]
fn a_pair_without_a_path_is_called_by_its_names() {
    let sumo = sumo_network(NET).unwrap();
    let back = "<routes><trip id=\"1\" depart=\"0\" fromJunction=\"C\" toJunction=\"A\"/></routes>";
    let demand = sumo.read_trips(&Text::new("routes", back)).unwrap();
    let failure = assign(&sumo.network, &demand, &Options::default()).unwrap_err();
    assert_eq!(
        failure.to_string(),
        "trips from C to A: found no path in the network, expected a path wherever there is demand"
    );
}

/// A network as SUMO's own tools write it.
#[test]
fn a_network_that_sumo_made_is_solved() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/sumo");
    let (net, routes) = (folder.join("grid.net.xml"), folder.join("routes.rou.xml"));
    if !net.exists() {
        // Not eprintln!, which the test harness swallows.
        let notice = format!(
            "\nNOT TESTED: SUMO's grid, because {} does not have it\n",
            folder.display()
        );
        std::io::stderr().write_all(notice.as_bytes()).unwrap();
        return;
    }
    let sumo = sumo::read_network(
        &Text::read(&net).unwrap(),
        &LaneModel::default(),
        CostWeights::default(),
    )
    .unwrap();
    assert_eq!(
        (sumo.network.links().len(), sumo.network.numbering().nodes),
        (48, 16)
    );
    let demand = sumo.read_trips(&Text::read(&routes).unwrap()).unwrap();
    let text = std::fs::read_to_string(&routes).unwrap();
    let vehicles = text
        .lines()
        .filter(|line| line.trim_start().starts_with("<vehicle "))
        .count();
    assert_eq!(demand.total() + demand.intrazonal(), vehicles as f64);
    let options = Options {
        gap: 1e-10,
        ..Options::default()
    };
    assert!(assign(&sumo.network, &demand, &options).unwrap().converged);
}
