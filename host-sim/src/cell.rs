//! One cell, slot by slot: the only radio-and-age loop there is. Policies, the trainer and the tests all drive it.

use crate::base_station::BaseStation;
use crate::channel::Channel;
use crate::mobility::{Mobility, Place};
use crate::radio::SlotOutcome;
use crate::scenario::Scenario;
use crate::stream::WorldKey;
use firmware::decision::Decision;
use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, Level, SUB_CHANNELS, SlotIndex};

/// Index of a world's first slot: every start age then has a slot in which the vehicle was last received.
const FIRST_SLOT: u32 = Age::MAX.slots() as u32;

/// A cell at the beginning of a slot, before anybody decides.
pub struct Cell<'s> {
    scenario: &'s Scenario,
    required_sinr: f64,
    mobility: Mobility<'s>,
    channel: Channel<'s>,
    base_station: BaseStation,
    places: Vec<(usize, Place)>,
    present: Vec<usize>,
    arrivals: Vec<usize>,
    departures: Vec<usize>,
    last_received: Vec<Option<u32>>,
    interference_db: Vec<[f32; SUB_CHANNELS]>,
    outcome: SlotOutcome,
    slot: u32,
}

impl<'s> Cell<'s> {
    /// A world's cell before its first slot. Every vehicle starts at the largest age.
    pub fn new(scenario: &'s Scenario, mobility: Mobility<'s>, key: &WorldKey) -> Self {
        let vehicles = mobility.vehicles();
        let mut cell = Self {
            scenario,
            required_sinr: scenario.radio.required_sinr(),
            mobility,
            channel: Channel::new(scenario, vehicles, key),
            base_station: BaseStation::new(&scenario.broadcast, vehicles),
            places: Vec::new(),
            present: Vec::new(),
            arrivals: Vec::new(),
            departures: Vec::new(),
            last_received: vec![None; vehicles],
            interference_db: vec![[0.0; SUB_CHANNELS]; vehicles],
            outcome: SlotOutcome::default(),
            slot: FIRST_SLOT,
        };
        cell.begin_slot();
        cell
    }

    /// How many vehicles ever appear; their indices are below.
    pub fn vehicles(&self) -> usize {
        self.last_received.len()
    }

    /// The present vehicles, ascending.
    pub fn present(&self) -> &[usize] {
        &self.present
    }

    /// The present vehicles' places, in the same order.
    pub fn places(&self) -> &[(usize, Place)] {
        &self.places
    }

