//! A batch of worlds, slot by slot: reset, observe, step. Policies, the trainer and sweeps share it.
//!
//! # Layout
//! Arrays over vehicles and worlds are `[vehicle][world]`, those over sub-channels too `[vehicle][sub_channel][world]`, so that
//! one vehicle's values of all worlds lie side by side. Which vehicles are present is the same in every world of a batch.
//! A world's bytes follow from its key alone: they do not depend on the batch that it is run in.

use crate::cell::Cell;
use crate::mobility::{Mobility, MobilitySource, Place};
use crate::scenario::Scenario;
use crate::stream::{Purpose, WorldKey};
use firmware::decision::Decision;
use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, SUB_CHANNELS, SlotIndex};
use std::ops::Range;

/// One slot's decisions of all vehicles that ever appear, in all worlds of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decisions {
    worlds: usize,
    /// `[vehicle][world]`.
    decisions: Vec<Decision>,
}

impl Decisions {
    /// Everybody silent.
    pub fn new(worlds: usize, vehicles: usize) -> Self {
        Self {
            worlds,
            decisions: vec![Decision::Silent; worlds * vehicles],
        }
    }

    /// Makes everybody silent.
    pub fn clear(&mut self) {
        self.decisions.fill(Decision::Silent);
    }

    /// What a vehicle does.
    pub fn get(&self, world: usize, vehicle: usize) -> Decision {
        self.decisions[vehicle * self.worlds + world]
    }

    /// Decides for a vehicle. An absent one's decision counts for nothing.
    pub fn set(&mut self, world: usize, vehicle: usize, decision: Decision) {
        self.decisions[vehicle * self.worlds + world] = decision;
    }
}

/// Worlds of one scenario at the beginning of a slot, before anybody decides.
pub struct Environment<'s> {
    scenario: &'s Scenario,
    source: &'s MobilitySource,
    seed: u64,
    purpose: Purpose,
    cells: Vec<Cell<'s>>,
}

impl<'s> Environment<'s> {
    /// The worlds with these indices before their first slot. Every vehicle starts at the largest age.
    pub fn new(
        scenario: &'s Scenario,
        source: &'s MobilitySource,
        seed: u64,
        purpose: Purpose,
        worlds: Range<u64>,
    ) -> Self {
        let mut environment = Self {
            scenario,
            source,
            seed,
            purpose,
            cells: Vec::new(),
        };
        environment.reset(worlds);
        environment
    }

    /// Goes on with other worlds, before their first slot.
    pub fn reset(&mut self, worlds: Range<u64>) {
        let Self {
            scenario,
            source,
            seed,
            purpose,
            ..
        } = *self;
        self.cells = worlds
            .map(|world| {
                let key = WorldKey { seed, purpose, world };
                Cell::new(scenario, Mobility::new(source, scenario, &key), &key)
            })
            .collect();
    }

    /// The scenario.
    pub fn scenario(&self) -> &'s Scenario {
        self.scenario
    }

    /// How many worlds.
    pub fn worlds(&self) -> usize {
        self.cells.len()
    }

    /// How many vehicles ever appear in a world; their indices are below.
    pub fn vehicles(&self) -> usize {
        self.source.vehicles(self.scenario)
    }

    /// How many sub-channels the cell has.
    pub fn sub_channels(&self) -> usize {
        SUB_CHANNELS
    }

    /// The present vehicles, ascending: the same in every world.
    pub fn present(&self) -> &[usize] {
        self.cells.first().map_or(&[], Cell::present)
    }

    /// The slot's index as units count it.
    pub fn slot(&self) -> SlotIndex {
        self.cells.first().map_or(SlotIndex(0), Cell::slot)
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.cells.first().map_or(0, Cell::elapsed)
    }

    /// A vehicle's age of information at the beginning of the slot.
    pub fn age(&self, world: usize, vehicle: usize) -> Age {
        self.cells[world].age(vehicle)
    }

    /// Sets a vehicle's age before its first decision, for training from many starts.
    pub fn set_age(&mut self, world: usize, vehicle: usize, age: Age) {
        self.cells[world].set_age(vehicle, age);
    }

    /// A vehicle's true gain on a sub-channel, in dB over noise at full power.
    pub fn gain_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        self.cells[world].gain_db(vehicle)[sub_channel]
    }

    /// Noise plus others' power on a sub-channel in the slot before, in dB over noise.
    pub fn interference_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        self.cells[world].interference_db(vehicle)[sub_channel]
    }

    /// What a present vehicle hears from the base station; `None` if that cannot serve the vehicle's group.
    pub fn broadcast(&self, world: usize, vehicle: usize) -> Option<Broadcast> {
        self.cells[world].broadcast(vehicle)
    }

    /// What a present vehicle's modem measures; `None` as [`Environment::broadcast`].
    pub fn measurement(&self, world: usize, vehicle: usize) -> Option<Measurement> {
        self.cells[world].measurement(vehicle)
    }

    /// Whether a vehicle was received in the slot before.
    pub fn received(&self, world: usize, vehicle: usize) -> bool {
        self.cells[world].outcome().received.contains(&vehicle)
    }

    /// Where a present vehicle is.
    pub fn place(&self, world: usize, vehicle: usize) -> Option<Place> {
        let places = self.cells[world].places();
        let index = places.binary_search_by_key(&vehicle, |&(v, _)| v).ok()?;
        Some(places[index].1)
    }

    /// How vehicles move.
    pub fn mobility(&self, world: usize) -> &Mobility<'s> {
        self.cells[world].mobility()
    }

    /// Carries out the slot's decisions in all worlds and begins the next slot.
    pub fn step(&mut self, decisions: &Decisions) {
        for (world, cell) in self.cells.iter_mut().enumerate() {
            let own: Vec<Decision> = (0..cell.vehicles())
                .map(|vehicle| decisions.get(world, vehicle))
                .collect();
            let _ = cell.step(&own);
        }
    }
}
