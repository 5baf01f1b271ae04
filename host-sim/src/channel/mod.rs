//! The uplink channel of every vehicle: path loss and shadowing that change with the places, fast fading that is new in
//! every slot and on every sub-channel, or follows the vehicles' speed.

mod fading;
mod path_loss;
mod shadowing;

use fading::Fading;
pub use path_loss::PathLoss;
pub use shadowing::Shadowing;

use crate::lanes::{FEW, LANES, LaneStream, Row, Rows, Vectors, decibels, log2, unit_interval};
use crate::mobility::Place;
use crate::scenario::Scenario;
use crate::stream::{Role, Stream, WorldKey};
use std::ops::Range;

/// Gains of all vehicles that ever appear, in a batch of worlds.
///
/// A gain is the level in dB over noise at which the base station receives the vehicle at full power (paper eq. 1, with
/// the link budget of Table I included).
#[derive(Clone)]
pub struct Channel<'s> {
    scenario: &'s Scenario,
    path_loss: PathLoss,
    budget_db: f64,
    sub_channels: usize,
    vehicles: usize,
    /// `[world][vehicle]`.
    shadowing: Vec<Option<Shadowing>>,
    /// `[vehicle][world]`.
    large_scale_db: Rows<f32>,
    /// `[vehicle][sub_channel][world]`.
    gain_db: Rows<f32>,
    /// By world.
    shadowing_streams: Vec<Stream>,
    /// By block of worlds.
    fading_streams: Vec<LaneStream>,
    /// Fading that is not new in every slot and on every sub-channel.
    fading: Option<Fading>,
}

impl<'s> Channel<'s> {
    /// A channel for `vehicles` vehicles, of which none is present yet.
    pub fn new(scenario: &'s Scenario, vehicles: usize, keys: &[WorldKey]) -> Self {
        let sub_channels = scenario.radio.sub_channels as usize;
        Self {
            scenario,
            path_loss: PathLoss::new(scenario),
            budget_db: scenario.radio.budget_db(),
            sub_channels,
            vehicles,
            shadowing: vec![None; vehicles * keys.len()],
            large_scale_db: Rows::new(keys.len(), vehicles, 0.0),
            gain_db: Rows::new(keys.len(), vehicles * sub_channels, 0.0),
            shadowing_streams: keys.iter().map(|key| key.stream(Role::Shadowing, 0)).collect(),
            fading_streams: LaneStream::rows(keys, Role::FastFading, 0),
            fading: Fading::new(scenario, vehicles, keys),
        }
    }

    /// [`Channel::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self, keys: &[WorldKey]) {
        self.shadowing.fill(None);
        self.large_scale_db.fill_all(0.0);
        self.gain_db.fill_all(0.0);
        for (stream, key) in self.shadowing_streams.iter_mut().zip(keys) {
            *stream = key.stream(Role::Shadowing, 0);
        }
        LaneStream::reset_rows(&mut self.fading_streams, keys);
        if let Some(fading) = &mut self.fading {
            fading.reset(keys);
        }
    }

    /// Takes one world's new places: path loss anew, shadowing on by the way driven.
    pub fn move_to(&mut self, world: usize, places: &[(usize, Place)]) {
        let radio = &self.scenario.radio;
        let (stream, first) = (&mut self.shadowing_streams[world], world * self.vehicles);
        for &(vehicle, place) in places {
            let normal = stream.normal();
            let shadowing = match self.shadowing[first + vehicle] {
                None => Shadowing::new(radio, normal),
                Some(shadowing) => shadowing.moved(radio, place.moved_m, normal),
            };
            self.shadowing[first + vehicle] = Some(shadowing);
            let loss = self.path_loss.db(place.x_m, place.y_m) + shadowing.db();
            self.large_scale_db
                .set(world, vehicle, (self.budget_db - loss) as f32);
            if let Some(fading) = &mut self.fading {
                fading.set_speed(world, vehicle, place.speed_m_per_s);
            }
        }
    }

    /// Another vehicle takes a vehicle's index in one world: nothing of its shadowing and fading stays.
    pub fn replace(&mut self, world: usize, vehicle: usize, place: Place) {
        self.shadowing[world * self.vehicles + vehicle] = None;
        if let Some(fading) = &mut self.fading {
            fading.replace(world, vehicle);
        }
        self.move_to(world, &[(vehicle, place)]);
    }

    /// Draws the slot's fast fading: Rayleigh, so the power is exponential with mean 1.
    pub fn fade(&mut self, vectors: Vectors, present: &[usize]) {
        let (gain_db, large_scale_db) = (&mut self.gain_db, &self.large_scale_db);
        let sub_channels = self.sub_channels;
        if let Some(fading) = &mut self.fading {
            fading.fade(vectors, present, large_scale_db, sub_channels, gain_db);
            return;
        }
        let few = self.shadowing_streams.len() <= FEW;
        for (block, stream) in self.fading_streams.iter_mut().enumerate() {
            vectors.run(
                #[inline(always)]
                || {
                    for &vehicle in present {
                        let mean_db = large_scale_db.row(block, vehicle);
                        let items = vehicle * sub_channels..(vehicle + 1) * sub_channels;
                        if few {
                            rayleigh::<FEW>(stream, mean_db, gain_db, block, items);
                        } else {
                            rayleigh::<LANES>(stream, mean_db, gain_db, block, items);
                        }
                    }
                },
            );
        }
    }

    /// Gain without fast fading in dB, `[vehicle][world]`.
    pub fn large_scale_db(&self) -> &Rows<f32> {
        &self.large_scale_db
    }

    /// Largest Doppler shift of each vehicle in Hz, `[vehicle][world]`; `None` where fading is new in every slot.
    pub fn doppler_hz(&self) -> Option<&Rows<f32>> {
        self.fading.as_ref().and_then(Fading::doppler_hz)
    }

    /// Gain of the slot on every sub-channel in dB, `[vehicle][sub_channel][world]`.
    pub fn gain_db(&self) -> &Rows<f32> {
        &self.gain_db
    }
}

/// 10 log10(1 / ln 2): by how much the power of Rayleigh fading is greater in octaves, minus the logarithm to base 2 of a number
/// within 0 and 1, than it is with the mean 1.
const OCTAVES_ABOVE_DB: f32 = 1.591_745_4;

/// A vehicle's gains under Rayleigh fading around a mean, in the first `N` worlds of a block.
///
/// Each logarithm is a chain of steps that wait for the one before, and a processor looks only some hundred ahead: two short loops
/// over all sub-channels are quicker than a long one.
#[inline(always)]
fn rayleigh<const N: usize>(
    stream: &mut LaneStream,
    mean_db: &Row<f32>,
    gain_db: &mut Rows<f32>,
    block: usize,
    items: Range<usize>,
) {
    for item in items.clone() {
        let words = stream.next_row();
        let power = gain_db.row_mut(block, item);
        for lane in 0..N {
            power[lane] = -log2(unit_interval(words[lane]));
        }
    }
    for item in items {
        let gain_db = gain_db.row_mut(block, item);
        for lane in 0..N {
            gain_db[lane] = mean_db[lane] + (decibels(gain_db[lane]) - OCTAVES_ABOVE_DB);
        }
    }
}
