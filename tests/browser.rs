//! The page in a real browser: it runs the simulator's own code, its links say what it shows, and nothing that a visitor sets ends
//! it. The moving picture that it makes. The reports there: they stand alone and can be read.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::table::Table;
use host_sim::age::AgeSummary;
use host_sim::mobility::Grid;
use host_sim::policy::{KINDS, Kind, actor, age_threshold, aloha, central};
use host_sim::scenario::ScenarioSource;
use host_sim::simulation::{Extent, Simulation};
use std::path::Path;
use std::process::Command;
use system_tests::browser::{Page, serve};
use system_tests::program;

const SEED: u64 = 18_446_744_073_709_551_557;
const WARMUP: u32 = 500;
const SLOTS: u32 = 1000;

/// Largest report, bytes.
const REPORT_BYTES: u64 = 3_000_000;
/// Least contrast of text with its background, after the Web Content Accessibility Guidelines 2.2, 1.4.3.
const LEAST_CONTRAST: f64 = 4.5;
/// Width of a small telephone, CSS pixels.
const TELEPHONE_PX: u32 = 360;

/// What each figure has. The numbers of an axis tell it: they are centred below a horizontal one, end beside a vertical one and
/// begin beside a scale of colours.
const FIGURES: &str = r"[...document.querySelectorAll('figure')].map((figure) => {
    const drawing = figure.querySelector('svg[role=img]');
    const texts = [...(drawing?.querySelectorAll('text') ?? [])];
    const having = (pattern) => texts.filter((text) => pattern.test(text.textContent.trim()));
    return {
        title: drawing?.querySelector(':scope > title:first-child')?.textContent.trim() ?? '',
        caption: figure.querySelector('figcaption')?.textContent.trim() ?? '',
        axes: new Set(having(/^[-−]?[\d.,]+$/).map((number) => number.getAttribute('text-anchor'))).size,
        labels: having(/\((1|ms|s|m|dB|frames|s per trip|veh\/h)\)$/).length,
    };
})";

/// The least contrast of a text outside drawings with what is behind it.
const CONTRAST: &str = r"(() => {
    const channels = (colour) => colour.match(/[\d.]+/g).map(Number);
    const luminance = (colour) => {
        const linear = channels(colour).slice(0, 3).map((value) => value / 255)
            .map((value) => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    };
    const behind = (element) => {
        const own = getComputedStyle(element).backgroundColor;
        return (channels(own)[3] ?? 1) === 1 ? own : element === document.body ? 'rgb(255, 255, 255)' : behind(element.parentElement);
    };
    const speaks = (element) => [...element.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim());
    const contrasts = [...document.body.querySelectorAll(':not(svg, svg *)')].filter(speaks).map((element) => {
        const pair = [luminance(getComputedStyle(element).color), luminance(behind(element))].sort((a, b) => b - a);
        return (pair[0] + 0.05) / (pair[1] + 0.05);
    });
    return Math.min(...contrasts);
})()";

fn open(link: &str) -> Page {
    let address = serve(Path::new(env!("CARGO_MANIFEST_DIR")).join("../web/page"));
    let page = Page::open(&format!("http://{address}/{link}"), (1280, 900));
    page.wait_for("document.getElementById('cell').dataset.elapsed > 0");
    page
}

/// What the command line runs for the page's world.
fn command_line(policy: &'static Kind) -> AgeSummary {
    let scenario = ScenarioSource::default().read().unwrap();
    let simulation = Simulation {
        scenario: &scenario,
        source: &Grid,
        extent: Extent {
            seed: SEED,
            worlds: 1,
            slots: SLOTS,
            warmup: WARMUP,
        },
    };
    let table = Table::parse(firmware::tables::DISTILLED).unwrap();
    simulation.run_policy(policy, &table, |_, _| ()).unwrap().0
}

fn mean_age_ms(page: &Page, run: usize) -> f64 {
    let text = page.value(&format!(
        "document.querySelector('data[data-run=\"{run}\"]').value"
    ));
    text.as_str().unwrap().parse().unwrap()
}

