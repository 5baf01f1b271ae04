//! The uplink channel of every vehicle: path loss and shadowing that change with the places, fast fading that is new in
//! every slot and on every sub-channel.

mod path_loss;
mod shadowing;

pub use path_loss::path_loss_db;
pub use shadowing::Shadowing;

use crate::mobility::Place;
use crate::scenario::Scenario;
use crate::stream::{Role, Stream, WorldKey};
use firmware::units::SUB_CHANNELS;

/// Gains of all vehicles that ever appear.
///
/// A gain is the level in dB over noise at which the base station receives the vehicle at full power (paper eq. 1, with
/// the link budget of Table I included).
pub struct Channel<'s> {
    scenario: &'s Scenario,
    shadowing: Vec<Option<Shadowing>>,
    large_scale_db: Vec<f32>,
    gain_db: Vec<[f32; SUB_CHANNELS]>,
    shadowing_stream: Stream,
    fading_stream: Stream,
}

impl<'s> Channel<'s> {
    /// A channel for `vehicles` vehicles, of which none is present yet.
    pub fn new(scenario: &'s Scenario, vehicles: usize, key: &WorldKey) -> Self {
        Self {
            scenario,
            shadowing: vec![None; vehicles],
            large_scale_db: vec![0.0; vehicles],
            gain_db: vec![[0.0; SUB_CHANNELS]; vehicles],
            shadowing_stream: key.stream(Role::Shadowing, 0),
            fading_stream: key.stream(Role::FastFading, 0),
        }
    }

    /// Takes new places: path loss anew, shadowing on by the way driven.
    pub fn move_to(&mut self, places: &[(usize, Place)]) {
        let radio = &self.scenario.radio;
        for &(vehicle, place) in places {
            let normal = self.shadowing_stream.normal();
            let shadowing = match self.shadowing[vehicle] {
                None => Shadowing::new(radio, normal),
                Some(shadowing) => shadowing.moved(radio, place.moved_m, normal),
            };
            self.shadowing[vehicle] = Some(shadowing);
            let loss = path_loss_db(self.scenario, place.x_m, place.y_m) + shadowing.db();
            self.large_scale_db[vehicle] = (radio.budget_db() - loss) as f32;
        }
    }

    /// Draws the slot's fast fading: Rayleigh, so the power is exponential with mean 1.
    pub fn fade(&mut self, present: &[usize]) {
        for &vehicle in present {
            for gain in &mut self.gain_db[vehicle] {
                *gain = self.large_scale_db[vehicle] + 10.0 * libm::log10f(self.fading_stream.exponential());
            }
        }
    }

    /// Gain without fast fading in dB.
    pub fn large_scale_db(&self, vehicle: usize) -> f32 {
        self.large_scale_db[vehicle]
    }

    /// Gain of the slot on every sub-channel in dB.
    pub fn gain_db(&self, vehicle: usize) -> &[f32; SUB_CHANNELS] {
        &self.gain_db[vehicle]
    }
}
