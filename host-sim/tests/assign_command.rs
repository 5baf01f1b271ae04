//! `host-sim assign`: what it writes, what it starts from, what it refuses.

// Helpers are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use clap::Parser as _;
use host_sim::command::assign::{AssignArguments, run};
use host_sim::report::table::{Column, Table};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../assignment/tests/fixtures")
        .join(name)
}

#[derive(clap::Parser)]
struct CommandLine {
    #[command(flatten)]
    arguments: AssignArguments,
}

fn assign_arguments(arguments: &[&str]) -> kit::error::Result<()> {
    let line = ["assign"].iter().chain(arguments);
    run(&CommandLine::try_parse_from(line).unwrap().arguments).map(drop)
}

fn assign_command(arguments: &[&str]) -> kit::error::Result<()> {
    solve_or_judge(arguments).map(drop)
}

fn exit_code(arguments: &[&str]) -> ExitCode {
    solve_or_judge(arguments).unwrap()
}

fn solve_or_judge(arguments: &[&str]) -> kit::error::Result<ExitCode> {
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    let problem = ["assign", "--json", "--net", net.to_str().unwrap(), "--trips"];
    let line = problem
        .into_iter()
        .chain([trips.to_str().unwrap()])
        .chain(arguments.iter().copied());
    run(&CommandLine::try_parse_from(line).unwrap().arguments)
}

#[test]
fn the_command_writes_every_result_and_starts_from_paths() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (paths, skims) = (file("paths.csv"), file("skims.csv"));
    let (selected, record) = (file("selected.csv"), file("convergence.csv"));
    assign_command(&[
        "--paths",
        &paths,
        "--skims",
        &skims,
        "--select-link",
        "1,3",
        "--select-link",
        "10,16",
        "--selected",
        &selected,
        "--convergence",
        &record,
    ])
    .unwrap();
    let text = std::fs::read_to_string(&selected).unwrap();
    assert!(text.starts_with("init_node,term_node,origin,destination,volume,share\n1,3,1,3,"));
    assert!(text.contains("\n10,16,"));
    assert!(std::fs::read_to_string(&skims).unwrap().lines().count() == 1 + 24 * 23);
    assert!(std::fs::exists(&record).unwrap());
    assign_command(&["--warm", &paths, "--max-iterations", "0"]).unwrap();
}

#[test]
fn the_command_refuses_results_that_do_not_exist() {
    for (arguments, message) in [
        (
            &["--selected", "x.csv"][..],
            "--selected: found no --select-link, expected both: the links, and the file for their trips",
        ),
        (
            &["--select-link", "1,2"],
            "--select-link: found no --selected, expected both: the links, and the file for their trips",
        ),
        (
            &["--select-link", "1", "--selected", "x.csv"],
            "--select-link: found `1`, expected two nodes with a comma between them",
        ),
        (
            &["--select-link", "1,9", "--selected", "x.csv"],
            "--select-link: found 1,9, expected two nodes that a link joins",
        ),
        (
            &["--algorithm", "bfw", "--paths", "x"],
            "--paths: found another algorithm, expected `--algorithm path`: the Frank-Wolfe family knows no paths",
        ),
        (
            &["--check", "x", "--skims", "y"],
            "--skims: found --check beside it, expected one of the two: --check solves nothing",
        ),
        (
            &["--warm", "/nowhere/paths"],
            "/nowhere/paths: No such file or directory (os error 2)",
        ),
    ] {
        assert_eq!(assign_command(arguments).unwrap_err().to_string(), message);
    }
}

