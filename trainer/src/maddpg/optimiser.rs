//! Parameters, the targets that follow them, and Adam, in one run over memory.

use super::pool::Pool;
use crate::laboratory::state::State;
use kit::error::Result;
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// Adam's decay rates and the number that keeps its division finite (Kingma and Ba 2015).
const BETA: (f32, f32) = (0.9, 0.999);
const EPSILON: f32 = 1e-8;

/// Moments below this count as zero, and slopes below `LEAST_SLOPE`, whose square it is (chosen). Beside `EPSILON` they move nothing;
/// without this the moments of units that have died away would decay into denormal numbers, on which processors count a
/// hundred times slower.
const LEAST_MOMENT: f32 = 1e-30;
const LEAST_SLOPE: f32 = 1e-15;

/// The parameters of one network while it learns.
#[derive(Clone, Debug, PartialEq)]
pub struct Learned {
    /// What acts or judges.
    pub parameters: Vec<f32>,
    /// What follows slowly and gives the learning targets.
    pub target: Vec<f32>,
    mean: Vec<f32>,
    square: Vec<f32>,
    powers: Powers,
}

/// `BETA` to the power of the number of steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Powers(f64, f64);

/// What a step needs besides the gradient.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Adam's learning rate.
    pub learning_rate: f32,
    /// The share of the way to the parameters that targets go (tau of Table I).
    pub target_rate: f32,
    /// The gradient is multiplied by this: 1, or less where it is clipped.
    pub scale: f32,
}

impl Learned {
    /// Targets begin as the parameters.
    pub fn new(parameters: Vec<f32>) -> Self {
        Self {
            target: parameters.clone(),
            mean: vec![0.0; parameters.len()],
            square: vec![0.0; parameters.len()],
            parameters,
            powers: Powers(1.0, 1.0),
        }
    }

    /// One step of Adam down the gradient, and one of the targets after the parameters.
    pub fn step(&mut self, gradient: &[f32], step: Step) {
        let (beta_1, beta_2) = BETA;
        self.powers.0 *= f64::from(beta_1);
        self.powers.1 *= f64::from(beta_2);
        let rate = (f64::from(step.learning_rate) / (1.0 - self.powers.0)) as f32;
        let root = (1.0 / libm::sqrt(1.0 - self.powers.1)) as f32;
        Arch::new().dispatch(Update {
            learned: self,
            gradient,
            rate,
            root,
            step,
        });
    }

    /// Steps down the gradient that `find` writes for the parameters, shortened to at most this length ([`clip`]). Finds whatever
    /// was left in the room.
    pub fn descend(
        &mut self,
        room: &Pool<Vec<f32>>,
        step: Step,
        longest_gradient: f32,
        find: impl FnOnce(&[f32], &mut [f32]),
    ) {
        room.lend(|gradient| {
            gradient.resize(self.parameters.len(), 0.0);
            find(&self.parameters, gradient);
            let scale = clip(gradient, longest_gradient);
            self.step(gradient, Step { scale, ..step });
        });
    }

    /// Writes everything into a state.
    pub fn save(&self, name: &str, state: &mut State) -> Powers {
        for (part, values) in self.parts() {
            state.put(format!("{name}.{part}"), &[values.len()], values.clone());
        }
        self.powers
    }

    /// Reads everything from a state.
    ///
    /// # Errors
    /// The tensor that is missing or has another length.
    pub fn load(&mut self, name: &str, state: &mut State, powers: Powers) -> Result<()> {
        let shape = [self.parameters.len()];
        for (part, values) in [
            ("parameters", &mut self.parameters),
            ("target", &mut self.target),
            ("mean", &mut self.mean),
            ("square", &mut self.square),
        ] {
            *values = state.take_f32(&format!("{name}.{part}"), &shape)?;
        }
        self.powers = powers;
        Ok(())
    }

    fn parts(&self) -> [(&'static str, &Vec<f32>); 4] {
        [
            ("parameters", &self.parameters),
            ("target", &self.target),
            ("mean", &self.mean),
            ("square", &self.square),
        ]
    }
}

/// One run over parameters, targets and moments.
struct Update<'a> {
    learned: &'a mut Learned,
    gradient: &'a [f32],
    /// Learning rate over the correction of the mean.
    rate: f32,
    /// One over the root of the correction of the squares.
    root: f32,
    step: Step,
}

