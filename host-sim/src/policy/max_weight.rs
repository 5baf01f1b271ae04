//! Max-weight scheduling: the base station weighs who is old against who will probably be received, as far as it knows the gains.

use super::{Decider, Kind, Needs, Scheduler};
use crate::decisions::Decisions;
use crate::lanes::{Rows, ratio};
use crate::scenario::Scenario;
use crate::truth::Knowledge;
use firmware::units::Dbm;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};
use std::sync::LazyLock;

/// The heaviest pairs of a vehicle and a sub-channel first, by age times the probability of reception.
pub static KIND: Kind = Kind {
    name: "max-weight",
    meaning: "A base station that weighs ages against how probably each vehicle is received, as far as it knows the gains.",
    stream: 9,
    needs: Needs::Nothing,
    build: |setup, _| {
        let (scenario, sub_channels) = (setup.scenario, setup.scenario.radio.sub_channels as usize);
        let chances = Chances::new(scenario, setup.worlds(), setup.vehicles);
        Decider::Scheduler(Box::new(MaxWeight {
            max_power: scenario.radio.max_power(),
            chances,
            weights: Vec::with_capacity(setup.vehicles * sub_channels),
            bids: Vec::with_capacity(setup.vehicles),
            free: vec![true; sub_channels],
        }))
    },
};

/// A greedy matching in every slot. A reception takes age (age + 1) / 2 off the sum of a vehicle's ages up to now; times its
/// probability that is the weight of a pair, as in the max-weight policies for the age of information (I. Kadota, E. Modiano,
/// MobiHoc 2019). Greedy instead of the best matching (chosen): with exact gains the weights are ages alone, and it then decides as
/// the central scheduler.
struct MaxWeight {
    max_power: Dbm,
    chances: Chances,
    /// `[present vehicle][sub_channel]`, of the world in work.
    weights: Vec<f32>,
    /// Of the world in work.
    bids: Vec<Bid>,
    /// `[sub_channel]`, of the world in work.
    free: Vec<bool>,
}

/// A vehicle's heaviest pair with a free sub-channel.
struct Bid {
    vehicle: usize,
    /// 0 for who was served, or would not be received.
    weight: f32,
    sub_channel: usize,
}

impl Scheduler for MaxWeight {
    fn decide(&mut self, known: &Knowledge<'_>, decisions: &mut Decisions) {
        for world in 0..known.worlds {
            self.weigh(known, world);
            while let Some(first) = self.heaviest() {
                let Bid {
                    vehicle, sub_channel, ..
                } = self.bids[first];
                decisions.transmit(world, vehicle, sub_channel, self.max_power);
                self.bids[first].weight = 0.0;
                self.free[sub_channel] = false;
                for index in 0..self.bids.len() {
                    if self.bids[index].weight > 0.0 && self.bids[index].sub_channel == sub_channel {
                        self.bid(known, world, index);
                    }
                }
            }
        }
    }
}

impl MaxWeight {
    /// Weighs all pairs of a world and lets everybody bid.
    fn weigh(&mut self, known: &Knowledge<'_>, world: usize) {
        self.free.fill(true);
        self.weights.clear();
        self.bids.clear();
        for &vehicle in known.presence.vehicles() {
            if !known.presence.contains(world, vehicle) {
                continue;
            }
            self.chances.update(known, world, vehicle);
            let age = f32::from(known.ages.get(world, vehicle));
            let weight = |sub_channel| {
                let gain_db = known
                    .gains_db
                    .get(world, vehicle * known.sub_channels + sub_channel);
                0.5 * age * (age + 1.0) * self.chances.of(known, world, vehicle, gain_db)
            };
            self.weights.extend((0..known.sub_channels).map(weight));
            self.bids.push(Bid {
                vehicle,
                weight: 0.0,
                sub_channel: 0,
            });
            self.bid(known, world, self.bids.len() - 1);
        }
    }

    /// The heaviest bid, of equal ones the first; `None` if nobody bids.
    fn heaviest(&self) -> Option<usize> {
        let (mut first, mut weight) = (None, 0.0);
        for (index, bid) in self.bids.iter().enumerate() {
            if bid.weight > weight {
                (first, weight) = (Some(index), bid.weight);
            }
        }
        first
    }