fn elapsed(page: &Page) -> u64 {
    let text = page.value("document.getElementById('cell').dataset.elapsed");
    text.as_str().unwrap().parse().unwrap()
}

fn assert_nothing_went_wrong(page: &Page) {
    assert_eq!(
        page.complaints(),
        Vec::<String>::new(),
        "the console is not empty"
    );
    let own = page.value("location.origin");
    let foreign = |url: &String| !url.starts_with(own.as_str().unwrap()) && !url.starts_with("data:");
    let foreign: Vec<_> = page.requests().into_iter().filter(foreign).collect();
    assert_eq!(foreign, Vec::<String>::new(), "the page asks others");
    assert!(page.requests().len() > 5, "{:?}", page.requests());
}

#[test]
fn the_page_has_the_command_line_s_numbers_and_policies_take_over_while_it_runs() {
    let until = WARMUP + SLOTS;
    let page = open(&format!("#seed={SEED}&speed=5&until={until}"));
    page.wait_for(&format!(
        "document.getElementById('cell').dataset.elapsed == {until}"
    ));
    page.wait_for("document.getElementById('cell').dataset.state === 'paused'");
    let shown = [&actor::KIND, &central::KIND, &age_threshold::KIND, &aloha::KIND];
    for (run, policy) in shown.into_iter().enumerate() {
        let expected = command_line(policy).mean_ms;
        assert_eq!(
            mean_age_ms(&page, run).to_bits(),
            expected.to_bits(),
            "{}",
            policy.name
        );
    }
    let actor = mean_age_ms(&page, 0);
    assert!(actor < 5.0, "{actor} ms");

    page.set("policy", "aloha");
    let _ = page.value("document.getElementById('play').click()");
    page.wait_for(&format!(
        "document.getElementById('cell').dataset.elapsed > {}",
        until + 2 * WARMUP
    ));
    let aloha = mean_age_ms(&page, 0);
    assert!(aloha > 2.0 * actor, "{actor} ms, then {aloha} ms");
    assert_nothing_went_wrong(&page);
}

#[test]
fn it_paints_at_once_and_stays_smooth() {
    let page = open("#vehicles=20&speed=1/2");
    let paint = page.value("performance.getEntriesByName('first-contentful-paint')[0].startTime");
    assert!(paint.as_f64().unwrap() < 2000.0, "first paint after {paint} ms");
    // Two cells at 60 frames a second, if the machine lets the browser.
    let milliseconds = page.milliseconds_per_frame(60);
    println!("first paint after {paint} ms, {milliseconds:.1} ms of processor time a frame");
    assert!(
        (0.1..1000.0 / 60.0).contains(&milliseconds),
        "{milliseconds} ms a frame"
    );
    assert_nothing_went_wrong(&page);
}

#[test]
fn vehicles_join_and_are_jammed_by_mouse_and_keyboard() {
    let page = open("#speed=1");
    let count = || {
        page.value("document.querySelectorAll('#vehicle-rows tr').length")
            .as_u64()
            .unwrap()
    };
    let _ = page.value("document.getElementById('vehicle-table').open = true");
    page.wait_for("document.querySelectorAll('#vehicle-rows tr').length === 20");

    // The map's western border: a vehicle joins there, unless one is just under the pointer, which is then jammed.
    let border = page.value(
        "((box) => [box.left + 12, box.top + box.height / 2])(document.getElementById('map').getBoundingClientRect())",
    );
    page.click(border[0].as_f64().unwrap(), border[1].as_f64().unwrap());
    let clicked = "document.querySelectorAll('#vehicle-rows tr').length > 20 || \
        [...document.querySelectorAll('#vehicle-rows button')].some((button) => button.textContent === 'Free')";
    page.wait_for(clicked);
    let before = count();
    page.press("a");
    page.wait_for(&format!(
        "document.querySelectorAll('#vehicle-rows tr').length === {}",
        before + 1
    ));

    let _ = page.value("document.getElementById('map').focus()");
    page.press("ArrowRight");
    page.press("Enter");
    let cell = |n: u32| format!("document.querySelector('#vehicle-rows tr td:nth-child({n})').textContent");
    page.wait_for(&format!("{} === 'Free'", cell(6)));
    page.wait_for(&format!("Number.parseInt({}) > 100", cell(2)));
    page.press("Enter");
    page.wait_for(&format!(
        "{} === 'Jam' && Number.parseInt({}) < 50",
        cell(6),
        cell(2)
    ));
    page.press(" ");
    page.wait_for("document.getElementById('cell').dataset.state === 'paused'");
    let paused = elapsed(&page);
    page.press("s");
    page.wait_for(&format!(
        "document.getElementById('cell').dataset.elapsed == {}",
        paused + 1
    ));
    assert_nothing_went_wrong(&page);
}

