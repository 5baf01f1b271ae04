//! SUMO as the traffic. What needs SUMO is marked as ignored, and `./test sumo` installs SUMO and runs it.

use host_sim::closed_loop::experiment::{LoopSource, Traffic};
use host_sim::journeys::delays::Fixed;
use host_sim::journeys::hour::{self, Case, Sight};
use host_sim::journeys::incidents::Incidents;
use host_sim::journeys::queues::Queues;
use host_sim::journeys::roads::{Road, RoadMap};
use host_sim::journeys::sumo::traci::Client;
use host_sim::journeys::sumo::{Programs, SumoTraffic};
use host_sim::journeys::town::Town;
use host_sim::journeys::{Arrival, TrafficModel, trips};
use host_sim::mobility::live::LiveSumo;
use host_sim::mobility::{MobilitySource as _, Place};
use host_sim::policy::clock;
use host_sim::scenario::ScenarioSource;
use host_sim::stream::{Purpose, Role, Stream, WorldKey};
use host_sim::{Experiment, ExperimentSource, Result};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;

const FREE_SPEED_M_PER_S: f64 = 13.9;

fn road(from: u32, to: u32, length_m: f64, lanes: u32, block: u32) -> Road {
    Road {
        from,
        to,
        length_m,
        free_speed_m_per_s: FREE_SPEED_M_PER_S,
        lanes,
        capacity_veh_per_h: 1800.0 * f64::from(lanes),
        block: Some(block),
    }
}

/// Roads one after the other on a line, by lanes.
fn line(roads: &[(f64, u32)]) -> RoadMap {
    let (mut x_m, mut places_m) = (0.0, vec![(0.0, 0.0)]);
    let mut list = Vec::new();
    for (index, &(length_m, lanes)) in (0_u32..).zip(roads) {
        x_m += length_m;
        places_m.push((x_m, 0.0));
        list.push(road(index, index + 1, length_m, lanes, index));
    }
    RoadMap::new(list, places_m).expect("a line of roads")
}

fn start(map: &RoadMap, incidents: Incidents) -> SumoTraffic {
    let programs = Programs::find().expect("./test sumo installs it");
    SumoTraffic::start(&programs, map, incidents, 1).expect("SUMO runs")
}

fn free(map: &RoadMap) -> SumoTraffic {
    start(map, Incidents::none(map.block_count()))
}

fn until(traffic: &mut SumoTraffic, time_s: f64) -> Vec<Arrival> {
    let mut arrived = Vec::new();
    traffic.advance(time_s, &mut arrived).expect("SUMO goes on");
    arrived
}

/// How many vehicles an hour arrive from 600 to 1,800 s, with more than enough of them at the beginning.
fn flow_veh_per_h(map: &RoadMap, incidents: Incidents, route: &[u32], lanes: u32) -> f64 {
    let mut traffic = start(map, incidents);
    let (mut vehicle, mut arrived) = (0, Vec::new());
    for second in 0..1_800 {
        for _ in 0..lanes {
            traffic.depart(vehicle, route).expect("a route");
            vehicle += 1;
        }
        traffic
            .advance(f64::from(second + 1), &mut arrived)
            .expect("SUMO goes on");
    }
    let counted = arrived.iter().filter(|arrival| arrival.time_s > 600.0).count();
    counted as f64 * 3.0
}

