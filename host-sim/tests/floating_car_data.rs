//! Traces of SUMO: what is read, what is refused, and where vehicles are between two records.

use flate2::{Compression, write::GzEncoder};
use host_sim::mobility::floating_car_data::{Position, Trace};
use proptest::prelude::*;
use std::io::Write as _;
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn parse(text: &str) -> Result<Trace, String> {
    Trace::parse("t.xml", text.as_bytes()).map_err(|error| error.to_string())
}

fn message(text: &str) -> String {
    match parse(text) {
        Err(message) => message,
        Ok(_) => panic!("was accepted: {text}"),
    }
}

fn place(x_m: f64, y_m: f64, speed_m_per_s: f64) -> Position {
    Position {
        x_m,
        y_m,
        speed_m_per_s,
    }
}

fn sampled(trace: &Trace, slot: u32) -> Vec<(usize, Position)> {
    trace.positions_at(slot).collect()
}

/// A trace around `body`, which begins on line 2.
fn export(body: &str) -> String {
    format!("<fcd-export>\n{body}\n</fcd-export>")
}

#[test]
fn vehicles_leave_before_a_gap_and_come_back() {
    let trace = Trace::read(&fixture("fcd-gap.xml")).unwrap();
    assert_eq!(trace.vehicle_ids(), ["a", "b", "c"]);
    assert_eq!(trace.step_count(), 5);
    assert_eq!(trace.duration_slots(), 600);
    assert_eq!(trace.max_simultaneous(), (2, 100));

    assert_eq!(sampled(&trace, 0), [(0, place(0.0, 100.0, 10.0))]);
    assert_eq!(sampled(&trace, 50), [(0, place(0.5, 100.0, 11.0))]);
    assert_eq!(
        sampled(&trace, 100),
        [(0, place(1.0, 100.0, 12.0)), (1, place(50.0, -8.0, 0.0))]
    );
    assert_eq!(
        sampled(&trace, 101).len(),
        1,
        "a has left at its last record before the gap"
    );
    assert_eq!(sampled(&trace, 150), [(1, place(50.0, -7.5, 10.0))]);
    assert_eq!(
        sampled(&trace, 200),
        [(1, place(50.0, -7.0, 20.0)), (2, place(7.0, 7.0, 1.0))]
    );
    assert_eq!(sampled(&trace, 201), []);
    assert_eq!(sampled(&trace, 499), []);
    assert_eq!(sampled(&trace, 500), [(0, place(4.0, 100.0, 10.0))]);
    assert_eq!(sampled(&trace, 550), [(0, place(4.5, 99.0, 10.0))]);
    assert_eq!(sampled(&trace, 600), [(0, place(5.0, 98.0, 10.0))]);
    assert_eq!(sampled(&trace, 601), []);
    assert_eq!(sampled(&trace, u32::MAX), []);
}

#[test]
fn a_cursor_sees_what_a_single_look_sees() {
    let trace = Trace::read(&fixture("fcd-gap.xml")).unwrap();
    let mut cursor = trace.cursor();
    for slot in (0..700).chain([3, 599, 0, 600, 250, u32::MAX, 100]) {
        let through_cursor: Vec<_> = cursor.advance_to(slot).collect();
        assert_eq!(through_cursor, sampled(&trace, slot), "slot {slot}");
    }
}

#[test]
fn gzip_is_seen_by_its_content() {
    let text = std::fs::read(fixture("fcd-gap.xml")).unwrap();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&text).unwrap();
    let compressed = encoder.finish().unwrap();
    let folder = tempfile::tempdir().unwrap();

    let misnamed = folder.path().join("trace.xml");
    std::fs::write(&misnamed, &compressed).unwrap();
    assert_eq!(Trace::read(&misnamed).unwrap().vehicle_ids(), ["a", "b", "c"]);

    let cut = folder.path().join("cut.xml.gz");
    std::fs::write(&cut, &compressed[..compressed.len() / 2]).unwrap();
    let message = Trace::read(&cut).unwrap_err().to_string();
    assert!(message.contains("cut.xml.gz:"), "{message}");
    assert!(message.ends_with("expected a whole, undamaged file"), "{message}");

    let empty = folder.path().join("empty.xml");
    std::fs::write(&empty, "").unwrap();
    let expected = format!(
        "{}:1: found the end of the file, expected <fcd-export>",
        empty.display()
    );
    assert_eq!(Trace::read(&empty).unwrap_err().to_string(), expected);

    let missing = folder.path().join("missing.xml");
    let message = Trace::read(&missing).unwrap_err().to_string();
    assert!(message.starts_with(&missing.display().to_string()), "{message}");
}

