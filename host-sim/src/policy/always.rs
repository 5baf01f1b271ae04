//! Everybody sends in every slot: what an own-age reward teaches.

use super::{Decider, Kind, Needs, Policy};
use crate::decisions::VehicleDecisions;
use crate::lanes::LANES;
use crate::senses::Senses;
use firmware::units::Dbm;

/// Full power on the best sub-channel.
pub static KIND: Kind = Kind {
    name: "always",
    meaning: "Full power on the best sub-channel in every slot.",
    stream: 6,
    needs: Needs::Nothing,
    build: |setup, _| {
        Decider::Policy(Box::new(Always {
            max_power: setup.scenario.radio.max_power(),
        }))
    },
};

struct Always {
    max_power: Dbm,
}

impl Policy for Always {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        senses.vectors().run(
            #[inline(always)]
            || {
                let mut most = senses.gain(0);
                let mut best = [0_i32; LANES];
                for sub_channel in 1..senses.sub_channels() {
                    let gain = senses.gain(sub_channel);
                    for lane in 0..LANES {
                        let better = gain[lane] > most[lane];
                        best[lane] = if better { sub_channel as i32 } else { best[lane] };
                        most[lane] = if better { gain[lane] } else { most[lane] };
                    }
                }
                *decisions.sub_channel = best.map(|best| best as u8);
                *decisions.power = [self.max_power.to_bits(); LANES];
            },
        );
    }
}
