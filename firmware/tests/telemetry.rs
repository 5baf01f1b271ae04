//! Counters, and how far their milliwatts are off.

use firmware::decision::Decision;
use firmware::telemetry::{Telemetry, milliwatts};
use firmware::unit::{Report, Silence, State};
use firmware::units::{Dbm, SlotIndex, SubChannel};

#[test]
fn milliwatts_are_near_enough_for_people() {
    let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0_u32);
    for bits in -40 * 256..=30 * 256 {
        let dbm = f64::from(bits) / 256.0;
        let exact = libm::exp10(dbm / 10.0);
        let error = f64::from(milliwatts(dbm as f32)) / exact - 1.0;
        worst = worst.max(error.abs());
        squares += error * error;
        count += 1;
    }
    let rms = libm::sqrt(squares / f64::from(count));
    println!("milliwatts: max {:.3} %, RMS {:.3} %", worst * 100.0, rms * 100.0);
    assert!(worst < 2.4e-3, "max {worst:e}");
    assert!(rms < 6.0e-4, "RMS {rms:e}");
}

fn report(state: State, decibels: Option<i16>) -> Report {
    Report {
        slot: SlotIndex(0),
        decision: decibels.map_or(Decision::Silent, |decibels| Decision::Transmit {
            sub_channel: SubChannel::new(0).unwrap(),
            power: Dbm::from_bits(decibels << 8),
        }),
        state,
    }
}

#[test]
fn every_slot_is_counted() {
    let mut telemetry = Telemetry::default();
    assert_eq!(telemetry.mean_power_mw(), 0.0);
    telemetry.count(&report(State::Nominal, Some(20)));
    telemetry.count(&report(State::Degraded, None));
    telemetry.count(&report(State::Silent(Silence::NoTable), None));
    telemetry.count(&report(State::Degraded, Some(20)));
    assert_eq!(
        (telemetry.slots, telemetry.transmissions, telemetry.degraded),
        (4, 2, 2)
    );
    assert!((telemetry.mean_power_mw() - 50.0).abs() < 0.2);
}

#[test]
fn the_mean_power_of_hours_does_not_drift() {
    let mut telemetry = Telemetry::default();
    let slots = 40_000_000; // 11 hours
    for _ in 0..slots {
        telemetry.count(&report(State::Nominal, Some(23)));
    }
    let exact = libm::exp10(2.3) as f32;
    let mean = telemetry.mean_power_mw();
    assert!(
        (mean / exact - 1.0).abs() < 3.0e-3,
        "{mean} mW after {slots} slots of {exact} mW"
    );
}
