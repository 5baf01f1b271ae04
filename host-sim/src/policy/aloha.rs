//! Slotted ALOHA: a random sub-channel at full power.

use super::{Decider, Kind, Needs, Policy, below};
use crate::decisions::{SILENT, VehicleDecisions};
use crate::lanes::{LANES, LaneStream, Row, unit_interval};
use crate::senses::{Broadcasts, Senses};
use firmware::units::Dbm;

/// Everybody sends with one probability in every slot.
pub static KIND: Kind = Kind {
    name: "aloha",
    meaning: "Slotted ALOHA: everybody sends by chance, as often as the sub-channels bear.",
    stream: 4,
    needs: Needs::Nothing,
    build: |setup, _| {
        Decider::Policy(Box::new(Aloha {
            max_power: setup.scenario.radio.max_power(),
            sub_channels: setup.scenario.radio.sub_channels,
            rule: Rule::Load(setup.scenario.baselines.aloha_load),
            streams: setup.row_streams(KIND.stream),
            least_age: [0; LANES],
            probability: [0.0; LANES],
        }))
    },
};

/// ALOHA of both kinds: from an age on, everybody sends with one probability.
pub(super) struct Aloha {
    pub(super) max_power: Dbm,
    pub(super) sub_channels: u32,
    pub(super) rule: Rule,
    /// By block of worlds.
    pub(super) streams: Vec<LaneStream>,
    /// In slots, of the block in work.
    pub(super) least_age: Row<u16>,
    /// Of sending from that age on, of the block in work.
    pub(super) probability: Row<f32>,
}

/// Who sends.
pub(super) enum Rule {
    /// Everybody, so often that this many send on each sub-channel.
    Load(f64),
    /// Whoever is older than this many times the vehicles on each sub-channel.
    Threshold { load: f64, probability: f64 },
}

impl Aloha {
    /// The least age at which a vehicle sends, and how probably it then does.
    fn rule(&self, vehicles: usize) -> (u16, f32) {
        let sub_channels = f64::from(self.sub_channels);
        match self.rule {
            Rule::Load(load) => (0, (load * sub_channels / vehicles.max(1) as f64) as f32),
            Rule::Threshold { load, probability } => {
                let threshold = (load * vehicles as f64 / sub_channels).round();
                (threshold.min(65_535.0) as u16, probability as f32)
            }
        }
    }
}

impl Policy for Aloha {
    fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        let mut last = None;
        for lane in 0..broadcasts.worlds() {
            let vehicles = broadcasts.vehicles(lane);
            if last != Some(vehicles) {
                // Worlds behind this one mostly have as many.
                let (least_age, probability) = self.rule(vehicles);
                self.least_age[lane..].fill(least_age);
                self.probability[lane..].fill(probability);
                last = Some(vehicles);
            }
        }
    }

    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let Self {
            sub_channels,
            least_age,
            probability,
            ..
        } = self;
        let stream = &mut self.streams[senses.block()];
        senses.vectors().run(
            #[inline(always)]
            || {
                let ages = senses.ages();
                let drawn = below(stream.next_row(), *sub_channels);
                let words = stream.next_row();
                for lane in 0..LANES {
                    let sends =
                        (unit_interval(words[lane]) < probability[lane]) & (ages[lane] >= least_age[lane]);
                    decisions.sub_channel[lane] = if sends { drawn[lane] } else { SILENT };
                }
                *decisions.power = [self.max_power.to_bits(); LANES];
            },
        );
    }
}