#[test]
fn any_setting_leaves_a_running_cell() {
    let page = open("#policy=nonsense&vehicles=1000&c-min=x&seed=-1&speed=99&until=-5&frobs=1");
    let message = || {
        page.value("document.getElementById('message').textContent")
            .as_str()
            .unwrap()
            .to_owned()
    };
    // Each is refused aloud, and what runs instead is in the link.
    let refused = message();
    for control in ["policy", "vehicles", "c-min", "seed", "speed", "until", "frobs"] {
        assert!(
            refused.contains(&format!("{control}: found ")),
            "{control}: {refused}"
        );
    }
    assert_eq!(
        page.value("location.hash"),
        "#policy=actor&beside=aloha&vehicles=20&c-min=3&seed=1"
    );
    let runs = || {
        let before = elapsed(&page);
        page.wait_for(&format!(
            "document.getElementById('cell').dataset.elapsed != {before}"
        ));
    };
    runs();
    page.set("seed", "1");
    page.set("speed", "9");
    for vehicles in ["1", "3", "72", "255"] {
        for c_min in ["1", "2.5", "3", "6"] {
            page.set("vehicles", vehicles);
            page.set("c-min", c_min);
            runs();
        }
    }
    page.set("c-min", "2");
    for &policy in KINDS {
        page.set("policy", policy.name);
        runs();
    }
    page.set("policy", "actor");
    assert!(
        message().contains("radio.min_spectral_efficiency"),
        "{}",
        message()
    );
    page.set("seed", "many");
    assert!(
        message().contains("expected a whole number from 0 to 18446744073709551615"),
        "{}",
        message()
    );
    runs();
    assert_nothing_went_wrong(&page);
}

#[test]
fn a_link_and_the_controls_say_the_same() {
    let link = "#policy=clock&beside=random&vehicles=7&c-min=2&imperfections=street&seed=5&speed=1/2&until=300&keys=off";
    let page = open(link);
    let shows = |expected: &[(&str, &str)]| {
        for (control, value) in expected {
            page.wait_for(&format!(
                "document.getElementById('{control}').value === '{value}'"
            ));
        }
    };
    shows(&[
        ("policy", "clock"),
        ("beside", "random"),
        ("vehicles", "7"),
        ("c-min", "2"),
        ("imperfections", "street"),
        ("seed", "5"),
        ("speed", "8"),
    ]);
    assert_eq!(page.value("location.hash"), link);
    page.wait_for("document.getElementById('cell').dataset.state === 'paused'");
    assert_eq!(elapsed(&page), 300);
    // The letters are off.
    page.press("s");
    page.press("a");
    assert_eq!(elapsed(&page), 300);

    // An edited link, a control, and back twice.
    let _ = page.value("void (location.hash = 'vehicles=30')");
    shows(&[
        ("policy", "actor"),
        ("beside", "aloha"),
        ("vehicles", "30"),
        ("imperfections", "none"),
    ]);
    page.set("beside", "always");
    page.wait_for("location.hash.includes('beside=always')");
    let _ = page.value("history.back()");
    shows(&[("beside", "aloha"), ("vehicles", "30")]);
    let _ = page.value("history.back()");
    shows(&[
        ("policy", "clock"),
        ("vehicles", "7"),
        ("imperfections", "street"),
    ]);
    assert_nothing_went_wrong(&page);
}

