//! Slotted ALOHA, and ALOHA from an age threshold on (Atabay et al. 2020; Yavascan and Uysal 2021): a random sub-channel
//! at full power.

use super::{Policy, below, dbm};
use crate::decisions::{Decisions, SILENT};
use crate::environment::Environment;
use crate::lanes::{LANES, LaneStream, unit_interval};
use crate::scenario::Scenario;
use firmware::units::Dbm;

/// ALOHA of both kinds: from an age on, everybody sends with one probability.
pub struct Aloha {
    max_power: Dbm,
    rule: Rule,
    /// By block of worlds.
    streams: Vec<LaneStream>,
}

/// Who sends.
enum Rule {
    /// Everybody, so often that this many send on each sub-channel.
    Load(f64),
    /// Whoever is older than this many times the vehicles on each sub-channel.
    Threshold { load: f64, probability: f64 },
}

impl Aloha {
    /// Sends with one probability in every slot.
    pub fn slotted(scenario: &Scenario, streams: Vec<LaneStream>) -> Self {
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
            rule: Rule::Load(scenario.baselines.aloha_load),
            streams,
        }
    }

    /// Sends with one probability once its age has reached the threshold.
    pub fn from_age(scenario: &Scenario, streams: Vec<LaneStream>) -> Self {
        let baselines = &scenario.baselines;
        Self {
            max_power: dbm(scenario.radio.max_power_dbm),
            rule: Rule::Threshold {
                load: baselines.age_threshold_load,
                probability: baselines.age_threshold_probability,
            },
            streams,
        }
    }
}

impl Policy for Aloha {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        let (present, sub_channels) = (environment.present(), environment.sub_channels());
        let vehicles = present.len().max(1) as f64;
        let (least_age, probability) = match self.rule {
            Rule::Load(load) => (0, load * sub_channels as f64 / vehicles),
            Rule::Threshold { load, probability } => {
                let threshold = (load * present.len() as f64 / sub_channels as f64).round();
                (threshold.min(255.0) as u8, probability)
            }
        };
        let probability = probability as f32;
        for (block, stream) in self.streams.iter_mut().enumerate() {
            environment.vectors().run(
                #[inline(always)]
                || {
                    for &vehicle in present {
                        let ages = environment.ages().row(block, vehicle);
                        let (sub_channel, power) = decisions.rows_mut(block, vehicle);
                        let drawn = below(stream.next_row(), sub_channels as u32);
                        let words = stream.next_row();
                        for lane in 0..LANES {
                            let sends =
                                (unit_interval(words[lane]) < probability) & (ages[lane] >= least_age);
                            sub_channel[lane] = if sends { drawn[lane] } else { SILENT };
                        }
                        *power = [self.max_power.to_bits(); LANES];
                    }
                },
            );
        }
    }
}