    /// A vehicle bids for the heaviest free sub-channel, of equally heavy ones that of the largest gain.
    fn bid(&mut self, known: &Knowledge<'_>, world: usize, index: usize) {
        let vehicle = self.bids[index].vehicle;
        let weights = &self.weights[index * known.sub_channels..][..known.sub_channels];
        let gain_db = |n: usize| known.gains_db.get(world, vehicle * known.sub_channels + n);
        let best = (0..known.sub_channels)
            .filter(|&n| self.free[n])
            .max_by(|&a, &b| {
                weights[a]
                    .total_cmp(&weights[b])
                    .then(gain_db(a).total_cmp(&gain_db(b)))
            });
        self.bids[index].weight = best.map_or(0.0, |n| weights[n]);
        self.bids[index].sub_channel = best.unwrap_or(0);
    }
}

/// Points of a curve over fading in dB: from a thousandth of the mean power, below which there is a thousandth of all fading, to
/// sixteen times it, above which there is next to nothing (chosen).
const POINTS: usize = 169;

/// Fading of the first point.
const LEAST_DB: f32 = -30.0;

/// Between two points (chosen).
const STEP_DB: f32 = 0.25;

/// Squared correlation from which fading counts as unchanged (chosen: 0.01 dB around the mean).
const UNCHANGED: f64 = 1.0 - 1e-6;

/// Steps that a curve of block errors is made of (chosen).
const BLOCK_ERROR_STEPS: u32 = 8;

/// How probably a transmission at full power is received, given what is known of its gain.
///
/// With exact gains that is 0 or 1. A gain that is some slots old and has an error is a measurement of the fading as it was:
///
/// 1. What the fading was: by Bayes, from the error's normal density in dB around the measurement and from the Rayleigh fading that
///    the mean gain lets expect. The normal distribution function alone would believe a gain far above the mean to be as probably
///    too low as too high.
/// 2. What it is now: amplitudes some slots apart are jointly normal with the correlation rho = |J0(2 pi f delay)| (Clarke 1968) at
///    the vehicle's Doppler shift f. Where the power was h times its mean, it now exceeds x times its mean with the probability
///    Q1(sqrt(2 rho^2 h / (1 - rho^2)), sqrt(2 x / (1 - rho^2))), Marcum's function. Where fading is new in every slot, rho is 0 and
///    this is e^-x, whatever was measured.
/// 3. Which x suffices: the required SINR, or, with a curve of block errors and with other cells' bursts, one of several with their
///    shares.
///
/// Each sub-channel is taken for itself, though neighbouring ones may fade alike.
struct Chances {
    /// Gain from which a vehicle is received, in dB, if there is one such gain.
    required_db: f32,
    /// Where gains are not exact.
    curves: Option<Curves>,
}

/// Probabilities of reception over the measured fading, of all vehicles.
struct Curves {
    /// Gains that suffice in dB, each with its share of the cases.
    required: Vec<(f32, f32)>,
    /// Slots that gains are old.
    delay: u32,
    /// How probably the fading was at each point, given a measurement, if measurements have errors: `[point][measured point]`.
    posterior: Option<Vec<[f32; POINTS]>>,
    vehicles: usize,
    /// `[world][vehicle]`.
    curves: Vec<[f32; POINTS]>,
    /// What each curve was made for. `[vehicle][world]`.
    made_for: Rows<Situation>,
}

/// What a vehicle's curve depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Situation {
    large_scale_db: f32,
    doppler_hz: f32,
    /// Slots that its gain is old: a newcomer's is not older than the newcomer.
    delay: u32,
}

impl Chances {
    fn new(scenario: &Scenario, worlds: usize, vehicles: usize) -> Self {
        // Room for the rounding of gains between dB and ratios.
        let required_db = (10.0 * libm::log10(scenario.radio.required_sinr())) as f32 + 1e-3;
        let required = required_levels(scenario, required_db);
        let (delay, deviation_db) = (
            scenario.knowledge.gain_delay_slots,
            scenario.knowledge.gain_error_db as f32,
        );
        let exact = delay == 0 && deviation_db == 0.0 && required.len() == 1;
        let nothing = Situation {
            large_scale_db: f32::NAN,
            doppler_hz: 0.0,
            delay: 0,
        };
        Self {
            required_db,
            curves: (!exact).then(|| {
                LazyLock::force(&MARCUM);
                Curves {
                    required,
                    delay,
                    posterior: (deviation_db > 0.0).then(|| posterior(deviation_db)),
                    vehicles,
                    curves: vec![[0.0; POINTS]; worlds * vehicles],
                    made_for: Rows::new(worlds, vehicles, nothing),
                }
            }),
        }
    }

