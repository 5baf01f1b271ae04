//! What an environment shows to Python in a slot, `[world][vehicle]`, and how it is filled.

use crate::shared_array::SharedArray;
use firmware::decision::{ACTIONS, Action, Decision, PowerPlan};
use firmware::observation::{INPUTS, ONE, Observation};
use firmware::units::{Level, Weight};
use host_sim::environment::Environment;
use host_sim::lanes::LANES;
use host_sim::policy::Observer;
use pyo3::prelude::*;
use trainer::game::reward::Reward;

/// The place of a vehicle that has none.
const NO_PLACE: i16 = -1;

/// Every array of a batch. An absent vehicle's values are 0, its place is [`NO_PLACE`].
pub struct Arrays {
    vehicles: usize,
    sub_channels: usize,
    /// `[world][vehicle][22]`.
    pub observations: SharedArray<i8>,
    /// `[world][vehicle][22]`, observations over 64.
    pub float_observations: SharedArray<f32>,
    /// `[world][vehicle]`, slots.
    pub ages: SharedArray<u16>,
    /// `[world][vehicle]`: received in the slot before.
    pub received: SharedArray<bool>,
    /// `[world][vehicle]`: another vehicle has the index from this slot on.
    pub replaced: SharedArray<bool>,
    /// `[world][vehicle]`, of the slot before; who was replaced is paid for its own age.
    pub rewards: SharedArray<f32>,
    /// `[world][vehicle][sub_channel]`, dB over noise.
    pub gains_db: SharedArray<f32>,
    /// `[world][vehicle][sub_channel]`, dB over noise.
    pub interference_db: SharedArray<f32>,
    /// `[world][vehicle]`, its place in the ring or [`NO_PLACE`].
    pub places: SharedArray<i16>,
    /// `[world][vehicle]`: the place was handed out.
    pub assigned: SharedArray<bool>,
    /// `[world][vehicle]`: what its age counts, 1 as it is.
    pub weights: SharedArray<f32>,
    /// `[world][vehicle]`: an acknowledgement may be under way.
    pub awaits: SharedArray<bool>,
    /// `[world][vehicle]`, places of the ring as it last heard.
    pub ring_places: SharedArray<u16>,
    /// `[world][vehicle][sub_channel]`: anybody may contend there, as it heard.
    pub open_sub_channels: SharedArray<bool>,
    /// `[world][vehicle]`: the least priority with which to contend, as it heard.
    pub thresholds: SharedArray<u32>,
    /// `[world][vehicle][action]`: silence, and what can be heard as far as the vehicle knows.
    pub masks: SharedArray<bool>,
    /// `[vehicle]`: the same in every world.
    pub present: SharedArray<bool>,
}

impl Arrays {
    /// Zeros for so many worlds, vehicles and sub-channels.
    ///
    /// # Errors
    /// If they do not fit the memory.
    pub fn zeros(py: Python<'_>, worlds: usize, vehicles: usize, sub_channels: usize) -> PyResult<Self> {
        let each = (worlds, vehicles);
        let inputs = (worlds, vehicles, INPUTS);
        let levels = (worlds, vehicles, sub_channels);
        Ok(Self {
            vehicles,
            sub_channels,
            observations: SharedArray::zeros(py, inputs)?,
            float_observations: SharedArray::zeros(py, inputs)?,
            ages: SharedArray::zeros(py, each)?,
            received: SharedArray::zeros(py, each)?,
            replaced: SharedArray::zeros(py, each)?,
            rewards: SharedArray::zeros(py, each)?,
            gains_db: SharedArray::zeros(py, levels)?,
            interference_db: SharedArray::zeros(py, levels)?,
            places: SharedArray::zeros(py, each)?,
            assigned: SharedArray::zeros(py, each)?,
            weights: SharedArray::zeros(py, each)?,
            awaits: SharedArray::zeros(py, each)?,
            ring_places: SharedArray::zeros(py, each)?,
            open_sub_channels: SharedArray::zeros(py, levels)?,
            thresholds: SharedArray::zeros(py, each)?,
            masks: SharedArray::zeros(py, (worlds, vehicles, ACTIONS))?,
            present: SharedArray::zeros(py, vehicles)?,
        })
    }