#[test]
fn flows_go_through_parquet_and_networks_through_gmns() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (flows, gmns, demand) = (path("flows.parquet"), path("gmns"), path("gmns/demand.csv"));
    assign_command(&["--flows", &flows, "--gmns", &gmns]).unwrap();
    let bytes = std::fs::read(&flows).unwrap();
    assert!(bytes.starts_with(b"PAR1"));
    assign_command(&["--check", &flows]).unwrap();
    // The network that was written is the same problem: the same flows, bit by bit.
    let again = path("again.parquet");
    let line = [
        "assign", "--json", "--net", &gmns, "--trips", &demand, "--flows", &again,
    ];
    run(&CommandLine::try_parse_from(line).unwrap().arguments).unwrap();
    assert_eq!(bytes, std::fs::read(&again).unwrap());
    // A file that only calls itself Parquet.
    let text = path("text.parquet");
    std::fs::rename(&demand, &text).unwrap();
    let message = assign_command(&["--check", &text]).unwrap_err().to_string();
    assert!(message.ends_with("expected a Parquet file"), "{message}");
}

#[test]
fn roads_with_flows_go_to_maps_and_reports() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (geojson, report) = (path("roads.geojson"), path("report.html"));
    assign_command(&["--geojson", &geojson, "--report", &report]).unwrap();
    let text = std::fs::read_to_string(&geojson).unwrap();
    let features: serde_json::Value = serde_json::from_str(&text).unwrap();
    let features = features["features"].as_array().unwrap();
    assert_eq!(features.len(), 76);
    assert_eq!(features[0]["properties"]["init_node"], "1");
    assert_eq!(
        features[0]["geometry"]["coordinates"].as_array().unwrap().len(),
        2
    );
    let page = std::fs::read_to_string(&report).unwrap();
    for part in ["<svg", "Flow over capacity", "columns speed, link_type"] {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn outputs_have_names_of_their_kind_and_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (sheet, flows) = (path("flows.xlsx"), path("flows.csv"));
    let again = path("../").replace("..", ".") + "flows.csv";
    for (arguments, message) in [
        (
            ["--flows", &sheet, "--threads", "1"],
            format!("--flows: found {sheet}, expected a name that ends in .csv or .parquet"),
        ),
        (
            ["--flows", &flows, "--paths", &again],
            format!("--paths: found {again}, as for --flows, expected a file of its own"),
        ),
    ] {
        assert_eq!(assign_command(&arguments).unwrap_err().to_string(), message);
    }
    assert!(!std::fs::exists(&flows).unwrap());
}

#[test]
fn flows_of_other_programs_are_judged() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let flows = path("flows.csv");
    assign_command(&["--flows", &flows]).unwrap();
    let text = std::fs::read_to_string(&flows).unwrap();
    let rows: Vec<Vec<&str>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect())
        .collect();
    let table = |head: &str, row: &dyn Fn(usize, &[&str]) -> String| {
        let lines = rows
            .iter()
            .enumerate()
            .rev()
            .map(|(index, fields)| row(index, fields));
        format!("{head}\n{}\n", lines.collect::<Vec<_>>().join("\n"))
    };
    for (name, text) in [
        (
            "published_flow.tntp",
            table("From \tTo \tVolume \tCost", &|_, row| row.join(" \t")),
        ),
        (
            "aequilibrae.csv",
            table("link_id,PCE_AB,PCE_BA,PCE_tot", &|index, row| {
                format!("{},{},0.0,{}", index + 1, row[2], row[2])
            }),
        ),
        (
            "link.csv",
            table("link_id,from_node_id,to_node_id,volume", &|index, row| {
                format!("{index},{},{},{}", row[0], row[1], row[2])
            }),
        ),
    ] {
        std::fs::write(path(name), text).unwrap();
        assign_command(&["--check", &path(name)]).unwrap();
    }
    let columns = vec![
        Column::unsigned("link_id", (0..rows.len()).map(|index| index as u64 + 1)),
        Column::number("PCE_AB", rows.iter().map(|row| row[2].parse::<f64>().unwrap())),
        Column::number("PCE_BA", rows.iter().map(|_| 0.0)),
    ];
    let bytes = Table::new(columns).unwrap().to_parquet().unwrap();
    std::fs::write(path("aequilibrae.parquet"), bytes).unwrap();
    assign_command(&["--check", &path("aequilibrae.parquet")]).unwrap();
    std::fs::write(path("short.csv"), "link_id,volume\n1,3\n").unwrap();
    let failure = assign_command(&["--check", &path("short.csv")])
        .unwrap_err()
        .to_string();
    assert!(
        failure.ends_with("found no flow of 75 links, the first from 1 to 3, expected a row for every link")
    );
}

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

