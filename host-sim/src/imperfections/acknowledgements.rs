//! Acknowledgements that are late or lost: a unit's age is then not the base station's.

use super::Losses;
use crate::lanes::{LANES, Rows};
use crate::scenario::FeedbackScenario;
use crate::stream::WorldKey;
use firmware::units::Age;

/// Slots since the last acknowledged success, as units know it.
pub(super) struct Acknowledgements {
    delay: usize,
    losses: Option<Losses>,
    /// Acknowledgements under way, 1 or 0: `[slot modulo the ring's length]`, of `[vehicle][world]`.
    under_way: Vec<Rows<u8>>,
    /// Where those go that are sent in this slot.
    now: usize,
    /// `[vehicle][world]`.
    ages: Rows<u8>,
    vehicles: usize,
}

impl Acknowledgements {
    pub(super) fn new(feedback: &FeedbackScenario, vehicles: usize, keys: &[WorldKey]) -> Option<Self> {
        let delay = feedback.acknowledgement_delay_slots as usize;
        let losses = Losses::new(feedback.acknowledgement_loss, 0, keys);
        (delay > 0 || losses.is_some()).then(|| Self {
            delay,
            losses,
            under_way: vec![Rows::new(keys.len(), vehicles, 0); delay + 1],
            now: delay,
            ages: Rows::new(keys.len(), vehicles, Age::MAX.slots()),
            vehicles,
        })
    }

    /// What is under way is for the unit that had this index before.
    pub(super) fn begin_unit(&mut self, world: usize, vehicle: usize, age: Age) {
        self.under_way
            .iter_mut()
            .for_each(|sent| sent.set(world, vehicle, 0));
        self.ages.set(world, vehicle, age.slots());
    }

    pub(super) fn begin_slot(&mut self, true_ages: &Rows<u8>) {
        let ring = self.under_way.len();
        self.now = (self.now + 1) % ring;
        let due = (self.now + 1) % ring;
        // The age right after an acknowledgement that comes now.
        let acknowledged = self.delay as u8 + Age::MIN.slots();
        for block in 0..true_ages.blocks() {
            for vehicle in 0..self.vehicles {
                let true_ages = true_ages.row(block, vehicle);
                let sent = self.under_way[self.now].row_mut(block, vehicle);
                for lane in 0..LANES {
                    sent[lane] = u8::from(true_ages[lane] == Age::MIN.slots());
                }
                if let Some(losses) = &mut self.losses {
                    let lost = losses.draw(block);
                    for lane in 0..LANES {
                        sent[lane] &= u8::from(!lost[lane]);
                    }
                }
                let arrived = self.under_way[due].row(block, vehicle);
                let ages = self.ages.row_mut(block, vehicle);
                for lane in 0..LANES {
                    let older = (ages[lane] + 1).min(Age::MAX.slots());
                    ages[lane] = if arrived[lane] > 0 { acknowledged } else { older };
                }
            }
        }
    }

    pub(super) fn ages(&self) -> &Rows<u8> {
        &self.ages
    }
}