    /// Arrays with the same values in memory of their own.
    ///
    /// # Errors
    /// If they do not fit the memory.
    pub fn copy(&mut self, py: Python<'_>) -> PyResult<Self> {
        Ok(Self {
            vehicles: self.vehicles,
            sub_channels: self.sub_channels,
            observations: self.observations.copy(py)?,
            float_observations: self.float_observations.copy(py)?,
            ages: self.ages.copy(py)?,
            received: self.received.copy(py)?,
            replaced: self.replaced.copy(py)?,
            rewards: self.rewards.copy(py)?,
            gains_db: self.gains_db.copy(py)?,
            interference_db: self.interference_db.copy(py)?,
            places: self.places.copy(py)?,
            assigned: self.assigned.copy(py)?,
            weights: self.weights.copy(py)?,
            awaits: self.awaits.copy(py)?,
            ring_places: self.ring_places.copy(py)?,
            open_sub_channels: self.open_sub_channels.copy(py)?,
            thresholds: self.thresholds.copy(py)?,
            masks: self.masks.copy(py)?,
            present: self.present.copy(py)?,
        })
    }

    /// The arrays that every slot fills, in parts of so many worlds.
    pub fn parts(&mut self, worlds: usize) -> Vec<Part<'_>> {
        let each = worlds * self.vehicles;
        let mut ages = self.ages.values_mut().chunks_mut(each);
        let mut received = self.received.values_mut().chunks_mut(each);
        let mut replaced = self.replaced.values_mut().chunks_mut(each);
        let mut rewards = self.rewards.values_mut().chunks_mut(each);
        let observations = self.observations.values_mut().chunks_mut(each * INPUTS);
        let parts = observations.filter_map(|observations| {
            Some(Part {
                observations,
                ages: ages.next()?,
                received: received.next()?,
                replaced: replaced.next()?,
                rewards: rewards.next()?,
            })
        });
        parts.collect()
    }

    /// Says who is present.
    pub fn mark_present(&mut self, present: &[usize]) {
        let marks = self.present.values_mut();
        marks.fill(false);
        present.iter().for_each(|&vehicle| marks[vehicle] = true);
    }

    /// Fills what is read less often, of a part whose first world is `first`: the measurement that a vehicle's unit gets. Where its modem
    /// measured nothing, levels are 0.
    pub fn fill_measurements(&mut self, first: usize, environment: &Environment<'_>) {
        let count = self.sub_channels;
        let (gains_db, interference_db) = (self.gains_db.values_mut(), self.interference_db.values_mut());
        let (places, assigned) = (self.places.values_mut(), self.assigned.values_mut());
        let (weights, awaits) = (self.weights.values_mut(), self.awaits.values_mut());
        let (ring_places, thresholds) = (self.ring_places.values_mut(), self.thresholds.values_mut());
        let open_sub_channels = self.open_sub_channels.values_mut();
        for world in 0..environment.worlds() {
            for vehicle in 0..self.vehicles {
                let index = (first + world) * self.vehicles + vehicle;
                let here = environment.presence().contains(world, vehicle);
                let measured = environment.measurement(world, vehicle).filter(|_| here);
                let heard = environment.broadcast(world, vehicle).filter(|_| here);
                for sub_channel in 0..count {
                    let place = index * count + sub_channel;
                    let db = |levels: &[Level]| levels[sub_channel].to_num::<f32>();
                    gains_db[place] = measured.map_or(0.0, |measured| db(measured.gain()));
                    interference_db[place] = measured.map_or(0.0, |measured| db(measured.interference()));
                    open_sub_channels[place] = heard.is_some_and(|heard| heard.open.contains(sub_channel));
                }
                ring_places[index] = heard.map_or(0, |heard| heard.ring.places());
                thresholds[index] = heard.map_or(0, |heard| heard.threshold);
                let (senses, lane) = (environment.senses(world / LANES, vehicle), world % LANES);
                let (own, told) = senses.places();
                // No place is the last of all codes.
                places[index] = if here { own[lane].cast_signed() } else { NO_PLACE };
                assigned[index] = here && told[lane] > 0;
                awaits[index] = here && senses.awaits()[lane] > 0;
                let weight = if here { senses.weights()[lane] } else { 0 };
                weights[index] = f32::from(weight) / f32::from(Weight::ONE.0);
            }
        }
    }

    /// Fills the masks of a part whose first world is `first`. What is no transmission is masked beside silence, and what is, where even
    /// full power would be too weak to be received alone at the level that was measured.
    pub fn fill_masks(&mut self, first: usize, environment: &Environment<'_>, plan: &PowerPlan) {
        let required = environment.scenario().radio.required_level();
        let (masks, _) = self.masks.values_mut().as_chunks_mut::<ACTIONS>();
        for world in 0..environment.worlds() {
            for vehicle in 0..self.vehicles {
                let mask = &mut masks[(first + world) * self.vehicles + vehicle];
                *mask = Action::ALL.map(|action| action == Action::Silent);
                if !environment.presence().contains(world, vehicle) {
                    continue;
                }
                if let Some(measurement) = environment.measurement(world, vehicle) {
                    let observation = Observation::new(&measurement, environment.identity(world, vehicle));
                    for (allowed, action) in mask.iter_mut().zip(Action::ALL) {
                        if let Decision::Transmit { sub_channel, .. } = plan.decision(action, &observation) {
                            *allowed = observation.gain()[sub_channel.index()] >= required;
                        }
                    }
                }
            }
        }
    }

    /// Fills the floats from the integers.
    pub fn fill_float_observations(&mut self) {
        let codes = self.observations.values_mut();
        let floats = self.float_observations.values_mut();
        for (float, &code) in floats.iter_mut().zip(codes.iter()) {
            *float = f32::from(code) / f32::from(ONE);
        }
    }
}

