//! Volume-delay functions: what a link costs when a given flow uses it.
//!
//! * The BPR function of the US Bureau of Public Roads (Traffic Assignment Manual, 1964),
//!   `t(x) = t0 (1 + B (x / capacity)^power)`.
//! * The conical function (Spiess, "Conical Volume-Delay Functions", Transportation Science 24, 1990), with `u = 1 - x / capacity`
//!   and `beta = (2 alpha - 1) / (2 alpha - 2)`: `t(x) = t0 (2 + sqrt(alpha^2 u^2 + beta^2) - alpha u - beta)`.
//! * The time-dependent function of Akcelik ("Travel Time Functions for Transport Planning Purposes", Australian Road Research 21,
//!   1991), with `z = x / capacity - 1` and a period of length T: `t(x) = t0 + T/4 (z + sqrt(z^2 + 8 J (x / capacity) / capacity))`.
//!
//! Each gains a part that no flow changes (toll, distance). The first is kept as `fixed + congestion x^power`, with powers
//! that are multiples of a half by multiplication and square root; the other two are branches of one hyperbola.

use crate::Objective;
use crate::hyperbola::Hyperbola;

/// B and power where nobody says otherwise, the values of the Bureau of Public Roads.
pub(crate) const BPR_B: f64 = 0.15;
pub(crate) const BPR_POWER: f64 = 4.0;

/// Powers up to this many halves are computed by multiplication (chosen: more would take as long as a logarithm).
const MOST_HALVES: f64 = 64.0;

/// Generalised cost of one link as a function of its flow.
///
/// Total for every flow of at least 0: never panics, never decreases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeDelay(Curve);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    Constant {
        cost: f64,
    },
    /// `fixed + congestion x^4`, the usual case.
    Quartic {
        fixed: f64,
        congestion: f64,
    },
    /// `fixed + congestion x^(halves / 2)`, with at least one half.
    Halves {
        fixed: f64,
        congestion: f64,
        halves: u32,
    },
    /// `fixed + congestion x^power`.
    Power {
        fixed: f64,
        congestion: f64,
        power: f64,
    },
    Hyperbola(Hyperbola),
    /// The marginal cost of a hyperbola, which is none.
    MarginalHyperbola(Hyperbola),
}

impl VolumeDelay {
    /// The BPR function with `fixed_cost` (toll and distance in units of time) on top.
    ///
    /// B = 0, a free-flow time of 0 or a power of 0 make the cost constant, whatever the capacity; `capacity^power` is
    /// folded into one coefficient here. The caller sees to it that `capacity` is positive where it is used and that
    /// the result [is finite](Self::is_finite): [`Link::volume_delay`](crate::Link::volume_delay) does.
    pub fn bpr(free_flow_time: f64, b: f64, capacity: f64, power: f64, fixed_cost: f64) -> Self {
        let fixed = free_flow_time + fixed_cost;
        if free_flow_time == 0.0 || b == 0.0 {
            return Self::constant(fixed);
        }
        if power == 0.0 {
            return Self::constant(fixed + free_flow_time * b);
        }
        Self::power(fixed, free_flow_time * b / power_of(capacity, power), power)
    }

    /// The conical function with `fixed_cost` on top. A free-flow time of 0 makes the cost constant; otherwise the caller
    /// sees to it that `alpha` is more than 1 and `capacity` positive.
    pub fn conical(free_flow_time: f64, alpha: f64, capacity: f64, fixed_cost: f64) -> Self {
        if free_flow_time == 0.0 {
            return Self::constant(fixed_cost);
        }
        let beta = (2.0 * alpha - 1.0) / (2.0 * alpha - 2.0);
        let width = beta * capacity / alpha;
        Self(Curve::Hyperbola(Hyperbola {
            base: fixed_cost + free_flow_time * (2.0 - beta),
            slope: free_flow_time * alpha / capacity,
            shift: capacity,
            width: width * width,
        }))
    }