#[test]
fn the_tour_shows_four_pairs_of_cells_and_towns() {
    let page = open("");
    for (step, beside, policy) in [
        (1, "aloha", "actor"),
        (2, "always", "aloha"),
        (3, "aloha", "actor"),
        (4, "aloha", "actor"),
    ] {
        let _ = page.value("document.getElementById('tour-next').click()");
        page.wait_for(&format!("location.hash.endsWith('&step={step}')"));
        for (side, name) in [("beside", beside), ("policy", policy)] {
            page.wait_for(&format!(
                "document.getElementById('{side}-name').textContent === '{name}'"
            ));
        }
        page.wait_for("document.getElementById('cell').dataset.elapsed > 10");
    }
    let _ = page.value("document.getElementById('tour-next').click()");
    page.wait_for("document.getElementById('heard-map').clientWidth > 100");
    assert_eq!(page.value("document.getElementById('map').clientWidth"), 0);
    assert_eq!(page.value("document.getElementById('tour-next').disabled"), true);
    // Some minutes into the incident those who are told have gone around.
    let queues =
        "['blind', 'heard'].map((side) => parseInt(document.getElementById(`${side}-queue`).textContent))";
    page.set("town-time", "270");
    page.wait_for("document.getElementById('town-clock').textContent === 'minute 14:00'");
    let queues = page.value(queues);
    let queued = |side: usize| queues[side].as_u64().unwrap();
    assert!(queued(0) > queued(1) && queued(1) > 0, "{queues}");
    // And back to cells.
    let _ = page.value("document.getElementById('tour-back').click()");
    page.wait_for("document.getElementById('map').clientWidth > 100");
    assert_nothing_went_wrong(&page);
}

#[test]
fn every_slot_since_the_last_picture_is_drawn() {
    let page = open("#until=1");
    // 24 vehicles on three channels: eight slots, in which everybody is served once, are one picture.
    let sent = page.value(
        "(async () => { const { Cell, load } = await import('./cell.js'); \
         const request = { seed: '1', settings: ['cell.vehicles=24', 'radio.max_power_dbm=50'], policy: 'clock', comparisons: [] }; \
         const cell = new Cell(await load('freshlane.wasm'), request); \
         cell.advance(300); cell.advance(8); \
         return cell.sent.received.filter((ago) => ago >= 0 && ago < 8).length; })()",
    );
    assert_eq!(sent, 24);
}

