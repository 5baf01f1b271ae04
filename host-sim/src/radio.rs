//! Who is received in a slot: interference, signal-to-interference-and-noise ratio, success (paper eqs. 2 and 3).

use crate::decisions::{Decisions, SILENT};
use crate::lanes::{FEW, LANES, LaneStream, Row, Rows, Vectors, decibels, ratio, unit_interval, widened};
use crate::neighbours::Neighbours;
use crate::scenario::Scenario;
use crate::stream::{Role, WorldKey};

/// What happened in a slot, in a batch of worlds.
#[derive(Clone, Debug)]
pub struct Radio {
    max_power_dbm: f32,
    required_sinr: f32,
    sub_channels: usize,
    /// Whether there are at most [`FEW`] worlds.
    few: bool,
    /// Received power of every vehicle over noise; 0 for a silent one. `[vehicle]`, of the block in work.
    power: Vec<Row<f32>>,
    /// Power of the other vehicles on its sub-channel over noise. `[vehicle]`, of the block in work.
    others: Vec<Row<f32>>,
    /// Power on every sub-channel over noise, of vehicles on one side of the one in work. `[sub_channel]`.
    sum: Vec<Row<f32>>,
    /// 1 for a vehicle that was received. `[vehicle][world]`.
    received: Rows<u8>,
    /// How many were received. One item.
    successes: Rows<u16>,
    /// Noise plus others' power over noise in dB. `[vehicle][sub_channel][world]`.
    interference_db: Rows<f32>,
    /// Other cells, if they interfere.
    neighbours: Option<Neighbours>,
    /// Reception by chance, if it is no step.
    block_errors: Option<BlockErrors>,
}

/// Reception near the required SINR: a logistic curve in dB.
#[derive(Clone, Debug)]
struct BlockErrors {
    required_db: f32,
    width_db: f32,
    /// By block of worlds.
    streams: Vec<LaneStream>,
}

impl Radio {
    /// Before the first slot: nobody was received, and nobody interfered.
    pub fn new(scenario: &Scenario, keys: &[WorldKey], vehicles: usize) -> Self {
        let (radio, worlds) = (&scenario.radio, keys.len());
        let sub_channels = radio.sub_channels as usize;
        Self {
            max_power_dbm: radio.max_power_dbm as f32,
            required_sinr: radio.required_sinr() as f32,
            sub_channels,
            few: worlds <= FEW,
            power: vec![[0.0; LANES]; vehicles],
            others: vec![[0.0; LANES]; vehicles],
            sum: vec![[0.0; LANES]; sub_channels],
            received: Rows::new(worlds, vehicles, 0),
            successes: Rows::new(worlds, 1, 0),
            interference_db: Rows::new(worlds, vehicles * sub_channels, 0.0),
            neighbours: Neighbours::new(&scenario.neighbours, sub_channels, keys),
            block_errors: BlockErrors::new(scenario, keys),
        }
    }

