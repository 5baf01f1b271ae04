//! Volume-delay functions: what a link costs when a given flow uses it.
//!
//! The BPR function of the US Bureau of Public Roads (Traffic Assignment Manual, 1964),
//! `t(x) = t0 (1 + B (x / capacity)^power)`, plus a part that no flow changes (toll, distance). It is kept as
//! `fixed + congestion x^power`, one power and one multiplication per evaluation.

use crate::Objective;

/// B and power where nobody says otherwise, the values of the Bureau of Public Roads.
pub(crate) const BPR_B: f64 = 0.15;
pub(crate) const BPR_POWER: f64 = 4.0;

/// Generalised cost of one link as a function of its flow: `fixed + congestion x^power`.
///
/// Total for every flow of at least 0: never panics, never decreases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeDelay {
    fixed: f64,
    congestion: f64,
    power: f64,
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
        Self {
            fixed,
            congestion: free_flow_time * b / power_of(capacity, power),
            power,
        }
    }

    /// A cost that no flow changes.
    pub fn constant(cost: f64) -> Self {
        Self {
            fixed: cost,
            congestion: 0.0,
            power: 1.0,
        }
    }

    /// The cost that every vehicle meets when `flow` vehicles use the link.
    #[inline]
    pub fn cost(&self, flow: f64) -> f64 {
        self.fixed + self.congestion * power_of(flow, self.power)
    }

    /// [`cost`](Self::cost) and its derivative at `flow`.
    ///
    /// The derivative is infinite at flow 0 where the power lies between 0 and 1.
    #[inline]
    pub fn cost_and_derivative(&self, flow: f64) -> (f64, f64) {
        if self.power == 4.0 {
            let cube = flow * flow * flow;
            (
                self.fixed + self.congestion * cube * flow,
                4.0 * self.congestion * cube,
            )
        } else if self.congestion == 0.0 {
            (self.fixed, 0.0)
        } else {
            (
                self.cost(flow),
                self.congestion * self.power * power_of(flow, self.power - 1.0),
            )
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
        flow * (self.fixed + self.congestion * power_of(flow, self.power) / (self.power + 1.0))
    }

    /// The marginal cost, what one more vehicle adds to everybody's cost: `d(x t(x)) / dx`.
    ///
    /// It has the same shape, with `(power + 1) congestion`, and its integral is `x t(x)`. A user equilibrium at marginal
    /// costs is therefore the system optimum.
    #[must_use]
    pub fn marginal(&self) -> Self {
        Self {
            congestion: (self.power + 1.0) * self.congestion,
            ..*self
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
        self.congestion > 0.0
    }

    /// Whether the coefficients are finite numbers.
    pub fn is_finite(&self) -> bool {
        self.fixed.is_finite() && self.congestion.is_finite()
    }
}

/// `flow^power` for a flow of at least 0. The usual powers need no library; the others take `libm`'s, which computes
/// the same bits on every machine.
#[inline]
fn power_of(flow: f64, power: f64) -> f64 {
    if power == 4.0 {
        let square = flow * flow;
        square * square
    } else if power == 1.0 {
        flow
    } else {
        libm::pow(flow, power)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bpr_is_the_printed_formula_and_its_derivative_and_integral_agree() {
        for power in [0.5, 1.0, 2.3, 4.0, 5.0, 16.8] {
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
}
