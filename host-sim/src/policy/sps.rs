//! Sensing-based semi-persistent scheduling, by which vehicles share sub-channels without a base station: LTE's sidelink mode 4
//! (3GPP TS 36.213 14.1.1.6, TS 36.321 5.14.1.1), as far as one cell allows.
//!
//! * A resource is a slot of a period and a sub-channel. The period follows the number of vehicles, as congestion control has it;
//!   another one is taken up when a count of reservations is used up.
//! * What a vehicle senses is the power on each sub-channel in the slot before as units measure it here, which is what the base
//!   station receives and reports. It is the same for all who listen: no vehicle is hidden from another, which flatters the scheme.
//! * A vehicle is half-duplex. In a slot in which it sends it senses nothing, on no sub-channel, and so neither its own resource nor
//!   who collides with it there. What it has not sensed it does not choose. No acknowledgement tells it more: broadcasts on the
//!   sidelink have none.
//! * The sensing window is one period (chosen: with five or ten, nearer to the specification's second, ages are 1 to 3 % larger, since a
//!   resource that was left stays loud).
//! * The specification first excludes what it has read to be reserved and receives above a level, which it raises by 3 dB until a
//!   fifth of all resources remains, and then takes the fifth with the least power. Where a reservation is known by its power alone,
//!   the second step contains the first.

use super::{Decider, Kind, Needs, Policy};
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, Row, Rows, ratio};
use crate::senses::{Broadcasts, Senses};
use crate::stream::Stream;
use firmware::units::Dbm;
use std::ops::Range;

/// Everybody reserves a resource that it senses to be quiet, for a number of periods.
pub static KIND: Kind = Kind {
    name: "sps",
    meaning: "Sensing-based semi-persistent scheduling: everybody reserves a resource that it senses to be quiet, for a while.",
    stream: 10,
    needs: Needs::Nothing,
    build: |setup, _| {
        let (scenario, worlds) = (setup.scenario, setup.worlds());
        let sub_channels = scenario.radio.sub_channels as usize;
        let load = scenario.baselines.sps_period_load;
        let ring = period(setup.most_vehicles, sub_channels, load) as usize;
        Decider::Policy(Box::new(SemiPersistent {
            max_power: scenario.radio.max_power(),
            load,
            keep_probability: scenario.baselines.sps_keep_probability,
            reservations: Rows::new(worlds, setup.vehicles, Reservation::default()),
            history: History {
                sub_channels,
                ring,
                sensed: Rows::new(worlds, ring * sub_channels, 1.0),
            },
            periods: [1; LANES],
            heard: [false; LANES],
            candidates: Vec::with_capacity(ring * sub_channels),
            streams: setup.streams(KIND.stream).collect(),
        }))
    },
};

/// Reservations that a vehicle makes at a time: what TS 36.321 has for periods from 100 ms on (chosen). For shorter ones it has more, 25
/// to 75 from 20 ms down, so that resources are kept as long. Here, where a period is 10 ms, two vehicles on one resource are
/// then unheard for seconds: 16 ms in 2 s after 0.5 s instead of 7, though 5.9 after 15 s instead of 6.6.
const RESERVATIONS: Range<u32> = 5..16;

struct SemiPersistent {
    max_power: Dbm,
    /// Periods over vehicles per sub-channel.
    load: f64,
    keep_probability: f64,
    /// `[vehicle][world]`.
    reservations: Rows<Reservation>,
    history: History,
    /// Of new reservations, in slots; of the row in work.
    periods: Row<u32>,
    /// Whether the slot before is in the history; of the row in work.
    heard: Row<bool>,
    /// Of the vehicle in work.
    candidates: Vec<Candidate>,
    /// By world.
    streams: Vec<Stream>,
}

/// A vehicle's resource.
#[derive(Clone, Copy, Debug, Default)]
struct Reservation {
    /// Slots between two transmissions; 0 before it has a resource.
    period: u32,
    /// The next transmission; without a resource, when it chooses one; 0 before it has begun to listen.
    next: u32,
    /// The last transmission.
    last: u32,
    sub_channel: u8,
    /// Transmissions until it keeps or leaves the resource.
    left: u32,
    /// The first slot that it has sensed since it has this resource, or since it listens.
    since: u32,
}

impl Reservation {
    /// Whether the vehicle has sent in a slot before its last transmission, or in that, since it has this resource.
    fn has_sent_in(&self, slot: u32) -> bool {
        self.period > 0 && self.last.abs_diff(slot).is_multiple_of(self.period)
    }
}

/// A resource that may be chosen.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    slot: u32,
    sub_channel: usize,
    /// Noise and power over noise that was sensed on it.
    power: f32,
}

