//! A batch of worlds, slot by slot: reset, observe, step. It is the only radio-and-age loop there is; policies, the trainer,
//! sweeps and the tests all drive it.
//!
//! # Layout
//! Arrays are `[vehicle][world]`, those over sub-channels `[vehicle][sub_channel][world]`, and contiguous; worlds are padded to
//! whole rows of [`crate::lanes::LANES`]. Which vehicles are present is the same in every world. A world's bytes follow from its
//! key alone: they do not depend on the batch, the lane or the thread that it is run in.

use crate::base_station::BaseStation;
use crate::cell::Cell;
use crate::channel::Channel;
use crate::decisions::Decisions;
use crate::lanes::{LANES, Rows, Vectors};
use crate::mobility::{Mobility, MobilitySource, Place};
use crate::radio::Radio;
use crate::scenario::Scenario;
use crate::stream::{Purpose, WorldKey};
use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, Level, SUB_CHANNELS, SlotIndex};
use std::ops::Range;

/// Index of a world's first slot: every start age then has a slot in which the vehicle was last received.
const FIRST_SLOT: u32 = Age::MAX.slots() as u32;

/// Worlds of one scenario at the beginning of a slot, before anybody decides.
pub struct Environment<'s> {
    scenario: &'s Scenario,
    source: &'s MobilitySource,
    vectors: Vectors,
    /// By world.
    keys: Vec<WorldKey>,
    mobility: Vec<Mobility<'s>>,
    /// Of the present vehicles, by world.
    places: Vec<Vec<(usize, Place)>>,
    present: Vec<usize>,
    arrivals: Vec<usize>,
    departures: Vec<usize>,
    channel: Channel<'s>,
    radio: Radio,
    base_station: BaseStation,
    /// In slots, `[vehicle][world]`.
    ages: Rows<u8>,
    slot: u32,
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
        let keys: Vec<WorldKey> = worlds.map(|world| WorldKey { seed, purpose, world }).collect();
        let (count, vehicles) = (keys.len(), source.vehicles(scenario));
        let sub_channels = scenario.radio.sub_channels as usize;
        let mut environment = Self {
            scenario,
            source,
            vectors: Vectors::widest(),
            mobility: keys
                .iter()
                .map(|key| Mobility::new(source, scenario, key))
                .collect(),
            places: vec![Vec::new(); count],
            present: Vec::new(),
            arrivals: Vec::new(),
            departures: Vec::new(),
            channel: Channel::new(scenario, vehicles, &keys),
            radio: Radio::new(&scenario.radio, count, vehicles),
            base_station: BaseStation::new(&scenario.broadcast, count, vehicles, sub_channels),
            ages: Rows::new(count, vehicles, Age::MAX.slots()),
            keys,
            slot: FIRST_SLOT,
        };
        environment.begin_slot();
        environment
    }

    /// Goes on with other worlds of the same seed and purpose, before their first slot.
    pub fn reset(&mut self, worlds: Range<u64>) {
        let Some(&WorldKey { seed, purpose, .. }) = self.keys.first() else {
            return;
        };
        let vectors = self.vectors;
        *self = Self::new(self.scenario, self.source, seed, purpose, worlds);
        self.vectors = vectors;
    }

    /// Goes on with another vector unit. The bytes are the same.
    pub fn set_vectors(&mut self, vectors: Vectors) {
        self.vectors = vectors;
    }

    /// The vector unit that does the work.
    pub fn vectors(&self) -> Vectors {
        self.vectors
    }

    /// The scenario.
    pub fn scenario(&self) -> &'s Scenario {
        self.scenario
    }

    /// The worlds' keys.
    pub fn keys(&self) -> &[WorldKey] {
        &self.keys
    }

    /// How many worlds.
    pub fn worlds(&self) -> usize {
        self.keys.len()
    }

    /// How many vehicles ever appear in a world; their indices are below.
    pub fn vehicles(&self) -> usize {
        self.source.vehicles(self.scenario)
    }

    /// The most vehicles at once.
    pub fn most_vehicles(&self) -> usize {
        self.source.most_vehicles(self.scenario)
    }

    /// How many sub-channels the cell has.
    pub fn sub_channels(&self) -> usize {
        self.scenario.radio.sub_channels as usize
    }

    /// The present vehicles, ascending: the same in every world.
    pub fn present(&self) -> &[usize] {
        &self.present
    }

    /// The slot's index as units count it.
    pub fn slot(&self) -> SlotIndex {
        SlotIndex(self.slot)
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.slot - FIRST_SLOT
    }

    /// One world.
    pub fn cell(&self, world: usize) -> Cell<'_> {
        Cell::new(self, world)
    }

    /// Ages of information at the beginning of the slot, in slots: `[vehicle][world]`.
    pub fn ages(&self) -> &Rows<u8> {
        &self.ages
    }

    /// True gains in dB over noise at full power, `[vehicle][sub_channel][world]`.
    pub fn gains_db(&self) -> &Rows<f32> {
        self.channel.gain_db()
    }

    /// Noise plus others' power in the slot before, in dB over noise: `[vehicle][sub_channel][world]`.
    pub fn interferences_db(&self) -> &Rows<f32> {
        self.radio.interference_db()
    }

    /// Whether each vehicle was received in the slot before: 1 or 0, `[vehicle][world]`.
    pub fn receptions(&self) -> &Rows<u8> {
        self.radio.received()
    }

    /// How many vehicles were received in the slot before, in every world: one item.
    pub fn successes(&self) -> &Rows<u16> {
        self.radio.successes()
    }

    /// Groups and broadcasts.
    pub fn base_station(&self) -> &BaseStation {
        &self.base_station
    }

    /// A vehicle's age of information at the beginning of the slot.
    pub fn age(&self, world: usize, vehicle: usize) -> Age {
        Age::after(u32::from(self.ages.get(world, vehicle)))
    }

    /// Sets a vehicle's age before its first decision, for training from many starts.
    pub fn set_age(&mut self, world: usize, vehicle: usize, age: Age) {
        self.ages.set(world, vehicle, age.slots());
    }

    /// A vehicle's true gain on a sub-channel, in dB over noise at full power.
    pub fn gain_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        let item = vehicle * self.sub_channels() + sub_channel;
        self.channel.gain_db().get(world, item)
    }

    /// Noise plus others' power on a sub-channel in the slot before, in dB over noise.
    pub fn interference_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        let item = vehicle * self.sub_channels() + sub_channel;
        self.radio.interference_db().get(world, item)
    }

    /// What a present vehicle hears from the base station; `None` if that cannot serve the vehicle's group.
    pub fn broadcast(&self, world: usize, vehicle: usize) -> Option<Broadcast> {
        self.base_station.broadcast(world, vehicle)
    }

    /// What a present vehicle's modem measures; `None` as [`Environment::broadcast`].
    ///
    /// Gains are rounded down to the units' 1/256 dB, so that a vehicle never believes to be heard where it is not.
    pub fn measurement(&self, world: usize, vehicle: usize) -> Option<Measurement> {
        let broadcast = self.broadcast(world, vehicle)?;
        let first = vehicle * SUB_CHANNELS;
        let levels = |values: &Rows<f32>| -> [Level; SUB_CHANNELS] {
            std::array::from_fn(|sub_channel| level(values.get(world, first + sub_channel)))
        };
        let (gain, interference) = (levels(self.gains_db()), levels(self.interferences_db()));
        let age = self.age(world, vehicle);
        let last_acknowledged = (age < Age::MAX).then(|| SlotIndex(self.slot - u32::from(age.slots())));
        Measurement::new(self.slot(), gain, interference, last_acknowledged, broadcast).ok()
    }

    /// Whether a vehicle was received in the slot before.
    pub fn received(&self, world: usize, vehicle: usize) -> bool {
        self.radio.received().get(world, vehicle) > 0
    }

    /// Where the present vehicles are, in the order of [`Environment::present`].
    pub fn places(&self, world: usize) -> &[(usize, Place)] {
        &self.places[world]
    }

    /// How vehicles move.
    pub fn mobility(&self, world: usize) -> &Mobility<'s> {
        &self.mobility[world]
    }

    /// Carries out the slot's decisions in all worlds and begins the next slot.
    pub fn step(&mut self, decisions: &Decisions) {
        for &vehicle in &self.departures {
            self.radio.leave(vehicle);
        }
        self.radio
            .evaluate(self.vectors, &self.present, decisions, self.channel.gain_db());
        let (ages, received) = (&mut self.ages, self.radio.received());
        for block in 0..ages.blocks() {
            self.vectors.run(
                #[inline(always)]
                || {
                    for &vehicle in &self.present {
                        let received = received.row(block, vehicle);
                        let ages = ages.row_mut(block, vehicle);
                        for lane in 0..LANES {
                            // Paper eq. 4.
                            let older = (ages[lane] + 1).min(Age::MAX.slots());
                            ages[lane] = if received[lane] > 0 {
                                Age::MIN.slots()
                            } else {
                                older
                            };
                        }
                    }
                },
            );
        }
        self.slot += 1;
        self.begin_slot();
    }

    /// Moves vehicles where it is time, draws the slot's fading and prepares the broadcasts.
    fn begin_slot(&mut self) {
        if self
            .elapsed()
            .is_multiple_of(self.scenario.radio.slow_update_slots)
        {
            self.move_vehicles();
        }
        self.channel.fade(self.vectors, &self.present);
        self.base_station.prepare(self.vectors, &self.present, &self.ages);
    }

    fn move_vehicles(&mut self) {
        let elapsed = self.elapsed();
        for (world, (mobility, places)) in self.mobility.iter_mut().zip(&mut self.places).enumerate() {
            mobility.advance(elapsed, places);
            self.channel.move_to(world, places);
        }
        self.find_arrivals_and_departures();
        for &vehicle in &self.arrivals {
            self.ages.fill(vehicle, Age::MAX.slots());
            self.radio.arrive(vehicle);
        }
        self.base_station.update(
            self.keys.len(),
            &mut self.arrivals,
            &self.departures,
            self.channel.large_scale_db(),
        );
    }

    /// Compares the present vehicles with the new places; both are ascending.
    fn find_arrivals_and_departures(&mut self) {
        let places = self.places.first().map_or(&[][..], Vec::as_slice);
        let now = |vehicle: &usize| places.binary_search_by_key(vehicle, |&(v, _)| v).is_ok();
        self.departures.clear();
        self.departures
            .extend(self.present.iter().copied().filter(|vehicle| !now(vehicle)));
        self.arrivals.clear();
        let before = |vehicle: usize| self.present.binary_search(&vehicle).is_ok();
        self.arrivals.extend(
            places
                .iter()
                .map(|&(vehicle, _)| vehicle)
                .filter(|&vehicle| !before(vehicle)),
        );
        self.present.clear();
        self.present.extend(places.iter().map(|&(vehicle, _)| vehicle));
    }
}

