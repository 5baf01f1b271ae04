//! Tables and figures: aligned, escaped, complete, and the same bytes every time.

use host_sim::report::chart::{Axis, Bar, BarChart, LineChart, Point, Reference, Series};
use host_sim::report::table::{Column, Table};
use kit::files::write_whole;
use quick_xml::events::Event;
use std::path::Path;

#[test]
fn a_text_table_is_aligned() {
    let mut table = Table::new(vec![
        Column::text("policy", ["always", "clock, the longest name"].map(str::to_owned)),
        Column::number("mean_age_ms", [70.0, 3.8649]).shown("mean age", "ms", 2),
        Column::number("ci95_ms", [Some(0.5), None]).shown("± 95 %", "ms", 2),
        Column::unsigned("worlds", [256, 256]).shown("worlds", "", 0),
    ])
    .unwrap()
    .titled("Age of information");
    table.note("2,000 slots per world.");
    let expected = "\
Age of information
policy                   mean age  ± 95 %  worlds
                               ms      ms
-----------------------  --------  ------  ------
always                      70.00    0.50     256
clock, the longest name      3.86       -     256
2,000 slots per world.
";
    assert_eq!(table.to_string(), expected);
    let none: [Option<u64>; 0] = [];
    let columns = vec![
        Column::text("name", Vec::<String>::new()),
        Column::unsigned("links", none),
    ];
    let bare = Table::new(columns).unwrap();
    assert_eq!(bare.to_string(), "name  links\n----  -----\n");
}

#[test]
fn csv_is_escaped_and_exact() {
    let names = ["clock", "a \"b\", c", "two\nlines", " rim "];
    let table = Table::new(vec![
        Column::text("policy", names.map(str::to_owned)),
        Column::number("mean_age_ms", [0.1, 1.0 / 3.0, 1e21, f64::NAN]),
        Column::unsigned("slots", [Some(2_000), None, Some(0), Some(1)]),
    ]);
    let text = table.unwrap().to_csv();
    assert_eq!(
        text,
        "policy,mean_age_ms,slots\nclock,0.1,2000\n\"a \"\"b\"\", c\",0.3333333333333333,\n\
         \"two\nlines\",1000000000000000000000,0\n\" rim \",NaN,1\n"
    );
    assert_eq!(
        "0.3333333333333333".parse::<f64>().unwrap().to_bits(),
        (1.0_f64 / 3.0).to_bits()
    );
}

/// The text of all elements, after checking that the whole is XML.
fn texts(svg: &str) -> Vec<String> {
    let mut reader = quick_xml::Reader::from_str(svg);
    let mut found = Vec::new();
    let mut depth = 0;
    let mut text = String::new();
    loop {
        match reader.read_event().expect("well-formed XML") {
            Event::Start(element) => {
                depth += 1;
                text.clear();
                assert!(element.attributes().all(|attribute| attribute.is_ok()));
            }
            Event::Empty(element) => assert!(element.attributes().all(|attribute| attribute.is_ok())),
            Event::Text(piece) => text += &piece.xml10_content(),
            Event::GeneralRef(entity) => text += &format!("&{};", &*entity),
            Event::End(_) => {
                depth -= 1;
                if !text.trim().is_empty() {
                    found.push(text.trim().to_owned());
                }
                text.clear();
            }
            Event::Eof => break,
            _ => {}
        }
    }
    assert_eq!(depth, 0);
    found
}

/// Every number that an attribute of this name has.
fn attribute_numbers(svg: &str, name: &str) -> Vec<f64> {
    let key = format!(" {name}=\"");
    svg.split(&key)
        .skip(1)
        .filter_map(|rest| rest.split('"').next()?.parse().ok())
        .collect()
}

/// Keeps a figure beside the test's other output, to be looked at.
fn keep(name: &str, svg: &str) {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    write_whole(&path, svg.as_bytes()).expect("a writable folder");
}

