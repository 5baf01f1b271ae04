//! Other cells' interference: bursts that raise the noise on each sub-channel.

use crate::lanes::{LANES, LaneStream, Rows, unit_interval};
use crate::scenario::NeighbourScenario;
use crate::stream::{Role, WorldKey};

/// Bursts in a batch of worlds: on every sub-channel a chain of two states, Gilbert 1960.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// Their power over noise while they interfere.
    power: f32,
    /// Probabilities that a burst begins, and ends, in a slot.
    begins: f32,
    ends: f32,
    /// Share of slots with a burst.
    duty: f32,
    sub_channels: usize,
    /// By block of worlds.
    streams: Vec<LaneStream>,
    /// Their power over noise in the slot. `[sub_channel][world]`.
    interference: Rows<f32>,
}

impl Neighbours {
    /// The scenario's; `None` without interference. Before the first slot each sub-channel is as likely hit as ever.
    pub fn new(scenario: &NeighbourScenario, sub_channels: usize, keys: &[WorldKey]) -> Option<Self> {
        if scenario.noise_rise_db <= 0.0 || scenario.duty <= 0.0 {
            return None;
        }
        let ends = 1.0 / scenario.burst_slots;
        let (begins, ends) = if scenario.duty < 1.0 {
            // In the mean as many bursts begin as end.
            (ends * scenario.duty / (1.0 - scenario.duty), ends)
        } else {
            (1.0, 0.0)
        };
        let mut neighbours = Self {
            power: (libm::exp10(scenario.noise_rise_db / 10.0) - 1.0) as f32,
            begins: begins as f32,
            ends: ends as f32,
            duty: scenario.duty as f32,
            sub_channels,
            streams: LaneStream::rows(keys, Role::Neighbours, 0),
            interference: Rows::new(keys.len(), sub_channels, 0.0),
        };
        neighbours.change(neighbours.duty, 1.0 - neighbours.duty);
        Some(neighbours)
    }

    /// [`Neighbours::new`] for as many other worlds, in the same memory.
    pub fn reset(&mut self, keys: &[WorldKey]) {
        LaneStream::reset_rows(&mut self.streams, keys);
        self.interference.fill_all(0.0);
        self.change(self.duty, 1.0 - self.duty);
    }

    /// Lets bursts begin and end.
    pub fn begin_slot(&mut self) {
        self.change(self.begins, self.ends);
    }

    /// Lets bursts begin and end with these probabilities.
    fn change(&mut self, begins: f32, ends: f32) {
        for (block, stream) in self.streams.iter_mut().enumerate() {
            for sub_channel in 0..self.sub_channels {
                let words = *stream.next_row();
                let row = self.interference.row_mut(block, sub_channel);
                for lane in 0..LANES {
                    let drawn = unit_interval(words[lane]);
                    let on = if row[lane] > 0.0 {
                        drawn >= ends
                    } else {
                        drawn < begins
                    };
                    row[lane] = if on { self.power } else { 0.0 };
                }
            }
        }
    }

    /// Their power over noise in the slot. `[sub_channel][world]`.
    pub fn interference(&self) -> &Rows<f32> {
        &self.interference
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Purpose;

    #[test]
    fn bursts_fill_their_share_and_last_as_told() {
        let scenario = NeighbourScenario {
            noise_rise_db: 10.0,
            duty: 0.3,
            burst_slots: 10.0,
        };
        let keys: Vec<WorldKey> = (0..8)
            .map(|world| WorldKey {
                seed: 1,
                purpose: Purpose::Evaluation,
                world,
            })
            .collect();
        let mut neighbours = Neighbours::new(&scenario, 3, &keys).unwrap();
        let (mut busy, mut begun, slots) = (0, 0, 20_000);
        for _ in 0..slots {
            let before = neighbours.interference().clone();
            neighbours.begin_slot();
            for world in 0..8 {
                for sub_channel in 0..3 {
                    let now = neighbours.interference().get(world, sub_channel);
                    assert!(now == 0.0 || (now - 9.0).abs() < 1e-5);
                    busy += u32::from(now > 0.0);
                    begun += u32::from(now > 0.0 && before.get(world, sub_channel) == 0.0);
                }
            }
        }
        let share = f64::from(busy) / f64::from(24 * slots);
        let length = f64::from(busy) / f64::from(begun);
        assert!(
            (share - 0.3).abs() < 0.01 && (length - 10.0).abs() < 0.4,
            "{share} {length}"
        );
        let none = NeighbourScenario {
            noise_rise_db: 0.0,
            ..scenario
        };
        assert!(Neighbours::new(&none, 3, &keys).is_none());
    }
}
