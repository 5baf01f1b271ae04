//! Broadcasts that not every vehicle hears: it goes on with the last one that it heard.

use super::Losses;
use crate::base_station::Announcements;
use crate::lanes::{LANES, Rows};
use crate::scenario::FeedbackScenario;
use crate::senses;
use crate::stream::WorldKey;

/// What each vehicle last heard. `[vehicle][world]` each.
#[derive(Clone)]
pub struct Heard {
    losses: Losses,
    vehicles: usize,
    /// How many places the ring has; 0 before the first broadcast.
    places: Rows<u16>,
    /// What is open in the slot; nothing if that was not heard.
    open: Rows<u16>,
    /// The least priority with which to contend in it.
    threshold: Rows<u32>,
    /// What the sub-channels that vehicles like are drawn with.
    salt: Rows<u8>,
    /// 1 where a unit has heard a broadcast.
    any: Rows<u8>,
}

impl std::fmt::Debug for Heard {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Heard").finish_non_exhaustive()
    }
}

impl Heard {
    pub(super) fn new(feedback: &FeedbackScenario, vehicles: usize, keys: &[WorldKey]) -> Option<Self> {
        Losses::new(feedback.broadcast_loss, 1, keys).map(|losses| Self {
            losses,
            vehicles,
            places: Rows::new(keys.len(), vehicles, 0),
            open: Rows::new(keys.len(), vehicles, 0),
            threshold: Rows::new(keys.len(), vehicles, u32::MAX),
            salt: Rows::new(keys.len(), vehicles, 0),
            any: Rows::new(keys.len(), vehicles, 0),
        })
    }

    pub(super) fn reset(&mut self, keys: &[WorldKey]) {
        self.losses.reset(keys);
        self.places.fill_all(0);
        self.threshold.fill_all(u32::MAX);
        self.salt.fill_all(0);
        self.any.fill_all(0);
    }

    pub(super) fn begin_unit(&mut self, world: usize, vehicle: usize) {
        self.any.set(world, vehicle, 0);
    }

    pub(super) fn begin_slot(&mut self, announcements: &Announcements) {
        for block in 0..self.any.blocks() {
            for vehicle in 0..self.vehicles {
                let lost = self.losses.draw(block);
                let associated = announcements.associated().row(block, vehicle);
                for lane in 0..LANES {
                    let heard_before = self.any.row(block, vehicle)[lane] > 0;
                    self.open.row_mut(block, vehicle)[lane] = 0;
                    if associated[lane] == 0 || (lost[lane] && heard_before) {
                        continue;
                    }
                    self.any.row_mut(block, vehicle)[lane] = 1;
                    self.places.row_mut(block, vehicle)[lane] = announcements.places().row(block, 0)[lane];
                    self.open.row_mut(block, vehicle)[lane] = announcements.open().row(block, 0)[lane];
                    self.threshold.row_mut(block, vehicle)[lane] =
                        announcements.thresholds().row(block, 0)[lane];
                    self.salt.row_mut(block, vehicle)[lane] = announcements.salts().row(block, 0)[lane];
                }
            }
        }
    }

    /// What a vehicle knows of them.
    #[inline(always)]
    pub fn of(&self, block: usize, vehicle: usize) -> senses::Heard<'_> {
        senses::Heard {
            places: self.places.row(block, vehicle),
            open: self.open.row(block, vehicle),
            thresholds: self.threshold.row(block, vehicle),
            salts: self.salt.row(block, vehicle),
        }
    }
}