fn capacity_chart() -> LineChart {
    let series = [5.0, 10.0, 15.0, 20.0, 25.0].map(|loss: f64| Series {
        name: format!("Δm = {loss} veh/h"),
        points: (0..=20)
            .map(|step| {
                let age = f64::from(step) / 20.0;
                let y = 13.333 / (30.0 - age * loss);
                Point {
                    x: age * 100.0,
                    y,
                    band: Some((0.94 * y, 1.07 * y)),
                }
            })
            .collect(),
    });
    LineChart {
        title: "Road volume over capacity against the age of information".into(),
        note: "Uniform age on all roads; user equilibrium of 240 vehicles per hour on the 4 x 4 grid.".into(),
        horizontal: Axis::linear("mean age of information (ms)"),
        vertical: Axis::linear("mean V/C (1)"),
        series: series.into(),
        references: vec![Reference {
            name: "capacity reached".into(),
            value: 1.0,
        }],
    }
}

fn training_chart() -> LineChart {
    let names = [
        "actor, distilled from the clock",
        "MADDPG with two time frames, 20 agents",
        "random",
        "ALOHA",
        "age threshold",
        "central greedy",
        "always on",
        "eighth",
    ];
    let series = names.iter().enumerate().map(|(index, name)| Series {
        name: (*name).into(),
        points: (0..500)
            .map(|episode| {
                let x = f64::from(episode);
                let wave = f64::from((episode * 37 + index as i32 * 11) % 17) / 17.0 - 0.5;
                let y = 4.0 + 9.0 * index as f64 + (60.0 - 6.0 * index as f64) / (1.0 + x / 40.0) + wave;
                Point {
                    x,
                    y,
                    band: (index < 2).then_some((y * 0.85, y * 1.15)),
                }
            })
            .collect(),
    });
    LineChart {
        title: "Mean age of information while learning, greedy evaluation on held-out worlds, with a title so long that it needs a second line".into(),
        note: "Bands: 95 % interval over 5 seeds; 256 worlds of 2,000 slots each. The bound is round robin without fading.".into(),
        horizontal: Axis::linear("training episode (100 slots each)"),
        vertical: Axis::logarithmic("mean age of information (ms)"),
        series: series.collect(),
        references: vec![Reference { name: "lower bound, 3.85 ms".into(), value: 3.85 }],
    }
}

fn policy_chart() -> BarChart {
    let policies = [
        ("central", 3.855, 0.003),
        ("actor", 4.31, 0.05),
        ("clock", 4.02, 0.04),
        ("age-threshold", 9.7, 0.6),
        ("aloha", 12.4, 0.8),
        ("random, uniformly over sub-channels and powers", 31.2, 2.1),
        ("always", 70.2, 1.3),
    ];
    BarChart {
        title: "Mean age of information by policy".into(),
        note: "20 vehicles, 3 sub-channels; 256 worlds of 2,000 slots after warm-up, the same for all policies. ± and whiskers: 95\u{a0}% interval of the mean over worlds. Bars begin at the bound: their length is the ratio to it.".into(),
        axis: Axis::logarithmic("mean age of information (ms)"),
        decimals: 2,
        bars: policies
            .iter()
            .map(|(name, value, half)| Bar {
                name: (*name).into(),
                value: *value,
                interval: Some((value - half, value + half)),
                emphasised: *name == "actor",
            })
            .collect(),
        reference: Some(Reference { name: "bound".into(), value: 3.85 }),
    }
}

#[test]
fn figures_hold_what_they_are_given() {
    for (name, svg, wanted) in [
        (
            "capacity.svg",
            capacity_chart().to_svg().unwrap(),
            vec![
                "Road volume over capacity against the age of information",
                "mean V/C (1)",
                "Δm = 25 veh/h",
                "capacity reached",
                "1.0",
                "100",
            ],
        ),
        (
            "training.svg",
            training_chart().to_svg().unwrap(),
            vec![
                "training episode (100 slots each)",
                "mean age of information (ms)",
                "MADDPG with two time",
                "5",
                "50",
            ],
        ),
        (
            "policies.svg",
            policy_chart().to_svg().unwrap(),
            vec![
                "Mean age of information by policy",
                "age-threshold",
                "70.20 ± 1.30",
                "4.31 ± 0.05",
                "3.85 ± &lt;0.01",
                "bound 3.85",
            ],
        ),
    ] {
        keep(name, &svg);
        let found = texts(&svg);
        for text in wanted {
            assert!(
                found.iter().any(|candidate| candidate == text),
                "{name} lacks '{text}': {found:?}"
            );
        }
        let start = "<svg role=\"img\" width=\"900\" height=\"";
        assert!(svg.starts_with(start), "{}", &svg[..80]);
    }
    let mut chart = policy_chart();
    chart.title = "a < b & \"c\"".into();
    let svg = chart.to_svg().unwrap();
    assert_eq!(
        svg.lines().nth(1),
        Some("<title>a &lt; b &amp; &quot;c&quot;</title>")
    );
    assert_eq!(texts(&svg)[0], "a &lt; b &amp; &quot;c&quot;");
}

