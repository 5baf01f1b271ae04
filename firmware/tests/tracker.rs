//! The level tracker on a synthetic track: shadowing of 8 dB with a decorrelation distance of 50 m at 12 m/s, Rayleigh
//! fading that is new on every sub-channel in every slot, and a distance that grows.

use firmware::observation::PAPER_SUB_CHANNELS;
use firmware::tracker::LevelTracker;
use firmware::units::Level;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

struct Track {
    rng: Pcg64Mcg,
    distance: f64,
    shadowing: f64,
}

impl Track {
    fn new(seed: u128) -> Self {
        let mut rng = Pcg64Mcg::new(seed);
        let shadowing = 8.0 * gaussian(&mut rng);
        Self {
            rng,
            distance: 100.0,
            shadowing,
        }
    }

    /// One slot further: the mean received level in dB, and what is measured with fading.
    fn slot(&mut self) -> (f64, [Level; PAPER_SUB_CHANNELS]) {
        let travelled = 12.0e-3;
        self.distance += travelled;
        let correlation = libm::exp(-travelled / 50.0);
        self.shadowing = correlation * self.shadowing
            + 8.0 * libm::sqrt(1.0 - correlation * correlation) * gaussian(&mut self.rng);
        let level = 120.0 - 37.6 * libm::log10(self.distance) + self.shadowing;
        let faded = std::array::from_fn(|_| {
            let power = -libm::log(uniform(&mut self.rng));
            Level::saturating_from_num(level + 10.0 * libm::log10(power))
        });
        // Euler's constant in dB: the mean of an exponential power's logarithm.
        (
            level - 10.0 * 0.577_215_664_901_532_9 * std::f64::consts::LOG10_E,
            faded,
        )
    }
}

fn uniform(rng: &mut Pcg64Mcg) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}

fn gaussian(rng: &mut Pcg64Mcg) -> f64 {
    let radius = libm::sqrt(-2.0 * libm::log(uniform(rng)));
    radius * libm::cos(2.0 * std::f64::consts::PI * uniform(rng))
}

/// RMS error in dB of (the tracker, repeating the last sample, repeating the last mean of three) as predictions of the mean
/// level `ahead` slots after the last measurement.
fn errors(ahead: usize) -> [f64; 3] {
    let (mut squares, mut count) = ([0.0; 3], 0_u32);
    for seed in 1..=20 {
        let (mut track, mut tracker) = (Track::new(seed), LevelTracker::default());
        for slot in 0..6_000 {
            let (_, measured) = track.slot();
            tracker.measure(&measured);
            // The filter's time constant is 20 slots; 300 let it settle.
            if slot < 300 || slot % 100 != 0 {
                continue;
            }
            let mut tracker = tracker;
            let mut truth = 0.0;
            for _ in 0..ahead {
                (truth, _) = track.slot();
                tracker.miss();
            }
            let sample = measured[0].to_num::<f64>();
            let mean = measured.iter().map(|level| level.to_num::<f64>()).sum::<f64>() / 3.0;
            let predicted = tracker.predicted().unwrap().to_num::<f64>();
            for (square, value) in squares.iter_mut().zip([predicted, sample, mean]) {
                *square += (value - truth) * (value - truth);
            }
            count += 1;
        }
    }
    squares.map(|square| libm::sqrt(square / f64::from(count)))
}

#[test]
fn prediction_beats_repeating_the_last_sample() {
    for (ahead, limit) in [
        (1, NEXT_SLOT_DB),
        (20, TWENTY_SLOTS_DB),
        (99, LAST_DEGRADED_SLOT_DB),
    ] {
        let [tracker, sample, mean] = errors(ahead);
        println!(
            "{ahead} slots ahead: tracker {tracker:.2} dB, last sample {sample:.2} dB, last mean {mean:.2} dB"
        );
        assert!(tracker < limit, "{ahead} slots ahead: {tracker:.2} dB");
        assert!(tracker < 0.5 * sample, "{tracker:.2} dB against {sample:.2} dB");
        assert!(tracker < mean, "{tracker:.2} dB against {mean:.2} dB");
    }
}

const NEXT_SLOT_DB: f64 = 0.85;
const TWENTY_SLOTS_DB: f64 = 1.3;
const LAST_DEGRADED_SLOT_DB: f64 = 2.5;

#[test]
fn nothing_is_predicted_before_the_first_measurement() {
    let mut tracker = LevelTracker::default();
    tracker.miss();
    assert_eq!(tracker.predicted(), None);
    tracker.measure(&[Level::from_num(12); PAPER_SUB_CHANNELS]);
    assert_eq!(tracker.predicted(), Some(Level::from_num(12)));
}
