//! One world of an [`Environment`], to look at.

use crate::environment::Environment;
use crate::mobility::{Mobility, Place};
use firmware::units::Age;

/// A cell at the beginning of a slot.
#[derive(Clone, Copy)]
pub struct Cell<'e> {
    environment: &'e Environment<'e>,
    world: usize,
}

impl<'e> Cell<'e> {
    /// The world of this index in its batch.
    pub fn new(environment: &'e Environment<'e>, world: usize) -> Self {
        Self { environment, world }
    }

    /// The batch.
    pub fn environment(&self) -> &'e Environment<'e> {
        self.environment
    }

    /// The present vehicles' places, by ascending vehicle.
    pub fn places(&self) -> &'e [(usize, Place)] {
        self.environment.places(self.world)
    }

    /// How vehicles move.
    pub fn mobility(&self) -> &'e Mobility<'e> {
        self.environment.mobility(self.world)
    }

    /// A vehicle's age of information at the beginning of the slot.
    pub fn age(&self, vehicle: usize) -> Age {
        self.environment.age(self.world, vehicle)
    }

    /// Whether a vehicle was received in the slot before.
    pub fn received(&self, vehicle: usize) -> bool {
        self.environment.received(self.world, vehicle)
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.environment.elapsed()
    }
}
