//! Images as vehicles of the simulated cell.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use host_sim::hil::fleet::{ANSWER_LIMIT, Fleet, FleetResult};
use host_sim::image::Image;
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
        answer_limit: ANSWER_LIMIT,
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
            error.ends_with("expected the ELF file of an image for the STM32F405"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1);
    }
    assert!(Image::read(&directory.path().join("nothing")).is_err());
}

/// `kill -STOP`, and nobody notices by himself: the process is there and its sockets are open.
#[cfg(target_os = "linux")]
#[test]
fn a_stopped_emulator_is_said_in_one_line() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = free.local_addr().unwrap().port();
    drop(free);
    let stop = || {
        let emulator = std::fs::read_dir("/proc").unwrap().flatten().find(|process| {
            let command = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&command).contains(&format!("id=line,host=127.0.0.1,port={port},"))
        });
        let process = emulator.unwrap().file_name();
        let status = std::process::Command::new("kill")
            .arg("-STOP")
            .arg(process)
            .status();
        assert!(status.unwrap().success());
    };
    let mut slots = 0;
    let fleet = Fleet {
        scenario: &scenario(),
        image: &Image::read(image::elf()).unwrap(),
        units: 1,
        slots: 1_000,
        seed: 11,
        port: Some(port),
        answer_limit: std::time::Duration::from_secs(5),
    };
    let result = fleet.run(|| {
        slots += 1;
        if slots == 10 {
            stop();
        }
    });
    assert_eq!(
        result.unwrap_err().to_string(),
        "unit 0: found no answer to slot 10 in 5 s, expected one within a slot; its emulator may be stopped"
    );
}