/// The arrays of a few worlds.
pub struct Part<'a> {
    observations: &'a mut [i8],
    ages: &'a mut [u16],
    received: &'a mut [bool],
    replaced: &'a mut [bool],
    rewards: &'a mut [f32],
}

impl Part<'_> {
    /// Takes in a slot's beginning.
    pub fn fill(&mut self, environment: &Environment<'_>, observer: &Observer, reward: &Reward) {
        let vehicles = environment.vehicles();
        if environment.present().len() < vehicles {
            self.observations.fill(0);
            self.ages.fill(0);
            self.received.fill(false);
            self.rewards.fill(0.0);
        }
        // A part is filled by one thread, which hears what it needs.
        let mut observer = observer.clone();
        for block in 0..environment.ages().blocks() {
            observer.hear(&environment.broadcasts(block));
            let worlds = (environment.worlds() - block * LANES).min(LANES);
            for &vehicle in environment.present() {
                let first = block * LANES * vehicles + vehicle;
                self.fill_vehicle(environment, &observer, block, vehicle, (first, worlds));
            }
        }
        self.replaced.fill(false);
        for left in environment.replacements() {
            self.replaced[left.world * vehicles + left.vehicle] = true;
        }
        for world in 0..environment.worlds() {
            self.fill_rewards(environment, world, reward);
        }
    }

    /// Takes in one vehicle in a block of worlds: its index in the first one, and how many these are.
    fn fill_vehicle(
        &mut self,
        environment: &Environment<'_>,
        observer: &Observer,
        block: usize,
        vehicle: usize,
        (first, worlds): (usize, usize),
    ) {
        let mut inputs = [[0; LANES]; INPUTS];
        let senses = environment.senses(block, vehicle);
        environment.vectors().run(
            #[inline(always)]
            || observer.encode(&observer.view(&senses), &mut inputs),
        );
        let ages = environment.ages().row(block, vehicle);
        let receptions = environment.receptions().row(block, vehicle);
        // Where modems may miss a slot, who measured nothing sees nothing.
        let misses = environment.scenario().feedback.measurement_loss > 0.0;
        for world in 0..worlds {
            let index = first + world * environment.vehicles();
            let (observation, _) = self.observations[index * INPUTS..].as_chunks_mut::<INPUTS>();
            observation[0] = if misses && senses.measurement(world).is_none() {
                [0; INPUTS]
            } else {
                std::array::from_fn(|input| inputs[input][world] as i8)
            };
            self.ages[index] = ages[world];
            self.received[index] = receptions[world] > 0;
        }
    }

    fn fill_rewards(&mut self, environment: &Environment<'_>, world: usize, reward: &Reward) {
        let (present, first) = (environment.present(), world * environment.vehicles());
        let paid = |&vehicle: &usize| {
            let left = environment.replacement(world, vehicle);
            let age = left.map_or_else(|| environment.age(world, vehicle), |left| left.last_age);
            reward.own.of(age, self.received[first + vehicle])
        };
        if reward.shared {
            let mean = present.iter().map(paid).sum::<f32>() / present.len().max(1) as f32;
            present
                .iter()
                .for_each(|vehicle| self.rewards[first + vehicle] = mean);
        } else {
            for vehicle in present {
                self.rewards[first + vehicle] = paid(vehicle);
            }
        }
    }
}