    /// [`Radio::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self, keys: &[WorldKey]) {
        self.received.fill_all(0);
        self.successes.fill_all(0);
        self.interference_db.fill_all(0.0);
        if let Some(neighbours) = &mut self.neighbours {
            neighbours.reset(keys);
        }
        if let Some(block_errors) = &mut self.block_errors {
            LaneStream::reset_rows(&mut block_errors.streams, keys);
        }
    }

    /// Whether each vehicle was received in the slot before: 1 or 0, `[vehicle][world]`.
    pub fn received(&self) -> &Rows<u8> {
        &self.received
    }

    /// How many vehicles were received in the slot before, in every world: one item.
    pub fn successes(&self) -> &Rows<u16> {
        &self.successes
    }

    /// Noise plus others' power over noise in the slot before in dB, `[vehicle][sub_channel][world]`: the base station reports it
    /// to every vehicle.
    pub fn interference_db(&self) -> &Rows<f32> {
        &self.interference_db
    }

    /// A vehicle that arrives in a world has heard nothing.
    pub fn arrive(&mut self, world: usize, vehicle: usize) {
        for sub_channel in 0..self.sub_channels {
            self.interference_db
                .set(world, vehicle * self.sub_channels + sub_channel, 0.0);
        }
    }

    /// A vehicle that left is not received.
    pub fn leave(&mut self, vehicle: usize) {
        self.received.fill(vehicle, 0);
    }

    /// Evaluates a slot's decisions. `gain_db` is the level over noise at full power, `[vehicle][sub_channel][world]`.
    ///
    /// A transmission is received if its ratio of signal to interference and noise reaches the required one, that is if
    /// its Shannon rate reaches C_min.
    pub fn evaluate(
        &mut self,
        vectors: Vectors,
        present: &[usize],
        decisions: &Decisions,
        gain_db: &Rows<f32>,
    ) {
        if let Some(neighbours) = &mut self.neighbours {
            neighbours.begin_slot();
        }
        for block in 0..gain_db.blocks() {
            vectors.run(
                #[inline(always)]
                || {
                    if self.few {
                        self.sum_powers::<FEW>(block, present, decisions, gain_db);
                        self.report::<FEW>(block, present, decisions);
                    } else {
                        self.sum_powers::<LANES>(block, present, decisions, gain_db);
                        self.report::<LANES>(block, present, decisions);
                    }
                },
            );
        }
    }

    /// Received powers, and for each transmission the sum of the others on its sub-channel. What comes before a vehicle and what
    /// comes after it are summed apart and nothing is subtracted: a strong transmission must not cancel a weak one away. Of the first
    /// `N` worlds of the block, as all that follow.
    #[inline(always)]
    fn sum_powers<const N: usize>(
        &mut self,
        block: usize,
        present: &[usize],
        decisions: &Decisions,
        gain_db: &Rows<f32>,
    ) {
        let sub_channels = self.sub_channels;
        for &vehicle in present {
            let (chosen, transmit_power) = decisions.rows(block, vehicle);
            let chosen = widened(chosen);
            let mut level_db = [0_u32; LANES];
            for sub_channel in 0..sub_channels {
                let gain_db = gain_db.row(block, vehicle * sub_channels + sub_channel);
                for lane in 0..N {
                    let here = mask(chosen[lane] == sub_channel as i32);
                    level_db[lane] |= here & gain_db[lane].to_bits();
                }
            }
            let mut power = [0.0; LANES];
            let transmit_power = *transmit_power;
            for lane in 0..N {
                let reduction_db = self.max_power_dbm - f32::from(transmit_power[lane]) / 256.0;
                let received = ratio(f32::from_bits(level_db[lane]) - reduction_db);
                let sends = mask(chosen[lane] != i32::from(SILENT));
                power[lane] = f32::from_bits(sends & received.to_bits());
            }
            self.power[vehicle] = power;
            self.others[vehicle] = [0.0; LANES];
        }
        self.sum.fill([0.0; LANES]);
        for &vehicle in present.iter().rev() {
            self.pass::<N>(block, vehicle, decisions);
        }
        self.sum.fill([0.0; LANES]);
        if let Some(neighbours) = &self.neighbours {
            // In one of the two sums, so that everybody has it once.
            for (sub_channel, sum) in self.sum.iter_mut().enumerate() {
                *sum = *neighbours.interference().row(block, sub_channel);
            }
        }
        for &vehicle in present {
            self.pass::<N>(block, vehicle, decisions);
        }
    }

    /// Adds to a vehicle what was summed so far on its sub-channel, then the vehicle to the sum.
    #[inline(always)]
    fn pass<const N: usize>(&mut self, block: usize, vehicle: usize, decisions: &Decisions) {
        let chosen = widened(decisions.rows(block, vehicle).0);
        let (power, mut others) = (self.power[vehicle], self.others[vehicle]);
        for (sub_channel, sum) in self.sum.iter_mut().enumerate() {
            let mut now = *sum;
            for lane in 0..N {
                let here = mask(chosen[lane] == sub_channel as i32);
                others[lane] += f32::from_bits(here & now[lane].to_bits());
                now[lane] += f32::from_bits(here & power[lane].to_bits());
            }
            *sum = now;
        }
        self.others[vehicle] = others;
    }

    /// Success, and the interference that is reported to every vehicle.
    #[inline(always)]
    fn report<const N: usize>(&mut self, block: usize, present: &[usize], decisions: &Decisions) {
        for total in &mut self.sum {
            for total in &mut total[..N] {
                *total = decibels(1.0 + *total);
            }
        }
        let successes = self.successes.row_mut(block, 0);
        *successes = [0; LANES];
        for &vehicle in present {
            let chosen = widened(decisions.rows(block, vehicle).0);
            let (power, others) = (self.power[vehicle], self.others[vehicle]);
            let (mut received, mut others_db) = ([0; LANES], [0.0; LANES]);
            for lane in 0..N {
                let heard = power[lane] >= self.required_sinr * (1.0 + others[lane]);
                received[lane] = u8::from(heard);
            }
            for lane in 0..N {
                others_db[lane] = decibels(1.0 + others[lane]);
            }
            if let Some(block_errors) = &mut self.block_errors {
                received = block_errors.draw(block, &power, &others_db);
            }
            for lane in 0..N {
                successes[lane] += u16::from(received[lane]);
            }
            *self.received.row_mut(block, vehicle) = received;
            for (sub_channel, total_db) in self.sum.iter().enumerate() {
                let mut row = [0.0; LANES];
                for lane in 0..N {
                    let here = mask(chosen[lane] == sub_channel as i32);
                    let bits = here & others_db[lane].to_bits() | !here & total_db[lane].to_bits();
                    row[lane] = f32::from_bits(bits);
                }
                let item = vehicle * self.sub_channels + sub_channel;
                *self.interference_db.row_mut(block, item) = row;
            }
        }
    }
}

