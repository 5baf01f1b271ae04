//! Files as people have them: what is read, what is assumed and said, and what is refused.

// Helpers are no `#[test]` functions, but unwrap as freely.
#![allow(clippy::unwrap_used)]

use assignment::formats::{Import, ImportOptions, import};
use assignment::imported_demand::{Unreachable, format_lost};
use assignment::report::NoteKind;
use assignment::units::Length;
use assignment::{Options, Solution, assign, gmns};
use std::io::Write as _;
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn read(net: &str, trips: &str) -> Import {
    import(&fixture(net), Some(&fixture(trips)), &ImportOptions::default()).unwrap()
}

fn folder(name: &str) -> Import {
    import(&fixture(name), None, &ImportOptions::default()).unwrap()
}

fn solve(import: &Import) -> Solution {
    let options = Options {
        gap: 1e-12,
        ..Options::default()
    };
    assign(&import.network, &import.trips.demand, &options).unwrap()
}

fn close_to(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() <= 1e-4 * expected.abs(),
        "found {found}, expected {expected}"
    );
}

/// Whether a note of this kind holds these words.
fn says(import: &Import, kind: NoteKind, words: &str) -> bool {
    import
        .report
        .notes()
        .any(|(note, _)| note.kind == kind && format!("{}: {}", note.place, note.text).contains(words))
}

