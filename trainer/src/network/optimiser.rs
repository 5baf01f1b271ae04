//! Adam, targets that follow the parameters, and the length of gradients.

use super::pool::Pool;
use super::product::Rounding;
use crate::laboratory::state::State;
use kit::error::Result;
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// Adam's decay rates and the number that keeps its division finite (Kingma and Ba 2015).
const BETA: (f32, f32) = (0.9, 0.999);
const EPSILON: f32 = 1e-8;

/// With [`Rounding::Fused`], moments below this count as zero, and slopes below `LEAST_SLOPE`, whose square it is (chosen). Beside
/// `EPSILON` they move nothing; without this the moments of units that have died away would decay into denormal numbers, on which
/// processors count a hundred times slower.
const LEAST_MOMENT: f32 = 1e-30;
const LEAST_SLOPE: f32 = 1e-15;

/// Adam (Kingma and Ba 2015): running moments of a gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Running mean.
    pub mean: Vec<f32>,
    /// Running mean of the squares.
    pub square: Vec<f32>,
    /// `BETA` to the power of the steps done.
    pub powers: Powers,
    rounding: Rounding,
}

/// `BETA` to the power of a number of steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Powers(pub f64, pub f64);

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

impl Step {
    /// A step down the gradient as it is.
    pub const fn plain(learning_rate: f32) -> Self {
        Self {
            learning_rate,
            target_rate: 0.0,
            scale: 1.0,
        }
    }
}

impl Adam {
    /// For so many parameters. With [`Rounding::Each`] the step is Kingma and Ba's as printed, in f32 throughout; with
    /// [`Rounding::Fused`] the corrections of both moments are found once, in f64.
    pub fn new(parameters: usize, rounding: Rounding) -> Self {
        Self {
            mean: vec![0.0; parameters],
            square: vec![0.0; parameters],
            powers: Powers(1.0, 1.0),
            rounding,
        }
    }

    /// One step of the parameters down the gradient, and of `target`, unless it is empty, after them: one run over memory.
    pub fn step(&mut self, parameters: &mut [f32], target: &mut [f32], gradient: &[f32], step: Step) {
        let (Powers(first, second), (beta_1, beta_2)) = (self.powers, BETA);
        let rates = if self.rounding == Rounding::Each {
            let (first, second) = (first as f32 * beta_1, second as f32 * beta_2);
            self.powers = Powers(first.into(), second.into());
            [step.learning_rate, 1.0 - first, 1.0 - second]
        } else {
            let (first, second) = (first * f64::from(beta_1), second * f64::from(beta_2));
            self.powers = Powers(first, second);
            let rate = f64::from(step.learning_rate) / (1.0 - first);
            [rate as f32, 1.0, (1.0 / libm::sqrt(1.0 - second)) as f32]
        };
        Arch::new().dispatch(Update {
            adam: self,
            parameters,
            target,
            gradient,
            rates,
            step,
        });
    }
}

/// One run over parameters, targets and moments.
struct Update<'a> {
    adam: &'a mut Adam,
    parameters: &'a mut [f32],
    target: &'a mut [f32],
    gradient: &'a [f32],
    /// The learning rate, and the corrections of the mean and of the squares, as [`moved`] takes them.
    rates: [f32; 3],
    step: Step,
}

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.adam.rounding {
            Rounding::Each => self.run::<S, true>(simd),
            Rounding::Fused => self.run::<S, false>(simd),
        }
    }
}

impl Update<'_> {
    #[inline(always)]
    fn run<S: Simd, const PRINTED: bool>(self, simd: S) {
        let (slopes, last_slopes) = S::as_simd_f32s(self.gradient);
        let (parameters, last_parameters) = S::as_mut_simd_f32s(self.parameters);
        let (targets, last_targets) = S::as_mut_simd_f32s(self.target);
        let (means, last_means) = S::as_mut_simd_f32s(&mut self.adam.mean);
        let (squares, last_squares) = S::as_mut_simd_f32s(&mut self.adam.square);
        let rates = self.rates.map(|rate| simd.splat_f32s(rate));
        let [scale, follow] = [self.step.scale, self.step.target_rate].map(|value| simd.splat_f32s(value));
        let mut targets = targets.iter_mut();
        for (((&slope, mean), square), parameter) in slopes.iter().zip(means).zip(squares).zip(parameters) {
            let slope = simd.mul_f32s(slope, scale);
            [*mean, *square, *parameter] =
                moved::<S, PRINTED>(simd, rates, slope, [*mean, *square, *parameter]);
            if let Some(target) = targets.next() {
                *target = followed(simd, *target, *parameter, follow);
            }
        }
        let last = [&*last_means, &*last_squares, &*last_parameters].map(|last| simd.partial_load_f32s(last));
        let slope = simd.mul_f32s(simd.partial_load_f32s(last_slopes), scale);
        let [mean, square, parameter] = moved::<S, PRINTED>(simd, rates, slope, last);
        simd.partial_store_f32s(last_means, mean);
        simd.partial_store_f32s(last_squares, square);
        simd.partial_store_f32s(last_parameters, parameter);
        let target = simd.partial_load_f32s(last_targets);
        simd.partial_store_f32s(last_targets, followed(simd, target, parameter, follow));
    }
}

