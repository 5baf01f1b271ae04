//! Exact line search: how far to go in a direction of link flows until the objective is least.

use crate::volume_delay::VolumeDelay;

/// A step length is found when the correction or the bracket is this share of the largest step.
const STEP_TOLERANCE: f64 = 1e-14;

/// Most evaluations in one search; bisection alone would need 47 for [`STEP_TOLERANCE`].
const EVALUATION_LIMIT: usize = 60;

/// The step from 0 to `largest_step` along `direction` at which the sum of the integrals of `delays` is least: the root of
/// its derivative, which never falls, by Newton's method within a bracket.
///
/// A step of 1 costs `linear` beside. 0 if the objective rises from the start. Flows that rounding would take below 0 count as 0.
pub(crate) fn exact_step(
    delays: &[VolumeDelay],
    link_flows: &[f64],
    direction: &[f64],
    (linear, largest_step): (f64, f64),
) -> f64 {
    let slope = |step: f64| {
        let (mut first, mut second) = (linear, 0.0);
        for ((delay, &flow), &change) in delays.iter().zip(link_flows).zip(direction) {
            if change != 0.0 {
                let (cost, derivative) = delay.cost_and_derivative((flow + step * change).max(0.0));
                first += change * cost;
                second += change * change * derivative;
            }
        }
        (first, second)
    };
    if slope(largest_step).0 <= 0.0 {
        return largest_step;
    }
    let (mut low, mut high) = (0.0, largest_step);
    let mut step = 0.0;
    for evaluation in 0..EVALUATION_LIMIT {
        let (first, second) = slope(step);
        if first > 0.0 {
            high = step;
        } else {
            low = step;
        }
        if evaluation == 0 && first >= 0.0 {
            return 0.0;
        }
        let newton = step - first / second;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        let correction = next - step;
        step = next;
        if correction.abs().min(high - low) < STEP_TOLERANCE * largest_step {
            break;
        }
    }
    step
}
