//! Rayleigh fading as complex amplitudes: alike on neighbouring sub-channels, and as fast as vehicles move, or new in every slot.

use crate::lanes::{LANES, LaneStream, Row, Rows, Vectors, decibels, normals};
use crate::scenario::Scenario;
use crate::stream::{Role, Stream, WorldKey};
use std::f64::consts::TAU;

/// Plane waves that a moving vehicle's amplitude is the sum of (chosen: from about eight on the sum is as good as normal).
const WAVES: usize = 12;

/// Least power that fading leaves, -90 dB: a sum of sinusoids may be 0.
const LEAST_POWER: f32 = 1e-9;

const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;

const SLOTS_PER_SECOND: f64 = 1000.0;

/// Fading amplitudes of a batch of worlds.
#[derive(Clone)]
pub struct Fading {
    /// Correlation of the amplitudes on neighbouring sub-channels.
    correlation: f32,
    source: Source,
}

/// Where amplitudes come from.
#[derive(Clone)]
enum Source {
    /// Complex normal numbers, new in every slot; by block of worlds.
    Fresh(Vec<LaneStream>),
    /// Waves that turn as vehicles move.
    Waves(Box<Waves>),
}

/// Sums of sinusoids (Clarke 1968; Jakes 1974): each wave of a vehicle comes from another direction, whose cosine is the share of
/// the Doppler shift by which it turns.
#[derive(Clone)]
struct Waves {
    /// Largest Doppler shift of one m/s.
    hz_by_m_per_s: f64,
    /// Of a vehicle that stands.
    residual_hz: f64,
    vehicles: usize,
    sub_channels: usize,
    /// By world.
    streams: Vec<Stream>,
    /// Largest Doppler shift. `[vehicle][world]`.
    doppler_hz: Rows<f32>,
    /// Cosine of each wave's direction. `[vehicle][sub_channel][wave][world]`, as all that follow.
    direction: Rows<f32>,
    real: Rows<f32>,
    imaginary: Rows<f32>,
    /// By what a slot turns each wave.
    turn_real: Rows<f32>,
    turn_imaginary: Rows<f32>,
}

impl Fading {
    /// The scenario's; `None` where fading is new in every slot and on every sub-channel, which takes no amplitudes.
    pub fn new(scenario: &Scenario, vehicles: usize, keys: &[WorldKey]) -> Option<Self> {
        let fading = &scenario.fading;
        let source = if fading.follows_speed {
            Source::Waves(Box::new(Waves::new(scenario, vehicles, keys)))
        } else if fading.sub_channel_correlation > 0.0 {
            Source::Fresh(LaneStream::rows(keys, Role::Scattering, 0))
        } else {
            return None;
        };
        Some(Self {
            correlation: fading.sub_channel_correlation as f32,
            source,
        })
    }

    /// [`Fading::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self, keys: &[WorldKey]) {
        match &mut self.source {
            Source::Fresh(streams) => LaneStream::reset_rows(streams, keys),
            Source::Waves(waves) => waves.begin(keys),
        }
    }

    /// A vehicle of one world moves on at this speed.
    pub fn set_speed(&mut self, world: usize, vehicle: usize, speed_m_per_s: f64) {
        if let Source::Waves(waves) = &mut self.source {
            waves.set_speed(world, vehicle, speed_m_per_s);
        }
    }

    /// Largest Doppler shift of each vehicle in Hz, `[vehicle][world]`; `None` where fading is new in every slot.
    pub fn doppler_hz(&self) -> Option<&Rows<f32>> {
        match &self.source {
            Source::Fresh(_) => None,
            Source::Waves(waves) => Some(&waves.doppler_hz),
        }
    }

    /// Another vehicle takes a vehicle's index in one world.
    pub fn replace(&mut self, world: usize, vehicle: usize) {
        if let Source::Waves(waves) = &mut self.source {
            waves.draw(world, vehicle);
        }
    }

    /// The slot's gains of all present vehicles, from those without fast fading. `[vehicle][world]` to
    /// `[vehicle][sub_channel][world]`.
    pub fn fade(
        &mut self,
        vectors: Vectors,
        present: &[usize],
        large_scale_db: &Rows<f32>,
        sub_channels: usize,
        gain_db: &mut Rows<f32>,
    ) {
        let (alike, own) = (
            self.correlation,
            libm::sqrtf(1.0 - self.correlation * self.correlation),
        );
        for block in 0..large_scale_db.blocks() {
            vectors.run(
                #[inline(always)]
                || {
                    for &vehicle in present {
                        let mean_db = *large_scale_db.row(block, vehicle);
                        let (mut real, mut imaginary) = ([0.0; LANES], [0.0; LANES]);
                        for sub_channel in 0..sub_channels {
                            let item = vehicle * sub_channels + sub_channel;
                            let [new_real, new_imaginary] = self.source.next(block, item);
                            // The first sub-channel has no neighbour before it.
                            let (alike, own) = if sub_channel == 0 {
                                (0.0, 1.0)
                            } else {
                                (alike, own)
                            };
                            let mut row = [0.0; LANES];
                            for lane in 0..LANES {
                                real[lane] = alike * real[lane] + own * new_real[lane];
                                imaginary[lane] = alike * imaginary[lane] + own * new_imaginary[lane];
                                let power = real[lane] * real[lane] + imaginary[lane] * imaginary[lane];
                                row[lane] = mean_db[lane] + decibels(power.max(LEAST_POWER));
                            }
                            *gain_db.row_mut(block, item) = row;
                        }
                    }
                },
            );
        }
    }
}

