//! Acknowledgements that are late or lost: a unit's age is then not the base station's, nor is what it knows of the place that it found.

use super::Losses;
use crate::base_station::NO_PLACE;
use crate::lanes::{LANES, Rows};
use crate::scenario::FeedbackScenario;
use crate::senses::Readings;
use crate::stream::WorldKey;
use firmware::units::Age;

/// What units know of their receptions, `[vehicle][world]` each.
#[derive(Clone)]
pub(super) struct Acknowledgements {
    delay: usize,
    losses: Option<Losses>,
    /// Acknowledgements under way, 1 or 0, with the places that they confirm: `[slot modulo the ring's length]`.
    under_way: Vec<(Rows<u8>, Rows<u16>)>,
    /// Where those go that are sent in this slot.
    now: usize,
    ages: Rows<u16>,
    found: Rows<u16>,
    /// Slots until that of the last transmission arrives, if it does.
    awaited: Rows<u8>,
    vehicles: usize,
}

impl Acknowledgements {
    pub(super) fn new(feedback: &FeedbackScenario, vehicles: usize, keys: &[WorldKey]) -> Option<Self> {
        let delay = feedback.acknowledgement_delay_slots as usize;
        let losses = Losses::new(feedback.acknowledgement_loss, 0, keys);
        let worlds = keys.len();
        let nothing = || {
            (
                Rows::new(worlds, vehicles, 0),
                Rows::new(worlds, vehicles, NO_PLACE),
            )
        };
        (delay > 0 || losses.is_some()).then(|| Self {
            delay,
            losses,
            under_way: vec![nothing(); delay + 1],
            now: delay,
            ages: Rows::new(worlds, vehicles, Age::TIME_CONSTRAINT.slots()),
            found: Rows::new(worlds, vehicles, NO_PLACE),
            awaited: Rows::new(worlds, vehicles, 0),
            vehicles,
        })
    }

    pub(super) fn reset(&mut self, keys: &[WorldKey]) {
        if let Some(losses) = &mut self.losses {
            losses.reset(keys);
        }
        for (sent, places) in &mut self.under_way {
            sent.fill_all(0);
            places.fill_all(NO_PLACE);
        }
        self.now = self.delay;
        self.ages.fill_all(Age::TIME_CONSTRAINT.slots());
        self.found.fill_all(NO_PLACE);
        self.awaited.fill_all(0);
    }

    /// What is under way is for the unit that had this index before.
    pub(super) fn begin_unit(&mut self, world: usize, vehicle: usize, age: Age) {
        self.under_way
            .iter_mut()
            .for_each(|(sent, _)| sent.set(world, vehicle, 0));
        self.ages.set(world, vehicle, age.slots());
        self.found.set(world, vehicle, NO_PLACE);
        self.awaited.set(world, vehicle, 0);
    }

    pub(super) fn begin_slot(&mut self, truth: &Readings<'_>) {
        let ring = self.under_way.len();
        self.now = (self.now + 1) % ring;
        let due = (self.now + 1) % ring;
        // The age right after an acknowledgement that comes now.
        let acknowledged = self.delay as u16 + Age::MIN.slots();
        for block in 0..truth.ages.blocks() {
            for vehicle in 0..self.vehicles {
                let true_ages = truth.ages.row(block, vehicle);
                let (acknowledgements, places) = &mut self.under_way[self.now];
                *places.row_mut(block, vehicle) = *truth.found.row(block, vehicle);
                let acknowledgements = acknowledgements.row_mut(block, vehicle);
                for lane in 0..LANES {
                    acknowledgements[lane] = u8::from(true_ages[lane] == Age::MIN.slots());
                }
                if let Some(losses) = &mut self.losses {
                    let lost = losses.draw(block);
                    for lane in 0..LANES {
                        acknowledgements[lane] &= u8::from(!lost[lane]);
                    }
                }
                let (arrived, places) = &self.under_way[due];
                let (arrived, places) = (arrived.row(block, vehicle), places.row(block, vehicle));
                let ages = self.ages.row_mut(block, vehicle);
                let found = self.found.row_mut(block, vehicle);
                for lane in 0..LANES {
                    let older = ages[lane].saturating_add(1);
                    ages[lane] = if arrived[lane] > 0 { acknowledged } else { older };
                    found[lane] = if arrived[lane] > 0 {
                        places[lane]
                    } else {
                        found[lane]
                    };
                }
                let Some(sent) = truth.sent else { continue };
                let (sent, awaited) = (sent.row(block, vehicle), self.awaited.row_mut(block, vehicle));
                for lane in 0..LANES {
                    let left = awaited[lane].saturating_sub(1);
                    awaited[lane] = if sent[lane] > 0 { self.delay as u8 } else { left };
                }
            }
        }
    }

    /// `truth`, but for what comes by acknowledgement.
    pub(super) fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t> {
        Readings {
            ages: &self.ages,
            found: &self.found,
            awaited: Some(&self.awaited),
            ..truth
        }
    }
}