#[test]
fn figures_are_the_same_bytes_every_time() {
    assert_eq!(
        capacity_chart().to_svg().unwrap(),
        capacity_chart().to_svg().unwrap()
    );
    assert_eq!(
        training_chart().to_svg().unwrap(),
        training_chart().to_svg().unwrap()
    );
    assert_eq!(policy_chart().to_svg().unwrap(), policy_chart().to_svg().unwrap());
}

#[test]
fn nothing_is_drawn_outside_the_figure() {
    let mut many = training_chart();
    many.series = (0..40).map(|_| many.series[0].clone()).collect();
    let mut long = policy_chart();
    long.bars[0].name = "x".repeat(400);
    long.axis = Axis::linear(&"very long axis label ".repeat(12));
    for (name, svg) in [
        ("many.svg", many.to_svg().unwrap()),
        ("long.svg", long.to_svg().unwrap()),
    ] {
        keep(name, &svg);
        let view = svg
            .split("viewBox=\"0 0 ")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap();
        let (width, height) = view.split_once(' ').unwrap();
        let (width, height): (f64, f64) = (width.parse().unwrap(), height.parse().unwrap());
        for points in svg.split(" points=\"").skip(1) {
            for point in points.split('"').next().unwrap().split(' ') {
                let (x, y) = point.split_once(',').unwrap();
                let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
                assert!(
                    (0.0..=width).contains(&x) && (0.0..=height).contains(&y),
                    "{name}: {point}"
                );
            }
        }
        for (names, limit) in [(["x", "cx"], width), (["y", "cy"], height)] {
            for attribute in names {
                for number in attribute_numbers(&svg, attribute) {
                    assert!((0.0..=limit).contains(&number), "{name}: {attribute}={number}");
                }
            }
        }
    }
}

#[cfg(unix)]
#[test]
fn written_files_can_be_read_by_others() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let plain = folder.path().join("plain");
    std::fs::write(&plain, "x").unwrap();
    let whole = folder.path().join("new/whole.csv");
    write_whole(&whole, b"x").unwrap();
    assert_eq!(mode(&whole), mode(&plain));
    write_whole(&whole, b"longer").unwrap();
    assert_eq!(std::fs::read(&whole).unwrap(), b"longer");
    assert_eq!(std::fs::read_dir(folder.path().join("new")).unwrap().count(), 1);
}

#[test]
fn odd_data_are_drawn_or_refused() {
    let mut chart = capacity_chart();
    for (x, y) in [(0.0, 0.0), (5.0, -3.0), (1e-9, 1e12), (1.0, f64::MAX)] {
        chart.references.clear();
        chart.series = vec![Series {
            name: "<&>".into(),
            points: vec![Point { x, y, band: None }],
        }];
        assert!(texts(&chart.to_svg().unwrap()).contains(&"&lt;&amp;&gt;".to_owned()));
    }
    chart.series[0].points[0].y = f64::NAN;
    assert_eq!(
        chart.to_svg().unwrap_err().to_string(),
        "figure 'Road volume over capacity against the age of information', axis 'mean V/C (1)': \
         found NaN, expected a finite number"
    );
    chart.vertical = Axis::logarithmic("age (ms)");
    chart.series[0].points[0].y = 0.0;
    assert!(
        chart
            .to_svg()
            .unwrap_err()
            .to_string()
            .ends_with("found 0, expected a finite number above 0")
    );
    for y in [f64::MIN_POSITIVE, 1.0, f64::MAX] {
        chart.series[0].points[0].y = y;
        let _drawn = texts(&chart.to_svg().unwrap());
    }
    chart.series.clear();
    assert!(
        chart
            .to_svg()
            .unwrap_err()
            .to_string()
            .ends_with("found no point, expected at least one")
    );
    let mut bars = policy_chart();
    bars.bars[0].interval = Some((0.0, 4.0));
    assert!(bars.to_svg().is_err());
    bars.bars.clear();
    assert!(bars.to_svg().is_err());
}