/// Files in a folder of their own.
fn files(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn message<T>(result: kit::error::Result<T>) -> String {
    match result {
        Ok(_) => "no error".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn lengths_come_in_the_units_that_the_folder_says_or_shows() {
    // A kilometre at 60 km/h, for 100 vehicles.
    let stated = folder("gmns_config");
    close_to(solve(&stated).total_travel_time, 100.0);
    assert!(says(&stated, NoteKind::Unit, "length: metre, as config.csv says"));
    let by_size = folder("gmns_metres");
    close_to(solve(&by_size).total_travel_time, 100.0);
    assert!(says(
        &by_size,
        NoteKind::Warning,
        "a median of 1000 is taken for metres"
    ));
    let refused = message(by_size.report.refuse_warnings());
    assert!(refused.ends_with("expected none, as --strict asks"), "{refused}");
    // 2,001.51 m at 50 km/h, as its longitudes and latitudes show.
    for name in ["osm2gmns_real", "osm2gmns_capacity_filled"] {
        let shown = folder(name);
        close_to(solve(&shown).link_costs[1], 2.001_51 / 50.0 * 60.0);
        assert!(says(
            &shown,
            NoteKind::Unit,
            "length: metre, as longitudes and latitudes show"
        ));
        assert_eq!(shown.report.warnings().count(), 0);
        assert_eq!(shown.roads.shapes[0].len(), 3);
    }
    let options = ImportOptions {
        length_unit: Some(Length::Kilometre),
        ..ImportOptions::default()
    };
    let told = import(&fixture("gmns_metres"), None, &options).unwrap();
    close_to(solve(&told).total_travel_time, 100_000.0);
}

#[test]
fn what_is_empty_is_put_in_and_counted() {
    let filled = folder("osm2gmns_real");
    let defaults: Vec<_> = filled
        .report
        .notes()
        .filter(|(note, _)| note.kind == NoteKind::Default)
        .map(|(note, times)| (format!("{}: {}", note.place, note.text), times))
        .collect();
    for expected in [
        ("link.csv: capacity: 1000 an hour and lane for residential", 2),
        ("link.csv: capacity: 1800 an hour and lane for primary", 2),
        ("link.csv: free_speed: 30 km/h for residential", 2),
        ("link.csv: lanes: 1", 2),
    ] {
        assert!(
            defaults
                .iter()
                .any(|(text, times)| (text.as_str(), *times) == expected),
            "{expected:?} in {defaults:?}"
        );
    }
    let blank = folder("gmns_blank");
    assert!(says(&blank, NoteKind::Default, "capacity: 900 an hour and lane"));
    let options = ImportOptions {
        lane_capacities: vec![("".to_owned(), 700.0), ("prim".to_owned(), 1_500.0)],
        ..ImportOptions::default()
    };
    let told = import(&fixture("osm2gmns_real"), None, &options).unwrap();
    let capacities: Vec<f64> = told.network.links().iter().map(|link| link.capacity).collect();
    assert_eq!(capacities, [1_500.0, 1_500.0, 700.0, 700.0]);
}

#[test]
fn delay_functions_of_the_folder_are_used() {
    // Two routes of 10 (1 + x / 1000) and 12 (1 + x / 1000) minutes: 7,000 / 11 and 4,000 / 11 vehicles.
    let solution = solve(&folder("gmns_vdf1"));
    close_to(solution.link_flows[0], 7_000.0 / 11.0);
    close_to(solution.link_flows[1], 4_000.0 / 11.0);
}

#[test]
fn cars_stay_off_paths_for_others() {
    let read = folder("gmns_uses");
    assert_eq!(solve(&read).link_flows, [100.0, 100.0]);
    assert!(says(&read, NoteKind::Unused, "links for walk,bike alone"));
}

#[test]
fn a_zone_of_several_nodes_begins_and_ends_at_all_of_them() {
    let read = folder("gmns_zone_many");
    let solution = solve(&read);
    // Two of two roads for each zone: both are used alike.
    for flow in &solution.link_flows[..4] {
        close_to(*flow, 50.0);
    }
    assert_eq!(read.network.roads().len(), 4);
    close_to(solution.total_travel_time, 200.0);
}

const NODES: &str =
    "\u{feff}node_id,zone_id,x_coord,y_coord\n1.0,1.0,0,0\n2.0,2.0,2,0\n3.0,0,1,0\n4,-1,1,1\n";
const LINKS: &str = "link_id,from_node_id,to_node_id,directed,length,free_speed,capacity,lanes\n\
                     a,1.0,3.0,1,1,60,900,1\nb,3.0,2.0,1,1,60,900,1\nc,3,4,1,2,60,900,1\nd,4,2,1,2,60,900,1\n";

#[test]
fn whole_numbers_may_be_written_with_decimals_and_zero_is_no_zone() {
    let folder = files(&[
        ("node.csv", NODES),
        ("link.csv", LINKS),
        ("demand.csv", "o_zone_id,d_zone_id,volume\n1,2,10\n2,2,\n"),
    ]);
    let read = import(folder.path(), None, &ImportOptions::default()).unwrap();
    assert_eq!(read.network.numbering().zones, 2);
    assert_eq!(solve(&read).link_flows, [10.0, 10.0, 0.0, 0.0]);
    assert!(says(&read, NoteKind::Default, "0 where the field is empty"));
}

#[test]
fn movements_are_all_turns_that_there_are_or_penalties_alone() {
    let demand = "o_zone_id,d_zone_id,volume\n1,2,10\n";
    for (rows, flows, cost) in [
        // The straight way is not among the turns.
        ("3,a,c,left,\n", [10.0, 0.0, 10.0, 10.0], 5.0),
        ("3,a,c,left,\n3,a,b,thru,\n", [10.0, 10.0, 0.0, 0.0], 2.0),
        // 90 s are less than the two minutes of the detour.
        ("3,a,b,thru,90\n", [10.0, 10.0, 0.0, 0.0], 3.5),
        ("3,a,b,thru,240\n", [10.0, 0.0, 10.0, 10.0], 5.0),
    ] {
        let movements = format!("node_id,ib_link_id,ob_link_id,type,penalty\n{rows}");
        let folder = files(&[
            ("node.csv", NODES),
            ("link.csv", LINKS),
            ("movement.csv", &movements),
            ("demand.csv", demand),
        ]);
        let read = import(folder.path(), None, &ImportOptions::default()).unwrap();
        let solution = solve(&read);
        assert_eq!(solution.link_flows[..4], flows, "{rows}");
        close_to(solution.total_travel_time, 10.0 * cost);
    }
}

#[test]
fn units_that_contradict_coordinates_are_refused() {
    let config = "long_length,speed\nmile,mph\n";
    let osm = |name: &str| std::fs::read_to_string(fixture("osm2gmns_real").join(name)).unwrap();
    let folder = files(&[
        ("config.csv", config),
        ("node.csv", &osm("node.csv")),
        ("link.csv", &osm("link.csv")),
        ("demand.csv", &osm("demand.csv")),
    ]);
    let failure = message(import(folder.path(), None, &ImportOptions::default()));
    let expected = "config.csv:2: long_length: found mile, expected metre, in which the lengths are what the coordinates say; \
                    --length-unit decides";
    assert!(failure.ends_with(expected), "{failure}");
    std::fs::write(folder.path().join("config.csv"), "long_length\nfurlong\n").unwrap();
    let failure = message(import(folder.path(), None, &ImportOptions::default()));
    let expected = "found `furlong`, expected meter, kilometer, foot or mile";
    assert!(failure.ends_with(expected), "{failure}");
}

#[test]
fn trips_without_a_path_are_named_or_left_out() {
    let mut read = read("unreachable_net.tntp", "unreachable_trips.tntp");
    assert_eq!(
        format_lost(read.trips.lost.iter().map(|lost| ("", lost))),
        "origin,destination,volume,reason\n1,3,1,no path\n"
    );
    assert_eq!(
        message(read.settle(Unreachable::Fail)),
        "trips: found 1 vehicles without a path, by pairs 1: 1 to 3, expected a path for every trip; --unreachable drop \
         leaves them out, --unreachable-pairs lists all"
    );
    read.settle(Unreachable::Drop).unwrap();
    assert_eq!((read.trips.demand.pairs(), read.trips.demand.total()), (1, 100.0));
    assert_eq!(solve(&read).link_flows, [100.0, 0.0]);
    // A zone that the network does not have.
    let folder = files(&[
        ("node.csv", NODES),
        ("link.csv", LINKS),
        ("demand.csv", "o_zone_id,d_zone_id,volume\n1,2,10\n1,7,3\n"),
    ]);
    let mut read = import(folder.path(), None, &ImportOptions::default()).unwrap();
    let failure = message(read.settle(Unreachable::Fail));
    assert!(
        failure.ends_with(
            "demand.csv:3: d_zone_id: found `7`, expected a zone of the network; --unreachable drop leaves such rows out"
        ),
        "{failure}"
    );
    read.settle(Unreachable::Drop).unwrap();
    assert_eq!(read.trips.demand.total(), 10.0);
}

/// A square of two-way roads: 1 and 4 are opposite corners, 2 the quick way between them, 3 the slow one.
const SQUARE: &str = "<NUMBER OF ZONES> 4\n<NUMBER OF NODES> 4\n<FIRST THRU NODE> 1\n<NUMBER OF LINKS> 8\n<END OF METADATA>\n\
                      1 2 100 1 1 0 4 0 0;\n2 4 100 1 1 0 4 0 0;\n1 3 100 1 3 0 4 0 0;\n3 4 100 1 3 0 4 0 0;\n\
                      2 1 100 1 1 0 4 0 0;\n4 2 100 1 1 0 4 0 0;\n3 1 100 1 3 0 4 0 0;\n4 3 100 1 3 0 4 0 0;\n";
const SQUARE_TRIPS: &str = "<NUMBER OF ZONES> 4\n<TOTAL OD FLOW> 12\n<END OF METADATA>\n\
                            Origin 1\n4 : 10.0; 2 : 1.0;\nOrigin 2\n4 : 1.0;\n";

#[test]
fn turns_of_a_table_are_banned_or_cost_time() {
    let folder = files(&[("net.tntp", SQUARE), ("trips.tntp", SQUARE_TRIPS)]);
    let path = |name: &str| folder.path().join(name);
    let with_turns = |rows: &str| {
        std::fs::write(
            path("turns.csv"),
            format!("from_node,via_node,to_node,penalty\n{rows}"),
        )
        .unwrap();
        let options = ImportOptions {
            turns: Some(path("turns.csv")),
            ..ImportOptions::default()
        };
        import(&path("net.tntp"), Some(&path("trips.tntp")), &options)
    };
    let total = |rows: &str| solve(&with_turns(rows).unwrap()).total_travel_time;
    // Trips that begin or end at the node do not turn there.
    close_to(total("1,2,4,1.5\n"), 10.0 * 3.5 + 2.0);
    close_to(total("1,2,4,\n"), 10.0 * 6.0 + 2.0);
    // With the slow way closed as well, the trips turn round at the corner, which nothing forbids: 1-2-1-3-4 does not help.
    let cut = with_turns("1,2,4,\n1,3,4,\n").unwrap();
    assert_eq!(cut.trips.lost.len(), 1);
    assert_eq!(
        (
            cut.trips.lost[0].origin.as_str(),
            cut.trips.lost[0].destination.as_str()
        ),
        ("1", "4")
    );
    let solution = solve(&with_turns("1,2,4,\n").unwrap());
    assert_eq!(solution.link_flows[..4], [1.0, 1.0, 10.0, 10.0]);
    for (rows, expected) in [
        (
            "1,2,3,\n",
            "turns.csv:2: to_node: found `3`, expected a node that a road joins with via_node",
        ),
        (
            "1,2,9,\n",
            "turns.csv:2: to_node: found `9`, expected a node of the network",
        ),
        (
            "1,2,4,-1\n",
            "turns.csv:2: penalty: found `-1`, expected a finite number, not negative",
        ),
        (
            "1,2,4,\n1,2,4,2\n",
            "turns.csv:3: via_node: found `2`, expected each turn once",
        ),
    ] {
        let failure = message(with_turns(rows));
        assert!(failure.ends_with(expected), "{failure}");
    }
}

#[test]
fn a_network_with_turns_survives_the_way_through_gmns() {
    let folder = files(&[
        ("net.tntp", SQUARE),
        ("trips.tntp", SQUARE_TRIPS),
        (
            "turns.csv",
            "from_node,via_node,to_node,penalty\n1,2,4,1.5\n4,2,1,\n",
        ),
    ]);
    let path = |name: &str| folder.path().join(name);
    let options = ImportOptions {
        turns: Some(path("turns.csv")),
        ..ImportOptions::default()
    };
    let read = import(&path("net.tntp"), Some(&path("trips.tntp")), &options).unwrap();
    for (name, text) in gmns::format_network(&read.network, &gmns::Extras::default()) {
        std::fs::write(path(&name), text).unwrap();
    }
    std::fs::write(
        path("demand.csv"),
        gmns::format_demand(&read.network, &read.trips.demand),
    )
    .unwrap();
    let again = import(folder.path(), None, &ImportOptions::default()).unwrap();
    assert_eq!(again.network.links(), read.network.links());
    assert_eq!(solve(&again).link_flows, solve(&read).link_flows);
}

#[test]
fn tntp_files_may_round_their_totals_and_leave_out_the_last_column() {
    let nine = read("nine_cols_net.tntp", "two_trips.tntp");
    assert_eq!(solve(&nine).link_flows, [100.0, 0.0]);
    let trips = |total: &str| {
        let text = format!(
            "\u{feff}<NUMBER OF ZONES> 2\n<TOTAL OD FLOW> {total}\n<END OF METADATA>\nOrigin 1\n2 : 25225746.76;\n"
        );
        let folder = files(&[("trips.tntp", &text)]);
        let trips = folder.path().join("trips.tntp");
        message(import(
            &fixture("two_net.tntp"),
            Some(&trips),
            &ImportOptions::default(),
        ))
    };
    assert_eq!(trips("2.52257e+007"), "no error");
    assert_eq!(trips("25225746.8"), "no error");
    let failure = trips("2.5225e+007");
    assert!(
        failure.ends_with(
            "found trips that add up to 25225746.76, expected 25225000, as <TOTAL OD FLOW> states"
        )
    );
    let infinite = message(import(
        &fixture("two_net.tntp"),
        Some(&fixture("total_inf_trips.tntp")),
        &ImportOptions::default(),
    ));
    assert!(infinite.ends_with("<TOTAL OD FLOW>: found inf, expected a finite number, not negative"));
}

#[test]
fn demand_comes_as_pairs_or_as_a_matrix_beside_any_network() {
    let net = fixture("SiouxFalls_net.tntp");
    let folder = files(&[
        ("pairs.csv", "O,D,Ton\n1,2,100\n3,1,50\n"),
        ("matrix.csv", "zone,1,2,3\n1,0,100,\n3,50,0,0\n"),
        ("tazs.csv", "orig_taz,dest_taz,total,name\n1,2,100,x\n3,1,50,y\n"),
    ]);
    for name in ["pairs.csv", "matrix.csv", "tazs.csv"] {
        let read = import(&net, Some(&folder.path().join(name)), &ImportOptions::default()).unwrap();
        let trips: Vec<_> = read
            .trips
            .demand
            .trips()
            .map(|trip| (trip.origin, trip.destination, trip.volume))
            .collect();
        assert_eq!(trips, [(1, 2, 100.0), (3, 1, 50.0)], "{name}");
    }
    // A trip table beside GMNS: its numbers are names of zones.
    let gmns = files(&[("node.csv", NODES), ("link.csv", LINKS)]);
    let trips = fixture("two_trips.tntp");
    let read = import(gmns.path(), Some(&trips), &ImportOptions::default()).unwrap();
    assert_eq!(read.trips.demand.total(), 100.0);
    let unknown = files(&[("trips.csv", "a,b,c,d\n1,2,3,4\n")]);
    let failure = message(import(
        &net,
        Some(&unknown.path().join("trips.csv")),
        &ImportOptions::default(),
    ));
    assert!(failure.ends_with("trips.csv:1: found no column `o_zone_id`, expected it in the first line"));
}

#[test]
fn cars_turn_where_sumo_has_a_connection() {
    let banned = read("sumo_turn/net.xml", "sumo_turn/trips.xml");
    assert_eq!(banned.trips.lost.len(), 1);
    let flow = read("sumo_turn/net.xml", "sumo_turn/flow.xml");
    assert!(flow.trips.lost.is_empty());
    assert_eq!(flow.trips.demand.total(), 300.0);
    let solution = solve(&flow);
    let used = flow.roads.names.iter().zip(&solution.link_flows);
    let used: Vec<&str> = used
        .filter(|(_, flow)| **flow > 0.0)
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(used, ["CS", "NC"]);
    let two = read("sumo_turn/net.xml", "sumo_turn/two.xml");
    assert!(says(
        &two,
        NoteKind::Default,
        "vehicles of class bus count as a car each"
    ));
    assert!(says(&two, NoteKind::Unused, "persons and containers"));
    assert!(says(
        &two,
        NoteKind::Warning,
        "departures span 2.0 h and count as one hour's: --demand-factor 0.500"
    ));
}

#[test]
fn sumo_trips_lead_between_zones_of_edges_and_may_be_compressed() {
    let net = std::fs::read(fixture("sumo_turn/net.xml")).unwrap();
    let folder = files(&[
        (
            "zones.xml",
            "<additional><tazs><taz id=\"1\" edges=\"NC WC\"/><taz id=\"2\"><tazSink id=\"CS\" weight=\"1\"/></taz></tazs></additional>",
        ),
        (
            "od.xml",
            "<routes><flow id=\"f\" begin=\"0\" end=\"3600\" number=\"40\" fromTaz=\"1\" toTaz=\"2\"/></routes>",
        ),
        ("od.csv", "from,to,trips\n1,2,40\nNC,CS,5\n"),
    ]);
    let path = |name: &str| folder.path().join(name);
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(&net).unwrap();
    let packed = packed.finish().unwrap();
    std::fs::write(path("net.xml.gz"), &packed).unwrap();
    let options = ImportOptions {
        taz: Some(path("zones.xml")),
        ..ImportOptions::default()
    };
    let read = import(&path("net.xml.gz"), Some(&path("od.xml")), &options).unwrap();
    assert_eq!(
        (read.trips.demand.total(), read.network.zone_name(1).as_ref()),
        (40.0, "1")
    );
    assert!(read.trips.lost.is_empty());
    let table = import(&path("net.xml.gz"), Some(&path("od.csv")), &options).unwrap();
    assert_eq!(
        (table.trips.demand.total(), table.network.numbering().zones),
        (45.0, 4)
    );
    let without = message(import(
        &path("net.xml.gz"),
        Some(&path("od.xml")),
        &ImportOptions::default(),
    ));
    assert!(
        without.ends_with("od.xml:1: found fromTaz=\"1\", expected a <taz> that came before, or of --taz")
    );
    std::fs::write(path("net.xml.gz"), &packed[..packed.len() / 2]).unwrap();
    let mut bomb = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut bomb, &vec![b' '; 20 << 20]).unwrap();
    std::fs::write(path("bomb.xml.gz"), bomb.finish().unwrap()).unwrap();
    let bomb = message(import(&path("bomb.xml.gz"), Some(&path("od.xml")), &options));
    assert!(
        bomb.ends_with("bytes when unpacked, expected at most 100 times the file's size"),
        "{bomb}"
    );
    let half = message(import(&path("net.xml.gz"), Some(&path("od.xml")), &options));
    assert!(
        half.ends_with("net.xml.gz: found a truncated gzip file, expected all of it"),
        "{half}"
    );
}

#[cfg(feature = "omx")]
#[test]
fn demand_and_skims_go_through_open_matrix() {
    use assignment::{omx, skims};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trips.omx");
    let zones = ["2", "1", "3"].map(str::to_owned);
    let day = vec![0.0, 5.0, f64::NAN, 1.5, 0.0, 2.0, 0.0, 0.0, 0.0];
    let bytes = omx::format(&zones, &[("day", day.clone()), ("night", vec![0.0; 9])]).unwrap();
    std::fs::write(&path, &bytes).unwrap();
    let net = fixture("SiouxFalls_net.tntp");
    let import_matrix = |name: Option<&str>| {
        let options = ImportOptions {
            matrix: name.map(str::to_owned),
            ..ImportOptions::default()
        };
        import(&net, Some(&path), &options)
    };
    let read = import_matrix(Some("day")).unwrap();
    let trips: Vec<_> = read
        .trips
        .demand
        .trips()
        .map(|trip| (trip.origin, trip.destination, trip.volume))
        .collect();
    // Rows and columns are called 2, 1, 3.
    assert_eq!(trips, [(1, 2, 1.5), (1, 3, 2.0), (2, 1, 5.0)]);
    assert!(says(&read, NoteKind::Default, "0 where the matrix has no number"));
    assert!(
        message(import_matrix(None))
            .ends_with("expected a matrix by --matrix, or `matrix` of a class, one of: day, night")
    );
    assert!(
        message(import_matrix(Some("noon"))).ends_with("matrix: found `noon`, expected one of: day, night")
    );
    // Skims of a solution, read as if they were trips.
    let costs = read.network.link_costs(&vec![0.0; read.network.links().len()]);
    let found = skims::skims(&read.network, &costs).unwrap();
    std::fs::write(
        &path,
        skims::format_omx(&read.network, &[("", found.clone())]).unwrap(),
    )
    .unwrap();
    let again = import_matrix(Some("cost")).unwrap();
    assert_eq!(again.trips.demand.pairs(), 24 * 23);
    close_to(
        again.trips.demand.total(),
        found.iter().map(|skim| skim.cost).sum(),
    );
    for (bytes, expected) in [
        (&bytes[..bytes.len() / 2], "expected an Open Matrix (OMX) file"),
        (&bytes[..100], "expected an Open Matrix (OMX) file"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let failure = message(import_matrix(Some("day")));
        assert!(failure.ends_with(expected), "{failure}");
    }
    let negative = omx::format(&zones[..1], &[("day", vec![-1.0])]).unwrap();
    std::fs::write(&path, negative).unwrap();
    let failure = message(import_matrix(None));
    assert!(
        failure.ends_with("/data/day: row 1, column 1: found -1, expected a finite number, not negative"),
        "{failure}"
    );
}

#[test]
fn flows_of_roads_alone_are_judged_where_all_else_is_free() {
    use assignment::check::evaluate;
    use assignment::{Objective, Text, flow_table};
    for read in [
        folder("gmns_zone_many"),
        read("sumo_turn/net.xml", "sumo_turn/flow.xml"),
    ] {
        let solution = solve(&read);
        let roads = read.network.roads().iter().zip(&solution.link_flows);
        let rows = roads.map(|(road, flow)| {
            let [from, to] = [road.init_node, road.term_node].map(|node| read.network.node_name(node));
            format!("{from},{to},{flow}\n")
        });
        let text = Text::new(
            "flows",
            &format!("from_node_id,to_node_id,volume\n{}", rows.collect::<String>()),
        );
        let flows = flow_table::read(&text, &read.network, &read.roads.names).unwrap();
        assert_eq!(flows.len(), read.network.roads().len());
        let whole = evaluate(
            &read.network,
            &read.trips.demand,
            Objective::UserEquilibrium,
            &solution.link_flows,
        )
        .unwrap();
        let alone = evaluate(
            &read.network,
            &read.trips.demand,
            Objective::UserEquilibrium,
            &flows,
        )
        .unwrap();
        assert_eq!(
            (alone.relative_gap, alone.objective),
            (whole.relative_gap, whole.objective)
        );
        assert!(whole.conserves_demand && alone.conserves_demand);
        let twice: Vec<f64> = flows.iter().map(|flow| 2.0 * flow).collect();
        let twice = evaluate(
            &read.network,
            &read.trips.demand,
            Objective::UserEquilibrium,
            &twice,
        )
        .unwrap();
        assert!(!twice.conserves_demand);
    }
}
