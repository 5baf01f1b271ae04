//! A choice among few by scores: the softmax, its entropy, and draws from it.

use host_sim::stream::Stream;

/// Writes the softmax of scores.
pub fn softmax(scores: &[f32], probabilities: &mut [f32]) {
    let largest = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sum = 0.0;
    for (probability, &score) in probabilities.iter_mut().zip(scores) {
        *probability = libm::expf(score - largest);
        sum += *probability;
    }
    probabilities
        .iter_mut()
        .for_each(|probability| *probability /= sum);
}

/// The softmax of scores.
pub fn probabilities(scores: &[f32]) -> Vec<f32> {
    let mut probabilities = vec![0.0; scores.len()];
    softmax(scores, &mut probabilities);
    probabilities
}

/// Logarithm of a probability; one that underflowed counts as the smallest normal number.
pub fn log_probability(probability: f32) -> f32 {
    libm::logf(probability.max(f32::MIN_POSITIVE))
}

/// The expectation of `gains`.
pub fn expectation(probabilities: &[f32], gains: &[f32]) -> f32 {
    let each = probabilities.iter().zip(gains);
    each.map(|(probability, gain)| probability * gain).sum()
}

/// Slopes of the expectation of `gains` under a softmax along its scores.
pub fn expectation_slopes(probabilities: &[f32], gains: &[f32]) -> Vec<f32> {
    let mean = expectation(probabilities, gains);
    let each = probabilities.iter().zip(gains);
    each.map(|(probability, gain)| probability * (gain - mean))
        .collect()
}

/// Entropy of a softmax in nats.
pub fn entropy(probabilities: &[f32]) -> f32 {
    -probabilities.iter().map(|&p| p * log_probability(p)).sum::<f32>()
}

/// The entropy's slope along the score of an action with this probability.
pub fn entropy_slope(probability: f32, entropy: f32) -> f32 {
    -probability * (log_probability(probability) + entropy)
}

/// Index of the largest score; the first of equals.
pub fn largest(scores: &[f32]) -> usize {
    (1..scores.len()).fold(
        0,
        |best, index| if scores[index] > scores[best] { index } else { best },
    )
}

/// Scores plus Gumbel noise: the largest is a draw from their softmax.
pub fn gumbel(scores: &[f32], stream: &mut Stream) -> Vec<f32> {
    let perturbed = scores
        .iter()
        .map(|score| score - libm::logf(stream.exponential()));
    perturbed.collect()
}

/// A draw from the softmax of scores.
pub fn draw(scores: &[f32], stream: &mut Stream) -> usize {
    largest(&gumbel(scores, stream))
}

/// Appends a vector of zeros with a one.
pub fn one_hot(index: usize, length: usize, values: &mut Vec<f32>) {
    values.extend((0..length).map(|other| f32::from(u8::from(other == index))));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random::initial;

    #[test]
    fn draws_follow_the_softmax() {
        let mut stream = initial(1, 0);
        let scores = [1.0, 0.0, -1.0, 2.0, 0.5, -9.0];
        let expected = probabilities(&scores);
        let mut counts = [0.0_f32; 6];
        for _ in 0..100_000 {
            counts[draw(&scores, &mut stream)] += 1e-5;
        }
        for (count, expected) in counts.iter().zip(expected) {
            // Five standard errors at most.
            assert!((count - expected).abs() < 0.008);
        }
    }
}