    /// Takes in what is known of a vehicle besides its gains, before it is asked for.
    fn update(&mut self, known: &Knowledge<'_>, world: usize, vehicle: usize) {
        let Some(curves) = &mut self.curves else { return };
        let situation = Situation {
            large_scale_db: known.large_scale_db.get(world, vehicle),
            doppler_hz: known.doppler_hz.map_or(0.0, |hz| hz.get(world, vehicle)),
            delay: curves
                .delay
                .min(known.elapsed - known.associated_at.get(world, vehicle)),
        };
        // It changes with places, every hundred slots.
        if curves.made_for.get(world, vehicle) != situation {
            curves.made_for.set(world, vehicle, situation);
            let squared_correlation = if situation.delay == 0 {
                1.0
            } else if known.doppler_hz.is_none() {
                0.0
            } else {
                let seconds = f64::from(situation.delay) / 1000.0;
                let correlation = libm::j0(TAU * f64::from(situation.doppler_hz) * seconds);
                correlation * correlation
            };
            curves.curves[world * curves.vehicles + vehicle] =
                curves.curve(situation.large_scale_db, squared_correlation);
        }
    }

    /// How probably a vehicle with this measured gain is received.
    fn of(&self, known: &Knowledge<'_>, world: usize, vehicle: usize, gain_db: f32) -> f32 {
        let Some(curves) = &self.curves else {
            return f32::from(u8::from(gain_db >= self.required_db));
        };
        let fading_db = gain_db - known.large_scale_db.get(world, vehicle);
        let place = ((fading_db - LEAST_DB) / STEP_DB).clamp(0.0, (POINTS - 1) as f32);
        let point = (place as usize).min(POINTS - 2);
        let (share, curve) = (
            place - point as f32,
            &curves.curves[world * curves.vehicles + vehicle],
        );
        curve[point] + share * (curve[point + 1] - curve[point])
    }
}

impl Curves {
    /// How probably a vehicle is received, over its measured fading.
    fn curve(&self, large_scale_db: f32, squared_correlation: f64) -> [f32; POINTS] {
        let mut given = [0.0; POINTS];
        for &(required_db, share) in &self.required {
            let required_db = required_db - large_scale_db;
            if squared_correlation > UNCHANGED {
                for (point, given) in given.iter_mut().enumerate() {
                    // The share of the fading nearest to the point that suffices.
                    let above = (fading_db(point) - required_db) / STEP_DB + 0.5;
                    *given += share * above.clamp(0.0, 1.0);
                }
            } else {
                let scale = 2.0 / (1.0 - squared_correlation);
                let suffices = libm::sqrt(scale * f64::from(ratio(required_db)));
                for (point, given) in given.iter_mut().enumerate() {
                    let was = scale * squared_correlation * f64::from(ratio(fading_db(point)));
                    *given += share * marcum_q(libm::sqrt(was), suffices);
                }
            }
        }
        let Some(posterior) = &self.posterior else {
            return given;
        };
        let mut curve = [0.0; POINTS];
        for (given, was) in given.iter().zip(posterior) {
            for (curve, was) in curve.iter_mut().zip(was) {
                *curve += given * was;
            }
        }
        curve
    }
}

/// Fading of a point over its mean, in dB.
fn fading_db(point: usize) -> f32 {
    LEAST_DB + point as f32 * STEP_DB
}

