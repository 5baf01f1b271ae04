//! A place in a frame, handed out at association: time division with frequency hopping as 5G's configured grants have it (3GPP TS 38.321 5.8.2, type 1).

use super::{Decider, Kind, Needs, Policy, dbm};
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, LaneStream, Row, unit_interval};
use crate::senses::{Broadcasts, Senses};
use firmware::units::{Dbm, SUB_CHANNELS, SlotIndex};

/// Everybody sends in its own slot of its group's frame, whatever its gain and its age.
pub static KIND: Kind = Kind {
    name: "assigned",
    meaning: "A place in a frame, handed out at association: each vehicle has its own slot on its group's sub-channel.",
    stream: 7,
    needs: Needs::Groups,
    build: |setup, _| {
        let losses = setup.scenario.feedback.place_loss > 0.0;
        Decider::Policy(Box::new(Assigned {
            max_power: dbm(setup.scenario.radio.max_power_dbm),
            periods: [[0; LANES]; SUB_CHANNELS],
            streams: losses.then(|| setup.row_streams(KIND.stream)),
        }))
    },
};

struct Assigned {
    max_power: Dbm,
    /// Of the row in work. `[group][world]`.
    periods: [Row<u8>; SUB_CHANNELS],
    /// Of those who got no place, if there may be any; by row of worlds.
    streams: Option<Vec<LaneStream>>,
}

impl Policy for Assigned {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        for (group, periods) in self.periods.iter_mut().enumerate() {
            *periods = *broadcasts.periods(group);
        }
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let words = self
            .streams
            .as_mut()
            .map(|streams| *streams[senses.block()].next_row());
        let (homes, ages) = (senses.homes(), senses.ages());
        let shift = hop(senses.slot(), senses.sub_channels());
        for lane in 0..senses.worlds() {
            let period = self.periods.get(usize::from(homes[lane])).map(|row| row[lane]);
            let Some(period) = period.filter(|&period| period > 0) else {
                continue;
            };
            let sends = match (senses.position(lane), &words) {
                (Some(position), _) => senses.slot().0 % u32::from(period) == u32::from(position),
                // Without a place it contends once it is older than a frame, once a frame in the mean (chosen).
                (None, Some(words)) => {
                    ages[lane] > period && unit_interval(words[lane]) * f32::from(period) < 1.0
                }
                (None, None) => false,
            };
            if sends {
                let sub_channel = (usize::from(homes[lane]) + shift) % senses.sub_channels();
                decisions.sub_channel[lane] = sub_channel as u8;
                decisions.power[lane] = self.max_power.to_bits();
            }
        }
    }
}

/// By how many sub-channels all groups have hopped together in a slot, so that who stands in a fade does not stay there: a hash of the
/// slot (Fibonacci hashing, Knuth, The Art of Computer Programming 3, 6.4), since no frame is a multiple of that.
fn hop(slot: SlotIndex, sub_channels: usize) -> usize {
    (slot.0.wrapping_mul(0x9e37_79b1) >> 16) as usize % sub_channels
}