#[test]
fn text_that_is_no_trace_is_refused() {
    let cases = [
        ("", "t.xml:1: found the end of the file, expected <fcd-export>"),
        (
            "time,x,y\n1,2,3\n",
            "t.xml:1: found text 'time,x,y 1,2,3', expected <fcd-export>",
        ),
        (
            "<?xml version=\"1.0\"?>\n\n<net version=\"1\">\n</net>",
            "t.xml:3: found <net>, expected <fcd-export>",
        ),
        (
            "<fcd-export>\n  <timestep time=\"0.0\">\n",
            "t.xml:3: found the end of the file, expected <vehicle> or </timestep>",
        ),
        (
            "<fcd-export>\n  <timestep time=\"0.0\">\n    <vehicle id=\"a\" x=\"1",
            "t.xml:3: found broken XML (attribute value not closed: `\"` not found before end of input), expected well-formed XML",
        ),
        (
            "<fcd-export>\n<timestep time=\"0\">\n</fcd-export>",
            "t.xml:3: found </fcd-export>, expected </timestep>",
        ),
        (
            "<fcd-export/>",
            "t.xml:1: found no time step, expected at least one <timestep>",
        ),
        (
            "<fcd-export>\n<timestep time=\"0\"/>\n<timestep time=\"1\"/>\n</fcd-export>\n",
            "t.xml:5: found no vehicle in any time step, expected at least one <vehicle>",
        ),
        (
            "<fcd-export>\n<timestep time=\"0\"/>\n</fcd-export>\n<fcd-export/>",
            "t.xml:4: found <fcd-export>, expected nothing after </fcd-export>",
        ),
        (
            "<fcd-export>\n\n  stray\n</fcd-export>",
            "t.xml:3: found text 'stray', expected <timestep> or </fcd-export>",
        ),
        (
            "<fcd-export>\n<vehicle id=\"a\" x=\"1\" y=\"1\" speed=\"1\"/>\n</fcd-export>",
            "t.xml:2: found <vehicle>, expected <timestep> or </fcd-export>",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(message(text), expected);
    }
    let not_utf8 = Trace::parse("t.xml", &b"<fcd-export>\n<timestep time=\"\xff\"/>"[..]);
    assert_eq!(
        not_utf8.unwrap_err().to_string(),
        "t.xml:2: found bytes that are not UTF-8, expected UTF-8 text"
    );
}

#[test]
fn a_small_file_cannot_claim_much_memory() {
    let folder = tempfile::tempdir().unwrap();
    let packed = |name: &str, parts: &[&[u8]]| {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(b"<fcd-export>").unwrap();
        for part in parts {
            encoder.write_all(part).unwrap();
        }
        let path = folder.path().join(name);
        std::fs::write(&path, encoder.finish().unwrap()).unwrap();
        Trace::read(&path).unwrap_err().to_string()
    };
    let blanks = vec![b' '; 2 << 20];
    let message = packed("text.xml.gz", &[&blanks]);
    assert!(message.contains("a text of more than 1048576 bytes"), "{message}");
    let message = packed("tag.xml.gz", &[b"<", &blanks]);
    assert!(message.contains("an element or a text of more than"), "{message}");
    // Comments of bearable length, in all a thousand times the file.
    let comment = [b"<!--", &blanks[..1 << 19], b"-->"].concat();
    let message = packed("many.xml.gz", &vec![comment.as_slice(); 80]);
    assert!(
        message.contains("more than a hundred times its size"),
        "{message}"
    );
}

#[test]
fn a_bad_vehicle_is_refused() {
    let cases = [
        (
            "x=\"1\" y=\"2\" speed=\"3\"",
            "<vehicle> without 'id', expected an attribute 'id'",
        ),
        (
            "id=\"a\" y=\"2\" speed=\"3\"",
            "<vehicle> without 'x', expected an attribute 'x'",
        ),
        (
            "id=\"a\" x=\"1\" speed=\"3\"",
            "<vehicle> without 'y', expected an attribute 'y'",
        ),
        (
            "id=\"a\" x=\"1\" y=\"2\"",
            "<vehicle> without 'speed', expected an attribute 'speed'",
        ),
        (
            "id=\"a\" x=\"NaN\" y=\"2\" speed=\"3\"",
            "x=\"NaN\", expected a number from -40000000 to 40000000",
        ),
        (
            "id=\"a\" x=\"1\" y=\"-inf\" speed=\"3\"",
            "y=\"-inf\", expected a number from -40000000 to 40000000",
        ),
        (
            "id=\"a\" x=\"1\" y=\"2\" speed=\"1e999\"",
            "speed=\"1e999\", expected a number from 0 to 343",
        ),
        (
            "id=\"a\" x=\"1,5\" y=\"2\" speed=\"3\"",
            "x=\"1,5\", expected a number from -40000000 to 40000000",
        ),
        (
            "id=\"a\" x=\"\" y=\"2\" speed=\"3\"",
            "x=\"\", expected a number from -40000000 to 40000000",
        ),
        (
            "id=\"a\" x=\"1\" y=\"2\" speed=\"-0.1\"",
            "speed=\"-0.1\", expected a number from 0 to 343",
        ),
    ];
    for (attributes, expected) in cases {
        let text = export(&format!(
            "<timestep time=\"0\">\n\n<vehicle {attributes}/>\n</timestep>"
        ));
        assert_eq!(message(&text), format!("t.xml:4: found {expected}"));
    }
    let vehicle = "<vehicle id=\"a\" x=\"1\" y=\"2\" speed=\"3\"/>";
    let twice = export(&format!(
        "<timestep time=\"0\">\n{vehicle}\n{vehicle}\n</timestep>"
    ));
    assert_eq!(
        message(&twice),
        "t.xml:4: found vehicle 'a' a second time, expected every vehicle once in a time step"
    );
    let doubled = export(
        "<timestep time=\"0\">\n<vehicle id=\"a\" id=\"b\" x=\"1\" y=\"2\" speed=\"3\"/>\n</timestep>",
    );
    assert!(
        message(&doubled).starts_with("t.xml:3: found broken XML"),
        "{}",
        message(&doubled)
    );
    let nested = export("<timestep time=\"0\">\n<tram id=\"a\"/>\n</timestep>");
    assert_eq!(
        message(&nested),
        "t.xml:3: found <tram>, expected <vehicle> or </timestep>"
    );
}

#[test]
fn times_are_exact_and_ascending() {
    for wrong in [
        "",
        ".",
        "1.",
        ".5",
        "1e3",
        "+1",
        "0:10:00",
        "NaN",
        "0.0001",
        "1.2345",
        "99999999999999999999",
        "१",
    ] {
        assert_eq!(
            message(&export(&format!("<timestep time=\"{wrong}\"/>"))),
            format!(
                "t.xml:2: found time=\"{wrong}\", expected seconds in decimal digits, in whole milliseconds"
            )
        );
    }
    assert_eq!(
        message(&export("<timestep/>")),
        "t.xml:2: found <timestep> without 'time', expected an attribute 'time'"
    );
    for (first, second) in [("600.10", "600.1"), ("2.000", "1.999"), ("-1", "-1.001")] {
        let text = export(&format!(
            "<timestep time=\"{first}\"/>\n<timestep time=\"{second}\"/>"
        ));
        let (first, second): (f64, f64) = (first.parse().unwrap(), second.parse().unwrap());
        assert_eq!(
            message(&text),
            format!(
                "t.xml:3: found time={second:.3} s, expected a time after the previous step's {first:.3} s"
            )
        );
    }
    let far = export("<timestep time=\"-1\"/>\n<timestep time=\"4294966.296\"/>");
    assert_eq!(
        message(&far),
        "t.xml:3: found time=4294966.296 s, expected at most 4294967.295 s after the first step's -1.000 s"
    );
    let vehicle = "<vehicle id=\"a\" x=\"1\" y=\"2\" speed=\"0\"/>";
    let trace = parse(&export(&format!(
        "<timestep time=\"-0.001\">{vehicle}</timestep><timestep time=\"0.2990000\">{vehicle}</timestep>"
    )));
    assert_eq!(trace.unwrap().duration_slots(), 300);
}

#[test]
fn markup_in_a_name_is_resolved() {
    let trace = parse(&export(
        "<timestep time=\"0\"><vehicle id=\"a&amp;b &#x20AC;\" x=\"1\" y=\"2\" speed=\"0\"><!-- none --></vehicle></timestep>",
    ));
    assert_eq!(trace.unwrap().vehicle_ids(), ["a&b €"]);
}

#[test]
fn a_real_trace_is_read_whole() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/sumo/fcd.xml.gz");
    if !path.exists() {
        println!(
            "NOT CHECKED: {} is missing; the small fixture is read instead",
            path.display()
        );
        assert_eq!(Trace::read(&fixture("fcd-gap.xml")).unwrap().step_count(), 5);
        return;
    }
    let trace = Trace::read(&path).unwrap();
    assert_eq!(trace.step_count(), 1_200);
    assert_eq!(trace.duration_slots(), 119_900);
    assert_eq!(trace.vehicle_ids().len(), 70);
    assert_eq!(trace.vehicle_ids()[..3], ["cv196", "cv204", "cv206"]);
    assert_eq!(trace.vehicle_ids()[69], "cv283");
    assert_eq!(trace.max_simultaneous(), (40, 43_500));
    assert_eq!(sampled(&trace, 0)[0], (0, place(177.91, 1294.20, 12.64)));
    assert_eq!(sampled(&trace, 100)[1], (1, place(745.20, 72.96, 12.83)));
    assert_eq!(sampled(&trace, 60_000)[0], (2, place(745.20, 15.87, 11.77)));
    let (vehicle, halfway) = sampled(&trace, 50)[0];
    assert_eq!(vehicle, 0);
    assert!((halfway.x_m - (177.91 + 179.18) / 2.0).abs() < 1e-9);
    assert!((halfway.speed_m_per_s - 12.66).abs() < 1e-9);

    let mut cursor = trace.cursor();
    let records: usize = (0..=trace.duration_slots())
        .step_by(100)
        .map(|slot| cursor.advance_to(slot).count())
        .sum();
    assert_eq!(records, 37_175);
}