/// Gains in dB from which a vehicle is received, each with its share of the cases.
fn required_levels(scenario: &Scenario, required_db: f32) -> Vec<(f32, f32)> {
    let (width_db, neighbours) = (scenario.reception.block_error_width_db, &scenario.neighbours);
    let steps = if width_db > 0.0 { BLOCK_ERROR_STEPS } else { 1 };
    let mut levels = Vec::new();
    for step in 0..steps {
        // Quantiles of the logistic distribution: 0 for a single one.
        let quantile = (f64::from(step) + 0.5) / f64::from(steps);
        let level_db = required_db + (width_db * libm::log(quantile / (1.0 - quantile))) as f32;
        let share = 1.0 / f64::from(steps);
        if neighbours.noise_rise_db > 0.0 && neighbours.duty > 0.0 {
            let raised_db = level_db + neighbours.noise_rise_db as f32;
            levels.push((raised_db, (share * neighbours.duty) as f32));
            levels.push((level_db, (share * (1.0 - neighbours.duty)) as f32));
        } else {
            levels.push((level_db, share as f32));
        }
    }
    levels
}

/// How probably the fading was at each point, given the measured point: Rayleigh fading, whose power h has in dB a density
/// proportional to h e^-h, and a normal error. `[point][measured point]`.
fn posterior(deviation_db: f32) -> Vec<[f32; POINTS]> {
    let likelihood = |point: usize, measured: usize| {
        let deviations = f64::from(fading_db(point) - fading_db(measured)) / f64::from(deviation_db);
        let power = f64::from(ratio(fading_db(point)));
        power * libm::exp(-power - 0.5 * deviations * deviations)
    };
    let sum = |measured| -> f64 { (0..POINTS).map(|point| likelihood(point, measured)).sum() };
    let sums: Vec<f64> = (0..POINTS).map(sum).collect();
    (0..POINTS)
        .map(|point| std::array::from_fn(|measured| (likelihood(point, measured) / sums[measured]) as f32))
        .collect()
}

/// Both arguments of Marcum's function, up to which it is in a table.
const MARCUM_END: f64 = 12.0;

/// Entries between two whole arguments (chosen: interpolation is exact to 3e-4).
const MARCUM_STEPS: usize = 20;

const MARCUM_ENTRIES: usize = MARCUM_END as usize * MARCUM_STEPS + 1;

/// Marcum's function of order 1, `[first argument][second argument]`: how probably one Poisson number, of mean b^2/2, is at most
/// another, of mean a^2/2.
static MARCUM: LazyLock<Vec<[f32; MARCUM_ENTRIES]>> = LazyLock::new(|| {
    /// Numbers beyond have a probability below 1e-20 at a mean of 72.
    const MOST: u32 = 200;
    let mean = |entry: usize| {
        let argument = entry as f64 / MARCUM_STEPS as f64;
        argument * argument / 2.0
    };
    let entry = |first: usize, second: usize| {
        let (first, second) = (mean(first), mean(second));
        let (mut larger, mut smaller) = (libm::exp(-first), libm::exp(-second));
        let (mut at_most, mut sum) = (0.0, 0.0);
        for number in 1..MOST {
            at_most += smaller;
            sum += larger * at_most;
            larger *= first / f64::from(number);
            smaller *= second / f64::from(number);
        }
        sum as f32
    };
    (0..MARCUM_ENTRIES)
        .map(|first| std::array::from_fn(|second| entry(first, second)))
        .collect()
});

