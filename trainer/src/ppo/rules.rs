//! What a slot of the cell costs its vehicles, and what the critic knows of them.

use super::central::{CELL_COUNTS, CellCounts, frames};
use super::recipe::CriticView;
use crate::game::cell::{Outcome, Rules, Sensed};

/// What a vehicle's reward is made of.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    /// Weight of each other vehicle's cost next to the own.
    pub team: f32,
    /// Cost of a slot: the age in frames, at most this.
    pub most_frames: f32,
    /// Cost of a transmission. Where everybody sends and nobody is heard, only this tells anybody to stop.
    pub transmission: f32,
    /// Rewards are multiplied by this; 1 less the discount makes a value a mean cost.
    pub scale: f32,
    /// What the critic sees.
    pub sees: CriticView,
    /// Where it is played.
    pub place: CellPlace,
}

/// Which cell of a mixture is played. The critic is told: the same ages in frames last longer where links are weak.
#[derive(Clone, Copy, Debug, Default)]
pub struct CellPlace {
    /// Its index.
    pub index: usize,
    /// Cells that the critic tells apart; 0 where there is one alone.
    pub cells: usize,
}

impl Costs {
    /// Values that the critic knows of the other vehicles.
    const fn of_others(&self) -> usize {
        match self.sees {
            CriticView::Cell => CELL_COUNTS,
            CriticView::Vehicle => 0,
        }
    }

    /// Of how many vehicles' costs the reward of one of so many is a mean.
    fn weight(&self, vehicles: f32) -> f32 {
        1.0 + self.team * (vehicles - 1.0)
    }
}

impl Rules for Costs {
    fn extra(&self) -> usize {
        self.of_others() + self.place.cells
    }

    fn know<'r>(&self, world: &[Option<Sensed>], extras: impl Iterator<Item = &'r mut [f32]>) {
        let observations = || {
            world
                .iter()
                .map(|sensed| sensed.as_ref().map(|sensed| &sensed.observation))
        };
        let counts = CellCounts::new(observations().flatten());
        for (observation, extra) in observations().zip(extras) {
            if let Some(observation) = observation {
                let (counted, cell) = extra.split_at_mut(self.of_others());
                if !counted.is_empty() {
                    counts.write(observation, counted);
                }
                if let Some(here) = cell.get_mut(self.place.index) {
                    *here = 1.0;
                }
            }
        }
    }

    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
        let cost = |outcome: &Outcome| frames(outcome.age, &outcome.observation).min(self.most_frames);
        let vehicles = world.iter().flatten().count() as f32;
        let sum: f32 = world.iter().flatten().map(cost).sum();
        for (outcome, reward) in world.iter().zip(rewards) {
            let Some(outcome) = outcome else { continue };
            let sent = if outcome.sent { self.transmission } else { 0.0 };
            let own = cost(outcome);
            *reward = -(own + sent + self.team * (sum - own)) / self.weight(vehicles) * self.scale;
        }
    }

    fn parts(&self, world: &[Option<Sensed>], parts: &mut [f32]) {
        let vehicles = world.iter().flatten().count() as f32;
        for (sensed, part) in world.iter().zip(parts) {
            *part = sensed.map_or(1.0, |_| self.weight(vehicles));
        }
    }
}