/// East, north and speed, if the vehicle is there.
type MaybeVehicle = Option<(f64, f64, f64)>;

/// Steps of (milliseconds since the step before, its vehicles).
fn any_steps() -> impl Strategy<Value = Vec<(u32, Vec<MaybeVehicle>)>> {
    let coordinate = || prop_oneof![-1e4..1e4, Just(0.1), Just(4e7), Just(-4e7)];
    let vehicle = proptest::option::weighted(0.7, (coordinate(), coordinate(), 0.0..60.0));
    proptest::collection::vec((1_u32..500, proptest::collection::vec(vehicle, 4)), 1..12)
}

proptest! {
    #[test]
    fn positions_lie_between_their_neighbours(steps in any_steps()) {
        let mut slots = Vec::new();
        let mut body = String::new();
        let mut time_ms = 0;
        for (gap_ms, vehicles) in &steps {
            time_ms += gap_ms;
            slots.push(time_ms);
            body += &format!("<timestep time=\"{}.{:03}\">", time_ms / 1_000, time_ms % 1_000);
            for (name, vehicle) in vehicles.iter().enumerate() {
                if let Some((x, y, speed)) = vehicle {
                    body += &format!("<vehicle id=\"{name}\" x=\"{x}\" y=\"{y}\" speed=\"{speed}\"/>");
                }
            }
            body += "</timestep>\n";
        }
        let Ok(trace) = parse(&export(&body)) else {
            prop_assert!(steps.iter().all(|(_, vehicles)| vehicles.iter().all(Option::is_none)));
            return Ok(());
        };
        let mut cursor = trace.cursor();
        for slot in 0..=slots[slots.len() - 1] - slots[0] + 5 {
            let found: Vec<_> = cursor.advance_to(slot).collect();
            let step = slots.partition_point(|time| time - slots[0] <= slot) - 1;
            let exact = slots[step] - slots[0] == slot;
            let empty = vec![None; 4];
            let before = &steps[step].1;
            let after = if exact { before } else { steps.get(step + 1).map_or(&empty, |later| &later.1) };
            let mut expected = 0;
            for (name, pair) in before.iter().zip(after).enumerate() {
                let (Some(from), Some(to)) = pair else { continue };
                expected += 1;
                let index = trace.vehicle_ids().iter().position(|id| *id == name.to_string());
                let here = found.iter().find(|(vehicle, _)| Some(*vehicle) == index);
                prop_assert!(here.is_some());
                if let Some((_, here)) = here {
                    prop_assert!(from.0.min(to.0) <= here.x_m && here.x_m <= from.0.max(to.0));
                    prop_assert!(from.1.min(to.1) <= here.y_m && here.y_m <= from.1.max(to.1));
                    prop_assert!(from.2.min(to.2) <= here.speed_m_per_s && here.speed_m_per_s <= from.2.max(to.2));
                    prop_assert!(!exact || (here.x_m == from.0 && here.y_m == from.1));
                }
            }
            prop_assert_eq!(found.len(), expected);
            prop_assert!(found.windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
    }

    #[test]
    fn damaged_bytes_never_panic(position in 0_usize..2_000, byte in any::<u8>(), length in 0_usize..2_000) {
        let mut bytes = std::fs::read(fixture("fcd-gap.xml")).unwrap();
        let position = position % bytes.len();
        bytes[position] = byte;
        bytes.truncate(length);
        let _outcome = Trace::parse("damaged", bytes.as_slice());
    }
}