#[test]
fn the_command_tells_the_formats_apart() {
    let folder = tempfile::tempdir().unwrap();
    let assign = |net: &Path, trips: &Path, flows: &Path| {
        let (net, trips, flows) = (
            net.to_str().unwrap(),
            trips.to_str().unwrap(),
            flows.to_str().unwrap(),
        );
        let line = [
            "assign", "--json", "--net", net, "--trips", trips, "--flows", flows,
        ];
        run(&CommandLine::try_parse_from(line).unwrap().arguments).unwrap();
    };
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let (net, routes) = (file("x.net.xml", NET), file("x.rou.xml", ROUTES));
    let flows = folder.path().join("flows.csv");
    assign(&net, &routes, &flows);
    let text = std::fs::read_to_string(&flows).unwrap();
    assert!(text.starts_with("init_node,term_node,volume,cost\nA,B,3,"));
    file("node.csv", NODES);
    file("link.csv", LINKS);
    assign(folder.path(), &file("demand.csv", DEMAND), &flows);
    let text = std::fs::read_to_string(&flows).unwrap();
    assert!(text.starts_with("init_node,term_node,volume,cost\nc7,a,100,"));
}

#[test]
fn the_command_refuses_options_that_make_no_sense() {
    let net = fixture("SiouxFalls_net.tntp");
    let net = net.to_str().unwrap();
    for (arguments, message) in [
        (
            &["--net", "grid", "--gap", "-1"][..],
            "gap: found -1, expected a finite number, not negative",
        ),
        (
            &["--net", "grid", "--gap", "nan"],
            "gap: found NaN, expected a finite number, not negative",
        ),
        (
            &["--net", "grid", "--toll-weight", "inf"],
            "toll_weight: found inf, expected a finite number, not negative",
        ),
        (
            &["--net", "grid", "--distance-weight", "-0.1"],
            "distance_weight: found -0.1, expected a finite number, not negative",
        ),
        (
            &["--net", "grid", "--trips", "x"],
            "trips: found x, expected none with the grid, which brings its own demand",
        ),
        (
            &["--net", net],
            "trips: found none, expected a TNTP trip table for the network file",
        ),
        (
            &["--net", "/nowhere/net"],
            "/nowhere/net: No such file or directory (os error 2)",
        ),
        (
            &["--net", "grid", "--toll-weight", "0.02"],
            "toll_weight: found 0.02, expected none with the grid, whose costs are times alone",
        ),
        (
            &["--net", "grid", "--select-link", "1,2"],
            "--select-link: found no --selected, expected both: the links, and the file for their trips",
        ),
        (
            &["--net", "grid", "--check", "x", "--flows", "y"],
            "--flows: found --check beside it, expected one of the two: --check solves nothing",
        ),
        (
            &["--net", "/nowhere/net", "--trips", "x"],
            "/nowhere/net: No such file or directory (os error 2)",
        ),
    ] {
        assert_eq!(assign_arguments(arguments).unwrap_err().to_string(), message);
    }
    let before = std::fs::read(net).unwrap();
    let failure = assign_arguments(&["--net", net, "--trips", net, "--flows", net]).unwrap_err();
    let expected = format!("--flows: found {net}, which is read, expected a file of its own");
    assert_eq!(failure.to_string(), expected);
    assert_eq!(std::fs::read(net).unwrap(), before);
}