fn close_to(found: f64, expected: f64, share: f64) {
    assert!(
        (found / expected - 1.0).abs() <= share,
        "found {found}, expected {expected} within {share}"
    );
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_vehicle_alone_drives_at_free_speed() {
    let map = line(&[(1390.0, 1), (695.0, 2)]);
    let mut traffic = free(&map);
    let _nobody = until(&mut traffic, 10.0);
    traffic.depart(7, &[0, 1]).expect("a route");
    let _nobody = until(&mut traffic, 60.0);
    let mut vehicles = Vec::new();
    traffic.on_roads(&mut vehicles).expect("places");
    assert_eq!((vehicles.len(), vehicles[0].vehicle, vehicles[0].road), (1, 7, 0));
    // It enters at 11 s with its 5 m on the road.
    close_to(vehicles[0].along_m, 49.0 * FREE_SPEED_M_PER_S + 5.0, 0.01);
    let arrived = until(&mut traffic, 200.0);
    assert_eq!(arrived.len(), 1);
    let trip_s = arrived[0].time_s - 10.0;
    assert!((150.0..=152.0).contains(&trip_s), "{trip_s}");
    traffic.on_roads(&mut vehicles).expect("places");
    assert_eq!(vehicles, []);
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_bottleneck_passes_its_capacity() {
    for (before, bottleneck) in [(1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (1, 2)] {
        let map = line(&[(1000.0, before), (500.0, bottleneck)]);
        let flow = flow_veh_per_h(&map, Incidents::none(2), &[0, 1], before);
        let expected = 1800.0 * f64::from(bottleneck.min(before));
        println!("{before} lanes, then {bottleneck}: {flow} vehicles/h of {expected}");
        close_to(flow, expected, 0.03);
    }
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn every_road_passes_its_own_capacity() {
    for (before, speeds_m_per_s, capacity) in [
        (1800.0, (13.9, 25.0), 1000.0),
        (1800.0, (25.0, 8.33), 1400.0),
        (1800.0, (8.33, 25.0), 1700.0),
        (1200.0, (13.9, 13.9), 1800.0),
    ] {
        let road = |node: u32, free_speed_m_per_s: f64, capacity_veh_per_h: f64| Road {
            free_speed_m_per_s,
            capacity_veh_per_h,
            ..road(node, node + 1, 800.0, 1, node)
        };
        let roads = vec![
            road(0, speeds_m_per_s.0, before),
            road(1, speeds_m_per_s.1, capacity),
        ];
        let map = RoadMap::new(roads, vec![(0.0, 0.0), (800.0, 0.0), (1600.0, 0.0)]).expect("two roads");
        let flow = flow_veh_per_h(&map, Incidents::none(2), &[0, 1], 1);
        println!("{before} at {speeds_m_per_s:?} m/s, then {capacity}: {flow} vehicles/h");
        close_to(flow, capacity.min(before), 0.05);
    }
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn an_incident_leaves_its_share_of_the_capacity() {
    for capacity_left in [0.2, 0.5] {
        let map = line(&[(1000.0, 2), (500.0, 2)]);
        let spans = vec![Vec::new(), vec![(0.0, 1e9)]];
        let flow = flow_veh_per_h(&map, Incidents::scripted(spans, capacity_left), &[0, 1], 2);
        println!("{capacity_left}: {flow} vehicles/h");
        close_to(flow, capacity_left * 3600.0, 0.1);
    }
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn an_incident_begins_and_ends() {
    let map = line(&[(1390.0, 1)]);
    let trip_s = |spans: Vec<(f64, f64)>| {
        let mut traffic = start(&map, Incidents::scripted(vec![spans], 0.25));
        traffic.depart(0, &[0]).expect("a route");
        until(&mut traffic, 1000.0)[0].time_s
    };
    let (before, within, after) = (
        trip_s(vec![(500.0, 900.0)]),
        trip_s(vec![(20.0, 70.0)]),
        trip_s(vec![(0.0, 1.0)]),
    );
    let slow_m = 50.0 * (FREE_SPEED_M_PER_S - map.roads()[0].crawl_speed_m_per_s(0.25));
    assert!(before < 103.0 && after < 105.0, "{before} {after}");
    close_to(within - before, slow_m / FREE_SPEED_M_PER_S, 0.1);
}

/// Two ways from 0 to 3: by 1 and by 2.
fn diamond() -> RoadMap {
    let places_m = vec![
        (0.0, 0.0),
        (500.0, 500.0),
        (500.0, -500.0),
        (1000.0, 0.0),
        (-700.0, 0.0),
    ];
    let roads = vec![
        road(4, 0, 700.0, 2, 0),
        road(0, 1, 700.0, 1, 1),
        road(1, 3, 700.0, 1, 2),
        road(0, 2, 700.0, 2, 3),
        road(2, 3, 700.0, 1, 4),
        road(0, 4, 700.0, 2, 0),
    ];
    RoadMap::new(roads, places_m).expect("a diamond")
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_vehicle_takes_the_route_that_it_is_told() {
    let mut traffic = free(&diamond());
    for vehicle in 0..4 {
        traffic.depart(vehicle, &[0, 1, 2]).expect("a route");
    }
    let _nobody = until(&mut traffic, 30.0);
    // The other way, back, and no further.
    traffic.take_route(1, &[3, 4]).expect("a route");
    traffic.take_route(2, &[5]).expect("a route");
    traffic.take_route(3, &[]).expect("a route");
    let arrived = until(&mut traffic, 75.0);
    assert_eq!(
        arrived.iter().map(|arrival| arrival.vehicle).collect::<Vec<_>>(),
        [3]
    );
    let mut vehicles = Vec::new();
    traffic.on_roads(&mut vehicles).expect("places");
    let on = |vehicle: u32| vehicles.iter().find(|on| on.vehicle == vehicle).map(|on| on.road);
    assert_eq!([on(0), on(1), on(2)], [Some(1), Some(3), Some(5)]);
    let error = traffic.take_route(0, &[4]).expect_err("no such way").to_string();
    assert_eq!(
        error,
        "route of vehicle 0: found road 4, expected a road that begins where the one before ends"
    );
    let error = traffic.take_route(3, &[]).expect_err("it is gone").to_string();
    assert_eq!(
        error,
        "route of vehicle 3: found no road under it, expected a vehicle on a road"
    );
    let error = traffic.depart(9, &[17]).expect_err("no such road").to_string();
    assert_eq!(
        error,
        "route of vehicle 9: found road 17, expected below 6, the number of roads"
    );
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_circle_of_queues_is_let_through() {
    let places_m = vec![
        (0.0, 0.0),
        (75.0, 0.0),
        (37.5, 65.0),
        (-100.0, -100.0),
        (175.0, -100.0),
        (37.5, 200.0),
    ];
    // A triangle, and a road to each of its corners.
    let circle = (0..3).map(|node| road(node, (node + 1) % 3, 75.0, 1, node));
    let feeders = (0..3).map(|node| road(node + 3, node, 150.0, 1, node + 3));
    let map = RoadMap::new(circle.chain(feeders).collect(), places_m).expect("a circle");
    let mut traffic = free(&map);
    for vehicle in 0..90 {
        let first = vehicle % 3;
        let (second, third) = ((first + 1) % 3, (first + 2) % 3);
        let route = [first + 3, first, second, third, first, second];
        traffic.depart(vehicle, &route).expect("a route");
    }
    let (mut arrived, mut vehicles, mut most) = (Vec::new(), Vec::new(), 0);
    for second in 1..=20_000 {
        traffic
            .advance(f64::from(second), &mut arrived)
            .expect("SUMO goes on");
        traffic.on_roads(&mut vehicles).expect("places");
        most = most.max(vehicles.len());
        // Whoever is being let through may be told a route, too.
        for on in vehicles.iter().filter(|on| on.road < 3 && second < 1_000) {
            let onward = [(on.road + 1) % 3, (on.road + 2) % 3];
            traffic.take_route(on.vehicle, &onward).expect("a route");
        }
    }
    println!(
        "{} let through, {} arrived, {most} at once",
        traffic.let_through(),
        arrived.len()
    );
    assert_eq!(arrived.len(), 90);
    assert!(traffic.let_through() > 0 && most <= 90, "{most}");
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_seed_gives_the_same_traffic() {
    let run = || {
        let mut traffic = free(&diamond());
        let (mut arrived, mut log) = (Vec::new(), Vec::new());
        for second in 0..600_u32 {
            let route: &[u32] = if second % 3 == 0 { &[0, 3, 4] } else { &[0, 1, 2] };
            traffic.depart(second, route).expect("a route");
            traffic
                .advance(f64::from(second + 1), &mut arrived)
                .expect("SUMO goes on");
            let mut vehicles = Vec::new();
            traffic.on_roads(&mut vehicles).expect("places");
            log.push(vehicles);
        }
        (arrived, log)
    };
    assert_eq!(run(), run());
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_killed_sumo_is_one_line() {
    let mut traffic = free(&diamond());
    traffic.depart(0, &[0, 1, 2]).expect("a route");
    let _nobody = until(&mut traffic, 10.0);
    let process = traffic.process_id().expect("a child").to_string();
    let killed = std::process::Command::new("kill").args(["-9", &process]).status();
    assert!(killed.expect("kill").success());
    let error = traffic
        .advance(20.0, &mut Vec::new())
        .expect_err("it is gone")
        .to_string();
    assert!(
        error.starts_with("sumo: found the program ended with signal: 9 (SIGKILL)")
            && error.ends_with("expected a program that runs until it is told to end")
            && error.lines().count() == 1,
        "{error}"
    );
    // What was known stays known.
    let mut vehicles = Vec::new();
    traffic.on_roads(&mut vehicles).expect("places");
    assert_eq!(vehicles.len(), 1);
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn it_ends_with_its_owner() {
    let mut traffic = free(&diamond());
    let process = traffic.process_id().expect("a child");
    drop(traffic);
    assert!(!Path::new(&format!("/proc/{process}")).exists());
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_port_that_is_taken_is_another_one() {
    let programs = Programs::find().expect("./test sumo installs it");
    let folder = tempfile::tempdir().expect("a folder");
    let network = folder.path().join("roads.net.xml");
    std::fs::write(folder.path().join("n.nod.xml"), NODES).expect("written");
    std::fs::write(folder.path().join("e.edg.xml"), EDGES).expect("written");
    let file = |option: &str, name: &str| [option.into(), folder.path().join(name).into()];
    let parts = [
        file("--node-files", "n.nod.xml"),
        file("--edge-files", "e.edg.xml"),
        file("--output-file", "roads.net.xml"),
    ];
    programs.convert(&parts.concat()).expect("a network");
    let arguments = ["--net-file".into(), network.into()];
    // Somebody who says nothing, and somebody who talks.
    for word in ["", "hello\n"] {
        let taken = TcpListener::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a port");
        let port = taken.local_addr().expect("an address").port();
        let talks = std::thread::spawn(move || {
            let (mut stream, _) = taken.accept().expect("a caller");
            let _ = stream.write_all(word.as_bytes());
            let _ = stream.read_to_end(&mut Vec::new());
        });
        let (_client, version) = programs.start(&arguments, Some(port)).expect("another port");
        assert!(version.program.starts_with("SUMO"));
        println!("{version:?}");
        talks.join().expect("a stranger");
    }
}

const NODES: &str = r#"<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>"#;
const EDGES: &str = r#"<edges><edge id="e" from="a" to="b"/></edges>"#;

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_network_that_sumo_refuses_is_one_line() {
    let programs = Programs::find().expect("./test sumo installs it");
    let map = RoadMap::new(vec![road(0, 0, 10.0, 1, 0)], vec![(0.0, 0.0)]).expect("a circle");
    let error = SumoTraffic::start(&programs, &map, Incidents::none(1), 1).expect_err("refused");
    let error = error.to_string();
    assert!(
        error.starts_with("netconvert: found ") && error.lines().count() == 1,
        "{error}"
    );
}

/// A client of a server that answers every message with these bytes, then closes.
fn told(answers: Vec<Vec<u8>>) -> Client {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let address = listener.local_addr().expect("an address");
    let _serves = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a client");
        for answer in answers {
            let mut length = [0; 4];
            stream.read_exact(&mut length).expect("a message");
            let mut message = vec![0; u32::from_be_bytes(length) as usize - 4];
            stream.read_exact(&mut message).expect("a message");
            let _ = stream.write_all(&answer);
        }
    });
    let stream = TcpStream::connect(address).expect("a server");
    Client::new(stream, None).expect("a client")
}

/// As SUMO says its version.
fn version(api: i32, program: &str) -> Vec<u8> {
    let text = program.as_bytes();
    let mut body = vec![7, 0, 0, 0, 0, 0, 0, 10 + text.len() as u8, 0];
    body.extend(api.to_be_bytes());
    body.extend((text.len() as u32).to_be_bytes());
    body.extend(text);
    let mut message = (body.len() as u32 + 4).to_be_bytes().to_vec();
    message.extend(body);
    message
}

#[test]
fn who_is_no_suitable_sumo_is_refused() {
    let known = told(vec![version(22, "SUMO 1.28.0")]).version().expect("SUMO");
    assert_eq!((known.api, known.program.as_str()), (22, "SUMO 1.28.0"));
    for (api, program, found) in [
        (18, "SUMO 1.0.0", "SUMO 1.0.0, TraCI 18"),
        (22, "Other 7", "Other 7, TraCI 22"),
        (-1, "SUMO\nx", "SUMO\\nx, TraCI -1"),
    ] {
        let error = told(vec![version(api, program)]).version().expect_err("refused");
        assert_eq!(
            error.to_string(),
            format!("sumo: found {found}, expected SUMO, TraCI 20 or later")
        );
    }
}

#[test]
fn hostile_answers_are_one_line() {
    let long = |length: u32| length.to_be_bytes().to_vec();
    for (answer, found) in [
        (Vec::new(), "the connection is closed"),
        (long(0), "an answer of 0 bytes"),
        (long(u32::MAX), "an answer of 4294967295 bytes"),
        (long(1 << 27), "the connection is closed"),
        ([long(5), vec![9]].concat(), "0 bytes"),
        ([long(6), vec![0, 0]].concat(), "1 bytes"),
        (version(22, "SUMO")[..20].to_vec(), "the connection is closed"),
        (
            b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(),
            "an answer of 1213486160 bytes",
        ),
    ] {
        let error = told(vec![answer]).version().expect_err("refused").to_string();
        let start = format!("sumo: found {found}");
        let answered = format!("sumo: answer: found {found}");
        assert!(
            (error.starts_with(&start) || error.starts_with(&answered)) && error.lines().count() == 1,
            "{error}"
        );
    }
}

/// A folder with programs that print a line and end.
#[cfg(unix)]
fn programs(line: &str) -> (tempfile::TempDir, Programs) {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sumo");
    std::fs::write(&path, format!("#!/bin/sh\necho '{line}' >&2\nexit 1\n")).expect("written");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("a program");
    let programs = Programs::in_folder(folder.path().to_owned());
    (folder, programs)
}

#[test]
#[cfg(unix)]
fn a_sumo_that_does_not_start_is_one_line() {
    let (_folder, broken) = programs("Error: no file x.sumocfg.");
    let error = broken.start(&[], None).expect_err("it ends").to_string();
    assert_eq!(
        error,
        "sumo: found the program ended with exit status: 1; it wrote: Error: no file x.sumocfg., expected a program that listens"
    );
    let (_folder, crowded) = programs("Error: bind: Address already in use");
    let error = crowded.start(&[], None).expect_err("no port").to_string();
    assert_eq!(
        error,
        "sumo: found 8 ports taken one after the other, expected a free port on 127.0.0.1"
    );
    let (folder, _) = programs("");
    let nowhere = Programs::in_folder(folder.path().join("nowhere"));
    let error = nowhere.start(&[], None).expect_err("no program").to_string();
    assert!(error.ends_with("expected SUMO's program of this name"), "{error}");
}

/// A crossing of the user's own, with traffic lights and vehicles by chance.
fn configuration(folder: &Path) -> String {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("written");
    let mut nodes = String::from(r#"<nodes><node id="m" x="500" y="500" type="traffic_light"/>"#);
    let mut edges = String::from("<edges>");
    for (name, x, y) in [("n", 500, 900), ("e", 900, 500), ("s", 500, 100), ("w", 100, 500)] {
        nodes += &format!(r#"<node id="{name}" x="{x}" y="{y}"/>"#);
        edges +=
            &format!(r#"<edge id="{name}m" from="{name}" to="m"/><edge id="m{name}" from="m" to="{name}"/>"#);
    }
    write("x.nod.xml", &(nodes + "</nodes>"));
    write("x.edg.xml", &(edges + "</edges>"));
    let file = |option: &str, name: &str| [option.into(), folder.join(name).into()];
    let parts = [
        file("--node-files", "x.nod.xml"),
        file("--edge-files", "x.edg.xml"),
        file("--output-file", "x.net.xml"),
    ];
    let programs = Programs::find().expect("./test sumo installs it");
    let arguments = [&parts.concat()[..], &["--offset.disable-normalization".into()]].concat();
    programs.convert(&arguments).expect("a network");
    let flow = |from: &str, to: &str| {
        format!(r#"<flow id="{from}{to}" from="{from}m" to="m{to}" begin="0" end="900" probability="0.1"/>"#)
    };
    let flows = [flow("n", "s"), flow("e", "w"), flow("s", "e"), flow("w", "n")].concat();
    write("x.rou.xml", &format!("<routes>{flows}</routes>"));
    write(
        "x.sumocfg",
        r#"<configuration><net-file value="x.net.xml"/><route-files value="x.rou.xml"/><step-length value="0.5"/></configuration>"#,
    );
    folder.join("x.sumocfg").display().to_string()
}

fn live(name: &str, vehicles: u32) -> Result<Experiment> {
    let mut scenario = ScenarioSource::default();
    scenario.set("cell.base_station_x_m", 500.0);
    scenario.set("cell.base_station_y_m", 500.0);
    let source = ExperimentSource {
        scenario,
        mobility: format!("sumo:{name}"),
        policies: vec![&clock::KIND],
        vehicles: Some(vehicles),
        worlds: Some(3),
        slots: Some(4000),
        ..ExperimentSource::default()
    };
    source.read()
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn vehicles_of_a_configuration_drive_live() {
    let folder = tempfile::tempdir().expect("a folder");
    let configuration = configuration(folder.path());
    let run = |threads| {
        let experiment = live(&format!("{configuration}@120"), 60).expect("a configuration");
        let pool = host_sim::thread_pool(Some(threads)).expect("threads");
        let results = pool.install(|| experiment.results(|_| ())).expect("SUMO drives");
        (results[0].ages.mean_ms, results[0].ages.by_world_ms.clone())
    };
    let (mean_ms, worlds) = run(1);
    println!("{mean_ms} ms, by world {worlds:?}");
    assert!(mean_ms < 30.0 && worlds[0] != worlds[1], "{mean_ms} {worlds:?}");
    assert_eq!(run(2), (mean_ms, worlds));
    let crowded = live(&format!("{configuration}@120"), 3).expect("a configuration");
    let error = crowded.results(|_| ()).err().expect("too many").to_string();
    assert_eq!(
        error,
        format!(
            "{configuration}: vehicles at once: found more vehicles, expected at most 3 in two steps of SUMO together: set \
             cell.vehicles (--vehicles)"
        )
    );
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_grid_of_points_sweeps_a_configuration() {
    let folder = tempfile::tempdir().expect("a folder");
    let _file = configuration(folder.path());
    let grid = r#"
mobility = "sumo:x.sumocfg@120"
policy = "clock"
worlds = 2
slots = 300
vehicles = 60
"cell.base_station_x_m" = 500
"cell.base_station_y_m" = 500
seed = [1, 2]
"#;
    let path = folder.path().join("grid.toml");
    std::fs::write(&path, grid).expect("written");
    let mut sweep = std::process::Command::new(env!("CARGO_BIN_EXE_host-sim"));
    sweep.arg("sweep").arg("--grid").arg(&path);
    sweep.arg("--out").arg(folder.path().join("results"));
    let output = sweep.output().expect("the program");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn vehicles_move_between_two_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let name = format!("{}@120", configuration(folder.path()));
    let source = LiveSumo::read(&name).expect("a configuration");
    let scenario = live(&name, 60).expect("a configuration").scenario;
    let key = WorldKey {
        seed: 1,
        purpose: Purpose::Evaluation,
        world: 0,
    };
    let mut mobility = source.open(&scenario, &key);
    let (mut places, mut before) = (Vec::new(), Vec::new());
    let mut moved = 0;
    for slot in (0..20_000).step_by(100) {
        mobility.advance(slot, &mut places).expect("SUMO drives");
        assert!(places.is_sorted_by_key(|&(vehicle, _)| vehicle));
        for &(vehicle, place) in &places {
            let known = before.iter().find(|&&(known, _)| known == vehicle);
            let Some(&(_, was)): Option<&(usize, Place)> = known else {
                continue;
            };
            let moved_m = (place.x_m - was.x_m).hypot(place.y_m - was.y_m);
            assert!((moved_m - place.moved_m).abs() < 1e-9, "{was:?} {place:?}");
            // A car over a crossing is drawn straight between two steps; 0.1 s of at most 15 m/s otherwise.
            assert!(moved_m < 3.0, "{was:?} {place:?}");
            moved += usize::from(moved_m > 1.0);
        }
        before.clone_from(&places);
    }
    assert!(moved > 1_000, "{moved}");
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_configuration_that_does_not_fit_is_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let name = configuration(folder.path());
    let error = |name: &str| live(name, 60).map(drop).expect_err("refused").to_string();
    let missing = folder.path().join("nothing.sumocfg").display().to_string();
    assert_eq!(
        error(&missing),
        format!("{missing}: No such file or directory (os error 2)")
    );
    let hour = error(&format!("{name}@hour"));
    assert!(
        hour.ends_with("found hour, expected whole seconds after the @"),
        "{hour}"
    );
    std::fs::remove_file(folder.path().join("x.net.xml")).expect("removed");
    let broken = error(&name);
    assert!(
        broken.starts_with("sumo: found the program ended with exit status: 1; it wrote: Error:")
            && broken.lines().count() == 1,
        "{broken}"
    );
}

/// The built-in traffic and SUMO on the same hours, with streets that fill: trip times of every case agree, and so does their order.
#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn the_built_in_traffic_agrees() {
    let times_s = |traffic| {
        let settings = [
            "planning.horizon_s=600",
            "planning.warmup_s=150",
            "planning.trips_per_pair_veh_per_h=80",
        ];
        let scenario = ScenarioSource {
            settings: settings.map(str::to_owned).to_vec(),
            ..ScenarioSource::default()
        };
        let source = LoopSource {
            scenario,
            policies: vec![&clock::KIND],
            worlds: 1,
            delays_s: Some(vec![60.0]),
            traffic,
            ..LoopSource::default()
        };
        let experiment = source.read().expect("a loop");
        let town = experiment.town().expect("a grid");
        let summary = experiment.summary(&town, |_| ()).expect("an hour");
        let cases = [
            &summary.all_obey,
            &summary.full_knowledge,
            &summary.covered,
            &summary.detected,
            &summary.delayed[0].1,
            &summary.no_information,
        ];
        cases.map(|case| (case.trip_time_s.0, case.queued.0))
    };
    let (own, sumo) = (times_s(Traffic::BuiltIn), times_s(Traffic::Sumo));
    for (own, sumo) in own.iter().zip(&sumo) {
        close_to(own.0, sumo.0, 0.1);
        close_to(own.1, sumo.1, 0.2);
    }
    // What nearly ties is left out: coverage and detection.
    for order in [[0, 1], [1, 4], [4, 5]] {
        let [less, more] = order;
        assert!(
            own[less].0 < own[more].0 && sumo[less].0 < sumo[more].0,
            "{own:?} {sumo:?}"
        );
    }
}

/// Twice as many as the roads carry: queues everywhere, and the built-in traffic still takes as long as SUMO.
#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn the_built_in_traffic_agrees_where_roads_are_full() {
    let settings = [
        "planning.horizon_s=600",
        "planning.warmup_s=150",
        "planning.trips_per_pair_veh_per_h=260",
    ];
    let scenario = ScenarioSource {
        settings: settings.map(str::to_owned).to_vec(),
        ..ScenarioSource::default()
    };
    let scenario = scenario.read().expect("a scenario");
    let town = Town::of_grid(&scenario).expect("a grid");
    let key = WorldKey {
        seed: 1,
        purpose: Purpose::Evaluation,
        world: 0,
    };
    let trips = trips::draw(town.paths(), scenario.planning.horizon_s, &key);
    let incidents = Incidents::none(town.map().block_count());
    let usual = town.free_speeds_m_per_s();
    let world = town.world(key, &trips, &incidents, &usual, &scenario.planning);
    let blind = Case {
        sight: Sight::Blind,
        connected_share: 0.0,
        obeying_share: 0.0,
        fade_s: 1.0,
    };
    let trip_time_s = |traffic: &mut dyn TrafficModel| {
        let outcome = hour::run(world, blind, traffic, &mut Fixed(0.0), |_, _| ());
        outcome.expect("ten minutes").trip_time_s
    };
    let own_s = trip_time_s(&mut Queues::new(town.map(), &incidents));
    let sumo_s = trip_time_s(&mut free(town.map()));
    println!("built-in {own_s} s, SUMO {sumo_s} s");
    close_to(own_s, sumo_s, 0.1);
}

/// A 4 x 4 grid of blocks with trips between any two crossings: free flow, for as much as its lanes carry.
#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn a_grid_holds_nobody_up() {
    const SIDE: u32 = 5;
    let (mut roads, mut places_m, mut block) = (Vec::new(), Vec::new(), 0);
    for node in 0..SIDE * SIDE {
        let (column, row) = (node % SIDE, node / SIDE);
        places_m.push((f64::from(column) * 250.0, f64::from(row) * 433.0));
        let mut both = |other: u32, length_m: f64| {
            roads.push(road(node, other, length_m, 2, block));
            roads.push(road(other, node, length_m, 2, block));
            block += 1;
        };
        if column + 1 < SIDE {
            both(node + 1, 250.0);
        }
        if row + 1 < SIDE {
            both(node + SIDE, 433.0);
        }
    }
    let map = RoadMap::new(roads, places_m).expect("a grid");
    for (trips_per_h, most_extra_s) in [(14_400.0, 4.0), (43_200.0, 12.0)] {
        let mut traffic = free(&map);
        let key = WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let mut stream = key.stream(Role::Mobility, 0);
        let (mut starts_s, mut frees_s) = (Vec::new(), Vec::new());
        let (mut arrived, mut vehicles) = (Vec::new(), Vec::new());
        let (mut second, mut most, mut updates) = (0_u32, 0, 0);
        let begin = std::time::Instant::now();
        while arrived.len() < starts_s.len() || second < 1_200 {
            while second < 1_200 && (starts_s.len() as f64) < f64::from(second) * trips_per_h / 3_600.0 {
                let (from, to) = (stream.below(SIDE * SIDE), stream.below(SIDE * SIDE));
                let mut route = shortest(&map, SIDE, from, to, &mut stream);
                if route.is_empty() {
                    route.push(map.outgoing(from)[0]);
                }
                let free_s: f64 = route
                    .iter()
                    .map(|&road| map.roads()[road as usize].free_time_s())
                    .sum();
                traffic.depart(starts_s.len() as u32, &route).expect("a route");
                starts_s.push(f64::from(second));
                frees_s.push(free_s);
            }
            second += 1;
            assert!(second < 10_000, "the grid is stuck");
            traffic
                .advance(f64::from(second), &mut arrived)
                .expect("SUMO goes on");
            traffic.on_roads(&mut vehicles).expect("places");
            most = most.max(vehicles.len());
            updates += vehicles.len();
        }
        let taken_s = begin.elapsed().as_secs_f64();
        let trips = arrived.len() as f64;
        let mean_s = arrived
            .iter()
            .map(|trip| trip.time_s - starts_s[trip.vehicle as usize])
            .sum::<f64>()
            / trips;
        let free_s = frees_s.iter().sum::<f64>() / trips;
        println!(
            "{trips} trips of {mean_s:.1} s, {free_s:.1} s alone; at most {most} at once; {} let through; {:.0} steps/s, {:.0} \
             vehicle updates/s",
            traffic.let_through(),
            f64::from(second) / taken_s,
            updates as f64 / taken_s
        );
        assert_eq!(traffic.let_through(), 0);
        assert!(
            mean_s > free_s && mean_s < free_s + most_extra_s,
            "{mean_s} {free_s}"
        );
    }
}

/// A way over the fewest crossings: first along one street, then along the other, or the other way round.
fn shortest(map: &RoadMap, side: u32, from: u32, to: u32, stream: &mut Stream) -> Vec<u32> {
    let (mut at, mut route) = (from, Vec::new());
    let columns_first = stream.chance(0.5);
    while at != to {
        let columns = at % side != to % side && (columns_first || at / side == to / side);
        let next = match (columns, at % side < to % side, at / side < to / side) {
            (true, true, _) => at + 1,
            (true, false, _) => at - 1,
            (false, _, true) => at + side,
            (false, _, false) => at - side,
        };
        let leads = |road: &&u32| map.roads()[**road as usize].to == next;
        route.extend(map.outgoing(at).iter().find(leads));
        at = next;
    }
    route
}

/// One of SUMO's programs that only tests need.
fn tool(name: &str, arguments: &[&str], folder: &Path) -> std::process::Output {
    let home = std::env::var_os("SUMO_HOME").map(|home| Path::new(&home).join("bin").join(name));
    let program = home.unwrap_or_else(|| name.into());
    let output = std::process::Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .output();
    output.expect("./test sumo installs it")
}

#[test]
#[ignore = "needs SUMO: ./test sumo"]
fn sumo_can_drive_every_route_of_an_assignment() {
    use assignment::formats::{ImportOptions, import};
    use assignment::imported_demand::Unreachable;
    use assignment::{Options, assign};
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let grid = "--grid --grid.number 8 --grid.length 200 --no-left-connections --no-turnarounds --output-file net.xml";
    let made = tool("netgenerate", &grid.split(' ').collect::<Vec<_>>(), folder.path());
    assert!(made.status.success(), "{made:?}");
    // From every edge to one that a stride away in the file.
    let net = std::fs::read_to_string(path("net.xml")).expect("a network");
    let edges = net
        .split("<edge id=\"")
        .skip(1)
        .filter_map(|rest| rest.split('"').next());
    let edges: Vec<&str> = edges.filter(|id| !id.starts_with(':')).collect();
    let mut trips = String::from("<routes>\n");
    for (index, from) in edges.iter().enumerate() {
        let to = edges[(index + 97) % edges.len()];
        trips += &format!("<trip id=\"{index}\" depart=\"{index}\" from=\"{from}\" to=\"{to}\"/>\n");
    }
    std::fs::write(path("trips.xml"), trips + "</routes>\n").expect("written");
    let mut read = import(
        &path("net.xml"),
        Some(&path("trips.xml")),
        &ImportOptions::default(),
    )
    .expect("read");
    // Without left turns some corners cannot be reached from everywhere.
    read.settle(Unreachable::Drop).expect("left out");
    let solution = assign(&read.network, &read.trips.demand, &Options::default()).expect("solved");
    assert!(solution.converged && solution.path_flows.len() > 100);
    let mut routes = String::from("<routes>\n");
    for (index, way) in solution.path_flows.iter().enumerate() {
        let roads = way
            .links
            .iter()
            .filter_map(|&link| read.roads.names.get(link as usize));
        let roads: Vec<&str> = roads.map(String::as_str).collect();
        let edges = roads.join(" ");
        routes +=
            &format!("<vehicle id=\"{index}\" depart=\"{index}\"><route edges=\"{edges}\"/></vehicle>\n");
    }
    std::fs::write(path("routes.xml"), routes + "</routes>\n").expect("written");
    let checked = tool(
        "duarouter",
        &[
            "--net-file",
            "net.xml",
            "--route-files",
            "routes.xml",
            "--output-file",
            "out.xml",
        ],
        folder.path(),
    );
    assert!(
        checked.status.success(),
        "{}",
        String::from_utf8_lossy(&checked.stderr)
    );
    let driven = std::fs::read_to_string(path("out.xml")).expect("routes");
    assert_eq!(driven.matches("<vehicle ").count(), solution.path_flows.len());
}