impl BlockErrors {
    fn new(scenario: &Scenario, keys: &[WorldKey]) -> Option<Self> {
        let width_db = scenario.reception.block_error_width_db as f32;
        (width_db > 0.0).then(|| Self {
            required_db: decibels(scenario.radio.required_sinr() as f32),
            width_db,
            streams: LaneStream::rows(keys, Role::Reception, 0),
        })
    }

    /// Who is received: 1 or 0. `power` is over noise, 0 for the silent; `others_db` noise and others' power over noise.
    #[inline(always)]
    fn draw(&mut self, block: usize, power: &Row<f32>, others_db: &Row<f32>) -> Row<u8> {
        /// dB of a ratio of e.
        const NEPER_DB: f32 = 10.0 * std::f32::consts::LOG10_E;
        let words = *self.streams[block].next_row();
        let mut received = [0; LANES];
        for lane in 0..LANES {
            let sends = power[lane] > 0.0;
            let sinr_db = decibels(power[lane].max(f32::MIN_POSITIVE)) - others_db[lane];
            let widths = ((sinr_db - self.required_db) / self.width_db).clamp(-40.0, 40.0);
            let heard = unit_interval(words[lane]) * (1.0 + ratio(-NEPER_DB * widths)) < 1.0;
            received[lane] = u8::from(sends & heard);
        }
        received
    }
}