impl WithSimd for Update<'_> {
    type Output = ();

    /// Every operation is rounded by itself and alike in vectors and in the rest, so the bits do not depend on their width.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (beta_1, beta_2) = BETA;
        let Learned {
            parameters,
            target,
            mean,
            square,
            ..
        } = self.learned;
        let (slopes, last_slopes) = S::as_simd_f32s(self.gradient);
        let (parameters, last_parameters) = S::as_mut_simd_f32s(parameters);
        let (targets, last_targets) = S::as_mut_simd_f32s(target);
        let (means, last_means) = S::as_mut_simd_f32s(mean);
        let (squares, last_squares) = S::as_mut_simd_f32s(square);
        let moments = means.iter_mut().zip(squares);
        let values = parameters.iter_mut().zip(targets);
        let [all_1, all_2] = [1.0 - beta_1, 1.0 - beta_2].map(|value| simd.splat_f32s(value));
        let [keep_2, scale, rate] = [beta_2, self.step.scale, self.rate].map(|value| simd.splat_f32s(value));
        let [root, epsilon, follow] =
            [self.root, EPSILON, self.step.target_rate].map(|value| simd.splat_f32s(value));
        for ((&slope, (mean, square)), (parameter, target)) in slopes.iter().zip(moments).zip(values) {
            let slope = unless_below(simd, simd.mul_f32s(slope, scale), LEAST_SLOPE);
            let moved = simd.add_f32s(*mean, simd.mul_f32s(all_1, simd.sub_f32s(slope, *mean)));
            *mean = unless_below(simd, moved, LEAST_MOMENT);
            let fresh = simd.mul_f32s(all_2, simd.mul_f32s(slope, slope));
            let moved = simd.add_f32s(simd.mul_f32s(keep_2, *square), fresh);
            *square = unless_below(simd, moved, LEAST_MOMENT);
            let below = simd.add_f32s(simd.mul_f32s(simd.sqrt_f32s(*square), root), epsilon);
            *parameter = simd.sub_f32s(*parameter, simd.div_f32s(simd.mul_f32s(rate, *mean), below));
            *target = simd.add_f32s(*target, simd.mul_f32s(follow, simd.sub_f32s(*parameter, *target)));
        }
        let moments = last_means.iter_mut().zip(last_squares);
        let values = last_parameters.iter_mut().zip(last_targets);
        for ((&slope, (mean, square)), (parameter, target)) in last_slopes.iter().zip(moments).zip(values) {
            let slope = slope * self.step.scale;
            let slope = if slope.abs() < LEAST_SLOPE { 0.0 } else { slope };
            let moved = *mean + (1.0 - beta_1) * (slope - *mean);
            *mean = if moved.abs() < LEAST_MOMENT { 0.0 } else { moved };
            let moved = beta_2 * *square + (1.0 - beta_2) * (slope * slope);
            *square = if moved.abs() < LEAST_MOMENT { 0.0 } else { moved };
            *parameter -= self.rate * *mean / (libm::sqrtf(*square) * self.root + EPSILON);
            *target += self.step.target_rate * (*parameter - *target);
        }
    }
}

/// The values, with zeros for those that are smaller than this.
#[inline(always)]
fn unless_below<S: Simd>(simd: S, values: S::f32s, least: f32) -> S::f32s {
    let small = simd.less_than_f32s(simd.abs_f32s(values), simd.splat_f32s(least));
    simd.select_f32s(small, simd.splat_f32s(0.0), values)
}

/// The factor that shortens a gradient to at most this length; 0 stands for no limit.
pub fn clip(gradient: &[f32], longest: f32) -> f32 {
    if longest == 0.0 {
        return 1.0;
    }
    let square: f64 = gradient
        .iter()
        .map(|&slope| f64::from(slope) * f64::from(slope))
        .sum();
    let length = libm::sqrt(square) as f32;
    if length > longest { longest / length } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_adam_and_targets_follow() {
        // 19 values: more than one vector and a rest.
        let slopes: Vec<f32> = (0..19).map(|index| index as f32 - 9.0).collect();
        let mut learned = Learned::new(vec![1.0; 19]);
        let step = Step {
            learning_rate: 0.1,
            target_rate: 0.25,
            scale: 0.5,
        };
        learned.step(&slopes, step);
        for (index, slope) in slopes.iter().enumerate() {
            // Adam's first step is the learning rate, whatever the slope's size.
            let expected = 1.0 - 0.1 * if *slope == 0.0 { 0.0 } else { slope.signum() };
            assert!((learned.parameters[index] - expected).abs() < 1e-6);
            assert!((learned.target[index] - (1.0 + 0.25 * (expected - 1.0))).abs() < 1e-6);
        }
        // The second step by hand for one parameter: slopes 4.5, then 0.
        learned.step(&[0.0; 19], step);
        let mean = 0.9 * 0.1 * 4.5 / (1.0 - 0.81);
        let root = libm::sqrt(0.999 * 0.001 * 4.5 * 4.5 / (1.0 - 0.999 * 0.999));
        assert!((f64::from(learned.parameters[18]) - (0.9 - 0.1 * mean / root)).abs() < 1e-5);
    }

    #[test]
    fn what_has_died_away_is_zero() {
        // 19 values: more than one vector and a rest. The mean falls below 1e-38 in 800 steps.
        let mut learned = Learned::new(vec![1.0; 19]);
        let step = Step {
            learning_rate: 0.1,
            target_rate: 0.25,
            scale: 1.0,
        };
        learned.step(&[0.5; 19], step);
        (0..1000).for_each(|_| learned.step(&[1e-20; 19], step));
        assert_eq!(learned.mean, [0.0; 19]);
        assert!(learned.square.iter().all(|square| *square > LEAST_MOMENT));
    }

    #[test]
    fn gradients_are_shortened_to_their_limit() {
        assert_eq!(clip(&[3.0, 4.0], 0.0), 1.0);
        assert_eq!(clip(&[3.0, 4.0], 10.0), 1.0);
        assert_eq!(clip(&[3.0, 4.0], 1.0), 0.2);
    }
}
