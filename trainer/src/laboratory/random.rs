//! Random numbers of learning. They are keyed by seed and episode, so that nothing about them must be saved, and by
//! [`Purpose::Training`], so that no evaluation meets them.

use host_sim::stream::{Purpose, Role, Stream, WorldKey};

/// The key of one of an episode's worlds. `worlds` is the number of worlds in every episode.
pub fn world(seed: u64, episode: u64, worlds: u64, index: u64) -> WorldKey {
    WorldKey {
        seed,
        purpose: Purpose::Training,
        world: episode * worlds + index,
    }
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
