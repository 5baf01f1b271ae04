//! ALOHA from an age threshold on (Atabay et al. 2020; Yavascan and Uysal 2021).

use super::aloha::{Aloha, Rule};
use super::{Decider, Kind, Needs};
use crate::lanes::LANES;

/// Everybody whose age has reached the threshold sends with one probability.
pub static KIND: Kind = Kind {
    name: "age-threshold",
    meaning: "Slotted ALOHA of those whose age has reached a threshold.",
    stream: 3,
    needs: Needs::Nothing,
    build: |setup, _| {
        let baselines = &setup.scenario.baselines;
        Decider::Policy(Box::new(Aloha {
            max_power: setup.scenario.radio.max_power(),
            sub_channels: setup.scenario.radio.sub_channels,
            rule: Rule::Threshold {
                load: baselines.age_threshold_load,
                probability: baselines.age_threshold_probability,
            },
            streams: setup.row_streams(KIND.stream),
            least_age: [0; LANES],
            probability: [0.0; LANES],
        }))
    },
};
