//! Accuracy of the encoding against real-valued formulas in f64.

use firmware::measurement::{Broadcast, Measurement};
use firmware::observation::{INPUTS, ONE, Observation, STRONG, turn_lost_after};
use firmware::units::{JoinerProbability, Level, Period, SlotIndex, SubChannel};

const STEP: f64 = 256.0;

/// Readings with everything plain but what a test is about.
#[derive(Clone, Copy)]
pub struct Readings {
    pub slot: u32,
    pub gain: [i16; 3],
    pub interference: [i16; 3],
    pub age: u8,
    pub home: u8,
    pub period: u8,
    pub joiner_probability: u8,
}

impl Default for Readings {
    fn default() -> Self {
        Self {
            slot: 1_000,
            gain: [25 << 8; 3],
            interference: [0; 3],
            age: 1,
            home: 0,
            period: 5,
            joiner_probability: 255,
        }
    }
}

impl Readings {
    pub fn measurement(self) -> Measurement {
        Measurement::new(
            SlotIndex(self.slot),
            self.gain.map(Level::from_bits),
            self.interference.map(Level::from_bits),
            Some(SlotIndex(self.slot.wrapping_sub(u32::from(self.age)))),
            Broadcast {
                home: SubChannel::new(self.home).unwrap(),
                period: Period::new(self.period).unwrap(),
                joiner_probability: JoinerProbability::from_code(self.joiner_probability),
            },
        )
        .unwrap()
    }

    pub fn observation(self) -> Observation {
        Observation::new(&self.measurement())
    }

    fn encode(self, required_sinr: i16) -> [i8; INPUTS] {
        self.observation().encode(Level::from_bits(required_sinr))
    }
}

/// a / (a + b) for a `difference` of a over b in 1/256 dB.
fn exact_share(difference: i32) -> f64 {
    1.0 / (1.0 + libm::exp10(-f64::from(difference) / STEP / 10.0))
}

/// Gains of the two other sub-channels that are `difference` apart.
fn apart(difference: i32) -> [i16; 3] {
    let a = difference / 2;
    [0, a as i16, (a - difference) as i16]
}

#[test]
fn private_uniform_is_accurate_at_every_difference() {
    let (mut worst, mut squares, mut sum, mut count) = (0.0_f64, 0.0, 0.0, 0_u32);
    for difference in -65_534..=65_534 {
        let gain = apart(difference);
        assert_eq!(i32::from(gain[1]) - i32::from(gain[2]), difference);
        let uniform = Readings {
            gain,
            ..Readings::default()
        }
        .observation()
        .quantities()
        .private_uniform();
        assert!(uniform <= 65_536);
        let error = f64::from(uniform) / 65_536.0 - exact_share(difference);
        worst = worst.max(error.abs());
        if difference.abs() <= 40 << 8 {
            squares += error * error;
            sum += error;
            count += 1;
        }
    }
    let (rms, mean) = (libm::sqrt(squares / f64::from(count)), sum / f64::from(count));
    println!("private_uniform: max {worst:.2e}, within 40 dB RMS {rms:.2e}, mean {mean:.2e}");
    assert!(worst < PRIVATE_UNIFORM_MAX, "max {worst:e}");
    assert!(rms < PRIVATE_UNIFORM_RMS, "RMS {rms:e}");
    assert!(mean.abs() < PRIVATE_UNIFORM_MEAN, "mean {mean:e}");
}

const PRIVATE_UNIFORM_MAX: f64 = 1.7e-4;
const PRIVATE_UNIFORM_RMS: f64 = 5.5e-5;
const PRIVATE_UNIFORM_MEAN: f64 = 1.0e-6;

#[test]
fn thinned_uniform_is_the_uniform_over_the_probability() {
    let mut worst = 0.0_f64;
    for code in 0..=u8::MAX {
        for difference in (-10_240..=10_240).step_by(7) {
            let observation = Readings {
                gain: apart(difference),
                joiner_probability: code,
                ..Readings::default()
            }
            .observation();
            let probability = f64::from(u16::from(code) + 1) / 256.0;
            let exact = f64::from(observation.quantities().private_uniform()) / 65_536.0 / probability;
            let thinned = f64::from(observation.quantities().thinned_uniform()) / 65_536.0;
            // Only below 1 does a joiner send.
            if exact < 1.0 {
                worst = worst.max((thinned - exact).abs());
            }
        }
    }
    println!("thinned_uniform: max {worst:.2e} below 1");
    assert!(worst < 3.9e-3, "max {worst:e}");
}

