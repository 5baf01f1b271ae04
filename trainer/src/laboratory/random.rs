//! Random numbers of learning. They are keyed by seed and episode, so that nothing about them must be saved, and by
//! [`Purpose::Training`], so that no evaluation meets them.

use host_sim::environment::Environment;
use host_sim::mobility::Grid;
use host_sim::scenario::Scenario;
use host_sim::stream::{Purpose, Role, Stream, WorldKey};
use std::ops::Range;

/// The key of one of an episode's worlds. `worlds` is the number of worlds in every episode.
pub fn world(seed: u64, episode: u64, worlds: u64, index: u64) -> WorldKey {
    WorldKey {
        seed,
        purpose: Purpose::Training,
        world: episode * worlds + index,
    }
}

/// Fresh worlds of a scenario on the road grid, for training.
pub fn worlds(scenario: &Scenario, seed: u64, worlds: Range<u64>) -> Environment<'_> {
    Environment::new(scenario, &Grid, seed, Purpose::Training, worlds)
}

/// The learner's own stream in an episode: exploration, sampling of batches, start ages. Worlds count from below, these
/// streams from above. Members separate uses; [`initial`] is one more.
pub fn episode(seed: u64, episode: u64, member: u32) -> Stream {
    let key = WorldKey {
        seed,
        purpose: Purpose::Training,
        world: u64::MAX - 1 - episode,
    };
    key.stream(Role::Policy, member)
}

/// The stream of what is drawn before the first episode, such as initial weights.
pub fn initial(seed: u64, member: u32) -> Stream {
    let key = WorldKey {
        seed,
        purpose: Purpose::Training,
        world: u64::MAX,
    };
    key.stream(Role::Policy, member)
}

/// A random order (Fisher and Yates).
pub fn shuffle(values: &mut [usize], stream: &mut Stream) {
    for last in (1..values.len()).rev() {
        values.swap(last, stream.below(last as u32 + 1) as usize);
    }
}
