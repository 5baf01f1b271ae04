//! Distance-dependent loss: 3GPP TR 36.942 4.5.2 (macro cell, urban), as in the paper's Table I.

use crate::scenario::Scenario;

/// Loss in dB from a vehicle at this place to the base station: `intercept + slope log10(d / km)`, with d in three
/// dimensions between the antennas and at least 1 m, and 21 log10(f / 2 GHz) for other carriers.
pub fn path_loss_db(scenario: &Scenario, x_m: f64, y_m: f64) -> f64 {
    let (cell, radio) = (&scenario.cell, &scenario.radio);
    let across = libm::hypot(x_m - cell.base_station_x_m, y_m - cell.base_station_y_m);
    let distance_m = libm::hypot(across, cell.base_station_height_m - cell.vehicle_height_m);
    radio.path_loss_intercept_db
        + radio.path_loss_slope_db * libm::log10(distance_m.max(1.0) / 1000.0)
        + 21.0 * libm::log10(radio.carrier_ghz / 2.0)
}

#[cfg(test)]
mod tests {
    use super::path_loss_db;
    use crate::scenario::ScenarioSource;

    #[test]
    fn loss_of_the_urban_macro_cell() {
        let scenario = ScenarioSource::default().read().unwrap();
        // Under the mast: 23.5 m. At 1 km in three dimensions: the intercept.
        assert!((path_loss_db(&scenario, 375.0, 649.5) - (128.1 - 37.6 * 1.628_932_137)).abs() < 1e-6);
        let across = libm::sqrt(1000.0 * 1000.0 - 23.5 * 23.5);
        assert!((path_loss_db(&scenario, 375.0 + across, 649.5) - 128.1).abs() < 1e-9);
    }
}