    /// How vehicles move.
    pub fn mobility(&self) -> &Mobility<'s> {
        &self.mobility
    }

    /// The slot's index as units count it.
    pub fn slot(&self) -> SlotIndex {
        SlotIndex(self.slot)
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.slot - FIRST_SLOT
    }

    /// A vehicle's age of information at the beginning of the slot.
    pub fn age(&self, vehicle: usize) -> Age {
        age_at(self.slot, self.last_received[vehicle])
    }

    /// Sets a vehicle's age before its first decision, for training from many starts.
    pub fn set_age(&mut self, vehicle: usize, age: Age) {
        self.last_received[vehicle] = (age < Age::MAX).then(|| self.slot - u32::from(age.slots()));
    }

    /// What happened in the slot before.
    pub fn outcome(&self) -> &SlotOutcome {
        &self.outcome
    }

    /// The scenario.
    pub fn scenario(&self) -> &'s Scenario {
        self.scenario
    }

    /// A vehicle's true gain on every sub-channel, in dB over noise at full power.
    pub fn gain_db(&self, vehicle: usize) -> &[f32; SUB_CHANNELS] {
        self.channel.gain_db(vehicle)
    }

    /// Noise plus others' power on every sub-channel in the slot before, in dB over noise.
    pub fn interference_db(&self, vehicle: usize) -> &[f32; SUB_CHANNELS] {
        &self.interference_db[vehicle]
    }

    /// What a present vehicle hears from the base station.
    pub fn broadcast(&self, vehicle: usize) -> Option<Broadcast> {
        self.base_station.broadcast(vehicle)
    }

    /// What a present vehicle's modem measures. `None` if the base station cannot serve the vehicle's group (more than 100
    /// members).
    ///
    /// Gains are rounded down to the units' 1/256 dB, so that a vehicle never believes to be heard where it is not.
    pub fn measurement(&self, vehicle: usize) -> Option<Measurement> {
        let broadcast = self.base_station.broadcast(vehicle)?;
        let gain = self.channel.gain_db(vehicle).map(level);
        let interference = self.interference_db[vehicle].map(level);
        let last_acknowledged = self.last_received[vehicle].map(SlotIndex);
        Measurement::new(self.slot(), gain, interference, last_acknowledged, broadcast).ok()
    }

    /// Carries out the slot's decisions, one for every vehicle that ever appears (an absent one's counts for nothing), and
    /// begins the next slot.
    pub fn step(&mut self, decisions: &[Decision]) -> &SlotOutcome {
        let channel = &self.channel;
        self.outcome.evaluate(
            self.present.iter().map(|&vehicle| (vehicle, decisions[vehicle])),
            |vehicle| channel.gain_db(vehicle),
            self.scenario.radio.max_power_dbm,
            self.required_sinr,
        );
        for &vehicle in &self.outcome.received {
            self.last_received[vehicle] = Some(self.slot);
        }
        self.sense_interference();
        self.slot += 1;
        self.begin_slot();
        &self.outcome
    }

    /// Noise plus others' power on every sub-channel, which the base station reports to every vehicle.
    fn sense_interference(&mut self) {
        let mut total_db = [0.0; SUB_CHANNELS];
        for (sub_channel, total) in total_db.iter_mut().enumerate() {
            *total = over_noise_db(self.outcome.interference(sub_channel, None));
        }
        for &vehicle in &self.present {
            self.interference_db[vehicle] = total_db;
        }
        for (index, transmission) in self.outcome.transmissions.iter().enumerate() {
            let others = self.outcome.interference(transmission.sub_channel, Some(index));
            self.interference_db[transmission.vehicle][transmission.sub_channel] = over_noise_db(others);
        }
    }

    /// Moves vehicles where it is time, draws the slot's fading and prepares the broadcasts.
    fn begin_slot(&mut self) {
        let elapsed = self.elapsed();
        if elapsed.is_multiple_of(self.scenario.radio.slow_update_slots) {
            self.mobility.advance(elapsed, &mut self.places);
            self.find_arrivals_and_departures();
            for &vehicle in &self.arrivals {
                self.last_received[vehicle] = None;
                self.interference_db[vehicle] = [0.0; SUB_CHANNELS];
            }
            self.channel.move_to(&self.places);
            let channel = &self.channel;
            self.base_station
                .update(&mut self.arrivals, &self.departures, |vehicle| {
                    channel.large_scale_db(vehicle)
                });
        }
        self.channel.fade(&self.present);
        let (last_received, slot) = (&self.last_received, self.slot);
        self.base_station.prepare(&self.present, |vehicle| {
            age_at(slot, last_received[vehicle]).slots()
        });
    }

    /// Compares the present vehicles with the new places; both are ascending.
    fn find_arrivals_and_departures(&mut self) {
        let now = |vehicle: &usize| self.places.binary_search_by_key(vehicle, |&(v, _)| v).is_ok();
        self.departures.clear();
        self.departures
            .extend(self.present.iter().copied().filter(|vehicle| !now(vehicle)));
        self.arrivals.clear();
        let before = |vehicle: usize| self.present.binary_search(&vehicle).is_ok();
        self.arrivals.extend(
            self.places
                .iter()
                .map(|&(vehicle, _)| vehicle)
                .filter(|&vehicle| !before(vehicle)),
        );
        self.present.clear();
        self.present
            .extend(self.places.iter().map(|&(vehicle, _)| vehicle));
    }
}

/// The age in a slot when the vehicle was last received in another.
fn age_at(slot: u32, last_received: Option<u32>) -> Age {
    last_received.map_or(Age::MAX, |last| Age::after(slot - last))
}

/// dB as a unit's [`Level`]: rounded down, and bounded by the receiver's range of -128 to +127.996 dB.
fn level(db: f32) -> Level {
    // A float-to-integer cast saturates, which is the receiver's range.
    Level::from_bits((db * 256.0).floor() as i16)
}

/// Noise plus interference over noise in dB.
fn over_noise_db(interference: f64) -> f32 {
    if interference == 0.0 {
        0.0
    } else {
        10.0 * libm::log10f(1.0 + interference as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mobility::MobilitySource;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;
    use firmware::units::{Dbm, SubChannel};

    #[test]
    fn ages_follow_the_recursion() {
        let scenario = ScenarioSource {
            settings: vec!["cell.vehicles=2".into()],
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        let key = WorldKey {
            seed: 3,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let mut cell = Cell::new(
            &scenario,
            Mobility::new(&MobilitySource::Grid, &scenario, &key),
            &key,
        );
        let send = |n| Decision::Transmit {
            sub_channel: SubChannel::new(n).unwrap(),
            power: Dbm::from_bits(30 << 8),
        };
        let mut expected = [100_u8; 2];
        for slot in 0..300 {
            // Vehicle 0 sends in every fifth slot, vehicle 1 never.
            let decisions = [
                if slot % 5 == 0 { send(0) } else { Decision::Silent },
                Decision::Silent,
            ];
            let success = slot % 5 == 0 && libm::exp10(f64::from(cell.gain_db(0)[0]) / 10.0) >= 7.0;
            assert_eq!(cell.age(0).slots(), expected[0]);
            assert_eq!(
                cell.measurement(0).unwrap().age(),
                cell.age(0),
                "the unit's age is the base station's"
            );
            let outcome = cell.step(&decisions);
            assert_eq!(outcome.received == [0], success);
            expected = [if success { 1 } else { (expected[0] + 1).min(100) }, 100];
            assert_eq!(cell.age(1).slots(), expected[1]);
        }
    }
}