#[test]
fn every_feature_is_within_one_step_of_its_formula() {
    // The constant 819 / 65536 for 3.2 / 256 adds up to 0.06 steps at the top of the gain's range.
    let close = |code: i8, real: f64, what: &str| {
        let real = real.clamp(-128.0, 127.0);
        let error = (f64::from(code) - real).abs();
        assert!(error <= 1.06, "{what}: {code} for {real}");
    };
    for bits in i16::MIN..=i16::MAX {
        let decibels = f64::from(bits) / STEP;
        let gain = Readings {
            gain: [bits; 3],
            ..Readings::default()
        }
        .encode(0);
        for k in 0..3 {
            close(gain[5 + k], 64.0 * (decibels / 10.0 - 3.5) / 2.0, "gain");
            assert_eq!(gain[8 + k], if bits >= 0 { ONE } else { 0 });
        }
        assert_eq!(gain[11] == ONE, bits >= STRONG.to_bits());
        if bits >= 0 {
            let encoded = Readings {
                interference: [bits; 3],
                ..Readings::default()
            }
            .encode(0);
            for k in 0..3 {
                close(encoded[17 + k], 64.0 * decibels / 40.0, "interference");
            }
        }
    }
    for period in 1..=100_u8 {
        assert_eq!(
            i32::from(turn_lost_after(Period::new(period).unwrap())),
            (7 * i32::from(period)).clamp(50, 98)
        );
        for age in 1..=100_u8 {
            let encoded = Readings {
                age,
                period,
                ..Readings::default()
            }
            .encode(0);
            let flag = |condition| if condition { ONE } else { 0 };
            assert_eq!(encoded[0], flag(age % period == 0), "own turn at {age}, {period}");
            assert_eq!(
                encoded[1],
                flag(i32::from(age) > (7 * i32::from(period)).clamp(50, 98))
            );
            assert_eq!(encoded[2], flag(i32::from(age) > 3 * i32::from(period)));
            let periods = f64::from(age) / f64::from(period);
            close(encoded[3], 64.0 * (periods / 5.0).min(1.0), "age");
            close(encoded[4], 64.0 * f64::from(period) / 20.0, "period");
        }
    }
    for code in 0..=u8::MAX {
        for difference in (-12_000..=12_000).step_by(61) {
            let readings = Readings {
                gain: apart(difference),
                joiner_probability: code,
                ..Readings::default()
            };
            let (encoded, thinned) = (
                readings.encode(0),
                readings.observation().quantities().thinned_uniform(),
            );
            let real = f64::from(thinned) / 65_536.0;
            close(encoded[12], 64.0 * real.min(1.25), "thinned uniform");
            for (k, limit) in [0.25, 0.5, 0.75, 1.0].into_iter().enumerate() {
                assert_eq!(encoded[13 + k] == ONE, real < limit);
            }
        }
    }
}

#[test]
fn the_home_sub_channel_comes_first() {
    let (gain, interference) = ([10 << 8, 20 << 8, 30 << 8], [1 << 8, 2 << 8, 3 << 8]);
    for home in 0..3_u8 {
        let observation = Readings {
            gain,
            interference,
            home,
            ..Readings::default()
        }
        .observation();
        for k in 0..3 {
            let channel = (usize::from(home) + k) % 3;
            assert_eq!(observation.gain()[k].to_bits(), gain[channel]);
        }
        let rotate = |values: [i16; 3]| std::array::from_fn(|k| values[(usize::from(home) + k) % 3]);
        let rotated = Readings {
            gain: rotate(gain),
            interference: rotate(interference),
            ..Readings::default()
        };
        let (own, turned) = (observation.encode(Level::ZERO), rotated.encode(0));
        assert_eq!(own, turned, "home {home}");
        assert_eq!(observation.home_gain().to_bits(), gain[usize::from(home)]);
    }
}
