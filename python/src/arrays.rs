//! What an environment shows to Python in a slot, `[world][vehicle]`, and how it is filled.

use crate::shared_array::SharedArray;
use firmware::observation::{INPUTS, ONE};
use firmware::units::{Age, SUB_CHANNELS};
use host_sim::environment::Environment;
use host_sim::lanes::LANES;
use host_sim::policy::actor::Encoder;
use kit::choice::Choice;
use pyo3::prelude::*;

/// What a vehicle is rewarded for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reward {
    /// Its own age.
    Own,
    /// The mean age of its world's vehicles.
    Team,
}

impl Choice for Reward {
    const ALL: &'static [Self] = &[Self::Own, Self::Team];

    fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Team => "team",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Own => "Its own age",
            Self::Team => "The mean age of its world's vehicles",
        }
    }
}

/// Every array of a batch. An absent vehicle's values are 0.
pub struct Arrays {
    vehicles: usize,
    /// `[world][vehicle][20]`.
    pub observations: SharedArray<i8>,
    /// `[world][vehicle][20]`, observations over 64.
    pub float_observations: SharedArray<f32>,
    /// `[world][vehicle]`, slots.
    pub ages: SharedArray<u8>,
    /// `[world][vehicle]`: received in the slot before.
    pub received: SharedArray<bool>,
    /// `[world][vehicle]`, minus an age over 100 slots.
    pub rewards: SharedArray<f32>,
    /// `[world][vehicle][sub_channel]`, dB over noise.
    pub gains_db: SharedArray<f32>,
    /// `[world][vehicle][sub_channel]`, dB over noise.
    pub interference_db: SharedArray<f32>,
    /// `[world][vehicle]`.
    pub home_sub_channels: SharedArray<i8>,
    /// `[world][vehicle]`, slots.
    pub periods: SharedArray<u8>,
    /// `[world][vehicle]`.
    pub joiner_probabilities: SharedArray<f32>,
    /// `[vehicle]`: the same in every world.
    pub present: SharedArray<bool>,
}

impl Arrays {
    /// Zeros for so many worlds and vehicles.
    ///
    /// # Errors
    /// If they do not fit the memory.
    pub fn zeros(py: Python<'_>, worlds: usize, vehicles: usize) -> PyResult<Self> {
        let each = (worlds, vehicles);
        let inputs = (worlds, vehicles, INPUTS);
        let sub_channels = (worlds, vehicles, SUB_CHANNELS);
        Ok(Self {
            vehicles,
            observations: SharedArray::zeros(py, inputs)?,
            float_observations: SharedArray::zeros(py, inputs)?,
            ages: SharedArray::zeros(py, each)?,
            received: SharedArray::zeros(py, each)?,
            rewards: SharedArray::zeros(py, each)?,
            gains_db: SharedArray::zeros(py, sub_channels)?,
            interference_db: SharedArray::zeros(py, sub_channels)?,
            home_sub_channels: SharedArray::zeros(py, each)?,
            periods: SharedArray::zeros(py, each)?,
            joiner_probabilities: SharedArray::zeros(py, each)?,
            present: SharedArray::zeros(py, vehicles)?,
        })
    }

