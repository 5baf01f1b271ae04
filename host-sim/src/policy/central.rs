//! The central scheduler: it sees every gain of the slot and every age, which no real base station can.

use super::{Policy, dbm, transmit};
use crate::cell::Cell;
use crate::scenario::Scenario;
use firmware::decision::Decision;
use firmware::units::{Dbm, SUB_CHANNELS};

/// Greedy by age: the oldest vehicle first, on its best free sub-channel that carries C_min, at full power.
pub struct Central {
    max_power: Dbm,
    required_db: f32,
    order: Vec<usize>,
}

impl Central {
    /// The scheduler in this scenario.
    pub fn new(scenario: &Scenario) -> Self {
        let required_db = 10.0 * libm::log10(scenario.radio.required_sinr());
        // Room for the rounding of gains between dB and ratios.
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
            required_db: required_db as f32 + 1e-3,
            order: Vec::new(),
        }
    }
}

impl Policy for Central {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        self.order.clear();
        self.order.extend(cell.present());
        // Stable: of equally old vehicles the one with the lower index.
        self.order
            .sort_by_key(|&vehicle| std::cmp::Reverse(cell.age(vehicle)));
        let mut free = [true; SUB_CHANNELS];
        for &vehicle in &self.order {
            let gain_db = cell.gain_db(vehicle);
            let best = (0..SUB_CHANNELS)
                .filter(|&n| free[n] && gain_db[n] >= self.required_db)
                .max_by(|&a, &b| gain_db[a].total_cmp(&gain_db[b]));
            if let Some(best) = best {
                free[best] = false;
                decisions[vehicle] = transmit(best, self.max_power);
                if !free.contains(&true) {
                    return;
                }
            }
        }
    }
}