#[test]
fn the_command_writes_flows_that_it_accepts_again() {
    let folder = tempfile::tempdir().unwrap();
    let flows = folder.path().join("flows.csv");
    let flows = flows.to_str().unwrap();
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    let problem = [
        "--net",
        net.to_str().unwrap(),
        "--trips",
        trips.to_str().unwrap(),
        "--json",
    ];
    assign_arguments(&[&problem[..], &["--flows", flows, "--threads", "2", "--seed", "7"]].concat()).unwrap();
    let text = std::fs::read_to_string(flows).unwrap();
    assert_eq!(text.lines().count(), 77);
    assert!(text.starts_with("init_node,term_node,volume,cost\n1,2,"));
    assign_arguments(&[&problem[..], &["--check", flows]].concat()).unwrap();
    // Too few iterations for the gap are no failure, and the flows are there.
    std::fs::remove_file(flows).unwrap();
    assign_arguments(
        &[
            &problem[..],
            &["--flows", flows, "--algorithm", "fw", "--max-iterations", "2"],
        ]
        .concat(),
    )
    .unwrap();
    assert!(std::fs::exists(flows).unwrap());
}

/// Two classes in Sioux Falls, and what else is true of its roads.
fn classes_command(more: &[&str]) -> kit::error::Result<ExitCode> {
    let file = |name: &str| fixture(name).to_str().unwrap().to_owned();
    let (net, classes) = (file("SiouxFalls_net.tntp"), file("SiouxFalls_classes.toml"));
    let links = file("SiouxFalls_links.csv");
    let problem = [
        "assign",
        "--json",
        "--net",
        &net,
        "--classes",
        &classes,
        "--link-table",
        &links,
    ];
    let line = problem.iter().chain(more);
    run(&CommandLine::try_parse_from(line).unwrap().arguments)
}

#[test]
fn classes_have_rows_and_columns_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (flows, paths, skims) = (path("flows.csv"), path("paths.csv"), path("skims.csv"));
    let selected = path("selected.csv");
    let more = [
        "--flows",
        &flows,
        "--paths",
        &paths,
        "--skims",
        &skims,
        "--select-link",
        "10,16",
        "--selected",
        &selected,
    ];
    classes_command(&more).unwrap();
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    let text = read(&flows);
    let mut rows = text.lines();
    assert_eq!(
        rows.next().unwrap(),
        "init_node,term_node,volume,cost,preload,volume_car,cost_car,volume_lorry,cost_lorry"
    );
    for row in rows {
        let fields: Vec<&str> = row.split(',').collect();
        let number = |column: usize| fields[column].parse::<f64>().unwrap();
        let (volume, cars, lorries) = (number(2), number(5), number(7));
        assert!(
            (volume - cars - 2.5 * lorries).abs() < 1e-9 * volume.max(1.0),
            "{row}"
        );
        // Where lorries may not drive none does, at no cost.
        assert_eq!(row.starts_with("3,1,"), fields[8].is_empty(), "{row}");
        assert!(!row.starts_with("3,1,") || lorries == 0.0, "{row}");
    }
    for (text, header) in [
        (
            read(&paths),
            "class,origin,destination,volume,cost,links\ncar,1,2,70,",
        ),
        (
            read(&skims),
            "class,origin,destination,cost,time,length,toll\ncar,1,2,",
        ),
        (
            read(&selected),
            "class,init_node,term_node,origin,destination,volume,share\ncar,10,16,",
        ),
    ] {
        assert!(text.starts_with(header) && text.contains("\nlorry,"), "{header}");
    }
    let text = read(&skims);
    // An hour is worth 20 tolls, so one costs three minutes.
    let toll: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
    let [cost, time]: [f64; 2] = [toll[3], toll[4]].map(|field| field.parse().unwrap());
    assert!((cost - time - 3.0).abs() < 1e-9, "{toll:?}");
    // Its own paths are an equilibrium already.
    let again = path("again.csv");
    let more = ["--warm", &paths, "--max-iterations", "0", "--flows", &again];
    classes_command(&more).unwrap();
    let volumes = |path: &str| -> Vec<f64> {
        let rows = read(path);
        let volumes = rows
            .lines()
            .skip(1)
            .map(|row| row.split(',').nth(7).unwrap().parse().unwrap());
        volumes.collect()
    };
    for (before, after) in volumes(&flows).into_iter().zip(volumes(&again)) {
        assert!((before - after).abs() < 1e-3, "{before} {after}");
    }
}