/// Mean, square and parameter after a step, every operation rounded by itself, so that the bits do not depend on the vectors' width.
/// As printed, or with the corrections in the learning rate and in a factor of the root, and zeros for moments that have died away.
#[inline(always)]
fn moved<S: Simd, const PRINTED: bool>(
    simd: S,
    [rate, of_mean, of_square]: [S::f32s; 3],
    slope: S::f32s,
    [mean, square, parameter]: [S::f32s; 3],
) -> [S::f32s; 3] {
    let [keep_1, keep_2] = [BETA.0, BETA.1].map(|beta| simd.splat_f32s(beta));
    let [all_1, all_2] = [1.0 - BETA.0, 1.0 - BETA.1].map(|share| simd.splat_f32s(share));
    let epsilon = simd.splat_f32s(EPSILON);
    if PRINTED {
        let mean = simd.add_f32s(simd.mul_f32s(keep_1, mean), simd.mul_f32s(all_1, slope));
        let fresh = simd.mul_f32s(simd.mul_f32s(all_2, slope), slope);
        let square = simd.add_f32s(simd.mul_f32s(keep_2, square), fresh);
        let root = simd.add_f32s(simd.sqrt_f32s(simd.div_f32s(square, of_square)), epsilon);
        let change = simd.div_f32s(simd.mul_f32s(rate, simd.div_f32s(mean, of_mean)), root);
        return [mean, square, simd.sub_f32s(parameter, change)];
    }
    let slope = unless_below(simd, slope, LEAST_SLOPE);
    let fresh = simd.mul_f32s(all_1, simd.sub_f32s(slope, mean));
    let mean = unless_below(simd, simd.add_f32s(mean, fresh), LEAST_MOMENT);
    let fresh = simd.mul_f32s(all_2, simd.mul_f32s(slope, slope));
    let square = unless_below(
        simd,
        simd.add_f32s(simd.mul_f32s(keep_2, square), fresh),
        LEAST_MOMENT,
    );
    let root = simd.add_f32s(simd.mul_f32s(simd.sqrt_f32s(square), of_square), epsilon);
    let change = simd.div_f32s(simd.mul_f32s(rate, mean), root);
    [mean, square, simd.sub_f32s(parameter, change)]
}

/// The values, with zeros for those that are smaller than this.
#[inline(always)]
fn unless_below<S: Simd>(simd: S, values: S::f32s, least: f32) -> S::f32s {
    let small = simd.less_than_f32s(simd.abs_f32s(values), simd.splat_f32s(least));
    simd.select_f32s(small, simd.splat_f32s(0.0), values)
}

/// The target after a step towards its parameter.
#[inline(always)]
fn followed<S: Simd>(simd: S, target: S::f32s, parameter: S::f32s, rate: S::f32s) -> S::f32s {
    simd.add_f32s(target, simd.mul_f32s(rate, simd.sub_f32s(parameter, target)))
}

/// The parameters of one network while it learns.
#[derive(Clone, Debug, PartialEq)]
pub struct Learned {
    /// What acts or judges.
    pub parameters: Vec<f32>,
    /// What follows slowly and gives the learning targets.
    pub target: Vec<f32>,
    adam: Adam,
}

impl Learned {
    /// Targets begin as the parameters.
    pub fn new(parameters: Vec<f32>) -> Self {
        Self {
            target: parameters.clone(),
            adam: Adam::new(parameters.len(), Rounding::Fused),
            parameters,
        }
    }

    /// One step of Adam down the gradient, and one of the targets after the parameters.
    pub fn step(&mut self, gradient: &[f32], step: Step) {
        self.adam
            .step(&mut self.parameters, &mut self.target, gradient, step);
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
        let Adam { mean, square, .. } = &self.adam;
        for (part, values) in PARTS.iter().zip([&self.parameters, &self.target, mean, square]) {
            state.put(format!("{name}.{part}"), &[values.len()], values.clone());
        }
        self.adam.powers
    }

    /// Reads everything from a state.
    ///
    /// # Errors
    /// The tensor that is missing or has another length.
    pub fn load(&mut self, name: &str, state: &mut State, powers: Powers) -> Result<()> {
        let shape = [self.parameters.len()];
        let Adam { mean, square, .. } = &mut self.adam;
        let parts = [&mut self.parameters, &mut self.target, mean, square];
        for (part, values) in PARTS.iter().zip(parts) {
            *values = state.take_f32(&format!("{name}.{part}"), &shape)?;
        }
        self.adam.powers = powers;
        Ok(())
    }
}

/// Names of a learned network's parts in a state.
const PARTS: [&str; 4] = ["parameters", "target", "mean", "square"];

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
        // As printed, without targets, the same but for rounding.
        let (mut adam, mut parameters) = (Adam::new(19, Rounding::Each), vec![1.0; 19]);
        adam.step(&mut parameters, &mut [], &slopes, step);
        adam.step(&mut parameters, &mut [], &[0.0; 19], step);
        for (printed, parameter) in parameters.iter().zip(&learned.parameters) {
            assert!((printed - parameter).abs() < 1e-6);
        }
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
        assert_eq!(learned.adam.mean, [0.0; 19]);
        assert!(learned.adam.square.iter().all(|square| *square > LEAST_MOMENT));
    }

    #[test]
    fn gradients_are_shortened_to_their_limit() {
        assert_eq!(clip(&[3.0, 4.0], 0.0), 1.0);
        assert_eq!(clip(&[3.0, 4.0], 10.0), 1.0);
        assert_eq!(clip(&[3.0, 4.0], 1.0), 0.2);
    }
}
