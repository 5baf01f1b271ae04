//! Images as vehicles of the simulated cell.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use host_sim::hil::fleet::{Fleet, FleetResult};
use host_sim::hil::image::Image;
use host_sim::mobility::Grid;
use host_sim::policy::actor;
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::simulation::{Extent, Simulation};
use system_tests::image;

fn scenario() -> Scenario {
    ScenarioSource::default().read().unwrap()
}

fn fleet(units: u32, slots: u32, port: Option<u16>) -> kit::error::Result<FleetResult> {
    let image = Image::read(image::elf()).unwrap();
    let fleet = Fleet {
        scenario: &scenario(),
        image: &image,
        units,
        slots,
        seed: 11,
        port,
    };
    fleet.run(|| {})
}

#[test]
fn images_decide_as_the_library_does_and_in_time() {
    let (units, slots) = (3, 300);
    let result = fleet(units, slots, None).unwrap();
    assert_eq!((result.mismatches, result.deadline_misses), (0, 0));
    assert_eq!(result.answers, u64::from(units * slots));
    println!(
        "{} to {} instructions",
        result.min_instructions, result.max_instructions
    );
    assert!(
        result.min_instructions > 1_000 && result.max_instructions < 24_000,
        "{result:?}"
    );

    let simulation = Simulation {
        scenario: &scenario(),
        source: &Grid,
        extent: Extent {
            seed: 11,
            worlds: 1,
            slots,
            warmup: 0,
        },
    };
    let table = firmware::table::Table::parse(firmware::tables::DISTILLED).unwrap();
    let (ages, _) = simulation.run_policy(&actor::KIND, &table, |_, _| ()).unwrap();
    assert_eq!(result.ages, ages);
}

#[test]
fn a_busy_port_is_said_in_one_line() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let error = fleet(1, 1, Some(port)).unwrap_err().to_string();
    assert!(error.starts_with(&format!("port {port}: found ")), "{error}");
    assert!(error.ends_with("expected a free port on 127.0.0.1"), "{error}");
    assert_eq!(error.lines().count(), 1);
}

#[test]
fn what_is_no_image_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let text = directory.path().join("text");
    std::fs::write(&text, "no ELF").unwrap();
    for path in [text, std::env::current_exe().unwrap()] {
        let error = Image::read(&path).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        assert!(
            error.ends_with("expected an ELF image for thumbv7em-none-eabihf"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1);
    }
    assert!(Image::read(&directory.path().join("nothing")).is_err());
}