/// dB as a unit's [`Level`]: rounded down, and bounded by the receiver's range of -128 to +127.996 dB.
fn level(db: f32) -> Level {
    // A float-to-integer cast saturates, which is the receiver's range.
    Level::from_bits((db * 256.0).floor() as i16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;
    use firmware::units::Dbm;

    #[test]
    fn ages_follow_the_recursion() {
        let scenario = ScenarioSource {
            settings: vec!["cell.vehicles=2".into()],
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        let worlds = LANES as u64 + 1;
        let source = MobilitySource::Grid;
        let mut environment = Environment::new(&scenario, &source, 3, Purpose::Evaluation, 0..worlds);
        let mut decisions = Decisions::new(environment.worlds(), 2);
        let mut expected = vec![100_u8; environment.worlds()];
        for slot in 0..300 {
            // Vehicle 0 sends in every fifth slot, vehicle 1 never.
            decisions.clear();
            for (world, expected) in expected.iter_mut().enumerate() {
                if slot % 5 == 0 {
                    decisions.transmit(world, 0, 0, Dbm::from_bits(30 << 8));
                }
                let gain = libm::exp10(f64::from(environment.gain_db(world, 0, 0)) / 10.0);
                let success = slot % 5 == 0 && gain >= 7.0;
                assert_eq!(environment.age(world, 0).slots(), *expected);
                assert_eq!(
                    environment.measurement(world, 0).unwrap().age(),
                    environment.age(world, 0),
                    "the unit's age is the base station's"
                );
                *expected = if success { 1 } else { (*expected + 1).min(100) };
                assert_eq!(environment.age(world, 1).slots(), 100);
            }
            environment.step(&decisions);
            for (world, expected) in expected.iter().enumerate() {
                assert_eq!(environment.received(world, 0), *expected == 1);
            }
        }
    }
}