#[test]
fn what_is_missing_is_said_and_what_may_not_move_stands() {
    let whole = Path::new(env!("CARGO_MANIFEST_DIR")).join("../web/page");
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(whole).unwrap() {
        let path = entry.unwrap().path();
        if path.file_name().unwrap() != "map.js" {
            let _ = std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
    }
    let page = Page::open(
        &format!("http://{}/", serve(folder.path().to_owned())),
        (1280, 900),
    );
    page.wait_for("getComputedStyle(document.getElementById('absent')).visibility === 'visible'");
    page.wait_for("document.getElementById('absent').textContent.includes('python3 -m http.server')");

    let page = open("");
    page.keep_still();
    page.wait_for("document.getElementById('cell').dataset.state === 'paused'");
    let _ = page.value("document.getElementById('tour-next').click()");
    page.wait_for("document.getElementById('cell').dataset.elapsed == 150");
    assert_eq!(
        page.value("document.getElementById('cell').dataset.state"),
        "paused"
    );
    page.narrow_to(TELEPHONE_PX);
    page.wait_for(&format!("innerWidth === {TELEPHONE_PX}"));
    assert_eq!(
        page.value("document.documentElement.scrollWidth"),
        page.value("document.documentElement.clientWidth"),
    );
    let top = page.value("document.getElementById('map').getBoundingClientRect().top");
    assert!(
        top.as_f64().unwrap() < 200.0,
        "the map comes first on a telephone: {top} px"
    );
    assert_nothing_went_wrong(&page);
}

/// Largest moving picture, bytes.
const PICTURE_BYTES: usize = 1_000_000;
/// Where its width and height stand in the file, after 24 bytes of heads and flags.
const PICTURE_SIZE: std::ops::Range<usize> = 24..30;

#[test]
fn the_page_makes_the_moving_picture() {
    let page = open("#until=1");
    for colour_scheme in ["light", "dark"] {
        page.show_as("screen", colour_scheme);
        let picture = page.value(include_str!("support/moving_picture.js"));
        let made: Vec<u8> = picture
            .as_array()
            .unwrap()
            .iter()
            .map(|byte| byte.as_u64().unwrap() as u8)
            .collect();
        assert!(
            made.len() < PICTURE_BYTES,
            "{colour_scheme}: {} bytes",
            made.len()
        );
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../docs/same_second_{colour_scheme}.webp"));
        if std::env::var_os("BLESS").is_some() {
            std::fs::write(&path, &made).unwrap();
        }
        // Other machines have other fonts: the same size and the same frames, of other lengths.
        let committed = std::fs::read(&path).unwrap();
        let frames = |bytes: &[u8]| bytes.windows(4).filter(|name| name == b"ANMF").count();
        assert_eq!(
            frames(&made),
            frames(&committed),
            "{colour_scheme}: BLESS=1 makes it anew"
        );
        assert_eq!(made[PICTURE_SIZE], committed[PICTURE_SIZE], "{colour_scheme}");
    }
    assert_nothing_went_wrong(&page);
}

/// Runs `host-sim` and looks at the report that it writes.
fn assert_report_can_be_read(arguments: &[&str], file: &str, figure_count: usize) {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(program("host-sim"))
        .args(arguments)
        .args(["--out", "."])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let bytes = folder.path().join(file).metadata().unwrap().len();
    assert!(bytes < REPORT_BYTES, "{file}: {bytes} bytes");

    let address = format!("http://{}/{file}", serve(folder.path().to_owned()));
    let page = Page::open(&address, (1280, 900));
    let figures = page.value(FIGURES);
    let figures = figures.as_array().unwrap();
    assert_eq!(figures.len(), figure_count, "{figures:#?}");
    for figure in figures {
        let count = |key: &str| figure[key].as_u64().unwrap();
        let empty = |key: &str| figure[key].as_str().unwrap().is_empty();
        assert!(!empty("title") && !empty("caption"), "{figure:#}");
        assert!(
            count("axes") > 0 && count("labels") == count("axes"),
            "{figure:#}"
        );
    }

    // What is folded is read, too.
    let _ = page.value("document.querySelectorAll('details').forEach((part) => part.open = true)");
    let grounds = "[...document.querySelectorAll('figure svg > rect:first-of-type')].map((ground) => getComputedStyle(ground).fill)";
    for (medium, colour_scheme, dark) in [
        ("screen", "light", false),
        ("screen", "dark", true),
        ("print", "dark", false),
    ] {
        page.show_as(medium, colour_scheme);
        let contrast = page.value(CONTRAST).as_f64().unwrap();
        assert!(
            contrast >= LEAST_CONTRAST,
            "{file}, {medium}, {colour_scheme}: {contrast}"
        );
        let ground = page.value("getComputedStyle(document.body).backgroundColor");
        assert_eq!(ground == "rgb(255, 255, 255)", !dark, "{medium}, {colour_scheme}");
        for behind in page.value(grounds).as_array().unwrap() {
            assert_eq!(
                *behind, ground,
                "{file}, {medium}, {colour_scheme}: a figure's ground"
            );
        }
    }
    page.show_as("screen", "light");
    page.narrow_to(TELEPHONE_PX);
    page.wait_for(&format!("innerWidth === {TELEPHONE_PX}"));
    assert_eq!(
        page.value("document.documentElement.scrollWidth"),
        page.value("document.documentElement.clientWidth"),
        "{file} is wider than a telephone"
    );
    assert_eq!(
        page.complaints(),
        Vec::<String>::new(),
        "the console is not empty"
    );
    let mut requests = page.requests();
    // The empty icon stands in the page itself.
    requests.retain(|url| !url.starts_with("data:"));
    assert_eq!(requests, [address], "a report asks nobody");
}

#[test]
fn reports_stand_alone_and_can_be_read() {
    // All policies and slots, as by default, in few worlds: figures have their full size.
    assert_report_can_be_read(&["run", "--worlds", "4"], "report.html", 8);
    assert_report_can_be_read(&["loop", "--worlds", "2"], "loop.html", 2);
}
