//! Choosing one of few actions by scores: softmax, its entropy, and draws from it.

use host_sim::stream::Stream;

/// The softmax of scores.
pub fn softmax(scores: &[f32]) -> Vec<f32> {
    let largest = scores
        .iter()
        .fold(f32::NEG_INFINITY, |largest, &score| largest.max(score));
    let mut probabilities: Vec<f32> = scores.iter().map(|score| libm::expf(score - largest)).collect();
    let sum: f32 = probabilities.iter().sum();
    probabilities
        .iter_mut()
        .for_each(|probability| *probability /= sum);
    probabilities
}

/// Slopes of the expectation of `gains` under a softmax along its scores.
pub fn expectation_slopes(probabilities: &[f32], gains: &[f32]) -> Vec<f32> {
    let mean = expectation(probabilities, gains);
    let each = probabilities.iter().zip(gains);
    each.map(|(probability, gain)| probability * (gain - mean))
        .collect()
}

/// The expectation of `gains`.
pub fn expectation(probabilities: &[f32], gains: &[f32]) -> f32 {
    probabilities
        .iter()
        .zip(gains)
        .map(|(probability, gain)| probability * gain)
        .sum()
}

/// Entropy of a softmax in nats, and its slopes along the scores.
pub fn entropy(probabilities: &[f32]) -> (f32, Vec<f32>) {
    let logarithms: Vec<f32> = probabilities
        .iter()
        .map(|probability| libm::logf(probability.max(f32::MIN_POSITIVE)))
        .collect();
    let entropy = -probabilities
        .iter()
        .zip(&logarithms)
        .map(|(p, log)| p * log)
        .sum::<f32>();
    let slopes = probabilities
        .iter()
        .zip(&logarithms)
        .map(|(p, log)| -p * (log + entropy));
    (entropy, slopes.collect())
}

/// Scores plus Gumbel noise: the largest is a draw from their softmax.
pub fn gumbel(scores: &[f32], stream: &mut Stream) -> Vec<f32> {
    scores
        .iter()
        .map(|score| score - libm::logf(stream.exponential()))
        .collect()
}

/// A draw from the softmax of scores; the first of equals.
pub fn sample(scores: &[f32], stream: &mut Stream) -> usize {
    let perturbed = gumbel(scores, stream);
    (1..scores.len()).fold(0, |best, index| {
        if perturbed[index] > perturbed[best] {
            index
        } else {
            best
        }
    })
}

/// Appends a vector of zeros with a one.
pub fn one_hot(index: usize, length: usize, values: &mut Vec<f32>) {
    values.extend((0..length).map(|other| f32::from(u8::from(other == index))));
}
