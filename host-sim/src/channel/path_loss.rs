//! Distance-dependent loss: 3GPP TR 36.942 4.5.2 (macro cell, urban), as in the paper's Table I.

use crate::scenario::Scenario;

/// Loss in dB from a vehicle to the base station: `intercept + slope log10(d / km)`, with d in three dimensions between the
/// antennas and at least 1 m, and 21 log10(f / 2 GHz) for other carriers.
#[derive(Clone, Copy, Debug)]
pub struct PathLoss {
    x_m: f64,
    y_m: f64,
    /// Of the difference in height, in square metres.
    height_squared: f64,
    /// At 1 m.
    intercept_db: f64,
    /// Per decade of the squared distance.
    slope_db: f64,
}

impl PathLoss {
    /// The scenario's.
    pub fn new(scenario: &Scenario) -> Self {
        let (cell, radio) = (&scenario.cell, &scenario.radio);
        let height_m = cell.base_station_height_m - cell.vehicle_height_m;
        Self {
            x_m: cell.base_station_x_m,
            y_m: cell.base_station_y_m,
            height_squared: height_m * height_m,
            intercept_db: radio.path_loss_intercept_db - 3.0 * radio.path_loss_slope_db
                + 21.0 * libm::log10(radio.carrier_ghz / 2.0),
            slope_db: radio.path_loss_slope_db / 2.0,
        }
    }

    /// The loss at a place.
    pub fn db(&self, x_m: f64, y_m: f64) -> f64 {
        let (x, y) = (x_m - self.x_m, y_m - self.y_m);
        let squared = x * x + y * y + self.height_squared;
        self.intercept_db + self.slope_db * libm::log10(squared.max(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::PathLoss;
    use crate::scenario::ScenarioSource;

    #[test]
    fn loss_of_the_urban_macro_cell() {
        let loss = PathLoss::new(&ScenarioSource::default().read().unwrap());
        // Under the mast: 23.5 m. At 1 km in three dimensions: the intercept.
        assert!((loss.db(375.0, 649.5) - (128.1 - 37.6 * 1.628_932_137)).abs() < 1e-6);
        let across = libm::sqrt(1000.0 * 1000.0 - 23.5 * 23.5);
        assert!((loss.db(375.0 + across, 649.5) - 128.1).abs() < 1e-9);
    }
}
