//! The two losses and their slopes: the actor's clipped surrogate with entropy, and the critic's Huber loss.

use crate::network::categorical::{entropy, log_probability, softmax};

/// What a sample adds to the means of an actor's step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActorTerms {
    /// Clipped surrogate less weighted entropy.
    pub loss: f32,
    /// Entropy in nats.
    pub entropy: f32,
    /// 1 if the sample was clipped.
    pub clipped: f32,
}

/// One decision that was taken, and how much better than expected it turned out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// The action's index.
    pub action: usize,
    /// Its log probability when it was taken.
    pub log_probability: f32,
    /// Its advantage.
    pub advantage: f32,
}

/// The clipped surrogate (Schulman et al., "Proximal policy optimization algorithms", 2017, eq. 7) less the weighted entropy
/// (eq. 9) of one sample; `slope` becomes the gradient against the outputs.
pub fn clipped_surrogate(
    outputs: &[f32],
    taken: Taken,
    clip: f32,
    entropy_weight: f32,
    slope: &mut [f32],
) -> ActorTerms {
    softmax(outputs, slope);
    let entropy = entropy(slope);
    let ratio = libm::expf(log_probability(slope[taken.action]) - taken.log_probability);
    let surrogate = ratio * taken.advantage;
    let bounded = ratio.clamp(1.0 - clip, 1.0 + clip) * taken.advantage;
    let clipped = bounded < surrogate;
    let factor = if clipped { 0.0 } else { surrogate };
    for (action, slope) in slope.iter_mut().enumerate() {
        let p = *slope;
        let chosen = if action == taken.action { 1.0 } else { 0.0 };
        *slope = factor * (p - chosen) + entropy_weight * p * (log_probability(p) + entropy);
    }
    ActorTerms {
        loss: -surrogate.min(bounded) - entropy_weight * entropy,
        entropy,
        clipped: f32::from(clipped),
    }
}

/// Huber's loss with its bend at 1, and its slope.
pub fn huber(value: f32, target: f32) -> (f32, f32) {
    let error = value - target;
    if error.abs() <= 1.0 {
        (0.5 * error * error, error)
    } else {
        (error.abs() - 0.5, error.signum())
    }
}
