//! The channel against first principles and the numbers that any implementation of the scenario must give.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::stream::Purpose;

fn scenario(settings: &[&str]) -> Scenario {
    let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
    ScenarioSource {
        settings,
        ..ScenarioSource::default()
    }
    .read()
    .unwrap()
}

/// Gains of every vehicle and sub-channel in the first slot of many worlds, `[world * vehicle][sub-channel]`.
fn first_gains(scenario: &Scenario, worlds: u64) -> Vec<[f32; 3]> {
    let source = Grid;
    let environment = Environment::new(scenario, &source, 99, Purpose::Evaluation, 0..worlds);
    let of_world = |world| {
        let gain_db = |vehicle| std::array::from_fn(|n| environment.gain_db(world, vehicle, n));
        environment
            .present()
            .iter()
            .map(|&vehicle| gain_db(vehicle))
            .collect::<Vec<_>>()
    };
    (0..environment.worlds()).flat_map(of_world).collect()
}

#[test]
fn lone_signal_has_the_expected_quantiles_and_outage() {
    let gains = first_gains(&scenario(&["cell.vehicles=100"]), 1000);
    let outage = |gain: &f32| f64::from(*gain) < 8.450_980_4;
    let one = gains.iter().filter(|gain| outage(&gain[0])).count() as f64 / gains.len() as f64;
    let all = gains.iter().filter(|gain| gain.iter().all(outage)).count() as f64 / gains.len() as f64;
    assert!((one - 0.014).abs() < 0.002, "outage on one sub-channel {one}");
    assert!((all - 0.0016).abs() < 0.0005, "outage on all three {all}");
}

#[test]
fn fast_fading_is_rayleigh_and_independent() {
    // Without shadowing, on a single lane length: compare sub-channels of one vehicle, whose large-scale gain cancels.
    let gains = first_gains(
        &scenario(&["cell.vehicles=100", "radio.shadowing_deviation_db=0"]),
        1000,
    );
    // a / (a + b) of two independent exponentials is uniform.
    let shares: Vec<f64> = gains
        .iter()
        .map(|gain| 1.0 / (1.0 + libm::exp10(f64::from(gain[1] - gain[0]) / 10.0)))
        .collect();
    let count = shares.len() as f64;
    for tenth in 1..10 {
        let quantile = f64::from(tenth) / 10.0;
        let below = shares.iter().filter(|&&share| share < quantile).count() as f64 / count;
        assert!(
            (below - quantile).abs() < 0.008,
            "P(share < {quantile}) = {below}"
        );
    }
}