    /// The time-dependent function of Akcelik with `fixed_cost` on top: `period` is the length of the time in which
    /// demand and capacity count vehicles, in units of the free-flow time, and `delay_parameter` his J. A J of 0 makes the cost
    /// constant; otherwise the caller sees to it that `capacity` is positive.
    pub fn akcelik(
        free_flow_time: f64,
        delay_parameter: f64,
        capacity: f64,
        period: f64,
        fixed_cost: f64,
    ) -> Self {
        if delay_parameter == 0.0 {
            return Self::constant(free_flow_time + fixed_cost);
        }
        let noise = 8.0 * delay_parameter / capacity;
        Self(Curve::Hyperbola(Hyperbola {
            base: free_flow_time + fixed_cost - period * noise / 8.0,
            slope: period / (4.0 * capacity),
            shift: capacity * (1.0 - noise / 2.0),
            width: capacity * capacity * noise * (1.0 - noise / 4.0),
        }))
    }

    /// A cost that no flow changes.
    pub fn constant(cost: f64) -> Self {
        Self(Curve::Constant { cost })
    }

    fn power(fixed: f64, congestion: f64, power: f64) -> Self {
        let halves = 2.0 * power;
        Self(if congestion == 0.0 {
            Curve::Constant { cost: fixed }
        } else if power == 4.0 {
            Curve::Quartic { fixed, congestion }
        } else if halves <= MOST_HALVES && halves == libm::floor(halves) {
            let halves = halves as u32;
            Curve::Halves {
                fixed,
                congestion,
                halves,
            }
        } else {
            Curve::Power {
                fixed,
                congestion,
                power,
            }
        })
    }

    /// The cost that every vehicle meets when `flow` vehicles use the link.
    #[inline]
    pub fn cost(&self, flow: f64) -> f64 {
        match self.0 {
            Curve::Quartic { fixed, congestion } => fixed + congestion * power_of(flow, 4.0),
            _ => self.cost_and_derivative(flow).0,
        }
    }

    /// [`cost`](Self::cost) and its derivative at `flow`.
    ///
    /// The derivative is infinite at flow 0 where the power lies between 0 and 1.
    #[inline]
    pub fn cost_and_derivative(&self, flow: f64) -> (f64, f64) {
        match self.0 {
            Curve::Quartic { fixed, congestion } => {
                let cube = flow * flow * flow;
                (fixed + congestion * cube * flow, 4.0 * congestion * cube)
            }
            Curve::Constant { cost } => (cost, 0.0),
            Curve::Halves {
                fixed,
                congestion,
                halves: 1,
            } => {
                let root = libm::sqrt(flow);
                (fixed + congestion * root, 0.5 * congestion / root)
            }
            Curve::Halves {
                fixed,
                congestion,
                halves,
            } => {
                let steep = congestion * half_power(flow, halves - 2);
                (fixed + steep * flow, 0.5 * f64::from(halves) * steep)
            }
            Curve::Power {
                fixed,
                congestion,
                power,
            } => {
                let steep = congestion * libm::pow(flow, power - 1.0);
                let delay = if flow == 0.0 { 0.0 } else { steep * flow };
                (fixed + delay, power * steep)
            }
            Curve::Hyperbola(hyperbola) => hyperbola.value_and_derivative(flow),
            Curve::MarginalHyperbola(hyperbola) => hyperbola.marginal_and_derivative(flow),
        }
    }

    /// Derivative of [`cost`](Self::cost) with respect to flow.
    #[inline]
    pub fn derivative(&self, flow: f64) -> f64 {
        self.cost_and_derivative(flow).1
    }

    /// Integral of [`cost`](Self::cost) from 0 to `flow`: the link's term of the Beckmann function.
    #[inline]
    pub fn integral(&self, flow: f64) -> f64 {
        let of_power = |fixed: f64, congestion: f64, power: f64| {
            flow * (fixed + congestion * power_of(flow, power) / (power + 1.0))
        };
        match self.0 {
            Curve::Constant { cost } => flow * cost,
            Curve::Quartic { fixed, congestion } => of_power(fixed, congestion, 4.0),
            Curve::Halves {
                fixed,
                congestion,
                halves,
            } => of_power(fixed, congestion, 0.5 * f64::from(halves)),
            Curve::Power {
                fixed,
                congestion,
                power,
            } => of_power(fixed, congestion, power),
            Curve::Hyperbola(hyperbola) => hyperbola.integral(flow),
            Curve::MarginalHyperbola(hyperbola) => flow * hyperbola.value_and_derivative(flow).0,
        }
    }