/// What was sensed in the last slots. All vehicles that do not send sense the same, so it is kept once for a world.
struct History {
    sub_channels: usize,
    /// Slots.
    ring: usize,
    /// Noise and vehicles over noise. `[slot modulo the ring][sub_channel][world]`.
    sensed: Rows<f32>,
}

/// Slots between two transmissions, so that the load is one vehicle for this many resources.
fn period(vehicles: usize, sub_channels: usize, load: f64) -> u32 {
    (vehicles as f64 / sub_channels as f64 * load).round().max(1.0) as u32
}

impl Policy for SemiPersistent {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        for lane in 0..broadcasts.worlds() {
            self.periods[lane] = period(broadcasts.vehicles(lane), self.history.sub_channels, self.load);
        }
        self.heard = [false; LANES];
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let (now, block) = (senses.slot().0, senses.block());
        self.sense(senses);
        for lane in 0..senses.worlds() {
            if !senses.is_present(lane) {
                continue;
            }
            let (world, vehicle) = (block * LANES + lane, senses.vehicle());
            let mut reservation = self.reservations.get(world, vehicle);
            if senses.is_new(lane) || reservation.next == 0 {
                reservation = Reservation {
                    // It listens for a period before it chooses (chosen: it is the window).
                    next: now + self.periods[lane],
                    since: now,
                    ..Reservation::default()
                };
            } else if reservation.next == now && reservation.period == 0 {
                self.choose(&mut reservation, world, now, self.periods[lane]);
            }
            if reservation.next == now {
                decisions.sub_channel[lane] = reservation.sub_channel;
                decisions.power[lane] = self.max_power.to_bits();
                reservation.last = now;
                reservation.next = now + reservation.period;
                reservation.left -= 1;
                if reservation.left == 0 {
                    self.renew(&mut reservation, world, now + 1, self.periods[lane]);
                }
            }
            self.reservations.set(world, vehicle, reservation);
        }
    }
}

impl SemiPersistent {
    /// Takes in the slot before: what a vehicle senses that did not send in it.
    fn sense(&mut self, senses: &Senses<'_>) {
        let (now, block) = (senses.slot().0, senses.block());
        let last = self.reservations.row(block, senses.vehicle());
        let mut listened = [false; LANES];
        for lane in 0..senses.worlds() {
            let there = senses.is_present(lane) && !senses.is_new(lane);
            listened[lane] = there && !self.heard[lane] && last[lane].last + 1 != now;
        }
        if !listened.contains(&true) {
            return;
        }
        for sub_channel in 0..self.history.sub_channels {
            let levels = senses.interference(sub_channel);
            let item = self.history.item(now - 1, sub_channel);
            let sensed = self.history.sensed.row_mut(block, item);
            for lane in 0..LANES {
                if listened[lane] {
                    sensed[lane] = ratio(levels[lane] as f32 / 256.0);
                }
            }
        }
        for lane in 0..LANES {
            self.heard[lane] |= listened[lane];
        }
    }

    /// Keeps the resource, or leaves it for another one from slot `first` on; in any case if the period is another one by now.
    fn renew(&mut self, reservation: &mut Reservation, world: usize, first: u32, period: u32) {
        let stream = &mut self.streams[world];
        if stream.chance(self.keep_probability) && reservation.period == period {
            reservation.left = reservations(stream);
        } else {
            self.choose(reservation, world, first, period);
        }
    }

    /// Chooses a resource in the period from slot `first` on.
    fn choose(&mut self, reservation: &mut Reservation, world: usize, first: u32, period: u32) {
        let (history, candidates) = (&self.history, &mut self.candidates);
        candidates.clear();
        for slot in first..first + period {
            for sub_channel in 0..history.sub_channels {
                candidates.extend(history.candidate(reservation, world, slot, sub_channel, period));
            }
        }
        let stream = &mut self.streams[world];
        reservation.left = reservations(stream);
        // A fifth of all resources, whether they are candidates or not.
        let fifth = (period as usize * history.sub_channels).div_ceil(5);
        let count = fifth.min(candidates.len());
        if count == 0 {
            // With one slot a period there is no other one that it could have sensed.
            return;
        }
        candidates.sort_unstable_by(|a, b| {
            a.power
                .total_cmp(&b.power)
                .then((a.slot, a.sub_channel).cmp(&(b.slot, b.sub_channel)))
        });
        // Of equally quiet resources, as all unused ones are, chance decides which belong to the fifth.
        let power = candidates[stream.below(count as u32) as usize].power;
        let equal = candidates.partition_point(|resource| resource.power < power)
            ..candidates.partition_point(|resource| resource.power <= power);
        let chosen = candidates[equal.start + stream.below(equal.len() as u32) as usize];
        *reservation = Reservation {
            period,
            next: chosen.slot,
            sub_channel: chosen.sub_channel as u8,
            since: first,
            ..*reservation
        };
    }
}

