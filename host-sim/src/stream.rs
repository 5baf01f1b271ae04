//! Random streams, keyed so that no two uses ever share one.

use crate::lanes::unit_interval;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

/// What a world is drawn for. Training and evaluation differ in the key itself, so no evaluation seed of anybody's
/// choice can meet a world that something was trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Held-out results.
    Evaluation = 0,
    /// Learning.
    Training = 1,
}

/// What a stream is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Where vehicles start, their speeds and turns.
    Mobility = 0,
    /// Log-normal shadowing.
    Shadowing = 1,
    /// Rayleigh fading.
    FastFading = 2,
    /// Draws of a randomised policy, one member a policy.
    Policy = 3,
    /// Identities of the units, which their lots follow from.
    Identities = 4,
    /// When capacity is lost, one member a block.
    Incidents = 5,
    /// Who is replaced when.
    Replacement = 6,
    /// Directions and phases of the waves that make fading, or its amplitudes.
    Scattering = 7,
    /// Errors of known gains.
    GainErrors = 8,
    /// Which acknowledgements, broadcasts and measurements are lost, one member each.
    Losses = 9,
    /// Whether a transmission near the required SINR is received.
    Reception = 10,
    /// Bursts of other cells' interference.
    Neighbours = 11,
    /// Who travels when and where.
    Trips = 12,
    /// How travellers see the roads, one member a vehicle.
    Tastes = 13,
}

/// One world of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorldKey {
    /// The run's seed.
    pub seed: u64,
    /// What for.
    pub purpose: Purpose,
    /// Index of the world within the run.
    pub world: u64,
}

impl WorldKey {
    /// The ChaCha key of one role's stream: different (seed, purpose, world, role, member) are different keys.
    pub(crate) fn bytes(&self, role: Role, member: u32) -> [u8; 32] {
        let mut key = [0; 32];
        let words = [
            self.seed,
            self.purpose as u64,
            self.world,
            (role as u64) << 32 | u64::from(member),
        ];
        for (bytes, word) in key.chunks_exact_mut(8).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        key
    }

    /// The stream for one role.
    pub fn stream(&self, role: Role, member: u32) -> Stream {
        Stream(ChaCha8Rng::from_seed(self.bytes(role, member)))
    }
}

/// A stream with the distributions that the simulator needs. Transcendental functions are libm's, the same on every
/// machine.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// Uniform on (0, 1): an odd multiple of 2^-24.
    pub fn uniform(&mut self) -> f32 {
        unit_interval(self.0.next_u32())
    }

    /// Uniform on the half-open interval.
    pub fn uniform_between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.uniform())
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        f64::from(self.uniform()) < probability
    }

    /// Uniform on `0..count`.
    pub fn below(&mut self, count: u32) -> u32 {
        ((u64::from(self.0.next_u32()) * u64::from(count)) >> 32) as u32
    }

    /// Exponential with mean 1: the power of Rayleigh fading.
    pub fn exponential(&mut self) -> f32 {
        -libm::logf(self.uniform())
    }

    /// Standard normal (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(2.0 * f64::from(self.exponential()));
        radius * libm::cos(std::f64::consts::TAU * f64::from(self.uniform()))
    }
}

impl rand_core::TryRng for Stream {
    type Error = std::convert::Infallible;

    fn try_next_u32(&mut self) -> std::result::Result<u32, Self::Error> {
        Ok(self.0.next_u32())
    }

    fn try_next_u64(&mut self) -> std::result::Result<u64, Self::Error> {
        Ok(self.0.next_u64())
    }

    fn try_fill_bytes(&mut self, destination: &mut [u8]) -> std::result::Result<(), Self::Error> {
        self.0.fill_bytes(destination);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: WorldKey = WorldKey {
        seed: 1,
        purpose: Purpose::Evaluation,
        world: 0,
    };

    #[test]
    fn distributions_have_their_moments() {
        let mut stream = KEY.stream(Role::FastFading, 0);
        let count = 200_000;
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let exponential: Vec<f64> = (0..count).map(|_| f64::from(stream.exponential())).collect();
        let normal: Vec<f64> = (0..count).map(|_| stream.normal()).collect();
        // Five standard errors each.
        assert!((mean(&exponential) - 1.0).abs() < 0.012);
        assert!(
            (exponential.iter().filter(|&&x| x > 3.0).count() as f64 / f64::from(count) - 0.049_787).abs()
                < 0.0025
        );
        assert!(mean(&normal).abs() < 0.012);
        assert!((mean(&normal.iter().map(|x| x * x).collect::<Vec<_>>()) - 1.0).abs() < 0.016);
        assert!((mean(&normal.iter().map(|x| x * x * x * x).collect::<Vec<_>>()) - 3.0).abs() < 0.11);
    }

    #[test]
    fn streams_differ_in_every_part_of_the_key() {
        let first = |key: WorldKey, role, member| key.stream(role, member).next_u64();
        let base = first(KEY, Role::Mobility, 0);
        assert_ne!(base, first(WorldKey { seed: 2, ..KEY }, Role::Mobility, 0));
        assert_ne!(
            base,
            first(
                WorldKey {
                    purpose: Purpose::Training,
                    ..KEY
                },
                Role::Mobility,
                0
            )
        );
        assert_ne!(base, first(WorldKey { world: 1, ..KEY }, Role::Mobility, 0));
        assert_ne!(base, first(KEY, Role::Shadowing, 0));
        assert_ne!(base, first(KEY, Role::Identities, 1));
        assert_eq!(base, first(KEY, Role::Mobility, 0));
    }
}