    /// The marginal cost, what one more vehicle adds to everybody's cost: `d(x t(x)) / dx`.
    ///
    /// Its integral is `x t(x)`. A user equilibrium at marginal costs is therefore the system optimum.
    #[must_use]
    pub fn marginal(&self) -> Self {
        match self.0 {
            Curve::Constant { .. } => *self,
            Curve::Quartic { fixed, congestion } => Self::power(fixed, 5.0 * congestion, 4.0),
            Curve::Halves {
                fixed,
                congestion,
                halves,
            } => {
                let power = 0.5 * f64::from(halves);
                Self::power(fixed, (power + 1.0) * congestion, power)
            }
            Curve::Power {
                fixed,
                congestion,
                power,
            } => Self::power(fixed, (power + 1.0) * congestion, power),
            Curve::Hyperbola(hyperbola) | Curve::MarginalHyperbola(hyperbola) => {
                Self(Curve::MarginalHyperbola(hyperbola))
            }
        }
    }

    /// The cost that drivers would balance under `objective`: the travel cost, or the marginal cost.
    #[must_use]
    pub fn view(&self, objective: Objective) -> Self {
        match objective {
            Objective::UserEquilibrium => *self,
            Objective::SystemOptimum => self.marginal(),
        }
    }

    /// Whether the cost depends on the flow.
    pub fn is_congestible(&self) -> bool {
        !matches!(self.0, Curve::Constant { .. })
    }

    /// Whether the coefficients are finite numbers.
    pub fn is_finite(&self) -> bool {
        match self.0 {
            Curve::Constant { cost } => cost.is_finite(),
            Curve::Quartic { fixed, congestion }
            | Curve::Halves {
                fixed, congestion, ..
            }
            | Curve::Power {
                fixed, congestion, ..
            } => fixed.is_finite() && congestion.is_finite(),
            Curve::Hyperbola(hyperbola) | Curve::MarginalHyperbola(hyperbola) => hyperbola.is_finite(),
        }
    }
}

/// `flow^power` for a flow of at least 0. Powers that are multiples of a half need no library; the others take `libm`'s,
/// which computes the same bits on every machine.
#[inline]
fn power_of(flow: f64, power: f64) -> f64 {
    let halves = 2.0 * power;
    if power == 4.0 {
        let square = flow * flow;
        square * square
    } else if halves <= MOST_HALVES && halves == libm::floor(halves) {
        half_power(flow, halves as u32)
    } else {
        libm::pow(flow, power)
    }
}