/// Marcum's function of order 1: how probably a normal point in the plane, of deviation 1 around a place `first` away from the origin, is
/// farther away from it than `second`. To 1e-3.
fn marcum_q(first: f64, second: f64) -> f32 {
    if first.max(second) >= MARCUM_END {
        // Far out the circle is a line; the distance's mean exceeds the place's by half its inverse.
        let beyond = second - first - 0.5 / first.max(1.0);
        return (0.5 * libm::erfc(beyond * FRAC_1_SQRT_2)) as f32;
    }
    let place = |argument: f64| {
        let place = argument * MARCUM_STEPS as f64;
        let entry = (place as usize).min(MARCUM_ENTRIES - 2);
        (entry, (place - entry as f64) as f32)
    };
    let ((row, down), (column, along)) = (place(first), place(second));
    let at = |row: usize| {
        let row = &MARCUM[row];
        row[column] + along * (row[column + 1] - row[column])
    };
    at(row) + down * (at(row + 1) - at(row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decisions::Decisions;
    use crate::environment::Environment;
    use crate::mobility::Grid;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;

    #[test]
    fn marcum_s_function_is_accurate() {
        // By integration in polar coordinates.
        let exact = |first: f64, second: f64| {
            let (steps, angles) = (2000, 400);
            let width = (first.max(second) + 9.0 - second) / f64::from(steps);
            let mut sum = 0.0;
            for step in 0..steps {
                let radius = second + (f64::from(step) + 0.5) * width;
                for angle in 0..angles {
                    let angle = TAU * (f64::from(angle) + 0.5) / f64::from(angles);
                    let squared = radius * radius + first * first - 2.0 * radius * first * libm::cos(angle);
                    sum += radius * libm::exp(-0.5 * squared);
                }
            }
            sum * width / f64::from(angles)
        };
        for first in [0.0, 0.33, 1.05, 2.0, 6.15, 11.95, 12.05] {
            for second in [0.0, 0.25, 1.05, 2.35, 6.5, 11.9, 12.1] {
                let (found, exact) = (f64::from(marcum_q(first, second)), exact(first, second));
                assert!((found - exact).abs() < 1e-3, "{first} {second}: {found} {exact}");
            }
        }
        assert!((marcum_q(0.0, 1.5) - libm::expf(-1.125)).abs() < 1e-3);
        assert!((f64::from(marcum_q(400.0, 401.0)) - 0.5 * libm::erfc(FRAC_1_SQRT_2)).abs() < 1e-3);
    }

    /// Of those who are received with some probability, that share is received: the simulator's own fading, whatever is known of it.
    #[test]
    fn probabilities_are_shares() {
        for settings in [
            &["fading.follows_speed=true", "knowledge.gain_delay_slots=2"][..],
            &[
                "fading.follows_speed=true",
                "knowledge.gain_delay_slots=2",
                "knowledge.gain_error_db=3",
            ],
            &[
                "fading.follows_speed=true",
                "knowledge.gain_delay_slots=4",
                "knowledge.gain_error_db=1",
                "mobility.standing_share=0.5",
                "fading.residual_doppler_hz=3",
            ],
            &["knowledge.gain_delay_slots=3", "knowledge.gain_error_db=1"],
            &["knowledge.gain_error_db=3"],
            &[
                "knowledge.gain_error_db=2",
                "reception.block_error_width_db=1.5",
                "neighbours.noise_rise_db=6",
            ],
        ] {
            check_shares(settings);
        }
    }

    fn check_shares(settings: &[&str]) {
        const BINS: usize = 10;
        // At this power one half is received.
        let settings = [settings, &["cell.vehicles=4", "radio.max_power_dbm=8"]].concat();
        let scenario = ScenarioSource {
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        let worlds = 1200;
        let mut environment = Environment::new(&scenario, &Grid, 8, Purpose::Evaluation, 0..worlds);
        let mut chances = Chances::new(&scenario, environment.worlds(), 4);
        let (mut expected, mut received, mut counts) = ([0.0; BINS], [0.0; BINS], [0.0; BINS]);
        let mut decisions = Decisions::new(environment.worlds(), 4);
        for slot in 0..48 {
            decisions.clear();
            // One vehicle after the other, each on another sub-channel: nobody interferes.
            for world in 0..environment.worlds() {
                for vehicle in 0..3 {
                    let sub_channel = (vehicle + slot) % 3;
                    decisions.transmit(world, vehicle, sub_channel, Dbm::from_bits(8 << 8));
                }
            }
            let known = environment.knowledge();
            let mut told = Vec::new();
            for world in 0..environment.worlds() {
                for vehicle in 0..3 {
                    let gain_db = known.gains_db.get(world, vehicle * 3 + (vehicle + slot) % 3);
                    chances.update(&known, world, vehicle);
                    told.push(chances.of(&known, world, vehicle, gain_db));
                }
            }
            environment.step(&decisions);
            for (index, chance) in told.into_iter().enumerate() {
                let bin = ((chance * BINS as f32) as usize).min(BINS - 1);
                expected[bin] += f64::from(chance);
                received[bin] += f64::from(u8::from(environment.received(index / 3, index % 3)));
                counts[bin] += 1.0;
            }
        }
        let mut filled = 0;
        for bin in 0..BINS {
            if counts[bin] > 1500.0 {
                let (told, found) = (expected[bin] / counts[bin], received[bin] / counts[bin]);
                assert!((told - found).abs() < 0.02, "{settings:?}: {told}, found {found}");
                filled += 1;
            }
        }
        assert!(filled >= 5, "{settings:?}: {counts:?}");
    }
}
