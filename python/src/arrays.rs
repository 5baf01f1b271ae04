//! What an environment shows to Python in a slot, `[world][vehicle]`, and how it is filled.

use crate::shared_array::SharedArray;
use firmware::observation::{INPUTS, ONE, Observation};
use firmware::units::{Age, Level, SUB_CHANNELS};
use host_sim::environment::Environment;
use pyo3::prelude::*;

/// What a vehicle is rewarded for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Reward {
    /// Its own age.
    Own,
    /// The mean age of its world's vehicles.
    Team,
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
    pub home_sub_channels: SharedArray<u8>,
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

    /// The arrays in parts of so many worlds.
    pub fn parts(&mut self, worlds: usize) -> Vec<Part<'_>> {
        let each = worlds * self.vehicles;
        let (inputs, sub_channels) = (each * INPUTS, each * SUB_CHANNELS);
        let mut observations = self.observations.values_mut().chunks_mut(inputs);
        let mut ages = self.ages.values_mut().chunks_mut(each);
        let mut received = self.received.values_mut().chunks_mut(each);
        let mut rewards = self.rewards.values_mut().chunks_mut(each);
        let mut gains_db = self.gains_db.values_mut().chunks_mut(sub_channels);
        let mut interference_db = self.interference_db.values_mut().chunks_mut(sub_channels);
        let mut home_sub_channels = self.home_sub_channels.values_mut().chunks_mut(each);
        let mut periods = self.periods.values_mut().chunks_mut(each);
        let mut joiner_probabilities = self.joiner_probabilities.values_mut().chunks_mut(each);
        let mut part = || {
            Some(Part {
                observations: observations.next()?,
                ages: ages.next()?,
                received: received.next()?,
                rewards: rewards.next()?,
                gains_db: gains_db.next()?,
                interference_db: interference_db.next()?,
                home_sub_channels: home_sub_channels.next()?,
                periods: periods.next()?,
                joiner_probabilities: joiner_probabilities.next()?,
            })
        };
        std::iter::from_fn(&mut part).collect()
    }

    /// Says who is present.
    pub fn mark_present(&mut self, present: &[usize]) {
        let marks = self.present.values_mut();
        marks.fill(false);
        present.iter().for_each(|&vehicle| marks[vehicle] = true);
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
    gains_db: &'a mut [f32],
    interference_db: &'a mut [f32],
    home_sub_channels: &'a mut [u8],
    periods: &'a mut [u8],
    joiner_probabilities: &'a mut [f32],
}

impl Part<'_> {
    /// Takes in a slot's beginning; `seen` keeps every vehicle's observation for its decision, `None` for an absent one and
    /// for one whose group the base station cannot serve.
    pub fn fill(
        &mut self,
        environment: &Environment<'_>,
        required_sinr: Level,
        reward: Reward,
        seen: &mut [Option<Observation>],
    ) {
        let vehicles = environment.vehicles();
        if environment.present().len() < vehicles {
            self.clear();
            seen.fill(None);
        }
        for world in 0..environment.worlds() {
            for &vehicle in environment.present() {
                let index = world * vehicles + vehicle;
                self.ages[index] = environment.age(world, vehicle).slots();
                self.received[index] = environment.received(world, vehicle);
                for sub_channel in 0..SUB_CHANNELS {
                    let place = index * SUB_CHANNELS + sub_channel;
                    self.gains_db[place] = environment.gain_db(world, vehicle, sub_channel);
                    self.interference_db[place] = environment.interference_db(world, vehicle, sub_channel);
                }
                seen[index] = environment.measurement(world, vehicle).map(|measurement| {
                    let broadcast = measurement.broadcast();
                    self.home_sub_channels[index] = broadcast.home.index() as u8;
                    self.periods[index] = broadcast.period.slots();
                    let probability = f32::from(broadcast.joiner_probability.in_256ths()) / 256.0;
                    self.joiner_probabilities[index] = probability;
                    Observation::new(&measurement)
                });
                let encoded =
                    seen[index].map_or([0; INPUTS], |observation| observation.encode(required_sinr));
                self.observations[index * INPUTS..][..INPUTS].copy_from_slice(&encoded);
            }
            self.fill_rewards(world * vehicles, environment.present(), reward);
        }
    }

    fn fill_rewards(&mut self, first: usize, present: &[usize], reward: Reward) {
        let of_age = |age: f32| -age / f32::from(Age::MAX.slots());
        let age = |vehicle: &usize| f32::from(self.ages[first + vehicle]);
        match reward {
            Reward::Own => {
                for vehicle in present {
                    self.rewards[first + vehicle] = of_age(age(vehicle));
                }
            }
            Reward::Team => {
                let mean = present.iter().map(age).sum::<f32>() / present.len().max(1) as f32;
                for vehicle in present {
                    self.rewards[first + vehicle] = of_age(mean);
                }
            }
        }
    }

    fn clear(&mut self) {
        self.observations.fill(0);
        self.ages.fill(0);
        self.received.fill(false);
        self.rewards.fill(0.0);
        self.gains_db.fill(0.0);
        self.interference_db.fill(0.0);
        self.home_sub_channels.fill(0);
        self.periods.fill(0);
        self.joiner_probabilities.fill(0.0);
    }
}