#[test]
fn fading_power_is_exponential_to_its_tails_and_new_in_every_slot() {
    // Without shadowing or slope every mean is the same, and known: the budget less the loss at any distance.
    let scenario = scenario(&[
        "cell.vehicles=100",
        "radio.shadowing_deviation_db=0",
        "radio.path_loss_slope_db=0",
    ]);
    let radio = &scenario.radio;
    let mean_db =
        radio.budget_db() - radio.path_loss_intercept_db - 21.0 * libm::log10(radio.carrier_ghz / 2.0);
    let source = Grid;
    let mut environment = Environment::new(&scenario, &source, 11, Purpose::Evaluation, 0..1000);
    let silent = Decisions::new(environment.worlds(), environment.vehicles());
    let mut slots: Vec<Vec<f64>> = Vec::new();
    for _ in 0..10 {
        let mut powers = Vec::new();
        for world in 0..environment.worlds() {
            for vehicle in 0..environment.vehicles() {
                for n in 0..3 {
                    let fading_db = f64::from(environment.gain_db(world, vehicle, n)) - mean_db;
                    powers.push(libm::exp10(fading_db / 10.0));
                }
            }
        }
        slots.push(powers);
        environment.step(&silent);
    }
    let count = slots[0].len() as f64;
    // Kolmogorov-Smirnov: above 1.95 / sqrt(n) by chance once in a thousand.
    let mut sorted = slots[0].clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let mut distance = 0.0_f64;
    for (rank, power) in sorted.iter().enumerate() {
        let expected = 1.0 - libm::exp(-power);
        distance = distance.max((rank as f64 / count - expected).abs());
        distance = distance.max(((rank + 1) as f64 / count - expected).abs());
    }
    assert!(distance * libm::sqrt(count) < 1.95, "{distance}");
    // Three million powers in the tails: each count within four standard deviations of the binomial's mean.
    let all = count * slots.len() as f64;
    let tail = |name: &str, probability: f64, inside: &dyn Fn(f64) -> bool| {
        let found = slots.iter().flatten().filter(|&&power| inside(power)).count() as f64;
        let expected = all * probability;
        let deviation = libm::sqrt(expected * (1.0 - probability));
        assert!(
            (found - expected).abs() < 4.0 * deviation,
            "{name}: {found} of {expected}"
        );
    };
    for limit in [1e-4, 1e-3, 1e-2] {
        tail("weak", 1.0 - libm::exp(-limit), &|power| power < limit);
    }
    for limit in [5.0, 8.0, 10.0, 11.5] {
        tail("strong", libm::exp(-limit), &|power| power > limit);
    }
    // A slot, a sub-channel, a vehicle and a world say nothing of the next: correlations have a deviation of 1 / sqrt(n).
    let correlation = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let (mut sum, mut pairs_count) = (0.0, 0.0);
        for (a, b) in pairs {
            sum += (a - 1.0) * (b - 1.0);
            pairs_count += 1.0;
        }
        sum / libm::sqrt(pairs_count)
    };
    let next_slot = correlation(&mut slots[0].iter().copied().zip(slots[1].iter().copied()));
    assert!(next_slot.abs() < 4.0, "next slot {next_slot}");
    for (name, step) in [("sub-channel", 1), ("vehicle", 3), ("world", 300)] {
        let (now, next) = (slots[0].iter().copied(), slots[0][step..].iter().copied());
        let found = correlation(&mut now.zip(next));
        assert!(found.abs() < 4.0, "next {name} {found}");
    }
}

#[test]
fn shadowing_decorrelates_over_its_distance() {
    // 10 m/s: 1 m an update, so 50 updates are the decorrelation distance, where the correlation is 1/e. Distance to the
    // base station hardly matters when the path loss has no slope.
    let scenario = scenario(&[
        "cell.vehicles=400",
        "mobility.min_speed_m_per_s=10",
        "mobility.max_speed_m_per_s=10",
        "radio.path_loss_slope_db=0",
        "radio.slow_update_slots=1",
        "radio.shadowing_decorrelation_m=0.05",
    ]);
    // One slot an update: 0.01 m a slot, so the distance of 0.05 m is 5 slots.
    let source = Grid;
    let mut cell = Environment::new(&scenario, &source, 4, Purpose::Evaluation, 0..1);
    let silent = Decisions::new(1, cell.vehicles());
    let mut history: Vec<Vec<f64>> = Vec::new();
    for _ in 0..400 {
        // The mean over sub-channels still holds fading, which is independent from slot to slot.
        let level = |v: usize| (0..3).map(|n| f64::from(cell.gain_db(0, v, n))).sum::<f64>() / 3.0;
        history.push((0..cell.vehicles()).map(level).collect());
        cell.step(&silent);
    }
    let all: Vec<f64> = history.iter().flatten().copied().collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let covariance = |lag: usize| {
        let pairs = history.iter().zip(&history[lag..]);
        let products: Vec<f64> = pairs
            .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)))
            .collect();
        products.iter().sum::<f64>() / products.len() as f64
    };
    // 64 dB^2 of shadowing at lag 0 (plus fading), 64 / e after 5 slots.
    let (near, far) = (covariance(5), covariance(10));
    assert!((near - 64.0 * 0.367_9).abs() < 1.5, "{near}");
    assert!((far - 64.0 * 0.135_3).abs() < 1.5, "{far}");
    // 31.0 dB^2 / 3 of Rayleigh fading in dB on top at lag 0.
    let none = covariance(0);
    assert!((none - 64.0 - 31.0 / 3.0).abs() < 2.0, "{none}");
}
