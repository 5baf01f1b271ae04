//! A random sub-channel and a random power.

use super::{Decider, Kind, Needs, Policy, below};
use crate::decisions::VehicleDecisions;
use crate::lanes::{LANES, LaneStream, decibels, unit_interval};
use crate::senses::Senses;

/// A uniformly drawn sub-channel and a uniformly drawn power between 0 W and full power.
pub static KIND: Kind = Kind {
    name: "random",
    meaning: "A random sub-channel and a random power in every slot.",
    stream: 5,
    needs: Needs::Nothing,
    build: |setup, _| {
        Decider::Policy(Box::new(Random {
            max_power_dbm: setup.scenario.radio.max_power_dbm as f32,
            streams: setup.row_streams(KIND.stream),
        }))
    },
};

struct Random {
    max_power_dbm: f32,
    /// By block of worlds.
    streams: Vec<LaneStream>,
}

impl Policy for Random {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let stream = &mut self.streams[senses.block()];
        senses.vectors().run(
            #[inline(always)]
            || {
                *decisions.sub_channel = below(stream.next_row(), senses.sub_channels() as u32);
                let words = stream.next_row();
                for lane in 0..LANES {
                    let power_dbm = self.max_power_dbm + decibels(unit_interval(words[lane]));
                    decisions.power[lane] = (power_dbm * 256.0).floor() as i16;
                }
            },
        );
    }
}
