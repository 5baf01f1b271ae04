//! Broadcasts that not every vehicle hears: it goes on with the last one that it heard.

use super::Losses;
use crate::base_station::Announcements;
use crate::lanes::{LANES, Row, Rows};
use crate::scenario::FeedbackScenario;
use crate::stream::WorldKey;

/// What each vehicle last heard of its group's broadcast. `[vehicle][world]` each.
pub struct Heard {
    losses: Losses,
    vehicles: usize,
    /// The announced period in slots, 0 where it is too long to be announced.
    period: Rows<u8>,
    /// The code of the joiner probability.
    joiner_code: Rows<u8>,
    /// Age up to which the vehicle keeps its turn.
    turn_lost_after: Rows<u8>,
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
        let nothing = Rows::new(keys.len(), vehicles, 0);
        Losses::new(feedback.broadcast_loss, 1, keys).map(|losses| Self {
            losses,
            vehicles,
            period: nothing.clone(),
            joiner_code: nothing.clone(),
            turn_lost_after: nothing.clone(),
            any: nothing,
        })
    }

    pub(super) fn begin_unit(&mut self, world: usize, vehicle: usize) {
        self.any.set(world, vehicle, 0);
    }

    pub(super) fn begin_slot(&mut self, announcements: &Announcements) {
        for block in 0..self.any.blocks() {
            for vehicle in 0..self.vehicles {
                let lost = self.losses.draw(block);
                let limits = announcements.turns_lost_after().row(block, vehicle);
                let homes = announcements.homes().row(block, vehicle);
                for lane in 0..LANES {
                    let group = usize::from(homes[lane]);
                    let heard_before = self.any.row(block, vehicle)[lane] > 0;
                    if group >= announcements.groups() || (lost[lane] && heard_before) {
                        continue;
                    }
                    self.any.row_mut(block, vehicle)[lane] = 1;
                    self.period.row_mut(block, vehicle)[lane] =
                        announcements.periods().row(block, group)[lane];
                    self.joiner_code.row_mut(block, vehicle)[lane] =
                        announcements.joiner_code(block * LANES + lane, group);
                    self.turn_lost_after.row_mut(block, vehicle)[lane] = limits[lane];
                }
            }
        }
    }

    /// The periods in slots that a vehicle last heard, 0 where it was too long to be announced.
    #[inline(always)]
    pub fn periods(&self, block: usize, vehicle: usize) -> &Row<u8> {
        self.period.row(block, vehicle)
    }

    /// The codes of the joiner probability.
    #[inline(always)]
    pub fn joiner_codes(&self, block: usize, vehicle: usize) -> &Row<u8> {
        self.joiner_code.row(block, vehicle)
    }

    /// The ages up to which it keeps its turn, as it knows.
    #[inline(always)]
    pub fn turns_lost_after(&self, block: usize, vehicle: usize) -> &Row<u8> {
        self.turn_lost_after.row(block, vehicle)
    }
}
