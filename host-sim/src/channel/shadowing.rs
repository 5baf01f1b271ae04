//! Log-normal shadowing with exponential correlation over distance: 3GPP TR 36.885 A.1.4 (Gudmundson 1991).

use crate::scenario::RadioScenario;

/// One vehicle's shadowing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadowing(f64);

impl Shadowing {
    /// A fresh value from a standard normal draw.
    pub fn new(radio: &RadioScenario, normal: f64) -> Self {
        Self(radio.shadowing_deviation_db * normal)
    }

    /// The value after driving `moved_m` metres: S' = e^(-x/d) S + sqrt(1 - e^(-2x/d)) N(0, deviation).
    #[must_use]
    pub fn moved(self, radio: &RadioScenario, moved_m: f64, normal: f64) -> Self {
        let correlation = libm::exp(-moved_m / radio.shadowing_decorrelation_m);
        let innovation = libm::sqrt(1.0 - correlation * correlation) * radio.shadowing_deviation_db * normal;
        Self(correlation * self.0 + innovation)
    }

    /// The loss in dB.
    pub const fn db(self) -> f64 {
        self.0
    }
}
