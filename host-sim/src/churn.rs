//! Vehicles that leave for good while others take their place in the cell, at any slot: who, when, and how long the new ones
//! wait to be heard.

use crate::stream::{Role, Stream, WorldKey};
use firmware::units::Age;

/// Joiners of the last slots of a run are not counted: they had no time to wait (chosen).
const LEAST_TIME_SLOTS: u32 = 200;

/// A vehicle that left for good: at the beginning of the slot another one has its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replacement {
    /// Its world.
    pub world: usize,
    /// Its index, now the other one's.
    pub vehicle: usize,
    /// Its own age after its last slot.
    pub last_age: Age,
}

/// Replacements in one world.
#[derive(Clone, Debug)]
pub struct Churn {
    /// Mean number of vehicle-slots between two replacements.
    mean_gap: f64,
    /// Vehicle-slots until the next one.
    left: f64,
    stream: Stream,
    /// Slots, from the start of the world, in which somebody associated who has not been heard since; by vehicle.
    waiting_since: Vec<Option<u32>>,
    /// Those who were heard: the slot in which they associated, and how many slots that took.
    heard: Vec<(u32, u32)>,
}

impl Churn {
    /// Each of `vehicles` vehicles is replaced with this probability in each slot. `None` for 0.
    pub fn new(probability: f64, vehicles: usize, key: &WorldKey) -> Option<Self> {
        (probability > 0.0).then(|| {
            let mut churn = Self {
                // Geometric gaps, as the whole parts of exponential ones.
                mean_gap: -1.0 / libm::log1p(-probability),
                left: 0.0,
                stream: key.stream(Role::Replacement, 0),
                waiting_since: vec![None; vehicles],
                heard: Vec::new(),
            };
            churn.reset(key);
            churn
        })
    }

    /// Goes on with another world before its first slot.
    pub fn reset(&mut self, key: &WorldKey) {
        self.stream = key.stream(Role::Replacement, 0);
        self.left = self.gap();
        self.waiting_since.fill(None);
        self.heard.clear();
    }

    fn gap(&mut self) -> f64 {
        (f64::from(self.stream.exponential()) * self.mean_gap).floor()
    }

    /// Draws which of the `present` vehicles somebody else takes the place of in this slot, in their order.
    pub fn draw(&mut self, present: &[usize], slot: u32, replaced: &mut Vec<usize>) {
        replaced.clear();
        while self.left < present.len() as f64 {
            let vehicle = present[self.left as usize];
            replaced.push(vehicle);
            self.waiting_since[vehicle] = Some(slot);
            self.left += 1.0 + self.gap();
        }
        self.left -= present.len() as f64;
    }

    /// Takes in who was received in a slot.
    pub fn hear(&mut self, slot: u32, received: impl Fn(usize) -> bool) {
        for (vehicle, waiting) in self.waiting_since.iter_mut().enumerate() {
            if let Some(since) = waiting.take_if(|_| received(vehicle)) {
                self.heard.push((since, slot - since + 1));
            }
        }
    }

    /// Slots from association to the first success, of those who associated from slot `first` on and early enough before slot
    /// `end`; `None` who was never heard. Who was replaced before being heard is not counted.
    pub fn waits(&self, first: u32, end: u32) -> impl Iterator<Item = Option<u32>> {
        let counts = move |since: u32| since >= first && since + LEAST_TIME_SLOTS <= end;
        let heard = self.heard.iter().filter(move |(since, _)| counts(*since));
        let waiting = self
            .waiting_since
            .iter()
            .flatten()
            .filter(move |since| counts(**since));
        heard.map(|&(_, wait)| Some(wait)).chain(waiting.map(|_| None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Purpose;

    #[test]
    fn replacements_come_as_often_as_told_and_waits_are_counted() {
        let key = WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        assert!(Churn::new(0.0, 5, &key).is_none());
        let mut churn = Churn::new(0.02, 5, &key).unwrap();
        let (present, mut replaced) = ([0, 1, 2, 4], Vec::new());
        let mut counts = [0; 5];
        for slot in 0..20_000 {
            churn.draw(&present, slot, &mut replaced);
            assert!(replaced.is_sorted());
            replaced.iter().for_each(|&vehicle| counts[vehicle] += 1);
            // Vehicle 4 is never heard, the others in the third slot.
            churn.hear(slot, |vehicle| vehicle < 4 && churn_slot(slot));
        }
        // 400 each, with a standard deviation of 20.
        for vehicle in present {
            assert!((300..500).contains(&counts[vehicle]), "{counts:?}");
        }
        let waits: Vec<_> = churn.waits(100, 20_000).collect();
        assert!(waits.iter().flatten().all(|wait| (1..=3).contains(wait)));
        assert!(waits.iter().flatten().count() > 900);
    }

    /// Every third slot.
    const fn churn_slot(slot: u32) -> bool {
        slot % 3 == 2
    }
}