/// All bits, or none. Values are chosen by masks because the compiler would make branches or masked stores of conditions.
#[inline(always)]
fn mask(condition: bool) -> u32 {
    u32::from(condition).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;
    use firmware::units::Dbm;

    fn keys(worlds: u64) -> Vec<WorldKey> {
        let key = |world| WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world,
        };
        (0..worlds).map(key).collect()
    }

    /// Vehicle by vehicle whether it is received, and the interference that it then knows of, in the last world of some.
    fn slot(gains: &[[f32; 3]], sent: &[(usize, f64)]) -> (Vec<u8>, Vec<[f32; 3]>) {
        const WORLDS: usize = 2 * LANES + 7;
        let scenario = ScenarioSource::default().read().unwrap();
        let vehicles = gains.len();
        let mut radio = Radio::new(&scenario, &keys(WORLDS as u64), vehicles);
        let mut decisions = Decisions::new(WORLDS, vehicles);
        let mut gain_db = Rows::new(WORLDS, 3 * vehicles, 0.0);
        for (vehicle, &(sub_channel, power_dbm)) in sent.iter().enumerate() {
            let power = Dbm::from_bits((power_dbm * 256.0) as i16);
            decisions.transmit(WORLDS - 1, vehicle, sub_channel, power);
            for n in 0..3 {
                gain_db.set(WORLDS - 1, vehicle * 3 + n, gains[vehicle][n]);
            }
        }
        let present: Vec<usize> = (0..vehicles).collect();
        radio.evaluate(Vectors::widest(), &present, &decisions, &gain_db);
        assert!((0..vehicles).all(|vehicle| radio.received().get(0, vehicle) == 0));
        (
            present
                .iter()
                .map(|&vehicle| radio.received().get(WORLDS - 1, vehicle))
                .collect(),
            present
                .iter()
                .map(|&vehicle| {
                    std::array::from_fn(|n| radio.interference_db().get(WORLDS - 1, vehicle * 3 + n))
                })
                .collect(),
        )
    }

    fn received(gains: &[[f32; 3]], sent: &[(usize, f64)]) -> Vec<u8> {
        slot(gains, sent).0
    }

    #[test]
    fn sinr_by_hand() {
        // Alone: 8.45 dB is just enough (SINR 7), 8.44 dB is not.
        assert_eq!(received(&[[8.46, 0.0, 0.0]], &[(0, 30.0)]), [1]);
        assert_eq!(received(&[[8.44, 0.0, 0.0]], &[(0, 30.0)]), [0]);
        // 3 dB less power needs 3 dB more gain.
        assert_eq!(received(&[[11.4, 0.0, 0.0]], &[(0, 27.0)]), [0]);
        assert_eq!(received(&[[11.5, 0.0, 0.0]], &[(0, 27.0)]), [1]);
        // Two at 30 and 20 dB on one sub-channel: 1000 / (1 + 100) = 9.9, so the stronger is captured.
        let two = [(0, 30.0), (0, 30.0)];
        assert_eq!(received(&[[30.0, 0.0, 0.0], [20.0, 0.0, 0.0]], &two), [1, 0]);
        // At 30 and 22 dB: 1000 / 159.5 = 6.3, so neither.
        assert_eq!(received(&[[30.0, 0.0, 0.0], [22.0, 0.0, 0.0]], &two), [0, 0]);
        // On two sub-channels both.
        let apart = [(0, 30.0), (1, 30.0)];
        assert_eq!(received(&[[30.0, 0.0, 0.0], [0.0, 22.0, 0.0]], &apart), [1, 1]);
    }

    #[test]
    fn interference_is_what_the_others_send() {
        // At 60, 3 and 10 dB on one sub-channel: the strong one hears the weak ones, 2 + 10 + 1 = 13 = 11.14 dB, as nearly as
        // the logarithm is; and 20 dB on another, 101 = 20.04 dB.
        let gains = [
            [60.0, 0.0, 0.0],
            [3.0103, 0.0, 0.0],
            [10.0, 0.0, 0.0],
            [0.0, 20.0, 0.0],
        ];
        let sent = [(0, 30.0), (0, 30.0), (0, 30.0), (1, 30.0)];
        let (received, interference_db) = slot(&gains, &sent);
        assert_eq!(received, [1, 0, 0, 1]);
        let near = |found: f32, expected: f64| (f64::from(found) - expected).abs() < 2e-5;
        assert!(near(interference_db[0][0], 11.139_434), "{interference_db:?}");
        assert!(near(interference_db[0][1], 20.043_214), "{interference_db:?}");
        assert!(near(interference_db[1][0], 60.000_048), "{interference_db:?}");
        assert_eq!(interference_db[3][1], 0.0);
        assert!(near(interference_db[3][0], 60.000_056), "{interference_db:?}");
        assert_eq!(interference_db[0][2], 0.0);
    }
}
