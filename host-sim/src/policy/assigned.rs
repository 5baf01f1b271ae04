//! A place in a frame, handed out at association: time division with frequency hopping as 5G's configured grants have it (3GPP TS 38.321 5.8.2, type 1).

use super::{Decider, Kind, Needs, Policy, below};
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, LaneStream, unit_interval};
use crate::senses::{Broadcasts, Senses};
use firmware::ring::{Ring, carrier, hop};
use firmware::units::Dbm;

/// Everybody sends in its own place of a frame, whatever its gain and its age.
pub static KIND: Kind = Kind {
    name: "assigned",
    meaning: "A place in a frame, handed out at association: each vehicle sends when its place comes round.",
    stream: 7,
    needs: Needs::Ring,
    build: |setup, _| {
        let losses = setup.scenario.feedback.place_loss > 0.0;
        Decider::Policy(Box::new(Assigned {
            max_power: setup.scenario.radio.max_power(),
            frames: [None; LANES],
            streams: losses.then(|| setup.row_streams(KIND.stream)),
        }))
    },
};

struct Assigned {
    max_power: Dbm,
    /// Of the row in work, each with its first place in the slot.
    frames: [Option<(Ring, u16)>; LANES],
    /// Of those who got no place, if there may be any; by row of worlds.
    streams: Option<Vec<LaneStream>>,
}

impl Policy for Assigned {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        for lane in 0..broadcasts.worlds() {
            let frame = broadcasts.frame(lane);
            self.frames[lane] = frame.map(|frame| (frame, frame.first_place(broadcasts.slot())));
        }
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let words = self.streams.as_mut().map(|streams| {
            let stream = &mut streams[senses.block()];
            let sub_channels = below(stream.next_row(), senses.sub_channels() as u32);
            (sub_channels, *stream.next_row())
        });
        let ages = senses.ages();
        for lane in 0..senses.worlds() {
            let Some((frame, first)) = self.frames[lane] else {
                continue;
            };
            let sub_channels = frame.sub_channels();
            let turn = if let Some(place) = senses.frame_place(lane) {
                let offset = (place + frame.places() - first) % frame.places();
                let hop = hop(senses.slot(), sub_channels);
                (usize::from(offset) < sub_channels.count())
                    .then(|| carrier(offset.into(), hop, sub_channels) as u8)
            } else if let Some((sub_channel, words)) = &words {
                // Without a place it contends once it is older than a frame, once a frame in the mean (chosen).
                let frame = f32::from(frame.places()) / sub_channels.count() as f32;
                let contends = f32::from(ages[lane]) > frame && unit_interval(words[lane]) * frame < 1.0;
                contends.then_some(sub_channel[lane])
            } else {
                None
            };
            if let Some(sub_channel) = turn {
                decisions.sub_channel[lane] = sub_channel;
                decisions.power[lane] = self.max_power.to_bits();
            }
        }
    }
}
