//! Slots in which a unit's modem measures nothing.

use super::Losses;
use crate::lanes::Rows;
use crate::scenario::FeedbackScenario;
use crate::stream::WorldKey;

/// Whether each modem measured in the slot: 1 or 0, `[vehicle][world]`.
#[derive(Clone)]
pub(super) struct Measured {
    losses: Losses,
    vehicles: usize,
    rows: Rows<u8>,
}

impl Measured {
    pub(super) fn new(feedback: &FeedbackScenario, vehicles: usize, keys: &[WorldKey]) -> Option<Self> {
        Losses::new(feedback.measurement_loss, 2, keys).map(|losses| Self {
            losses,
            vehicles,
            rows: Rows::new(keys.len(), vehicles, 1),
        })
    }

    pub(super) fn reset(&mut self, keys: &[WorldKey]) {
        self.losses.reset(keys);
    }

    pub(super) fn begin_slot(&mut self) {
        for block in 0..self.rows.blocks() {
            for vehicle in 0..self.vehicles {
                *self.rows.row_mut(block, vehicle) = self.losses.draw(block).map(|lost| u8::from(!lost));
            }
        }
    }

    pub(super) fn rows(&self) -> &Rows<u8> {
        &self.rows
    }
}