    /// The arrays that every slot fills, in parts of so many worlds.
    pub fn parts(&mut self, worlds: usize) -> Vec<Part<'_>> {
        let each = worlds * self.vehicles;
        let mut ages = self.ages.values_mut().chunks_mut(each);
        let mut received = self.received.values_mut().chunks_mut(each);
        let mut rewards = self.rewards.values_mut().chunks_mut(each);
        let observations = self.observations.values_mut().chunks_mut(each * INPUTS);
        let parts = observations.filter_map(|observations| {
            Some(Part {
                observations,
                ages: ages.next()?,
                received: received.next()?,
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

    /// Fills what is read less often: levels and broadcasts of a part whose first world is `first`.
    pub fn fill_measurements(&mut self, first: usize, environment: &Environment<'_>) {
        let gains_db = self.gains_db.values_mut();
        let interference_db = self.interference_db.values_mut();
        let home_sub_channels = self.home_sub_channels.values_mut();
        let periods = self.periods.values_mut();
        let joiner_probabilities = self.joiner_probabilities.values_mut();
        for world in 0..environment.worlds() {
            for vehicle in 0..self.vehicles {
                let index = (first + world) * self.vehicles + vehicle;
                let (senses, lane) = (environment.senses(world / LANES, vehicle), world % LANES);
                let present = environment.presence().contains(world, vehicle);
                for sub_channel in 0..SUB_CHANNELS {
                    let place = index * SUB_CHANNELS + sub_channel;
                    let db = |level: i32| if present { level as f32 / 256.0 } else { 0.0 };
                    gains_db[place] = db(senses.gain(sub_channel)[lane]);
                    interference_db[place] = db(senses.interference(sub_channel)[lane]);
                }
                let broadcast = environment.broadcast(world, vehicle).filter(|_| present);
                home_sub_channels[index] = broadcast.map_or(0, |heard| heard.home.index() as i8);
                periods[index] = broadcast.map_or(0, |heard| heard.period.slots());
                joiner_probabilities[index] = broadcast.map_or(0.0, |heard| {
                    f32::from(heard.joiner_probability.in_256ths()) / 256.0
                });
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
    ages: &'a mut [u8],
    received: &'a mut [bool],
    rewards: &'a mut [f32],
}

impl Part<'_> {
    /// Takes in a slot's beginning.
    pub fn fill(&mut self, environment: &Environment<'_>, encoder: &Encoder, reward: Reward) {
        let vehicles = environment.vehicles();
        if environment.present().len() < vehicles {
            self.observations.fill(0);
            self.ages.fill(0);
            self.received.fill(false);
            self.rewards.fill(0.0);
        }
        // A part is filled by one thread, which hears what it needs.
        let mut encoder = encoder.clone();
        for block in 0..environment.ages().blocks() {
            encoder.hear(&environment.broadcasts(block));
            let worlds = (environment.worlds() - block * LANES).min(LANES);
            for &vehicle in environment.present() {
                let first = block * LANES * vehicles + vehicle;
                self.fill_vehicle(environment, &encoder, block, vehicle, (first, worlds));
            }
        }
        for world in 0..environment.worlds() {
            self.fill_rewards(world * vehicles, environment.present(), reward);
        }
    }

    /// Takes in one vehicle in a block of worlds: its index in the first one, and how many these are.
    fn fill_vehicle(
        &mut self,
        environment: &Environment<'_>,
        encoder: &Encoder,
        block: usize,
        vehicle: usize,
        (first, worlds): (usize, usize),
    ) {
        let mut inputs = [[0; LANES]; INPUTS];
        let senses = environment.senses(block, vehicle);
        environment.vectors().run(
            #[inline(always)]
            || encoder.encode(&encoder.view(&senses), &mut inputs),
        );
        let ages = environment.ages().row(block, vehicle);
        let receptions = environment.receptions().row(block, vehicle);
        for world in 0..worlds {
            let index = first + world * environment.vehicles();
            let (observation, _) = self.observations[index * INPUTS..].as_chunks_mut::<INPUTS>();
            observation[0] = std::array::from_fn(|input| inputs[input][world] as i8);
            self.ages[index] = ages[world];
            self.received[index] = receptions[world] > 0;
        }
    }

    fn fill_rewards(&mut self, first: usize, present: &[usize], reward: Reward) {
        let of_age = |age: f32| -age / f32::from(Age::MAX.slots());
        let age = |vehicle: &usize| f32::from(self.ages[first + vehicle]);
        let mean = present.iter().map(age).sum::<f32>() / present.len().max(1) as f32;
        for vehicle in present {
            self.rewards[first + vehicle] = match reward {
                Reward::Own => of_age(age(vehicle)),
                Reward::Team => of_age(mean),
            };
        }
    }
}