impl Source {
    /// The next amplitude of a vehicle on a sub-channel, of mean power 1: real and imaginary part.
    #[inline(always)]
    fn next(&mut self, block: usize, item: usize) -> [Row<f32>; 2] {
        match self {
            Self::Fresh(streams) => {
                let stream = &mut streams[block];
                let (first, second) = (*stream.next_row(), *stream.next_row());
                let [mut real, mut imaginary] = normals(&first, &second);
                for lane in 0..LANES {
                    real[lane] *= std::f32::consts::FRAC_1_SQRT_2;
                    imaginary[lane] *= std::f32::consts::FRAC_1_SQRT_2;
                }
                [real, imaginary]
            }
            Self::Waves(waves) => waves.next(block, item),
        }
    }
}

impl Waves {
    fn new(scenario: &Scenario, vehicles: usize, keys: &[WorldKey]) -> Self {
        let sub_channels = scenario.radio.sub_channels as usize;
        let rows = Rows::new(keys.len(), vehicles * sub_channels * WAVES, 0.0);
        let mut waves = Self {
            hz_by_m_per_s: scenario.radio.carrier_ghz * 1e9 / SPEED_OF_LIGHT_M_PER_S,
            residual_hz: scenario.fading.residual_doppler_hz,
            vehicles,
            sub_channels,
            streams: Vec::with_capacity(keys.len()),
            doppler_hz: Rows::new(keys.len(), vehicles, f32::NAN),
            direction: rows.clone(),
            real: rows.clone(),
            imaginary: rows.clone(),
            turn_real: rows.clone(),
            turn_imaginary: rows,
        };
        waves.begin(keys);
        waves
    }

    /// Draws all vehicles' waves.
    fn begin(&mut self, keys: &[WorldKey]) {
        self.streams.clear();
        self.streams
            .extend(keys.iter().map(|key| key.stream(Role::Scattering, 0)));
        for world in 0..keys.len() {
            for vehicle in 0..self.vehicles {
                self.draw(world, vehicle);
            }
        }
    }

    /// The waves of a vehicle on a sub-channel.
    fn items(&self, vehicle: usize) -> std::ops::Range<usize> {
        let waves = self.sub_channels * WAVES;
        vehicle * waves..(vehicle + 1) * waves
    }

    /// Draws directions and phases anew. Each direction comes from its own sector.
    fn draw(&mut self, world: usize, vehicle: usize) {
        for item in self.items(vehicle) {
            let stream = &mut self.streams[world];
            let angle = TAU * ((item % WAVES) as f64 + f64::from(stream.uniform())) / WAVES as f64;
            let phase = TAU * f64::from(stream.uniform());
            let amplitude = libm::sqrt(1.0 / WAVES as f64);
            self.direction.set(world, item, libm::cos(angle) as f32);
            self.real.set(world, item, (amplitude * libm::cos(phase)) as f32);
            self.imaginary
                .set(world, item, (amplitude * libm::sin(phase)) as f32);
        }
        self.doppler_hz.set(world, vehicle, f32::NAN);
    }

    fn set_speed(&mut self, world: usize, vehicle: usize, speed_m_per_s: f64) {
        let doppler_hz = (speed_m_per_s * self.hz_by_m_per_s).max(self.residual_hz) as f32;
        if self.doppler_hz.get(world, vehicle) == doppler_hz {
            return;
        }
        self.doppler_hz.set(world, vehicle, doppler_hz);
        for item in self.items(vehicle) {
            let direction = f64::from(self.direction.get(world, item));
            let angle = TAU * f64::from(doppler_hz) * direction / SLOTS_PER_SECOND;
            self.turn_real.set(world, item, libm::cos(angle) as f32);
            self.turn_imaginary.set(world, item, libm::sin(angle) as f32);
        }
    }

    /// The sum of the waves on a vehicle's sub-channel, which then turn on.
    #[inline(always)]
    fn next(&mut self, block: usize, item: usize) -> [Row<f32>; 2] {
        let (mut real_sum, mut imaginary_sum) = ([0.0; LANES], [0.0; LANES]);
        for wave in item * WAVES..(item + 1) * WAVES {
            let real = self.real.row_mut(block, wave);
            let imaginary = self.imaginary.row_mut(block, wave);
            let turn_real = self.turn_real.row(block, wave);
            let turn_imaginary = self.turn_imaginary.row(block, wave);
            for lane in 0..LANES {
                let (before_real, before_imaginary) = (real[lane], imaginary[lane]);
                real_sum[lane] += before_real;
                imaginary_sum[lane] += before_imaginary;
                real[lane] = before_real * turn_real[lane] - before_imaginary * turn_imaginary[lane];
                imaginary[lane] = before_real * turn_imaginary[lane] + before_imaginary * turn_real[lane];
            }
        }
        [real_sum, imaginary_sum]
    }
}