/// `flow^(halves / 2)`, by squaring.
#[inline]
fn half_power(flow: f64, halves: u32) -> f64 {
    let mut power = if halves & 1 == 1 { libm::sqrt(flow) } else { 1.0 };
    let mut square = flow;
    let mut rest = halves >> 1;
    while rest > 0 {
        if rest & 1 == 1 {
            power *= square;
        }
        square *= square;
        rest >>= 1;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bpr_is_the_printed_formula_and_its_derivative_and_integral_agree() {
        for power in [0.5, 1.0, 1.5, 2.3, 4.0, 5.0, 7.5, 16.8, 33.0] {
            let delay = VolumeDelay::bpr(6.0, 0.15, 30.0, power, 2.0);
            let flow = 21.0;
            let expected = 2.0 + 6.0 * (1.0 + 0.15 * libm::pow(flow / 30.0, power));
            assert!((delay.cost(flow) - expected).abs() < 1e-12 * expected);
            let step = 1e-5;
            let slope = (delay.cost(flow + step) - delay.cost(flow - step)) / (2.0 * step);
            assert!((delay.derivative(flow) - slope).abs() < 1e-7);
            let area = (delay.integral(flow + step) - delay.integral(flow - step)) / (2.0 * step);
            assert!((delay.cost(flow) - area).abs() < 1e-7);
            assert!(
                (delay.marginal().integral(flow) - flow * delay.cost(flow)).abs() < 1e-12 * flow * expected
            );
        }
    }

    #[test]
    fn constants_ignore_capacity() {
        assert_eq!(
            VolumeDelay::bpr(5.0, 0.0, 0.0, 4.0, 1.0),
            VolumeDelay::constant(6.0)
        );
        assert_eq!(
            VolumeDelay::bpr(0.0, 0.15, 0.0, 4.0, 1.0),
            VolumeDelay::constant(1.0)
        );
        assert_eq!(
            VolumeDelay::bpr(4.0, 0.5, 0.0, 0.0, 1.0),
            VolumeDelay::constant(7.0)
        );
        assert_eq!(VolumeDelay::constant(6.0).derivative(0.0), 0.0);
    }

    #[test]
    fn conical_and_akcelik_are_the_printed_formulas() {
        let (free, capacity, fixed) = (6.0, 30.0, 2.0);
        for flow in [0.0, 0.3, 21.0, 30.0, 44.0, 300.0] {
            for alpha in [1.1, 2.0, 4.0, 11.0] {
                let (u, beta): (f64, f64) =
                    (1.0 - flow / capacity, (2.0 * alpha - 1.0) / (2.0 * alpha - 2.0));
                let root = libm::sqrt(alpha * alpha * u * u + beta * beta);
                let expected = fixed + free * (2.0 + root - alpha * u - beta);
                let cost = VolumeDelay::conical(free, alpha, capacity, fixed).cost(flow);
                assert!(
                    (cost - expected).abs() < 1e-12 * expected,
                    "{alpha} {flow}: {cost} {expected}"
                );
            }
            // The last one waits for hours behind a signal that lets five vehicles pass.
            for delay_parameter in [0.1, 0.4, 1.6, 60.0] {
                let (z, period): (f64, f64) = (flow / capacity - 1.0, 60.0);
                let noise = 8.0 * delay_parameter * flow / (capacity * capacity);
                let expected = fixed + free + period / 4.0 * (z + libm::sqrt(z * z + noise));
                let delay = VolumeDelay::akcelik(free, delay_parameter, capacity, period, fixed);
                let cost = delay.cost(flow);
                assert!(
                    (cost - expected).abs() < 1e-12 * (expected + period),
                    "{delay_parameter} {flow}"
                );
            }
        }
        // Spiess: without flow the free-flow time, at capacity twice as much.
        let conical = VolumeDelay::conical(free, 4.0, capacity, 0.0);
        assert!(
            (conical.cost(0.0) - free).abs() < 1e-13 && (conical.cost(capacity) - 2.0 * free).abs() < 1e-13
        );
    }

    #[test]
    fn derivatives_and_integrals_agree_with_numerical_ones() {
        let delays = [
            VolumeDelay::conical(6.0, 4.0, 30.0, 2.0),
            VolumeDelay::conical(6.0, 1.2, 30.0, 0.0),
            VolumeDelay::akcelik(6.0, 0.4, 30.0, 60.0, 1.0),
            VolumeDelay::akcelik(6.0, 100.0, 30.0, 60.0, 1.0),
            VolumeDelay::bpr(6.0, 0.15, 30.0, 1.5, 1.0),
            VolumeDelay::bpr(6.0, 0.15, 30.0, 7.5, 1.0),
        ];
        for delay in delays.iter().flat_map(|delay| [*delay, delay.marginal()]) {
            assert_eq!(delay.integral(0.0), 0.0);
            for flow in [0.5, 21.0, 30.0, 44.0, 90.0] {
                let step = 1e-4;
                let (cost, derivative) = delay.cost_and_derivative(flow);
                let slope = (delay.cost(flow + step) - delay.cost(flow - step)) / (2.0 * step);
                assert!(
                    (derivative - slope).abs() < 1e-6 * (1.0 + slope),
                    "{delay:?} {flow}"
                );
                let area = (delay.integral(flow + step) - delay.integral(flow - step)) / (2.0 * step);
                assert!(
                    (cost - area).abs() < 1e-7 * cost,
                    "{delay:?} {flow}: {cost} {area}"
                );
                assert!(derivative >= 0.0);
            }
        }
    }
}