#[test]
fn classes_that_make_no_sense_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    let trips = format!("trips = {:?}", trips.to_str().unwrap());
    let links = path("links.csv");
    // Node 1 of the network leads to 2 and 3 alone.
    std::fs::write(&links, "from,to,banned_car\n1,2,1\n1,3,1\n").unwrap();
    let links = links.to_str().unwrap();
    for (classes, more, message) in [
        (
            "[[class]]\nname = \"car\"\n".to_owned(),
            &[][..],
            "classes.toml:1: found missing field `trips`",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\nspeed = 3\n"),
            &[],
            "classes.toml:4: found unknown field `speed`",
        ),
        (
            format!("[[class]]\nname = \"my car\"\n{trips}\n"),
            &[],
            "classes.toml: class my car: found its name, expected letters",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n[[class]]\nname = \"Car\"\n{trips}\n"),
            &[],
            "classes.toml: class Car: found a second one",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\nvalue_of_time = 0\n"),
            &[],
            "classes.toml: class car: value_of_time: found 0",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\ndemand_factor = 0\n"),
            &[],
            "class car: demand: found no trips",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n"),
            &["--link-table", links],
            "trips of class car: found 8800 vehicles without a path, by pairs 23: 1 to 2, 1 to 3",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n"),
            &["--toll-weight", "1"],
            "toll and distance weights: found some, expected none with classes",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n"),
            &["--gmns", "out"],
            "--gmns: found --classes beside it, expected one of the two",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n"),
            &["--delay-period", "2"],
            "delay_period: found 2, expected none: it is a part of Akcelik's delay",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\npassenger_car_equivalent = 0\n"),
            &[],
            "classes.toml: class car: passenger_car_equivalent: found 0",
        ),
        (
            format!("[[class]]\nname = \"car\"\n{trips}\n"),
            &["--algorithm", "bfw"],
            "algorithm for classes: found Frank-Wolfe",
        ),
    ] {
        std::fs::write(path("classes.toml"), classes).unwrap();
        let classes = path("classes.toml").to_str().unwrap().to_owned();
        let problem = [
            "assign",
            "--json",
            "--net",
            net.to_str().unwrap(),
            "--classes",
            &classes,
        ];
        let line = problem.iter().chain(more);
        let failure = run(&CommandLine::try_parse_from(line).unwrap().arguments).unwrap_err();
        let failure = failure.to_string();
        let place = format!("{}/", folder.path().display());
        let found = failure.strip_prefix(&place).unwrap_or(&failure);
        assert!(found.starts_with(message), "{found}");
    }
}

#[test]
fn a_judgement_has_an_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let flows = folder.path().join("flows.csv").to_str().unwrap().to_owned();
    assign_command(&["--flows", &flows, "--gap", "1e-3"]).unwrap();
    let judged = |more: &[&str]| {
        let arguments = [&["--check", flows.as_str()][..], more].concat();
        format!("{:?}", exit_code(&arguments))
    };
    let code = |code: u8| format!("{:?}", ExitCode::from(code));
    assert_eq!(judged(&[]), code(0));
    assert_eq!(judged(&["--gap", "1e-2"]), code(0));
    assert_eq!(judged(&["--gap", "1e-9"]), code(1));
    assert_eq!(judged(&["--demand-factor", "0.5"]), code(1));
}
