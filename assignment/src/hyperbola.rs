//! A branch of a hyperbola that rises from a flat line to a steep one: the shape of conical and time-dependent delays.

/// `base + slope (d + sqrt(d^2 + width))` with `d = x - shift`.
///
/// For all `x` of at least 0 the radicand is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hyperbola {
    pub(crate) base: f64,
    /// Half the slope far to the right.
    pub(crate) slope: f64,
    /// Where the asymptotes meet.
    pub(crate) shift: f64,
    /// How gently it bends there, squared.
    pub(crate) width: f64,
}

impl Hyperbola {
    #[inline]
    pub(crate) fn value_and_derivative(&self, x: f64) -> (f64, f64) {
        let (distance, root) = self.distance_and_root(x);
        let rise = distance + root;
        (self.base + self.slope * rise, self.slope * rise / root)
    }

    /// Value and derivative of `d(x f(x)) / dx`.
    #[inline]
    pub(crate) fn marginal_and_derivative(&self, x: f64) -> (f64, f64) {
        let (_, root) = self.distance_and_root(x);
        let (value, first) = self.value_and_derivative(x);
        let second = self.slope * self.width / (root * root * root);
        (value + x * first, 2.0 * first + x * second)
    }

    /// From 0 to `x`.
    pub(crate) fn integral(&self, x: f64) -> f64 {
        let linear = self.base * x + self.slope * x * (0.5 * x - self.shift);
        linear + 0.5 * self.slope * (self.root_integral(x) - self.root_integral(0.0))
    }

    /// Twice the integral of the root, but for a constant.
    fn root_integral(&self, x: f64) -> f64 {
        let (distance, root) = self.distance_and_root(x);
        // Of the two ways to write the logarithm, the one that does not cancel.
        let logarithm = if distance > 0.0 {
            libm::log(distance + root)
        } else {
            libm::log(self.width) - libm::log(root - distance)
        };
        distance * root + self.width * logarithm
    }

    #[inline]
    fn distance_and_root(&self, x: f64) -> (f64, f64) {
        let distance = x - self.shift;
        (distance, libm::sqrt(distance * distance + self.width))
    }

    pub(crate) fn is_finite(&self) -> bool {
        [self.base, self.slope, self.shift, self.width]
            .iter()
            .all(|coefficient| coefficient.is_finite())
    }
}