/// How many reservations a vehicle makes.
fn reservations(stream: &mut Stream) -> u32 {
    RESERVATIONS.start + stream.below(RESERVATIONS.end - RESERVATIONS.start)
}

impl History {
    fn item(&self, slot: u32, sub_channel: usize) -> usize {
        slot as usize % self.ring * self.sub_channels + sub_channel
    }

    /// A resource as a vehicle with this reservation has sensed it a period before; `None` where it has not.
    fn candidate(
        &self,
        reservation: &Reservation,
        world: usize,
        slot: u32,
        sub_channel: usize,
        period: u32,
    ) -> Option<Candidate> {
        let before = slot - period;
        let sent = reservation.has_sent_in(before);
        (before >= reservation.since && !sent).then(|| Candidate {
            slot,
            sub_channel,
            power: self.sensed.get(world, self.item(before, sub_channel)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Purpose, Role, WorldKey};

    /// Slot and sub-channel of what a vehicle chooses at slot 1001 of 10 resources, of which it holds one of period 5; how often in a
    /// thousand. `sensed` is the power over noise by slot from 997 on, `[slot][sub_channel]`.
    fn chosen(sensed: [[f32; 2]; 4], since: u32) -> Vec<((u32, u8), u32)> {
        let key = WorldKey {
            seed: 1,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let mut policy = SemiPersistent {
            max_power: Dbm::from_bits(30 << 8),
            load: 1.0,
            keep_probability: 0.0,
            reservations: Rows::new(1, 1, Reservation::default()),
            history: History {
                sub_channels: 2,
                ring: 5,
                // What was quiet while the vehicle itself sent, it does not know.
                sensed: Rows::new(1, 10, 0.0),
            },
            periods: [5; LANES],
            heard: [false; LANES],
            candidates: Vec::new(),
            streams: vec![key.stream(Role::Policy, KIND.stream)],
        };
        for (slot, powers) in (997..).zip(sensed) {
            for (sub_channel, power) in powers.into_iter().enumerate() {
                let item = policy.history.item(slot, sub_channel);
                policy.history.sensed.set(0, item, power);
            }
        }
        // Its own slots are 1001, 996, ...: it renews after it has sent.
        let own = Reservation {
            period: 5,
            next: 1006,
            last: 1001,
            sub_channel: 1,
            left: 0,
            since,
        };
        let mut counts = std::collections::BTreeMap::new();
        for _ in 0..1000 {
            let mut reservation = own;
            policy.renew(&mut reservation, 0, 1002, 5);
            assert!(RESERVATIONS.contains(&reservation.left) && reservation.period == 5);
            assert_eq!(reservation.last, 1001);
            *counts
                .entry((reservation.next, reservation.sub_channel))
                .or_insert(0) += 1;
        }
        counts.into_iter().collect()
    }

    #[test]
    fn a_vehicle_chooses_among_the_quietest_fifth_that_it_has_sensed() {
        let half = |count: u32| (430..570).contains(&count);
        // Two of ten: those of 2 and 3, whose slots come again a period later. Its own slot, 1006, would be quieter still.
        let found = chosen([[9.0, 8.0], [7.0, 2.0], [6.0, 5.0], [3.0, 4.0]], 900);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].0, found[1].0), ((1003, 1), (1005, 0)));
        assert!(half(found[0].1) && half(found[1].1), "{found:?}");
        // One is quietest; which of the three next is the second of the fifth is chance.
        let found = chosen([[9.0, 3.0], [3.0, 8.0], [1.0, 5.0], [7.0, 3.0]], 900);
        let places: Vec<(u32, u8)> = found.iter().map(|&(place, _)| place).collect();
        assert_eq!(places, [(1002, 1), (1003, 0), (1004, 0), (1005, 1)]);
        assert!(half(found[2].1), "{found:?}");
        assert!(
            [0, 1, 3]
                .iter()
                .all(|&other| (110..230).contains(&found[other].1))
        );
        // What was before it had its resource, it has not sensed.
        let found = chosen([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0], [7.0, 6.0]], 1000);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].0, found[1].0), ((1005, 0), (1005, 1)));
        // If it has sensed nothing, it stays.
        assert_eq!(chosen([[1.0; 2]; 4], 1001), [((1006, 1), 1000)]);
    }

    #[test]
    fn the_period_follows_the_load() {
        assert_eq!(period(20, 3, 1.5), 10);
        assert_eq!(period(40, 3, 1.5), 20);
        assert_eq!(period(1, 200, 0.1), 1);
        assert_eq!(period(0, 3, 1.5), 1);
    }
}
